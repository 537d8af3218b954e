"""Measures speed; growth is measured alike."""

import argparse

from benchmark.page import build as page
from benchmark.reports import measured


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    measured.measure(options.command, options.results, smoke=options.smoke)
    if not options.smoke and page.published(options.results):
        print(f"the page is {page.write(options.results)}.")
    return 0
