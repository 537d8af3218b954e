"""The stages of a search: who is run again, and who is chosen."""

from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.analysis.frames import keys_of, tables
from benchmark.analysis.search import best_apart, chosen, finalists, outcomes, searched_measures
from benchmark.execution import driver
from benchmark.execution.executors import Threads
from benchmark.execution.store import Store
from benchmark.experiments import load_experiment
from benchmark.studies import runs_of
from tests.benchmark.studies.conftest import experiment_of

SMALL = load_experiment("tuning_smoke")
LONGER = """
extends = "tuning_smoke"
description = "The same runs, and more."
changes = { stream = "tuning_smoke", "search.trials" = 5 }
"""
EARLY = """
extends = "tuning_smoke"
description = "How early runs learn."
[changes]
solved = { success = 0.5, growth = 1.3 }
evaluation_every = 50
"search.around" = false
"settings.budget" = 800
"""
# Areas by trial and scenario: trial 1 is lucky, trial 3 the best in the second scenario.
FIRST = [[0.1, 0.1], [0.9, 0.3], [0.5, 0.5], [0.2, 0.8]]
FRESH = [[0.1, 0.1], [0.3, 0.3], [0.4, 0.6], [0.2, 0.7]]


@pytest.mark.parametrize(
    ("declared", "ranked"),  # 0.5 and 0.3 of finalists, against trial 0
    [([0.1, 0.1], [2, 1]), ([0.5, 0.5], [2, 1]), ([0.6, 0.5], [0, 2, 1])],
)
def test_the_winner_of_a_lottery_does_not_win(declared: list[float], ranked: list[int]) -> None:
    areas = np.array(FIRST)[:, :, None].repeat(2, axis=2)
    assert finalists(areas, 2) == [1, 2]  # 0.6, 0.5; as trial 3, but declared before it
    assert best_apart(areas) == [1, 3]
    rows, again = [], [declared, *FRESH[1:]]
    for (stage, means), population in product({"search": FIRST, "fresh": again}.items(), SMALL.populations):
        row = keys_of(population) | {"stage": stage}
        at = [*SMALL.scenarios].index(row["scenario"])
        rows.append(row | {"area": means[int(row["trial"])][at]})
    assert [outcome.ranked for outcome in outcomes(SMALL, pd.DataFrame(rows))] == [ranked] * 3


def test_runs_are_compared_by_how_early_they_learn(tmp_path: Path) -> None:
    """Each by the rule of `[solved]`, step by step; and nothing is run around what is chosen."""
    experiment = experiment_of(tmp_path / "early.toml", EARLY)
    with Store(tmp_path / "runs.db") as store:
        for groups in stages(experiment, store):
            assert driver.run(runs_of(groups), store, 1, executor=Threads(1)) == []
        all_stages = [*stages(experiment, store)]
        frame, _ = tables([group for groups in all_stages for group in groups], store)
        runs = [run for groups in all_stages for group in groups for run in group.runs]
        curves = [record.arrays["success"] for record in store.get([run.digest for run in runs])]
        found = chosen(experiment, store)
    assert len(all_stages) == 2
    assert "area" not in frame
    steps = runs[0].schedule.evaluation_steps
    assert steps[:3] == (0, 50, 100)
    assert steps[-1] == 800
    assert {curve.size for curve in curves} == {len(steps)}
    expected = []
    for curve in curves:
        # For each evaluation, until when success has to stay: twice as many steps, or the end.
        ends = [
            next((j for j in range(i + 1, len(steps)) if steps[j] >= 2 * steps[i]), -1)
            for i in range(len(steps))
        ]
        stays = [
            steps[i] for i, j in enumerate(ends) if min(curve[i : len(steps) if j < 0 else j + 1]) >= 0.5
        ]
        expected.append(1 - np.log(max(stays[0], 50) / 50) / np.log(800 / 50) if stays else 0.0)
    assert frame["earliness"].tolist() == pytest.approx(expected)
    assert 0 < np.mean(expected) < 1
    for outcome in outcomes(experiment, frame):
        best = found[outcome.learner.name]
        assert [best.trial, *(other.trial for other in best.others)] == outcome.ranked
        assert best.score >= best.others[0].score
        assert best.steps == 800 * best.runs == 800 * (4 * 2 * 2 + 2 * 2 * 3)


def test_stages_follow_from_what_is_stored(tmp_path: Path) -> None:
    """A search can be interrupted anywhere, and lengthened without repeating what is done."""
    with Store(tmp_path / "runs.db") as store:
        for n_stages, groups in enumerate(stages(SMALL, store), start=1):
            runs = runs_of(groups)
            for part in (runs[: len(runs) // 2], runs):
                assert len([*stages(SMALL, store)]) == n_stages
                assert driver.run(part, store, 1, executor=Threads(1)) == []
        first, fresh, around = stages(SMALL, store)
        every = runs_of([*first, *fresh, *around])
        assert len(every) == sum(len(group.runs) for group in (*first, *fresh, *around))
        todo = driver.pending(runs_of(next(stages(experiment_of(tmp_path / "l.toml", LONGER), store))), store)
        assert {run.condition for run in todo} == {"default/trial=4", "default/trial=5"}
        frame, _ = tables([*first, *fresh, *around], store)
        success = store.get([first[0].runs[0].digest])[0].arrays["success"]
        effort = {name: found.steps for name, found in chosen(SMALL, store).items()}
    # By hand: the mean success of evaluations, of which the first and the last count half.
    assert frame["area"].iloc[0] == pytest.approx((success[:-1] + success[1:]).mean() / 2)
    for outcome in outcomes(SMALL, frame):
        areas, name = searched_measures(frame, SMALL, outcome.learner), outcome.learner.name
        everywhere = {(trial, scene) for trial in (*finalists(areas, 2), 0) for scene in SMALL.scenarios}
        assert {*outcome.fresh} == everywhere | {*zip(best_apart(areas), SMALL.scenarios, strict=True)}
        assert {len(fresh) for fresh in outcome.fresh.values()} == {3}
        assert effort[name] == 400 * (4 * 2 * 2 + 2 * 2 * 3)  # all trials, and two finalists with 3 seeds
    assert {run.seed for run in runs_of(fresh)} == {10, 11, 12}

    # Around the chosen settings, one of them changes at a time.
    unchanged: dict[tuple[str, str], dict[str, object]] = {}
    for group in around:
        key = group.population.learner.name, group.population.scenario.name
        settings = group.runs[0].settings.model_dump()
        own = unchanged.setdefault(key, settings)  # the first of each has the chosen settings
        assert {run.seed for run in group.runs} == {13, 14}
        changed = {name for name in own if own[name] != settings[name]}
        assert changed == {group.more["setting"].split(".")[0]} - {""}
