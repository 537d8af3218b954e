"""Repeats a run and writes its trained agent: as a model of Stable-Baselines3, or as tables."""

import argparse
import json
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from zipfile import ZipFile

import numpy as np

from agents.nets.learner import NetAlgorithm
from agents.policy import mask_policy
from agents.sb3.algorithms import Sb3Algorithm
from benchmark.commands import MOST_SEEDS
from benchmark.commands.verify import difference
from benchmark.commands.watch import learner_of
from benchmark.drawing.style import check_file
from benchmark.execution.executors.processes import Processes
from benchmark.execution.job import POLICY
from benchmark.execution.store import Store
from benchmark.experiments import RunSpecification, load_experiment
from envs import ACTIONS
from envs.inputs import InputError, unknown_name, whole_number
from envs.observations import compile_seen, observation_table


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    experiment, path = load_experiment(options.experiment), options.file
    seed = whole_number(options.seed, "--seed", 0, MOST_SEEDS - 1)
    variant, _, observation = options.learner.partition(", ")
    learner = learner_of(experiment, variant, observation)
    is_net = isinstance(learner.algorithm, NetAlgorithm | Sb3Algorithm)
    check_file(path, *([".zip"] if is_net else []), ".npz")
    alike = [population for population in experiment.populations if population.learner.name == learner.name]
    condition = options.condition or alike[0].condition.name
    if condition not in (names := {population.condition.name for population in alike}):
        unknown_name(f"{experiment.name}: {learner.name}", "condition", condition, names)
    scenario = options.scenario or next(iter(experiment.scenarios))
    run = experiment.population(condition, scenario, learner.name).first.with_seed(seed)
    title = f"{run.scenario.name}: {learner.title}, seed {seed}"
    made = path.with_name(f".making_{path.name}")
    try:
        with Store(options.results / "runs.db") as store:
            store.discard_damaged([run.digest])
            about = _export(run, store, made, title)
        made.replace(path)
    finally:
        made.unlink(missing_ok=True)
    print(f"{title}, after training, {about}: {path}")
    return 0


def _export(run: RunSpecification, store: Store, path: Path, title: str) -> str:
    """Repeats a run and writes its agent; returns how the run compares with the store."""
    scenario = run.drawn_scenario if run.solved else run.scenario
    keep, is_model = partial[object](bool), path.suffix.lower() == ".zip"  # bool keeps nothing
    if is_model:
        from agents.sb3.training import save

        keep = partial(save, path, scenario, run.settings, run.observation)
    print(f"training {title} ...", file=sys.stderr)
    executor = Processes(1)
    try:
        (record,) = executor.submit([run], keep).result()
    finally:
        executor.cancel()
    if record.status != "done":
        raise InputError(f"{title}: there is no agent to write: {record.error or 'it diverged'}.")
    greedy, q, stochastic = (record.arrays[name] for name in POLICY)
    if run.solved:  # of these, the store has only curves
        curves = {name: array for name, array in record.arrays.items() if name not in POLICY}
        record = replace(record, arrays=curves)
    is_stored = bool(store.ended([run.digest]))
    if is_stored and (found := difference(*store.get([run.digest]), record)):
        raise InputError(f"{title}: not written, since the repeated run {found}.")
    store.add([record])
    about = {"digest": run.digest, "scenario": scenario.model_dump(mode="json"), **json.loads(run.content)}
    if is_model:
        with ZipFile(path, "a") as archive:
            archive.writestr("about.json", json.dumps(about))
    else:
        observations = observation_table(compile_seen(scenario, run.observation), run.observation)
        tables = {"greedy": mask_policy(greedy[-1]), "stochastic": stochastic[-1:].reshape(-1, len(ACTIONS))}
        np.savez(path, about=json.dumps(about), observations=observations, q=q, **tables)
    return "identical to the stored run" if is_stored else "now stored"
