"""The two tables of runs and curves, against the records that they are made of."""

from pathlib import Path

import numpy as np
import pytest

from benchmark.analysis.frames import Group, by_population, by_step, learned, tables
from benchmark.execution.driver import run
from benchmark.execution.executors.threads import Threads
from benchmark.execution.store import Store
from envs import InputError
from tests.benchmark.reports.conftest import experiment_of

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
    text = EXPERIMENT + "[sweep.seed]\nlow.settings.time_limit = 50\nhigh = {}\n"
    experiment = experiment_of(tmp_path / "mine.toml", text)
    groups = [Group(population, population.runs()) for population in experiment.populations]
    with Store(tmp_path / "runs.db") as store:
        assert run([run for group in groups for run in group.runs], store, 1, executor=Threads) == []
        runs, curves = tables(groups, store)
        assert len(runs) == 2 * 2 * (3 + 2)
        assert len(curves) == 5 * len(runs)
        # An axis with the name of another column has a prefix.
        assert {*runs["axis_seed"]} == {"low", "high"}
        for group, (keys, rows) in zip(groups, by_population(runs), strict=True):
            assert (keys["condition"], keys["learner"]) == (
                group.population.condition.name,
                group.population.learner.name,
            )
            records = store.get([run.digest for run in group.runs])
            prefix = "stochastic_" if keys["algorithm"] == "ppo" else ""
            for name in ("success", "every_cell_success"):
                expected = [record.arrays[prefix + name][-1] for record in records]
                assert rows[name].tolist() == expected
            assert rows["seed"].tolist() == [run.seed for run in group.runs]
            own = curves[(curves[[*keys]] == keys).all(axis=1)]
            expected = [record.arrays[f"{prefix}success"] for record in records]
            assert np.array_equal(by_step(own, "success"), expected)
            assert np.array_equal(
                by_step(own, "training_wrong_pings"), [record.arrays["disagreements"] for record in records]
            )
        some, nothing = tables(groups[:1], store, ["area"])
        assert (some["area"] == runs["area"][:3]).all()
        assert "success" not in some
        assert nothing.empty


def test_a_policy_that_is_not_learned_is_refused(tmp_path: Path) -> None:
    text = EXPERIMENT.partition("[algorithms.ppo]")[0] + 'policy = "stochastic"'
    experiment = experiment_of(tmp_path / "mine.toml", text)
    group = Group(experiment.populations[0], experiment.populations[0].runs())
    with Store(tmp_path / "runs.db") as store:
        run(group.runs, store, 1, executor=Threads)
        with pytest.raises(InputError, match=r"algorithms\.table\.policy = stochastic: .*; accepted: greedy"):
            tables([group], store)


def test_learned_by_hand() -> None:
    steps = [0, 10, 20, 30, 40]
    curves = np.array([[0, 1, 1, 1, 0], [1, 1, 1, 1, 1], [0, 0, 0, 0, 0.9], [0, 0, 0, 0, 0.8]])
    assert learned(curves, steps, 0.9).tolist() == [5, 0, 4, 5]
    assert learned(curves, steps, 0.9, until=2).tolist() == [1, 0, 4, 5]
    assert learned(curves, steps, 0.5, until=2).tolist() == [1, 0, 4, 4]
