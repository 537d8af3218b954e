"""The command `export`: trains a run again and writes its agent, for NumPy or Stable-Baselines3.

Settings of nets can be written without a run, as hyperparameters of RL Baselines3 Zoo.
"""

import argparse
import json
import re
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from agents import load_algorithm
from agents.nets.learner import NetAlgorithm
from agents.policy import mask_policy
from agents.sb3.algorithms import Sb3Algorithm
from benchmark.executors import Processes
from benchmark.experiment import Experiment, load_experiment
from benchmark.job import POLICY
from benchmark.specification import RunSpecification
from benchmark.style import check_file
from envs import InputError, load_scenario
from envs.inputs import unknown_name, whole_number
from envs.observations import compile_seen, observation_table

_MAX_SEED = 999_999


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    experiment, path = load_experiment(options.experiment), options.file
    run, title = find_run(experiment, options.learner, options.seed, options.scenario)
    is_net = isinstance(load_algorithm(run.algorithm), NetAlgorithm | Sb3Algorithm)
    check_file(path, *([".zip", ".yml"] if is_net else []), ".npz")
    if path.suffix.lower() == ".yml":
        path.write_text(hyperparameters(run, title), encoding="utf-8")
        print(f"{title}: {path} has its settings, for rl_zoo3.")
        return 0
    print(f"training {title} ...", file=sys.stderr)
    made = path.with_name(f".making_{path.name}")
    try:
        _export(run, title, made)
        made.replace(path)
    finally:
        made.unlink(missing_ok=True)
    print(f"{title}: {path} has the trained agent.")
    return 0


def find_run(
    experiment: Experiment, learner: str, seed: str, scenario: str | None
) -> tuple[RunSpecification, str]:
    """Finds a run with any seed of a learner, or of a variant with its first form of observation.

    Returns it and its title. The condition is the learner's first, and so is the scenario by
    default.
    """
    number = whole_number(seed, "--seed", 0, _MAX_SEED)
    alike = [p for p in experiment.populations if learner in (p.learner.name, p.learner.variant)]
    if not alike:
        names = {f'"{population.learner.name}"' for population in experiment.populations}
        unknown_name(experiment.name, "learner", learner, names)
    found = alike[0]
    run = found.first.with_seed(number)
    if scenario is not None:
        stem = Path(scenario).stem
        known = experiment.scenarios.get(stem, scenario)
        run = replace(run, scenario=load_scenario(known, found.condition.scenario(stem)))
    return run, f"{run.scenario.name}: {found.learner.title}, seed {number}"


def hyperparameters(run: RunSpecification, title: str) -> str:
    """Returns a run's settings for `rl_zoo3.train --conf-file`, in YAML, for any environment."""
    settings: Any = run.settings
    given = {"n_timesteps": settings.budget, "policy": "MlpPolicy", "n_envs": settings.n_envs}
    given |= settings.arguments
    policy = given.get("policy_kwargs", {})
    if "features_extractor_class" in policy:
        raise InputError(f"{title}: accepted: a net without features_extractor_class.")
    given["policy_kwargs"] = f"dict({', '.join(f'{key}={policy[key]!r}' for key in policy)})"
    lines = [f"  {key}: {json.dumps(value)}" for key, value in given.items()]
    lines = [re.sub(r"^(  \w+: [0-9]+)e", r"\1.0e", line) for line in lines]  # as YAML has numbers
    return "\n".join([f"# {title}", "default:", *lines, ""])


def _export(run: RunSpecification, title: str, path: Path) -> None:
    """Trains a run and writes its agent."""
    form = run.observation
    scenario = run.scenario.drawn(run.seed) if run.solved else run.scenario
    content = json.loads(run.content) | {"scenario": scenario.model_dump(mode="json")}
    about = json.dumps(content | {"digest": run.digest})
    keep: Any = bool  # keeps nothing
    if path.suffix.lower() == ".zip":
        from agents.sb3.training import save

        keep = partial(save, path, about, scenario, run.settings, form)
    executor = Processes(1)
    try:
        (record,) = executor.submit([replace(run, keep=keep)]).result()
    finally:
        executor.cancel()
    if record.status != "done":
        reason = record.error or "it diverged"
        raise InputError(f"{title}: there is no agent to write: {reason}.")
    greedy, q, stochastic = (record.arrays[name] for name in POLICY)
    if path.suffix.lower() == ".npz":
        with path.open("wb") as file:
            np.savez(
                file,
                about=about,
                q=q,
                greedy=mask_policy(greedy[-1]),
                observations=observation_table(compile_seen(scenario, form), form),
                stochastic=stochastic[-1:].reshape(-1, 5),
            )
