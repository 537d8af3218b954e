"""The search by itself: its stages, what it chooses, what is picked of b trials, and what is published."""

import json
from itertools import permutations, product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from benchmark.__main__ import main
from benchmark.analysis.frames import keys_of
from benchmark.analysis.intervals import mean_over_scenarios
from benchmark.drawing.tables import write_csv
from benchmark.execution import driver
from benchmark.execution.executors import Threads
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, load_experiment
from benchmark.experiments.search import read_chosen, trials
from benchmark.folder import Folder, write_manifest
from benchmark.studies import report_of, runs_of
from benchmark.studies.search import headline, tables
from benchmark.studies.search.analysis import (
    SearchAnalysis,
    best_by_scenario,
    expected_drawn,
    expected_total,
    finalists,
    gain,
    outcomes,
)
from tests.benchmark.studies.conftest import experiment_of
from tests.support import ROOT, mistyped_columns

SEARCH = Path(__file__).with_name("small_search.toml")
PUBLISHED = ROOT / "results" / "tuning"
TUNING, SMALL = load_experiment("tuning"), load_experiment(SEARCH)
SAME = f'extends = "{SEARCH}"\ndescription = "-"\nchanges = {{ stream = "small_search" }}\n'
LONGER = f"""
extends = "{SEARCH}"
description = "The same runs, and more."
changes = {{ stream = "small_search", "search.trials" = 5 }}
"""
EARLY = f"""
extends = "{SEARCH}"
description = "How early runs learn."
[changes]
scenarios = ["FarCorner"]
solved = {{ success = 0.5, growth = 1.3 }}
evaluation_every = 50
"search.trials" = 2
"settings.budget" = 800
"""
# Areas by trial and scenario: trial 1 is lucky, trial 3 the best in the second scenario.
FIRST = [[0.1, 0.1], [0.9, 0.3], [0.5, 0.5], [0.2, 0.8]]
FRESH = [[0.1, 0.1], [0.3, 0.3], [0.4, 0.6], [0.2, 0.7]]


def extended(path: Path, changes: dict[str, int]) -> Experiment:
    """The miniature with changes."""
    text = ", ".join(f'"{key}" = {value}' for key, value in changes.items())
    text = f'extends = "{SEARCH}"\ndescription = "-"\nchanges = {{ {text} }}\n'
    return experiment_of(path, text)


def searched(experiment: Experiment, store: Store) -> SearchAnalysis:
    """Executes both stages, and returns what they have found."""
    report = report_of(experiment)
    for n_stages, groups in enumerate(report.stages(store), start=1):
        runs = runs_of(groups)
        for part in (runs[: len(runs) // 2], runs):  # a search can be interrupted anywhere
            assert len([*report.stages(store)]) == n_stages
            assert driver.run(part, store, 1, executor=Threads(1)) == []
    found = report.study.analyse(report.data(store))
    assert isinstance(found, SearchAnalysis)
    return found


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for the miniature's runs."""
    return tmp_path_factory.mktemp("results")


@pytest.fixture(scope="module")
def small(results: Path) -> SearchAnalysis:
    """What the miniature has found."""
    with Store(results / "runs.db") as store:
        return searched(experiment_of(results / "same.toml", SAME), store)


# By hand


@pytest.mark.parametrize(
    ("declared", "finalists_of_parts", "picks"),  # fresh: 0.3, 0.5 and 0.45, against trial 0
    [
        ([0.1, 0.1], [[1, 2]], [2]),
        ([0.5, 0.5], [[1, 2]], [2]),
        ([0.6, 0.5], [[1, 2]], [0]),
        ([0.1, 0.1], [[1], [2]], [1, 2]),
        ([0.6, 0.5], [[1], [2]], [0, 2]),  # in the first part alone, trial 0 is a candidate
    ],
)
def test_the_winner_of_a_lottery_does_not_win(
    declared: list[float], finalists_of_parts: list[list[int]], picks: list[int], tmp_path: Path
) -> None:
    areas, n_parts = np.array(FIRST)[:, :, None].repeat(2, axis=2), len(finalists_of_parts)
    changes = {"search.parts": n_parts, "search.finalists": len(finalists_of_parts[0])}
    experiment = extended(tmp_path / "mine.toml", changes)
    search = experiment.declared.search
    assert search is not None
    # 0.6, and 0.5 like that of trial 3, which is declared after it
    assert finalists(areas, search) == finalists_of_parts
    assert best_by_scenario(areas) == [1, 3]
    rows, again = [], [declared, *FRESH[1:]]
    seeds = (search.fresh.start - 1, FIRST), (search.fresh.start, again)
    for (seed, means), each in product(seeds, experiment.populations):
        row: dict[str, Any] = keys_of(each) | {"seed": seed}
        at = [*SMALL.scenarios].index(row["scenario"])
        rows.append(row | {"area": means[int(row["trial"])][at]})
    assert [outcome.picks for outcome in outcomes(experiment, pd.DataFrame(rows))] == [picks] * 3


def test_expected_totals_are_means_over_all_orders() -> None:
    """Every order of the other runs in turn, until one has learned; each failure costs the budget, 1,000."""
    for others in ([300.0, 500.0, np.inf, np.inf, np.inf], [np.inf, 40.0], [7.0]):
        sums = []
        for order in permutations(others):
            n_failed = [*map(np.isfinite, order)].index(True)
            sums.append(1000 * n_failed + order[n_failed])
        mean = float(np.mean(sums))
        assert expected_total(np.array([np.inf]), np.array(others), 1000) == pytest.approx(1000 + mean)
        assert expected_total(np.array([np.inf, 80]), np.array(others), 1000) == pytest.approx(540 + mean / 2)
        assert expected_drawn(np.array(others), 1000) == pytest.approx(mean)
    assert expected_total(np.array([80.0]), np.array([np.inf]), 1000) == 80
    assert expected_total(np.array([np.inf]), np.array([np.inf]), 1000) == np.inf


def test_effort_by_hand() -> None:
    """From 100 to 10,000 steps, an earliness of 0.5 is 1,000 steps, of 1 is 100, and 0 is never."""
    run = SimpleNamespace(evaluation_every=100, settings=SimpleNamespace(budget=10_000))
    experiment = SimpleNamespace(populations=[SimpleNamespace(first=run)], scenarios={"A": None, "B": None})
    learner = SimpleNamespace(variant="x", observation="index")
    # By trial and scenario
    searched = np.array([[[0.0], [0.5]], [[0.5], [0.0]], [[0.0], [0.0]], [[1.0], [0.0]]])
    outcomes = [SimpleNamespace(learner=learner, searched=searched)]
    analysis: Any = SimpleNamespace(measure="earliness", outcomes=outcomes)
    analysis.data = SimpleNamespace(experiment=experiment)
    table = tables.effort.tabulate(analysis)
    assert table is not None
    # In A, of three others two learn, after 550 steps on average: a third of a failure precedes the first.
    of_a = 10_000 + 10_000 / 3 + 550
    expected = [
        ("all", np.inf, 2, 6, (of_a + 1000) / 2, np.inf),
        ("A", np.inf, 2, 3, of_a, of_a - 10_000),
        ("B", 1000, 0, 3, 1000, np.inf),
    ]
    rows = table[["scenario", "default", "learned", "trials", "total", "drawn"]].itertuples(
        index=False, name=None
    )
    for row, (scenario, *numbers) in zip(rows, expected, strict=True):
        assert row[0] == scenario
        assert [*row[1:]] == pytest.approx(numbers)
    analysis.measure = "area"
    assert tables.effort.tabulate(analysis) is None


def test_means_are_over_scenarios() -> None:
    x, y = [np.ones(10), np.zeros(20)], [np.zeros(10), np.zeros(20)]
    mean = mean_over_scenarios(x)
    assert mean.value == gain(x, y).value == 0.5
    assert mean.low < 0.5 < mean.high
    assert gain(x, y).low > 0
    assert gain(x, x) == (0, 0, 0)  # the same runs
    assert gain(y, [np.zeros(10), np.zeros(20)]).low < 0  # others that fail, too


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([(1, 0.2, 0.5, 0.1), (0, 0.1, 0.1, 0.0)], "goes from 0.2 to 0.5 for the best learner, a, index."),
        ([(0, 0.5, 0.5, 0.0), (1, 0.2, 0.3, 0.1)], "for the best learner, a, index, but no gain is shown."),
    ],
)
def test_headlines_claim_no_gain_that_is_not_shown(rows: Any, expected: str, tmp_path: Path) -> None:
    rows = [(*row, name, "index") for row, name in zip(rows, "ab", strict=False)]
    columns = ["trial", "default", "chosen", "gain_low", "variant", "observation"]
    write_csv(pd.DataFrame(rows, columns=columns), tmp_path / "chosen.csv")
    manifest = {"report": {"kind": "search"}, "scenarios": {}, "search": {"trials": 2}, "solved": None}
    write_manifest(tmp_path, manifest)
    assert expected in (headline(Folder(tmp_path)) or "")


# From runs


def test_stages_follow_from_what_is_stored(small: SearchAnalysis, results: Path, tmp_path: Path) -> None:
    """A search can be lengthened without repeating what is done."""
    longer = report_of(experiment_of(tmp_path / "longer.toml", LONGER))
    with Store(results / "runs.db", read_only=True) as store:
        first, fresh = report_of(SMALL).stages(store)
        todo = driver.pending(runs_of(next(longer.stages(store))), store)
        success = store.get([first[0].runs[0].digest])[0].arrays["success"]
    assert {run.condition for run in todo} == {"trial=4", "trial=5"}
    assert {run.seed for run in runs_of(fresh)} == {10, 11, 12}
    assert len(small.data.specifications) == sum(len(group.runs) for group in (*first, *fresh))
    # By hand: the mean success of evaluations, of which the first and the last count half.
    assert small.data.runs["area"].iloc[0] == pytest.approx((success[:-1] + success[1:]).mean() / 2)
    for outcome in small.outcomes:
        (best,) = outcome.finalists
        again = {*product((*best, 0), SMALL.scenarios)}
        again |= {*zip(best_by_scenario(outcome.searched), SMALL.scenarios, strict=True)}
        assert {*outcome.fresh} == again
        assert {len(fresh) for fresh in outcome.fresh.values()} == {3}
        # All trials, and two finalists with 3 seeds.
        assert small.chosen[outcome.learner.name].steps == 400 * (4 * 2 * 2 + 2 * 2 * 3)


def test_everything_of_a_search_is_published(
    small: SearchAnalysis, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command, folder = ["report", str(results / "same.toml"), "--results", str(results)], results / "same"
    assert main(command) == 0
    assert "the chosen settings are in" in capsys.readouterr().out
    assert read_chosen(small.data.experiment.path, "here").learners == small.chosen
    tables = {path.stem: pd.read_csv(path) for path in folder.glob("*.csv")}
    assert {name: len(table) for name, table in tables.items()} == {
        "chosen": 3, "cost": 3, "trials": 12,
    }  # fmt: skip
    assert sorted(path.stem for path in folder.glob("*.svg")) == ["trials"]
    assert [path.name for path in folder.glob("*.csv") if mistyped_columns(path)] == []
    chosen, rows = tables["chosen"].iloc[0], tables["trials"]
    row = rows[(rows["observation"] == "index") & (rows["trial"] == chosen["trial"])].iloc[0]
    assert row["fresh_area"] == pytest.approx(chosen["chosen"], abs=1e-5)
    assert row["settings"] == chosen["settings"]
    # The same runs choose the same settings.
    before = (file := results / "same.chosen.json").read_bytes()
    file.unlink()
    assert main(command) == 0
    assert file.read_bytes() == before


def test_runs_are_compared_by_how_early_they_learn(tmp_path: Path) -> None:
    """Each by the rule of `[solved]`, step by step."""
    experiment = experiment_of(tmp_path / "early.toml", EARLY)
    with Store(tmp_path / "runs.db") as store:
        found = searched(experiment, store)
        runs, frame = [run for group in found.data.groups for run in group.runs], found.data.runs
        curves = [record.arrays["success"] for record in store.get([run.digest for run in runs])]
    steps = runs[0].schedule.evaluation_steps
    assert (*steps[:3], steps[-1]) == (0, 50, 100, 800)
    assert {curve.size for curve in curves} == {len(steps)}
    expected = []
    for curve in curves:
        # For each evaluation, until when success has to stay: twice as many steps, or the end.
        ends = [
            next((j for j in range(i + 1, len(steps)) if steps[j] >= 2 * steps[i]), len(steps))
            for i in range(len(steps))
        ]
        stays = [steps[i] for i, j in enumerate(ends) if min(curve[i : j + 1]) >= 0.5]
        expected.append(1 - np.log(max(stays[0], 50) / 50) / np.log(800 / 50) if stays else 0.0)
    assert frame["earliness"].tolist() == pytest.approx(expected)
    assert 0 < np.mean(expected) < 1
    for outcome in found.outcomes:
        best = found.chosen[outcome.learner.name]
        assert ([best.trial], best.picks) == (outcome.picks, ())
        assert best.steps == 800 * best.runs == 800 * (3 * 2 + 2 * 3)
    assert main(["report", str(experiment.path), "--results", str(tmp_path)]) == 0
    trials, chosen = (pd.read_csv(tmp_path / "early" / f"{name}.csv") for name in ("trials", "chosen"))
    assert {"earliness", "fresh_earliness"} < {*trials}
    assert trials["fresh_earliness"].max() == pytest.approx(chosen["chosen"].max(), abs=1e-5)
    text = (tmp_path / "early" / "README.md").read_text(encoding="utf-8")
    rule = "at or above 0.5 at every evaluation from step *s* to the first one at or after step 2*s*"
    assert rule in " ".join(text.split())
    assert "area" not in {*frame, *trials, *text.split()}


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("command", [["report", "--seeds=0-3"], ["run", "--seeds=0-3"]])
def test_a_search_has_its_own_seeds_and_no_part(
    command: list[str], results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*command, str(results / "same.toml"), "--results", str(results)]) == 2
    assert command[1].partition("=")[0] in capsys.readouterr().err


# As published


def test_published_trials_are_the_declared_ones() -> None:
    published = pd.read_csv(PUBLISHED / "trials.csv")
    for learner in TUNING.learners.values():
        is_own = published["variant"] == learner.variant
        rows = published[is_own & (published["observation"] == learner.observation)]
        drawn = trials(learner.variant, learner.declared.search, 48)
        assert len(rows) == len(drawn) == 49
        for settings, changes in zip(rows["settings"][1:], drawn[1:], strict=True):
            for key, value in changes.items():
                assert f"{key.split('.')[-1]} {json.dumps(value)}, " in f"{settings}, "


def test_experiments_take_what_is_published() -> None:
    """The file that experiments read says what the published table says."""
    published = pd.read_csv(PUBLISHED / "chosen.csv")
    chosen = read_chosen(TUNING.path, "here").learners
    assert [*chosen] == [*(published["variant"] + ", " + published["observation"])]
    assert [found.trial for found in chosen.values()] == published["trial"].tolist()
    scores = [found.score for found in chosen.values()]
    assert scores == pytest.approx(published["chosen"], abs=1e-5)


def test_baselines_are_the_best_tables_and_tile_coding_of_the_search() -> None:
    experiment = load_experiment("compare_deep")
    best: dict[tuple[str, str], tuple[float, str]] = {}
    for learner in experiment.learners.values():
        if learner.chosen is not None and learner.family != "deep" and not learner.reference_for:
            key = learner.family, learner.declared.policy
            best[key] = max(best.get(key, (0.0, "")), (learner.chosen.score, learner.name))
    assert {*report_of(experiment).declared.baseline} == {name for _, name in best.values()}
