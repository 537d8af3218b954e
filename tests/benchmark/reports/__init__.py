"""Tests of `benchmark.reports`."""
