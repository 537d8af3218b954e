"""Records: what they are read from, and what is computed of each."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmark.executors import Threads
from benchmark.experiment import load_experiment
from benchmark.job import failures
from benchmark.records import anchors, check_scores, load_records
from benchmark.run import execute
from benchmark.store import Store
from envs import InputError, load_scenario
from envs.model import PING
from tests.benchmark.populations import population
from tests.support import specifications

SMOKE = load_experiment("reproduce", smoke=True)


def test_records_are_read_in_order_unless_one_is_not_valid(tmp_path: Path) -> None:
    runs = specifications(SMOKE, "default", "S2", "q_learning", "index", range(3))
    with Store(tmp_path / "runs.db") as store:
        store.add(failures(runs[:1], ValueError("oh")))
        execute(runs[1:], store, 1, executor=Threads(1))
        loaded = load_records([runs[2], runs[1]], store)
        (record,) = store.get([runs[1].digest])
        with pytest.raises(InputError, match=r"S2/q_learning_index/seed_0: this run failed"):
            load_records(runs, store)
    assert loaded.seeds == [2, 1]
    for name, values in record.arrays.items():
        assert np.array_equal(loaded.arrays[name][1], values)


def test_scores_lie_between_the_exact_anchors() -> None:
    easy, optimal = anchors(population().model, population().run.horizon)
    assert easy == pytest.approx(4 * -0.4 - 1)  # giving up, by five wrong PINGs; random costs more
    assert optimal == pytest.approx(0.0, abs=1e-12)
    returns = np.array([[optimal, easy, (optimal + easy) / 2, easy - (optimal - easy)]])
    assert population(n=1, grid_return=returns).unbounded_scores()[0] == pytest.approx(
        [1, 0, 0.5, -1]
    )


def test_ping_is_valued_where_its_value_is_positive() -> None:
    q = np.full((1, 120, 5), 0.5)  # what the table began with is no value of PING
    q[:, 7:9, PING] = 0.4, -0.1
    made = population(n=1, q=q)
    settings = made.run.settings.model_copy(update={"initial_value": 0.5})
    made = replace(made, runs=[replace(made.run, settings=settings)])
    assert np.flatnonzero(made.values_ping[0]).tolist() == [7]


def test_scenarios_in_which_nobody_can_succeed_are_refused() -> None:
    """The target region of S1 is ten moves and a PING from the start."""
    run = population().run
    check_scores([replace(run, horizon=11)])
    with pytest.raises(InputError, match=r"S1: no policy succeeds within horizon = 10; accepted: "):
        check_scores([replace(run, horizon=10)])
    free = load_scenario("S1", {"rewards.other": 0, "rewards.wrong_ping": 0})
    with pytest.raises(InputError, match=r"S1: within 2 steps random moves or PINGs alone earn"):
        check_scores([replace(run, horizon=2, scenario=free)])
