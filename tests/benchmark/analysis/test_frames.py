"""The two tables of runs and curves, against the records that they are made of."""

from pathlib import Path

import numpy as np
import pytest

from benchmark.analysis.frames import Group, by_population, by_step, tables
from benchmark.analysis.records import anchors
from benchmark.execution.driver import run
from benchmark.execution.executors import Threads
from benchmark.execution.store import Store
from envs import InputError
from envs.observations import compile_seen
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
    experiment = experiment_of(
        tmp_path / "mine.toml",
        EXPERIMENT + "[grids.all.axes.length]\nlow.settings.time_limit = 50\nhigh = {}\n",
    )
    groups = [Group(population, population.runs()) for population in experiment.populations]
    with Store(tmp_path / "runs.db") as store:
        assert run([run for group in groups for run in group.runs], store, 1, executor=Threads(1)) == []
        runs, curves = tables(groups, store)
        assert len(runs) == 2 * 2 * (3 + 2)
        for column in {*runs, *curves} - {"length"}:
            with pytest.raises(InputError, match=f"axes.{column}, a column of the tables of runs"):
                experiment_of(tmp_path / "other.toml", f"{EXPERIMENT}[grids.all.axes.{column}]\nlow = {{}}\n")
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
            low, high = anchors(model, 100, "start")
            returns = np.array([arrays[prefix + "grid_return"] for arrays in records])
            scores = np.round((returns - low) / (high - low), 9)
            assert scores.min() < 0
            assert np.array_equal(by_step(own, "unbounded_score"), scores)
            assert np.array_equal(by_step(own, "score"), np.clip(scores, 0, 1))
        some, nothing = tables(groups[:1], store, ["area"])
        assert (some["area"] == runs["area"][:3]).all()
        assert nothing.empty


def test_a_policy_that_is_not_learned_is_refused(tmp_path: Path) -> None:
    text = EXPERIMENT.partition("[algorithms.ppo]")[0] + 'policy = "stochastic"'
    experiment = experiment_of(tmp_path / "mine.toml", text)
    group = Group(experiment.populations[0], experiment.populations[0].runs())
    with Store(tmp_path / "runs.db") as store:
        run(group.runs, store, 1, executor=Threads(1))
        with pytest.raises(InputError, match=r"algorithms\.table\.policy = stochastic: .*; accepted: greedy"):
            tables([group], store)
