"""Measures speed."""

import argparse

from benchmark.reports import measured


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    measured.measure("speed", options.results, smoke=options.smoke)
    if not options.smoke:
        from benchmark.page import build as page

        if page.published(options.results):
            print(f"the page is {page.write(options.results)}.")
    return 0
