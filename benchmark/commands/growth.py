"""Measures how time and memory grow."""

import argparse

from benchmark.reports.growth import report


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    report.measure(options.results / ("growth_smoke" if options.smoke else "growth"), smoke=options.smoke)
    return 0
