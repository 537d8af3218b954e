"""Measures how time and memory grow."""

import argparse

from benchmark.reports import measured


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    measured.measure("growth", options.results, smoke=options.smoke)
    return 0
