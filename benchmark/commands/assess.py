"""Scores an agent exactly, and draws where it PINGs."""

import argparse

from benchmark.assessment import PICTURES, assess
from benchmark.drawing.style import check_file
from envs.packages import imported


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    if options.save is not None:
        check_file(options.save, *PICTURES)
    agent = options.model
    if options.agent is not None:
        agent = imported(options.agent, "--agent", "function")
    names = ("scenario", "observation", "algorithm", "stochastic")
    assessment = assess(agent, **{name: getattr(options, name) for name in names})
    print(assessment)
    if options.save is not None:
        assessment.draw(options.save)
        print(f"\nmap: {options.save}")
    return 0
