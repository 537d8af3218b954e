"""Repeats a run and writes its trained agent: as a model of Stable-Baselines3, or as tables."""

import argparse
import json
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from agents.nets.learner import NetAlgorithm
from agents.policy import mask_policy
from agents.sb3.algorithms import Sb3Algorithm
from benchmark.commands import find_run
from benchmark.commands.verify import difference_of
from benchmark.drawing.style import check_file
from benchmark.execution.executors.processes import Processes
from benchmark.execution.job import POLICY
from benchmark.execution.store import Store
from benchmark.experiments import RunSpecification, load_experiment
from envs import InputError
from envs.observations import compile_seen, observation_table


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    experiment, path = load_experiment(options.experiment), options.file
    run = find_run(experiment, options.learner, options.seed, options.scenario, options.condition)
    learner = experiment.learners[f"{run.variant}, {run.observation}"]
    is_net = isinstance(learner.algorithm, NetAlgorithm | Sb3Algorithm)
    check_file(path, *([".zip"] if is_net else []), ".npz")
    title = f"{run.scenario.name}: {learner.title}, seed {run.seed}"
    print(f"training {title} ...", file=sys.stderr)
    made = path.with_name(f".making_{path.name}")
    try:
        with Store(options.results / "runs.db") as store:
            _export(run, title, made, store)
        made.replace(path)
    finally:
        made.unlink(missing_ok=True)
    print(f"{title}: {path} has the trained agent; its run is stored in {options.results}")
    return 0


def _export(run: RunSpecification, title: str, path: Path, store: Store) -> None:
    """Repeats a run and writes its agent; the run is stored, or must be identical to the stored one."""
    scenario, form = run.drawn_scenario if run.solved else run.scenario, run.observation
    content = json.loads(run.content) | {"scenario": scenario.model_dump(mode="json"), "digest": run.digest}
    about = json.dumps(content)
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
        raise InputError(f"{title}: there is no agent to write: {record.error or 'it diverged'}.")
    greedy, q, stochastic = (record.arrays[name] for name in POLICY)
    if path.suffix.lower() == ".npz":
        observations = observation_table(compile_seen(scenario, form), form)
        policy, learned = mask_policy(greedy[-1]), stochastic[-1:].reshape(-1, 5)
        with path.open("wb") as file:
            np.savez(file, about=about, observations=observations, q=q, greedy=policy, stochastic=learned)
    if run.solved:  # of these, the store has only curves
        curves = {name: array for name, array in record.arrays.items() if name not in POLICY}
        record = replace(record, arrays=curves)
    if not store.ended([run.digest]):
        store.add([record])
    elif found := difference_of(store.get([run.digest])[0], record):
        raise InputError(f"{title}: not written, since the repeated run {found}.")
