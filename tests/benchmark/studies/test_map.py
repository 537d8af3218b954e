"""Maps: real runs of tables, drawn in miniature, and curves with known ends."""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest

from agents import load_algorithm
from agents.dynamic_programming import evaluate
from agents.policy import mask_policy
from benchmark.analysis.frames import keys_of, learned
from benchmark.execution.job import execute_job
from benchmark.experiments import Population
from benchmark.publish.document import Document
from benchmark.studies import Item, report_of
from benchmark.studies.map import figures, tables
from benchmark.studies.map.analysis import MapAnalysis, analyse
from benchmark.studies.map.contrasts import until_learned
from envs import InputError
from envs.observations import compile_seen
from tests.benchmark.studies.conftest import experiment_of, results_of
from tests.support import mistyped_columns

OFFSETS, TABLE = "shared, offset", "table, index"
EXPERIMENT = """
description = "A map in miniature."
scenarios = ["Anywhere"]
horizon = 60
evaluation_every = 100
map_every = 100
solved = { success = 0.9, growth = 1.2 }
settings = { budget = 6000, time_limit = 60, record_every = 6000, epsilon = 0.1 }

[report]
kind = "map"
contrasts = [["shared, offset", "table, index"]]
answer.grid = "unseen"
answer.point = "places 8"
answer.unseen = "unseen"

[[report.answer.groups]]
title = "Cells"
learners = { "table, index" = "mine" }

[[report.answer.groups]]
learners = { "table, index" = "mine", "shared, offset" = "shared" }

[[report.panels]]
grid = "places"
title = "All"
learners = ["shared, offset", "table, index"]

[grids.places]
scenario = { "grid.rows" = 5, "grid.columns" = 6 }
axes.places.1.scenario = { "issuer.places" = 1 }
axes.places.4.scenario = { "issuer.places" = 4 }
axes.places.16.scenario = { "issuer.places" = 16 }

[grids.rooms]
axes.room.5x6.scenario = { "grid.rows" = 5, "grid.columns" = 6 }
axes.room.6x7.scenario = { "grid.rows" = 6, "grid.columns" = 7 }
axes.places.1.scenario = { "issuer.places" = 1 }

[grids.unseen]
question = "What is learned about places in which the person never stood?"
scenario = { "grid.rows" = 5, "grid.columns" = 6 }
axes.places.8.scenario = { "issuer.places" = 8, "issuer.unseen" = 13 }

[algorithms]
shared = { title = "shared table", algorithm = "q_learning", observations = ["offset"], seeds = 12 }
table = { algorithm = "q_learning", observations = ["index"], seeds = 12 }
check = { algorithm = "q_learning", reference_for = "table", seeds = 2 }
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of results of the miniature."""
    return results_of(tmp_path_factory.mktemp("map"), EXPERIMENT)


def test_tables_follow_from_the_runs_that_are_published(made: Path) -> None:
    frames = {path.stem: pd.read_csv(path) for path in made.glob("*.csv")}
    assert [name for name in frames if mistyped_columns(made / f"{name}.csv")] == []
    cells, contrasts = frames["cells"], frames["contrasts"]
    runs = frames["runs"].fillna(np.inf).groupby(["grid", "point", "learner"])
    for _, row in cells.iterrows():
        learner = f"{row['variant']}, {row['observation']}"
        steps = runs.get_group((row["grid"], row["point"], learner))["steps"]
        assert (len(steps), np.isfinite(steps).sum()) == (row["n"], row["n_solved"])
        assert row["steps_low"] <= row["steps"] == np.median(steps) <= row["steps_high"]
    for _, row in contrasts.iterrows():
        x, y = (runs.get_group((row["grid"], row["point"], row[s]))["steps"].to_numpy() for s in "xy")
        assert len(x) == row["n"] == 12
        assert np.where(x == y, 0.5, x < y).mean() == pytest.approx(row["faster"], abs=1e-5)
        assert np.median(y) / np.median(x) == pytest.approx(row["ratio"], rel=1e-5)
    # Failures in unseen places are compared, too, whether runs have learned or not.
    unseen = frames["unseen"].groupby("learner")["unseen_budget"]
    row = contrasts[contrasts["grid"] == "unseen"].iloc[0]
    x, y = (1 - unseen.get_group(row[side]).to_numpy() for side in "xy")
    share = np.where(x == y, 0.5, x < y).mean()
    assert (row["failures_verdict"], row["fewer_failures"]) == ("faster", pytest.approx(share, abs=1e-5))
    assert contrasts["failures_verdict"].notna().sum() == 1
    means = cells[cells["grid"] == "unseen"].set_index("variant")["unseen_success"]
    assert means["shared"] > 0.6 > 0.5 > means["table"]  # what is known of an offset holds everywhere
    shared = frames["unseen"].query("learner == @OFFSETS")["unseen_success"]
    assert means["shared"] == pytest.approx(shared.mean(), abs=1e-5)


def test_runs_of_a_seed_have_the_same_places(tmp_path: Path) -> None:
    places: dict[str, object] = {}
    for population in experiment_of(tmp_path / "mine.toml", EXPERIMENT).populations:
        drawn = [run.drawn_scenario.layout.places for run in population.runs(range(2))]
        assert drawn == places.setdefault(population.condition.name, drawn)
        assert drawn[0] != drawn[1] or population.scenario.issuer.unseen


def test_the_headline_counts_verdicts(made: Path) -> None:
    headline = Document(made).headline or ""
    verdicts = pd.read_csv(made / "contrasts.csv").query("grid == 'places'")["verdict"]
    start = "the shared table of offsets compared with the table: "
    assert start in headline
    for verdict, n in verdicts.value_counts().items():
        assert f"{verdict} at {n}" in headline.partition(start)[2]


NET = """
[algorithms.net]
algorithm = "compiled_dqn"
observations = ["offset_coordinates"]
seeds = 12
settings = { policy_kwargs = { net_arch = [8] } }
"""


@pytest.mark.parametrize("learner", [OFFSETS, "net, offset_coordinates"])
def test_unseen_places_are_scored_at_equal_numbers_of_steps(learner: str, tmp_path: Path) -> None:
    """At the budget and when a run has learned, by both policies; the second method trains to the end."""
    text = EXPERIMENT.replace(", record_every = 6000, epsilon = 0.1", "") + NET
    text = text.replace("6000", "1500").replace("success = 0.9, ", "success = 0.4, ")
    experiment = experiment_of(tmp_path / "unseen.toml", text)
    run = experiment.population("unseen/places=8", "Anywhere", learner).first
    (record,) = execute_job([run])
    model = compile_seen(run.drawn_scenario, run.observation)
    algorithm = load_algorithm(run.algorithm)
    training = algorithm.train(model, run.settings, run.observation, [run.seed_sequence], run.schedule)
    policies = [mask_policy(greedy) for greedy in training.greedy[0]]
    success = np.array([[float(evaluate(model, policy, 60).success) for policy in policies]])
    steps = run.schedule.evaluation_steps
    first = int(learned(success, steps, 0.4, until=2)[0])
    later = [i for i in range(len(steps)) if i > first and steps[i] >= 2 * steps[first]]
    read = [policies[i] for i in ([*later, len(steps) - 1][0], len(steps) - 1)]
    both = [(policy, 0.95 * policy + 0.01) for policy in read]
    expected = [[float(evaluate(model, own, 60, "unseen").success) for own in pair] for pair in both]
    assert record.arrays["unseen_success"].tolist() == pytest.approx(np.array(expected))
    assert record.arrays["success"][-1] == pytest.approx(success[0, -1])
    assert record.arrays["updates"] == training.updates[0]


# Maps made by hand, with 100,000 steps


Changes = Mapping[float, float]


def by_hand(
    folder: Path, curves_of: Callable[[Population], Changes | list[Changes]], more: str = ""
) -> MapAnalysis:
    """Analyses a map in which success is 0, and a number from each of these steps on, with each pick."""
    text = (EXPERIMENT + more).replace("6000", "100000")
    experiment, populations, runs, curves = experiment_of(folder / "hand.toml", text), [], [], []
    for population in experiment.populations:
        if not population.learner.reference_for:
            found = curves_of(population)
            picks = found if isinstance(found, list) else [found]
            populations.append(replace(population, firsts=(population.first,) * len(picks)))
            ends = [min(start, 1e5) * part for changes in picks for start in changes for part in (0.9, 1)]
            step = np.unique([0, 100, 1e5, *ends])
            success = np.zeros((12, len(step)))
            for run in range(12):
                for start, value in picks[run % len(picks)].items():
                    success[run, step >= start] = value
            curve = {"step": step, "training_wrong_pings": step / 10, "cpu_time_s": step / 1000}
            columns = {name: np.tile(values, 12) for name, values in curve.items()}
            columns |= {"seed": np.repeat(range(12), len(step)), "success": success.ravel()}
            curves.append(pd.DataFrame(keys_of(population) | columns))
            unseen = {"unseen_success": 0.25, "unseen_budget": 0.5}
            runs.append(pd.DataFrame(keys_of(population) | {"seed": range(12), **unseen}))
    data = {"runs": pd.concat(runs), "curves": pd.concat(curves), "declared": report_of(experiment).declared}
    experiment = replace(experiment, populations=populations)
    return analyse(cast("Any", SimpleNamespace(experiment=experiment, **data)))


def tabulated(item: Item, analysis: MapAnalysis) -> pd.DataFrame:
    table = item.tabulate(analysis)
    assert table is not None
    return table


def drawn(draw: Any, analysis: MapAnalysis) -> Any:
    """Returns the axes of a figure."""
    return draw(analysis, pd.DataFrame()).axes


@pytest.mark.parametrize(
    ("shared", "table", "verdict", "ratio"),
    [
        (1000, 1600, "faster", 1.6),
        (1000, np.inf, "faster", 100),  # runs that never learn: the budget counts
        (np.inf, np.inf, "neither learns", np.nan),
        (0, 0, "no verdict", np.nan),  # all succeed untrained
    ],
)
def test_verdicts_and_ratios_by_hand(
    shared: float, table: float, verdict: str, ratio: float, tmp_path: Path
) -> None:
    steps = {"shared": shared, "table": table}
    analysis = by_hand(tmp_path, lambda population: {steps[population.learner.variant]: 1.0})
    contrasts = tabulated(tables.contrasts, analysis)
    assert {*contrasts["verdict"]} == {verdict}
    found = contrasts.iloc[0][["ratio", "ratio_low", "ratio_high"]].astype(float)
    assert found.tolist() == pytest.approx([ratio] * 3, nan_ok=True)
    for draw in (figures.answer.draw, figures.picture.draw, figures.unseen):
        assert drawn(draw, analysis)  # without a difference, too


def test_the_answer_by_hand(tmp_path: Path) -> None:
    """Of each row, whose heading is a row, too: texts, values, and which markers are hollow."""
    steps = {"shared": 7000, "table": np.inf}
    analysis = by_hand(tmp_path, lambda each: {steps[each.learner.variant]: 1.0})
    left, right = drawn(figures.answer.draw, analysis)
    assert [label.get_text() for label in left.get_yticklabels()] == ["", "mine", "mine", "shared"]
    assert right.get_title(loc="left").endswith("after 100,000 steps")
    never = "never learns"
    for axis, texts, values in (
        (left, ["Cells", never, never, "7,000"], [1e5, 1e5, 7e3]),
        (right, ["0.50"] * 3, [0.5] * 3),  # at the budget, not when it has learned
    ):
        assert sorted(text.get_text() for text in axis.texts) == sorted(texts)
        dots = [line for line in axis.lines if line.get_linestyle() == "None"]
        at = [(float(*dot.get_xdata()), float(*dot.get_ydata())) for dot in dots]
        assert at == [*zip(values, (1, 2, 3), strict=True)]
        assert [dot.get_markerfacecolor() == "white" for dot in dots] == [axis is left] * 2 + [False]
    first, second = drawn(figures.unseen, analysis)
    question = "What is learned about places in which the person never stood?"
    titles = [" ".join(axis.get_title(loc="left").split()) for axis in (first, second)]
    assert titles == [f"Cells: {question}", question]
    assert "after 100,000 steps" in first.get_ylabel()
    assert first.lines[0].get_ydata().tolist() == [0.5]


def test_picks_by_hand(tmp_path: Path) -> None:
    """Three picks of one learner and two of the other: 12 runs have each of 6 pairs of picks twice."""
    steps = {"shared": [3000.0, 500.0, 600.0], "table": [2000.0, 550.0]}

    def curves(population: Population) -> list[Changes]:
        return [{start: 1.0} for start in steps[population.learner.variant]]

    analysis = by_hand(tmp_path, curves)
    contrasts = tabulated(tables.contrasts, analysis)
    # Below 2,000: 500 and 600; below 550: 500.
    assert ({*contrasts["picks"]}, {*contrasts["picks_faster"]}) == ({6}, {3})
    cells = tabulated(tables.cells, analysis).query("point == 'places 4' and variant == 'shared'").iloc[0]
    assert cells[["picks", "steps_fastest", "steps", "steps_slowest"]].tolist() == [3, 500, 600, 3000]


PEOPLE = """
[grids.pairs]
question = "What does each further pair cost?"
scenario = { "grid.rows" = 5, "grid.columns" = 6, "group" = { people = 2, apart = [2, 2] } }
axes.pairs.2.scenario = { "issuer.places" = 2, "issuer.unseen" = 3 }
axes.pairs.5.scenario = { "issuer.places" = 5 }

[[report.panels]]
grid = "pairs"
title = "Two people"
learners = ["shared, offset"]
"""


@pytest.fixture(scope="module")
def people(tmp_path_factory: pytest.TempPathFactory) -> MapAnalysis:
    folder = tmp_path_factory.mktemp("people")
    return by_hand(folder, lambda population: {1000.0 * len(population.scenario.layout.places): 1.0}, PEOPLE)


def test_panels_show_their_learners(people: MapAnalysis) -> None:
    one, two = drawn(figures.picture.draw, people)
    assert [axis.get_title(loc="left") for axis in (one, two)] == ["All", "Two people"]
    assert one.get_ylim() == two.get_ylim()
    assert [text.get_text() for text in two.texts] == ["never learns", "shared table of\noffsets"]
    assert two.lines[0].get_xdata().tolist() == [2, 5]
    assert two.lines[0].get_ydata().tolist() == [5000, 5000]  # unseen places are places, too
    for axis, n_learners in ((one, 2), (two, 1)):
        assert [line.get_linestyle() for line in axis.lines].count("None") == 2 * n_learners
        assert len({line.get_color() for line in axis.lines if line.get_linestyle() != "None"}) == n_learners


@pytest.mark.parametrize(("budget", "steps"), [(800, 800), (200, 200), (400, np.inf)])
def test_a_run_has_learned_if_success_stays_to_its_end(budget: int, steps: float) -> None:
    curves = pd.DataFrame({"step": [0, 100, 200, 400, 800], "success": [0.0, 0.0, 1.0, 0.0, 1.0]})
    curves = curves.assign(seed=0, training_wrong_pings=curves["step"] / 10, cpu_time_s=0.0)
    end = until_learned(curves[curves["step"] <= budget], 0.9)
    assert (*end["steps"], *end["spent"]) == (steps, budget)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("solved = ", "# ", "[solved] is missing"),
        ("horizon = 60", "horizon = 2", "in Anywhere at places/places=1 no policy succeeds more"),
        ("seeds = 12", "seeds = 13", "shared, offset and table, index: accepted: two with the same"),
        ('["Anywhere"]', '["Anywhere", "AnywhereHidden"]', "scenarios: 2: accepted: exactly one"),
        ("table = {", "table = { settings = { budget = 9000, record_every = 9000 },",
         "algorithms.table: budget = 9000 at places/places=1: accepted: 6000, as others have there"),
        ('grid = "places"', 'grid = "rooms"', "report.panels: rooms: accepted: places; unseen."),
        ('point = "places 8"', 'point = "places 9"', "unseen, places 9: accepted: unseen, places 8."),
        ('"table, index" = "m', '"dqn, index" = "m', "report.answer: dqn, index: accepted: shared, offset"),
        ('"table, index"]]', '"shared, offset"]]', "shared, offset and shared, offset: accepted: two"),
    ],
)  # fmt: skip
def test_mistakes_are_named(old: str, new: str, message: str, tmp_path: Path) -> None:
    assert old in EXPERIMENT
    with pytest.raises(InputError, match=re.escape(message)) as refused:
        report_of(experiment_of(tmp_path / "mine.toml", EXPERIMENT.replace(old, new, 1))).check()
    assert len(refused.value.args) == 1
