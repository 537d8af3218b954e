"""Extends the project from outside: all code of an extension is in its test's own file."""
