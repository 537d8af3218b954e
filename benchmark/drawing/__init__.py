"""Figures, maps, moving pictures and tables."""
