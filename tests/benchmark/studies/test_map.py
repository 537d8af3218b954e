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
from agents.dynamic_programming import evaluate, solve
from agents.policy import mask_policy
from benchmark.__main__ import main
from benchmark.analysis.frames import keys_of, learned
from benchmark.execution.job import execute_job
from benchmark.execution.store import Store
from benchmark.experiments import Population, load_experiment
from benchmark.publish.document import Document
from benchmark.studies import Item, report_of, runs_of
from benchmark.studies.map import figures, tables
from benchmark.studies.map.analysis import MapAnalysis, analyse
from benchmark.studies.map.ceilings import ceilings
from benchmark.studies.map.looks import until_learned
from envs import InputError, compile_scenario, load_scenario
from envs.observations import compile_seen
from tests.benchmark.studies.conftest import experiment_of
from tests.support import mistyped_columns

OFFSETS, TABLE = "shared, offset", "table, index"
EXPERIMENT = """
description = "A map in miniature."
scenarios = ["Anywhere"]
horizon = 60
evaluation_every = 100
map_every = 100
solved = { success = 0.9, growth = 1.2, levels = [0.5, 0.7] }
settings = { budget = 6000, time_limit = 60, record_every = 6000, epsilon = 0.1 }

[report]
kind = "map"
contrasts = [["shared, offset", "table, index"]]
looks = [12, 16]
answer.grid = "unseen"
answer.point = "places 8"
answer.learners = { "table, index" = "mine", "shared, offset" = "shared" }

[grids.places]
question = "What does each further place cost?"
scenario = { "grid.rows" = 5, "grid.columns" = 6 }
axes.places.1.scenario = { "issuer.places" = 1 }
axes.places.4.scenario = { "issuer.places" = 4 }
axes.places.16.scenario = { "issuer.places" = 16 }

[grids.rooms]
question = "What does a larger room cost?"
without = ["room=6x7/places=2"]
axes.room.5x6.scenario = { "grid.rows" = 5, "grid.columns" = 6 }
axes.room.6x7.scenario = { "grid.rows" = 6, "grid.columns" = 7 }
axes.places.1.scenario = { "issuer.places" = 1 }
axes.places.2.scenario = { "issuer.places" = 2 }

[grids.code]
question = "Does the order of the coordinates matter?"
scenario = { "grid.rows" = 5, "grid.columns" = 6, "issuer.places" = 4 }
axes.permuted.0.scenario = { "issuer.permuted" = 0.0 }
axes.permuted.100.scenario = { "issuer.permuted" = 1.0 }

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
    folder = tmp_path_factory.mktemp("map")
    (folder / "small.toml").write_text(EXPERIMENT, encoding="utf-8")
    arguments = ["run", str(folder / "small.toml"), "--report", "--jobs", "1", "--results", str(folder)]
    assert main(arguments) == 0
    return folder / "small"


def test_cells_have_what_the_runs_took(made: Path) -> None:
    frames = {path.stem: pd.read_csv(path) for path in made.glob("*.csv")}
    assert [name for name in frames if mistyped_columns(made / f"{name}.csv")] == []
    cells, names = frames["cells"], ["grid", "point", "variant", "observation"]
    learners = cells["variant"] + ", " + cells["observation"]
    runs, curves = frames["runs"].groupby(["grid", "point", "learner"]), frames["success"].groupby(names)
    for learner, (_, row) in zip(learners, cells.iterrows(), strict=True):
        steps = runs.get_group((row["grid"], row["point"], learner))["steps"].fillna(np.inf)
        assert (len(steps), np.isfinite(steps).sum()) == (row["n"], row["n_solved"])
        assert row["steps_low"] <= row["steps"] == np.median(steps) <= row["steps_high"]
        curve = curves.get_group(tuple(row[names]))
        assert len(curve) <= 18
        assert curve["step"].is_monotonic_increasing
        assert (curve["step"].iloc[0], curve["step"].iloc[-1]) == (100, row["budget"])
        last = curve.iloc[-1][["success", "success_low", "success_high"]].astype(float)
        assert last.tolist() == pytest.approx(row[[*last.index]].astype(float).tolist(), abs=0.0051)
    assert (cells["unseen_success"].notna() == (cells["grid"] == "unseen")).all()
    unseen = cells[cells["grid"] == "unseen"].set_index("variant")["unseen_success"]
    assert unseen["shared"] > 0.6 > 0.5 > unseen["table"]  # what is known of an offset holds everywhere
    means = frames["unseen"].groupby("learner")["unseen_success"].mean()
    assert means[OFFSETS] == pytest.approx(unseen["shared"], abs=1e-5)


def test_contrasts_follow_from_the_pairs_that_are_published(made: Path) -> None:
    contrasts, pairs = (pd.read_csv(made / f"{name}.csv") for name in ("contrasts", "pairs"))
    points = pairs.fillna(np.inf).groupby(["grid", "point"])
    for _, row in contrasts.iterrows():
        x, y = (points.get_group((row["grid"], row["point"]))[side] for side in ("steps_x", "steps_y"))
        assert len(x) == row["n"]
        assert np.where(x == y, 0.5, x < y).mean() == pytest.approx(row["faster"], abs=1e-5)
        assert np.median(y) / np.median(x) == pytest.approx(row["ratio"], rel=1e-5)
    # Failures in unseen places are compared, too, whether runs have learned or not.
    unseen = pd.read_csv(made / "unseen.csv").groupby("learner")["unseen_budget"]
    (row,) = (row for _, row in contrasts[contrasts["grid"] == "unseen"].iterrows())
    first, second = (1 - unseen.get_group(row[side]).to_numpy() for side in "xy")
    assert np.where(first == second, 0.5, first < second).mean() == pytest.approx(
        row["fewer_failures"], abs=1e-5
    )
    assert row["failures_verdict"] == "faster"
    assert (
        contrasts.loc[contrasts["grid"] != "unseen", ["failures_verdict", "fewer_failures"]]
        .isna()
        .to_numpy()
        .all()
    )


def test_a_contrast_gets_more_runs_until_it_is_decided(made: Path) -> None:
    contrasts = pd.read_csv(made / "contrasts.csv")
    assert {*contrasts["n"]} == {12, 16}
    assert (contrasts.loc[contrasts["n"] == 12, "verdict"] != "undecided").all()
    decided = contrasts[contrasts["point"] == "places 16"].iloc[0]
    assert (decided["n"], decided["verdict"]) == (12, "faster")
    looks = pd.read_csv(made / "looks.csv")
    distinct = contrasts.drop_duplicates(["rows", "columns", "places", "unseen", "permuted"])
    assert len(distinct) == len(contrasts) - 2  # two points of two grids are the same
    by_steps = looks[looks["unit"] == "steps"].set_index("n")["contrasts"]
    assert by_steps.to_dict() == distinct.groupby("n").size().to_dict()
    with Store(made.parent / "runs.db", read_only=True) as store:
        first, second = report_of(load_experiment(made.parent / "small.toml")).stages(store)
        assert {run.digest for run in runs_of([*first, *second])} == store.ended()
    assert {run.seed for run in runs_of(second)} == {12, 13, 14, 15}
    undecided = contrasts.loc[contrasts["n"] == 16, ["grid", "point"]].itertuples(index=False, name=None)
    more = [group.population.condition.name.split("/")[1:] for group in second]
    assert {(grid, ", ".join(point).replace("=", " ")) for grid, *point in more} == {*undecided}


def test_runs_of_a_seed_have_the_same_places_and_permuting_is_nothing_to_a_table(made: Path) -> None:
    experiment = load_experiment(made.parent / "small.toml")
    curves: dict[tuple[str, str], list[bytes]] = {}
    places: dict[str, object] = {}
    with Store(made.parent / "runs.db", read_only=True) as store:
        for population in experiment.populations:
            condition, runs = population.condition.name, population.runs(range(2))
            drawn = [run.drawn_scenario.layout.places for run in runs]
            assert drawn == places.setdefault(condition, drawn)
            assert drawn[0] != drawn[1] or "unseen" in condition
            stored = store.get([run.digest for run in runs])
            curves[condition, population.learner.name] = [run.arrays["success"].tobytes() for run in stored]
    straight, permuted = (curves[f"default/code/permuted={share}", TABLE] for share in (0, 100))
    assert straight == permuted


def test_the_document(made: Path) -> None:
    document = Document(made)
    headline = document.headline or ""
    for unit, verdict in (("steps", "faster"), ("wrong PINGs", "fewer")):
        assert f"In {unit}, the shared table of offsets compared with the table: {verdict} at " in headline
    assert {*pd.read_csv(made / "reference.csv")["y"]} == {"check, index"}
    assert "at most 5 %" in (made / "README.md").read_text(encoding="utf-8")


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
    text = EXPERIMENT.replace("record_every = 6000, epsilon = 0.1 ", "").replace("60, }", "60 }") + NET
    text = text.replace("6000", "1500").replace("success = 0.9, ", "success = 0.4, ")
    text = text.replace(", levels = [0.5, 0.7]", "")
    experiment = experiment_of(tmp_path / "unseen.toml", text)
    run = experiment.population("default/unseen/places=8", "Anywhere", learner).first
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
    folder: Path,
    curves_of: Callable[[Population], Changes | list[Changes]],
    more: str = "",
    text: str = EXPERIMENT,
) -> MapAnalysis:
    """Analyses a map in which success is 0, and a number from each of these steps on, with each pick."""
    text = (text + more).replace("6000", "100000")
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


def tabulated(item: Item[Any], analysis: MapAnalysis) -> pd.DataFrame:
    table = item.tabulate(analysis)
    assert table is not None
    return table


def drawn(draw: Any, analysis: MapAnalysis) -> Any:
    """Returns the axes of a figure."""
    return draw(analysis, pd.DataFrame()).axes


@pytest.mark.parametrize(
    ("shared", "table", "verdict", "ratio", "sign"),
    [
        (1000, 1600, "faster", 1.6, "1.6"),
        (1000, np.inf, "faster", 100, "≥100"),  # runs that never learn: the budget counts
        (np.inf, np.inf, "neither learns", np.nan, "–"),
        (0, 0, "no verdict", np.nan, "x"),  # all succeed untrained
    ],
)
def test_verdicts_and_ratios_by_hand(
    shared: float, table: float, verdict: str, ratio: float, sign: str, tmp_path: Path
) -> None:
    steps = {"shared": shared, "table": table}
    analysis = by_hand(tmp_path, lambda population: {steps[population.learner.variant]: 1.0})
    contrasts = tabulated(tables.contrasts, analysis)
    assert {*contrasts["verdict"]} == {verdict}
    for column in ("ratio", "ratio_disagreements"):
        found = contrasts.iloc[0][[column, f"{column}_low", f"{column}_high"]].astype(float)
        assert found.tolist() == pytest.approx([ratio] * 3, nan_ok=True)
    texts = [text.get_text() for text in drawn(figures.verdicts, analysis)[0].texts]
    assert texts.count(sign) == len(contrasts) == 9
    titles = {"places", "rooms: cells, places", "code: permuted", "unseen: places"}
    assert {text.replace("\n", " ") for text in texts} - {sign} == titles
    for draw in (figures.answer.draw, figures.picture.draw, figures.unseen):
        assert drawn(draw, analysis)  # without a difference, too


GROUPS = """
[[report.answer.groups]]
title = "Cells"
learners = { "table, index" = "mine" }

[[report.answer.groups]]
title = "Both"
learners = { "table, index" = "mine", "shared, offset" = "shared" }
"""


@pytest.mark.parametrize(
    ("groups", "headings", "learners", "rows"),
    [
        ("", [], ["mine", "shared"], [0, 1]),
        (GROUPS, ["Cells", "Both"], ["mine", "mine", "shared"], [1, 3, 4]),
    ],
)
def test_the_answer_by_hand(
    groups: str, headings: list[str], learners: list[str], rows: list[int], tmp_path: Path
) -> None:
    """Of each row, whose heading is a row, too: texts, values, and which markers are hollow."""
    steps = {"shared": 7000, "table": np.inf}
    text = re.sub("answer.learners.*", "", EXPERIMENT) if groups else EXPERIMENT
    analysis = by_hand(tmp_path, lambda each: {steps[each.learner.variant]: 1.0}, groups, text)
    left, right = drawn(figures.answer.draw, analysis)
    assert [*filter(None, (label.get_text() for label in left.get_yticklabels()))] == learners
    assert right.get_title(loc="left").endswith("after 100,000 steps")
    shown = {"mine": ("never learns", 1e5), "shared": ("7,000", 7e3)}
    for axis, texts, values in (
        (left, [shown[name][0] for name in learners], [shown[name][1] for name in learners]),
        (right, ["0.50"] * len(rows), [0.5] * len(rows)),  # not when it has learned
    ):
        assert sorted(text.get_text() for text in axis.texts) == sorted(texts + headings * (axis is left))
        dots = [line for line in axis.lines if line.get_linestyle() == "None"]
        assert [float(*dot.get_xdata()) for dot in dots] == values
        assert [float(*dot.get_ydata()) for dot in dots] == rows
        assert [dot.get_markerfacecolor() == "white" for dot in dots] == [text[0] == "n" for text in texts]
    panels = drawn(figures.unseen, analysis)
    question = "What is learned about places in which the person never stood?"
    titles = [" ".join(axis.get_title(loc="left").split()) for axis in panels]
    assert titles == [f"{heading}: {question}" for heading in headings] or titles == [question]
    assert "after 100,000 steps" in panels[0].get_ylabel()
    assert panels[0].lines[0].get_ydata().tolist() == [0.5]


def test_levels_by_hand(tmp_path: Path) -> None:
    """With 16 places, the shared table takes longer at all levels; with others, it is faster at 0.5 and 0.7.

    In larger rooms, it is as fast as the table at 0.5 and 0.7, and at 0.7 alone with 8 places.
    """

    def curve(population: Population) -> dict[float, float]:
        scenario = population.scenario
        n_places = len(scenario.layout.places) - scenario.issuer.unseen
        if population.learner.variant == "table":
            return {1000: 1.0}
        if n_places == 16:
            return {1500: 0.6, 2000: 1.0}
        if scenario.grid.rows == 6:
            return {1000: 0.8, 2000: 1.0}
        return {1000: 0.7, 1500: 0.6, 2000: 1.0} if n_places == 8 else {500: 0.8, 2000: 1.0}

    analysis = by_hand(tmp_path, curve)
    columns = ["verdict", "verdict_0.5", "verdict_0.7"]
    rows = tabulated(tables.contrasts, analysis).set_index("grid")[["point", *columns]].itertuples()
    verdicts_at = {tuple(row[:2]): [*row[2:]] for row in rows}
    assert {found[0] for found in verdicts_at.values()} == {"slower"}
    assert verdicts_at["places", "places 16"] == ["slower"] * 3
    assert verdicts_at["places", "places 4"] == ["slower", "faster", "faster"]
    assert verdicts_at["rooms", "room 6x7, places 1"] == ["slower", "undecided", "undecided"]
    assert verdicts_at["unseen", "places 8"] == ["slower", "undecided", "slower"]
    # Of 9 points, 7 are distinct: 1, 4 and 16 places, 2 in the room, 1 in the larger one, permuted, unseen.
    (row,) = tabulated(tables.levels, analysis).to_dict("records")
    counts = {"at_all_levels": 1, "at_some_levels": 1, "at_no_other_level": 1, "reversed": 4}
    assert row == {"x": OFFSETS, "y": TABLE, "points": 7, "decided": 7, **counts}


def test_runs_do_not_depend_on_levels(tmp_path: Path) -> None:
    texts = (EXPERIMENT, EXPERIMENT.replace(", levels = [0.5, 0.7]", ""))
    with_levels, without = (
        {population.first.digest for population in experiment_of(tmp_path / "same.toml", text).populations}
        for text in texts
    )
    assert with_levels == without


# Of (shared 1, table 1) and (shared 1, table 2), 16 places are the first at which 3,000 steps are fewer; of
# (shared 2, table 1), 4 places; (shared 2, table 2) is faster everywhere.
STEPS = {
    "shared": [(3000.0, 3000.0, 3000.0), (1500.0, 500.0, 500.0)],
    "table": [(1000.0, 2000.0, 4000.0), (2000.0, 2000.0, 8000.0)],
}


@pytest.mark.parametrize(
    ("third", "counts", "faster", "slowest"),
    [
        (20_000.0, {"x_always": 1, "y_always": 2, "x_later": 3, "agreement": 0}, (1, 2, 4), 20_000),
        (600.0, {"x_always": 3, "y_always": 0, "x_later": 3, "agreement": 1}, (3, 4, 6), 3000),
    ],
)
def test_picks_by_hand(
    third: float, counts: dict[str, int], faster: tuple[int, ...], slowest: float, tmp_path: Path
) -> None:
    """Three picks of one learner and two of the other: 12 runs have each of 6 pairs of picks twice.

    With one place, 1,500 steps are fewer than 2,000, and 600 fewer than both 1,000 and 2,000, but not 20,000.
    """
    steps = STEPS | {"shared": [*STEPS["shared"], (third,) * 3]}

    def curves(population: Population) -> list[Changes]:
        places = {"1": 0, "4": 1, "16": 2}.get(population.condition.axes.get("places", ""), 0)
        return [{own[places]: 1.0} for own in steps[population.learner.variant]]

    analysis = by_hand(tmp_path, curves)
    (row,) = tabulated(tables.crossings, analysis).to_dict("records")
    names = {"grid": "places", "x": OFFSETS, "y": TABLE, "combinations": 6, "values": 3}
    assert row == names | counts | {"earliest": 4.0, "latest": 16.0}
    contrasts = tabulated(tables.contrasts, analysis).query("grid == 'places'")
    assert ({*contrasts["picks"]}, tuple(contrasts["picks_faster"])) == ({6}, faster)
    cells = tabulated(tables.cells, analysis).query("point == 'places 4' and variant == 'shared'").iloc[0]
    middle = sorted([3000, 500, third])[1]
    assert cells[["picks", "steps_fastest", "steps", "steps_slowest"]].tolist() == [3, 500, middle, slowest]


PEOPLE = """
[grids.pairs]
question = "What does each further pair cost?"
scenario = { "grid.rows" = 5, "grid.columns" = 6, "group" = { people = 2, apart = [2, 2] } }
axes.pairs.2.scenario = { "issuer.places" = 2, "issuer.unseen" = 3 }
axes.pairs.5.scenario = { "issuer.places" = 5 }

[[report.panels]]
title = "One person"
learners = ["shared, offset", "table, index"]

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
    assert [axis.get_title(loc="left") for axis in (one, two)] == ["One person", "Two people"]
    assert one.get_ylim() == two.get_ylim()
    assert [text.get_text() for text in two.texts] == ["never learns", "shared table of\noffsets"]
    assert two.lines[0].get_xdata().tolist() == [2, 5]
    assert two.lines[0].get_ydata().tolist() == [5000, 5000]  # unseen places are places, too
    for axis, n_learners in ((one, 2), (two, 1)):
        assert [line.get_linestyle() for line in axis.lines].count("None") == 2 * n_learners
        assert len({line.get_color() for line in axis.lines if line.get_linestyle() != "None"}) == n_learners


def test_ceilings_are_those_of_votes_counted_one_by_one(people: MapAnalysis) -> None:
    rows = tabulated(ceilings, people).to_dict("records")
    found = {(row["grid"], row["observation"]): row for row in rows}
    scene = load_scenario(
        "Anywhere", {"grid.rows": 5, "grid.columns": 6, "group": {"people": 2, "apart": [2, 2]}}
    )
    q = solve(compile_scenario(scene), 1.0, 60, issuer_rewards=False).q
    for form in ("index", "offset"):
        model = compile_seen(scene, form)
        votes: dict[int, list[set[int]]] = {}
        for state in range(len(q)):
            first = state % (30 * 5) < 30 and not model.is_over[state]  # before any PING; 30 cells, 5 PINGs
            if first:
                best = {a for a in range(5) if q[state, a] > max(q[state]) - 1e-9}
                votes.setdefault(int(model.observation[state]), []).append(best)
        most = [max(sum(a in best for best in states) for a in range(5)) for states in votes.values()]
        row = found["pairs", form]
        assert (row["rows"], row["states"]) == (len(votes), len(q))
        assert row["optimal"] == pytest.approx(sum(most) / sum(map(len, votes.values())))
        votes_of = np.zeros((model.n_observations, 5))
        for o, states in votes.items():
            votes_of[o] = [sum(a in best for best in states) for a in range(5)]
        policy = np.eye(5)[votes_of.argmax(axis=1)]  # of equally many, the first
        assert row["success"] == pytest.approx(float(evaluate(model, policy, 60).success))
    assert (found["pairs", "index"]["optimal"], found["pairs", "index"]["success"]) == (1, pytest.approx(1))


@pytest.mark.parametrize(("budget", "steps", "spent"), [(800, 800, 80), (200, 200, 20), (400, np.inf, 40)])
def test_a_run_has_learned_if_success_stays_to_its_end(budget: int, steps: float, spent: float) -> None:
    curves = pd.DataFrame({"step": [0, 100, 200, 400, 800], "success": [0.0, 0.0, 1.0, 0.0, 1.0]})
    curves = curves.assign(seed=0, training_wrong_pings=curves["step"] / 10, cpu_time_s=0.0)
    end = until_learned(curves[curves["step"] <= budget], 0.9)[0]
    assert (end["steps"], end["spent_disagreements"]) == (steps, spent)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("looks = [12, 16]", "looks = [16, 12]", "report.looks = [16, 12]: accepted: increasing numbers"),
        ("solved = ", "# ", "[solved] is missing"),
        ("seeds = 12", "seeds = 13", "algorithms.shared.seeds = 13: accepted: report.looks[0] = 12, as"),
        ('"shared, offset", "t', '"mesh, offset", "t', "contrasts: mesh, offset: accepted: shared, offset"),
        ("horizon = 60", "horizon = 2", "in Anywhere at places/places=1 no policy succeeds more"),
        ("seeds = 12", "seeds = 12, first_seed = 5", "accepted: the same first_seed"),
        ('["Anywhere"]', '["Anywhere", "AnywhereHidden"]', "scenarios: 2: accepted: exactly one"),
        ('{ "issuer.places" = 2', '{ "grid.rows" = 5, "issuer.places" = 2', "grid.rows: accepted: different"),
        ("axes.permuted.100", "axes.permuted.all", "grids.code.axes.permuted: all: accepted: a number"),
        ('question = "What does a larger room cost?"', "", "grids.rooms.question is missing"),
        ("room=6x7/places=2", "room=6x7", "without: room=6x7: accepted: points such as room=5x6/places=1"),
        ("table = {", "table = { settings = { budget = 9000, record_every = 9000 },",
         "algorithms.table: budget = 9000 at places/places=1: accepted: 6000, as others have there"),
        ("[grids.code]", '[grids.code]\nlearners = ["dqn"]', "grids.code.learners: dqn: accepted: "),
        ("levels = [0.5", "levels = [0.95", "levels = [0.95, 0.7]: accepted: numbers up to success = 0.9"),
        ("levels = [0.5", "given_up_after = 0.3, levels = [0.4", "[0.4, 0.7]: accepted: numbers from 0.45"),
        ("[report]", '[report]\npanels = [{ title = "All", learners = ["dqn, index"] }]',
         "report.panels: dqn, index: accepted: learners of the grid places: shared, o"),
        ("[report]", '[report]\npanels = [{ grid = "code", title = "All", learners = ["table, index"] }]',
         "report.panels: grid = code: accepted: places."),
        ('grid = "unseen"', 'grid = "rooms"',
         'report.answer: grid = "rooms", point = "places 8": accepted: grid = "unseen", point = "places 8".'),
        ('"table, index" = "m', '"dqn, index" = "m', "report.answer: dqn, index: accepted: sha"),
        ("[report]", '[report]\npanels = [{ title = "All", learners = ["check, index"] }]',
         "report.panels: check, index: accepted: learners of the grid places"),
        ("axes.places.1.scenario", "axes.rate.1 = {}\naxes.places.1.scenario",
         "grids: accepted: at least one that has one axis"),
        ("axes.places.16", "axes.places.04", "axes.places, as numbers: [4.0] is named twice"),
        ("axes.places.16", f'axes.places.{"9" * 400}', "a number of at most 15 characters"),
        # By hand: at 3 + 3 + 2 + 1 points, two learners are looked at, and their reference has two runs.
        ("looks = [12, 16]", "looks = [12, 1_000_000_000]", "18,000,000,018 runs, which take 208,333.3 days"),
        ('"table, index"]]', '"shared, offset"]]', "shared, offset and shared, offset: accepted: two"),
        ('"table, index"]]', '"table, index"], ["table, index", "shared, offset"]]', "index is named twice"),
        ("answer.learners", 'answer.groups = [{ title = "-", learners = { x = "y" } }]\nanswer.learners',
         "report.answer: accepted: either learners or groups"),
        ('"mine"', '"shared"', "report.answer: shared is named twice"),
    ],
)  # fmt: skip
def test_mistakes_are_named(old: str, new: str, message: str, tmp_path: Path) -> None:
    assert old in EXPERIMENT
    with pytest.raises(InputError, match=re.escape(message)) as refused:
        report_of(experiment_of(tmp_path / "mine.toml", EXPERIMENT.replace(old, new, 1))).check()
    assert len(refused.value.args) == 1


def test_seeds_of_all_looks_are_others_than_those_of_a_search(tmp_path: Path) -> None:
    """The search has used seeds from 100 on: 12 runs from 85 on are before them, 16 are not."""
    text = EXPERIMENT.replace('"shared table"', '"shared table", tuned_by = "tuning:q_learning"')

    def check(first: int) -> None:
        own = text.replace("seeds = ", f"first_seed = {first}, seeds = ")
        report_of(experiment_of(tmp_path / "mine.toml", own)).check()

    check(84)
    with pytest.raises(InputError, match=r"100 to 139; accepted: .* than 85 to 100\."):
        check(85)
