"""Measures speed."""

import argparse

from benchmark import speed
from benchmark.publish.page import build as page


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    speed.measure(options.results, smoke=options.smoke)
    if not options.smoke:
        print(f"the page is {page.write(options.results)}.")
    return 0
