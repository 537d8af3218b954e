"""Scores an agent exactly, ranks it among the published learners, and draws where it PINGs."""

import argparse
from hashlib import sha256

from benchmark import leaderboard
from benchmark.assessment import PICTURES, RESULTS, assess, saved_model
from benchmark.drawing.style import check_file
from envs.inputs import InputError
from envs.packages import imported


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    if options.save is not None:
        check_file(options.save, *PICTURES)
    keys = ("learner", "training_steps", "search_trials", "note")
    declared = {key: given for key in keys if (given := getattr(options, key)) is not None}
    if declared and options.submit is None:
        raise InputError("--learner, --training-steps, --search-trials, --note: accepted only with --submit.")
    agent = options.model
    if options.agent is not None:
        agent = imported(options.agent, "--agent", "function")
    names = ("scenario", "observation", "algorithm", "normalization", "stochastic")
    given = {name: getattr(options, name) for name in names}
    assessment = assess(agent, **given, results=options.results or RESULTS)
    if options.submit is not None:
        if options.model is not None:
            files = [saved_model(options.model), *filter(None, [options.normalization])]
            digests = [f"{file.name}, SHA-256 {sha256(file.read_bytes()).hexdigest()}" for file in files]
            declared["model"] = f"{options.algorithm}, {'; normalised by '.join(digests)}"
        leaderboard.submit(assessment, options.submit, **declared)
    print(assessment)
    if options.submit is not None:
        print(f"\nsubmission: {options.submit} ('report' lists it if it is in results/leaderboard)")
    if options.save is not None:
        assessment.draw(options.save)
        print(f"\nmap: {options.save}")
    return 0
