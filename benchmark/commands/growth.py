"""Measures how time and memory grow."""

from benchmark.commands.speed import main

__all__ = ["main"]
