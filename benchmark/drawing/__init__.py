"""Figures, maps, films, text and table files; nothing is computed here."""
