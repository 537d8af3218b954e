"""The stages of a search: who is run again, and who is chosen."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from benchmark.analysis.search import Searched, area, searched
from benchmark.analysis.stages import known_runs, stages
from benchmark.execution import driver
from benchmark.execution.executors.threads import Threads
from benchmark.execution.store import Store
from benchmark.experiments import RunSpecification, load_experiment

SMALL = load_experiment("tuning_smoke")


class Lottery(Searched):
    """A learner whose areas are made up, by trial, scenario and whether the runs are fresh."""

    FIRST = (
        [0.1, 0.1],
        [0.9, 0.3],
        [0.5, 0.5],
        [0.2, 0.8],
    )  # trial 1 is lucky, trial 3 best in the second scene
    FRESH = ([0.1, 0.1], [0.3, 0.3], [0.4, 0.6], [0.2, 0.7])

    def areas(self, runs: Sequence[RunSpecification]) -> np.ndarray:
        """Returns the made-up areas."""
        i = SMALL.scenarios.index(runs[0].scenario.name)
        trial = int(runs[0].condition.partition("trial=")[2])
        is_fresh = runs[0].seed >= 10
        return np.full(len(runs), (self.FRESH if is_fresh else self.FIRST)[trial][i])


def test_the_winner_of_a_lottery_does_not_win(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.db") as store:
        lottery = Lottery(SMALL, "q_learning", "index", store)
        assert lottery.finalists == [1, 2]  # 0.6, 0.5; as trial 3, but declared before it
        assert lottery.best == [1, 3]
        assert lottery.chosen == 2
        first, second = SMALL.scenarios
        everywhere = {(t, name) for t in (0, 1, 2) for name in (first, second)}
        assert {*lottery.fresh_runs} == everywhere | {(3, second)}
        assert {run.seed for runs in lottery.fresh_runs.values() for run in runs} == {10, 11, 12}


def test_around_the_chosen_one_setting_changes_at_a_time(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.db") as store:
        lottery = Lottery(SMALL, "q_learning", "index", store)
        own = lottery.around["", ""][0].settings.model_dump()
        assert len(lottery.around) == 1 + 3 + 1  # three marks of a range, the other one of two choices
        for (key, _), runs in lottery.around.items():
            values = runs[0].settings.model_dump()
            assert {name for name in own if own[name] != values[name]} == ({key} if key else set())
            assert {run.seed for run in runs} == {13, 14}
            assert [run.scenario.name for run in runs] == [name for name in SMALL.scenarios for _ in range(2)]


def test_stages_follow_from_what_is_stored(tmp_path: Path) -> None:
    """A search can be interrupted anywhere, and lengthened without repeating what is done."""
    with Store(tmp_path / "runs.db") as store:
        seen: list[str] = []
        for n_stages, runs in enumerate(stages(SMALL, store), start=1):
            assert len([*stages(SMALL, store)]) == n_stages
            assert driver.run(runs[: len(runs) // 2], store, 1, executor=Threads) == []
            assert len([*stages(SMALL, store)]) == n_stages
            assert driver.run(runs, store, 1, executor=Threads) == []
            seen += [run.digest for run in runs]
        assert n_stages == 3
        assert len(seen) == len({*seen})
        assert [run.digest for run in known_runs(SMALL, store)] == seen
        assert SMALL.search is not None
        longer = SMALL.model_copy(update={"search": SMALL.search.model_copy(update={"trials": 5})})
        todo = driver.pending(next(stages(longer, store)), store)
        assert {run.condition for run in todo} == {"default/trial=4", "default/trial=5"}
        # By hand: the mean success of evaluations, of which the first and the last count half.
        each = searched(SMALL, store)[0]
        (run, *_) = each.runs(1, "FarCorner")
        success = store.get([run.digest])[0].arrays["success"]
        assert each.searched[1, 0, 0] == pytest.approx((success[:-1] + success[1:]).mean() / 2)
        assert each.result().steps == 400 * (4 * 2 * 2 + 3 * len(each.fresh_runs))


def test_area_of_a_staircase() -> None:
    assert area(np.array([[0, 0, 1], [1, 1, 1]]), [0, 30, 40]).tolist() == [0.125, 1.0]
