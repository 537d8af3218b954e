"""Experiments: a TOML file each, and beside it the function that says what was found."""
