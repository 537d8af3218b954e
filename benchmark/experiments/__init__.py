"""Experiments: a TOML file each, and beside it a function that says what was found."""
