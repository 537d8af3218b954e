"""The two tables of runs and curves, against the records that they are made of."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from agents.dynamic_programming import evaluate
from agents.policy import mask_policy
from benchmark.analysis.frames import Group, by_population, by_step, tables
from benchmark.analysis.records import Records, anchors
from benchmark.execution.driver import run
from benchmark.execution.executors import Threads
from benchmark.execution.store import Record, Store
from benchmark.experiments import load_experiment
from envs import ZONES, InputError
from envs.observations import compile_seen
from tests.benchmark.populations import population
from tests.benchmark.studies.conftest import experiment_of

EXPERIMENT = """
description = ""
scenarios = ["S1", "S3"]
horizon = 100
evaluation_every = 100
map_every = 200
evaluated_from = ["start", "every_cell"]
settings = { budget = 400, time_limit = 100 }
[algorithms.table]
algorithm = "q_learning"
observations = ["index"]
seeds = 3
[algorithms.ppo]
algorithm = "compiled_ppo"
observations = ["one_hot"]
seeds = 2
policy = "stochastic"
settings = { n_steps = 100, batch_size = 50, n_epochs = 1 }
"""


def test_tables_have_what_records_hold(tmp_path: Path) -> None:
    experiment = experiment_of(tmp_path / "mine.toml", EXPERIMENT)
    groups = [Group(population, population.runs()) for population in experiment.populations]
    with Store(tmp_path / "runs.db") as store:
        assert run([run for group in groups for run in group.runs], store, 1, executor=Threads(1)) == []
        runs, curves = tables(groups, store)
        assert len(runs) == 2 * (3 + 2)
        assert len(curves) == 5 * len(runs)
        for group, (keys, rows) in zip(groups, by_population(runs), strict=True):
            assert keys["learner"] == group.population.learner.name
            assert rows["seed"].tolist() == [run.seed for run in group.runs]
            prefix = "stochastic_" if keys["variant"] == "ppo" else ""
            records = [record.arrays for record in store.get([run.digest for run in group.runs])]
            for name in ("success", "every_cell_success"):
                assert rows[name].tolist() == [arrays[prefix + name][-1] for arrays in records]
            own = curves[(curves[[*keys]] == keys).all(axis=1)]
            for name, array in (("success", f"{prefix}success"), ("training_wrong_pings", "disagreements")):
                assert np.array_equal(by_step(own, name), [arrays[array] for arrays in records])
            model = compile_seen(group.population.scenario, keys["observation"])
            # A second method: recorded policies, evaluated again.
            policies = [
                arrays["stochastic"][-1] if prefix else mask_policy(arrays["greedy"][-1])
                for arrays in records
            ]
            for name, start in (("success", "start"), ("every_cell_success", "every_cell")):
                again = evaluate(model, np.stack(policies), 100, start).success
                assert rows[name].tolist() == pytest.approx(again.tolist())
            low, high = anchors(model, 100, "start")
            returns = np.array([arrays[prefix + "grid_return"] for arrays in records])
            scores = np.round((returns - low) / (high - low), 9)
            assert scores.min() < 0
            assert np.array_equal(by_step(own, "unbounded_score"), scores)
            assert np.array_equal(by_step(own, "score"), np.clip(scores, 0, 1))
        some, nothing = tables(groups[:1], store, ["area"])
        assert (some["area"] == runs["area"][:3]).all()
        assert nothing.empty


def tabulated(made: Records, path: Path, *columns: str) -> pd.DataFrame:
    """Returns the table `runs` of records made by hand, which are stored first."""
    agents = zip(made.runs, made.agents, strict=True)
    with Store(path / "runs.db") as store:
        store.add([Record(run.digest, run.content, "done", {}, arrays) for run, arrays in agents])
        group = Group(load_experiment("reproduce", smoke=True).populations[0], made.runs)
        runs, _ = tables([group], store, columns)
    return runs[[*columns]]


def test_uncomfortable_steps_are_those_after_training_by_hand(tmp_path: Path) -> None:
    steps = {"outside": 30.0, "target": 1.0, "uncomfortable": 4.0, "issuer": 0.5}
    zone_steps = np.zeros((2, 4, 4))  # (N, T, zones)
    zone_steps[:, -1] = [steps[zone] for zone in ZONES]
    found = tabulated(population(n=2, zone_steps=zone_steps), tmp_path, "uncomfortable_steps")
    assert found["uncomfortable_steps"].tolist() == [4, 4]


def test_success_in_unseen_places_by_hand(tmp_path: Path) -> None:
    """When learned and at the budget, by the greedy policy, which counts, and the other one."""
    made = population(n=1, unseen_success=np.array([[[0.1, 0.2], [0.3, 0.4]]]))
    solved = {"success": 0.9, "growth": 1.2}
    made = replace(made, runs=[replace(run, solved=solved) for run in made.runs])
    expected = {
        **{"unseen_success": 0.1, "unseen_greedy": 0.1, "unseen_stochastic": 0.2},
        **{"unseen_budget": 0.3, "unseen_budget_greedy": 0.3, "unseen_budget_stochastic": 0.4},
    }
    assert tabulated(made, tmp_path, *expected).to_dict("records") == [expected]


def test_a_policy_that_is_not_learned_is_refused(tmp_path: Path) -> None:
    text = EXPERIMENT.partition("[algorithms.ppo]")[0] + 'policy = "stochastic"'
    experiment = experiment_of(tmp_path / "mine.toml", text)
    group = Group(experiment.populations[0], experiment.populations[0].runs())
    with Store(tmp_path / "runs.db") as store:
        run(group.runs, store, 1, executor=Threads(1))
        with pytest.raises(InputError, match=r"algorithms\.table\.policy = stochastic: .*; accepted: greedy"):
            tables([group], store)
