"""The command `bench`: runs an algorithm of one's own in the scenes of the suite.

It writes an experiment that extends `suite`, trains its runs, and reports them beside the published
learners.
"""

import argparse
import re
import tomllib
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmark.executors import usable_cores
from benchmark.experiment import Experiment, load_experiment
from benchmark.folder import Folder, write_text
from benchmark.run import main as run
from benchmark.study import Data
from benchmark.suite import PUBLISHED_SUITE, SUITE, published, rows_to_paste
from benchmark.tables import read
from envs import InputError
from envs.inputs import shortened
from envs.sources import search_beside

SEEDS = 5
FIRST_SEED = 1000  # as of the published learners, so that the same cells are drawn
_STEPS_PER_SECOND = 1000  # of DQN of Stable-Baselines3, on one core
_SHARED = ("budget", "time_limit")  # settings that the suite fixes


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    path = _experiment_file(options)
    experiment = load_experiment(path, smoke=options.smoke)
    if (experiment.declared.report or {}).get("kind") != SUITE:
        raise InputError(f'{path}: accepted: an experiment with extends = "{SUITE}".')
    print(_about(experiment))
    if published() is None:
        print(f"The published learners are not shown, since {PUBLISHED_SUITE} does not exist.")
    others = {"experiment": str(path), "report": True, "seeds": None, "cluster": None}
    if code := run(Namespace(**vars(options) | others)):
        return code
    folder = options.results / experiment.name
    data = Data(experiment, None, *read(folder), tables=Folder(folder).tables())
    print(f"\n{rows_to_paste(data)}\n\npicture: {folder / f'{SUITE}.svg'}")
    return 0


def _experiment_file(options: argparse.Namespace) -> Path:
    """Returns the file of an experiment: the given one, or one that is written for an algorithm."""
    algorithm, settings = options.algorithm, options.settings or []
    if algorithm.endswith(".toml"):
        if settings or options.observation or options.stochastic:
            given = "--settings, --observation and --stochastic"
            raise InputError(f"{algorithm}: {given}: not accepted with a file, which has them.")
        return Path(algorithm)
    module, _, attribute = algorithm.rpartition(":")
    if module.endswith(".py"):
        if not Path(module).is_file():
            raise InputError(f"{algorithm}: there is no file {module}.")
        search_beside(Path(module))
        algorithm = f"{Path(module).stem}:{attribute}"
    name = attribute.rpartition(".")[2]
    if not re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII):
        accepted = "MODULE:CLASS, as in sb3_contrib:TRPO, FILE.py:CLASS, or FILE.toml"
        raise InputError(f"{shortened(algorithm)}: accepted: {accepted}.")
    path: Path = options.results / f"bench_{name}" / f"bench_{name}.toml"
    write_text(path, _declaration(name, algorithm, options, _settings(settings)))
    return path


def _settings(given: Sequence[str]) -> str:
    """Returns settings as lines of TOML; refuses those that are not."""
    for text in given:
        key, _, value = text.partition("=")
        try:
            keys = {*tomllib.loads(f"{key} = {value}")}
        except tomllib.TOMLDecodeError:
            keys = set()
        if len(keys) != 1 or "\n" in text:
            accepted = (
                "KEY=VALUE, as in TOML: learning_rate=1e-3, or policy_kwargs.net_arch=[64,64]"
            )
            raise InputError(f"--settings {shortened(text)}: accepted: {accepted}.")
        if keys & {*_SHARED}:
            accepted = f"other settings than {' and '.join(_SHARED)}, which the suite fixes"
            raise InputError(f"--settings {shortened(text)}: accepted: {accepted}.")
    return "".join(f"{text}\n" for text in given)


def _declaration(name: str, algorithm: str, options: Any, settings: str) -> str:
    return f"""\
extends = "{SUITE}"
description = "{name} in the scenes of the suite."

[changes.algorithms.{name}]
algorithm = "{algorithm}"
observations = ["{options.observation or "centred"}"]
seeds = {SEEDS}
first_seed = {FIRST_SEED}
policy = "{"stochastic" if options.stochastic else "greedy"}"

[changes.algorithms.{name}.settings]
{settings}"""


def _about(experiment: Experiment) -> str:
    """Says how long the runs take at most."""
    runs = [run for population in experiment.populations for run in population.runs()]
    steps = sum(run.settings.budget for run in runs)
    minutes = steps / _STEPS_PER_SECOND / usable_cores() / 60
    return f"""\
{experiment.name}: {len(runs)} runs, which end once they have learned, or after
{steps // len(runs):,} steps. At {_STEPS_PER_SECOND:,} steps per second and core, they take at most
{minutes:.0f} minutes."""
