"""Tests; truth comes from the paper, hand arithmetic or a second method."""
