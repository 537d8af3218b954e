"""The report of a map: real runs of tables, and made ones with known ends."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from benchmark.reports.map.data import Maps
from benchmark.reports.map.headline import headline

from benchmark.__main__ import main
from benchmark.analysis.looks import Cell, Ends, cells, runs_of
from benchmark.analysis.stages import stages
from benchmark.drawing.tables import plain, write_csv
from benchmark.execution.store import Store
from benchmark.experiments import load_experiment
from benchmark.reports.document import Document
from benchmark.reports.draw import draw_figure, tables_of
from benchmark.reports.folder import Folder
from benchmark.reports.map import REPORT
from tests.benchmark.reports.conftest import experiment_of
from tests.benchmark.reports.sentences import check_links
from tests.support import mistyped_columns

OFFSETS, TABLE = "shared, offset", "table, index"
EXPERIMENT = """
description = "A map in miniature."
scenarios = ["Anywhere"]
horizon = 60
evaluation_every = 100
map_every = 100
solved = { success = 0.9, growth = 1.2 }
settings = { budget = 30000, time_limit = 60, record_every = 30000, epsilon = 0.1 }

[report]
kind = "map"
contrasts = [["shared, offset", "table, index"]]
looks = [12, 16]

[grids.places]
question = "What does each further place cost?"
scenario = { "grid.rows" = 5, "grid.columns" = 6 }
axes.places.1 = { "issuer.places" = 1 }
axes.places.4 = { "issuer.places" = 4 }
axes.places.16 = { "issuer.places" = 16 }

[grids.rooms]
question = "What does a larger room cost?"
without = ["room=6x7/places=2"]
axes.room.5x6 = { "grid.rows" = 5, "grid.columns" = 6 }
axes.room.6x7 = { "grid.rows" = 6, "grid.columns" = 7 }
axes.places.1 = { "issuer.places" = 1 }
axes.places.2 = { "issuer.places" = 2 }

[grids.code]
question = "Does the order of the coordinates matter?"
scenario = { "grid.rows" = 5, "grid.columns" = 6, "issuer.places" = 4 }
axes.permuted.0 = { "issuer.permuted" = 0.0 }
axes.permuted.100 = { "issuer.permuted" = 1.0 }

[grids.unseen]
question = "What is learned about places in which the person never stood?"
scenario = { "grid.rows" = 5, "grid.columns" = 6 }
axes.places.8 = { "issuer.places" = 8, "issuer.unseen" = 13 }

[algorithms.shared]
title = "shared table"
algorithm = "q_learning"
observations = ["offset"]
seeds = 12

[algorithms.table]
algorithm = "q_learning"
observations = ["index"]
seeds = 12

[algorithms.check]
algorithm = "q_learning"
reference_for = "table"
seeds = 2
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of results of the miniature."""
    folder = tmp_path_factory.mktemp("map")
    (folder / "small.toml").write_text(EXPERIMENT, encoding="utf-8")
    arguments = ["run", str(folder / "small.toml"), "--report", "--jobs", "1", "--results", str(folder)]
    assert main(arguments) == 0
    return folder / "small"


def test_tables_have_what_the_runs_took(made: Path) -> None:
    frames = {path.stem: pd.read_csv(path) for path in made.glob("*.csv")}
    assert [name for name in frames if mistyped_columns(made / f"{name}.csv")] == []
    runs, found = frames["runs"], frames["cells"]
    for _, row in found.iterrows():
        learner = f"{row['algorithm']}, {row['observation']}"
        own = runs[
            (runs["grid"] == row["grid"]) & (runs["point"] == row["point"]) & (runs["learner"] == learner)
        ]
        steps = np.sort(own["steps"].fillna(np.inf))
        assert (len(steps), np.isfinite(steps).sum()) == (row["n"], row["n_solved"])
        assert row["steps"] == np.median(steps)
        assert row["steps_low"] <= row["steps"] <= row["steps_high"]
    assert (found["unseen_success"].notna() == (found["grid"] == "unseen")).all()
    last = found[found["grid"] == "unseen"].set_index("algorithm")["unseen_success"]
    assert last["shared"] > 0.6 > 0.5 > last["table"]  # what is known of an offset holds everywhere
    of_runs = frames["unseen"].groupby("learner")["unseen_success"].mean()
    assert of_runs[OFFSETS] == pytest.approx(last["shared"], abs=1e-5)


def test_contrasts_follow_from_the_pairs_that_are_published(made: Path) -> None:
    contrasts, pairs = (pd.read_csv(made / f"{name}.csv") for name in ("contrasts", "pairs"))
    for _, row in contrasts.iterrows():
        own = pairs[(pairs["grid"] == row["grid"]) & (pairs["point"] == row["point"])].fillna(np.inf)
        x, y = own["steps_x"], own["steps_y"]
        assert len(own) == row["n"]
        assert np.where(x == y, 0.5, x < y).mean() == pytest.approx(row["faster"], abs=1e-5)
        assert np.median(y) / np.median(x) == pytest.approx(row["ratio"], rel=1e-5)


def test_a_contrast_gets_more_runs_until_it_is_decided(made: Path) -> None:
    contrasts = pd.read_csv(made / "contrasts.csv")
    assert {*contrasts["n"]} == {12, 16}
    assert (contrasts.loc[contrasts["n"] == 12, "verdict"] != "undecided").all()
    one = contrasts[contrasts["point"] == "places 16"].iloc[0]
    assert (one["n"], one["verdict"]) == (12, "faster")
    looks = pd.read_csv(made / "looks.csv").set_index("n")
    distinct = contrasts.drop_duplicates(["rows", "columns", "places", "unseen", "permuted"])
    assert len(distinct) == len(contrasts) - 2  # two points of two grids are the same
    assert looks["contrasts"].to_dict() == distinct.groupby("n").size().to_dict()
    experiment = load_experiment(made.parent / "small.toml")
    with Store(made.parent / "runs.db", read_only=True) as store:
        first, second = stages(experiment, store)
        ended = store.ended()
    assert {run.digest for run in (*first, *second)} == ended
    undecided = {(row["grid"], row["point"]) for _, row in contrasts[contrasts["n"] == 16].iterrows()}
    assert {run.seed for run in second} == {12, 13, 14, 15}
    more = {tuple(run.condition.split("/")[1:]) for run in second}
    assert {(grid, ", ".join(point).replace("=", " ")) for grid, *point in more} <= undecided


def test_runs_of_a_seed_have_the_same_places_and_permuting_is_nothing_to_a_table(made: Path) -> None:
    experiment = load_experiment(made.parent / "small.toml")
    with Store(made.parent / "runs.db", read_only=True) as store:
        curves: dict[tuple[str, str], list[Any]] = {}
        for cell in cells(experiment):
            runs = runs_of(experiment, cell, range(2))
            places = [run.drawn_scenario.places for run in runs]
            assert places[0] != places[1] or "unseen" in cell.condition
            others = runs_of(experiment, cell._replace(variant="shared", observation="offset"), range(2))
            assert places == [run.drawn_scenario.places for run in others]
            curves[cell.condition, cell.learner] = [
                record.arrays["success"].tobytes() for record in store.get([run.digest for run in runs])
            ]
    plain, permuted = (curves[f"default/code/permuted={share}", TABLE] for share in (0, 100))
    assert plain == permuted


def test_document_and_figures(made: Path) -> None:
    document = Document(made)
    check_links(document, fewest=3)
    assert document.headline is not None
    text = plain(document.headline.text)
    assert text.startswith("The shared table of offsets needs fewer steps than the table at places 16; it is")
    assert "The smallest median, which is not tested, is that of the shared table of offsets at " in text
    assert "map.svg" in {path.name for path in made.iterdir()}
    reference = pd.read_csv(made / "reference.csv")
    assert {*reference["y"]} == {"check, index"}
    assert "5 %" in (made / "README.md").read_text(encoding="utf-8")


def test_drawing_again_gives_the_same_but_for_times(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path.name: path.read_bytes() for path in made.iterdir()}
    (made / "cells.csv").write_text("")
    assert main(["report", str(made.parent / "small.toml"), "--results", str(made.parent)]) == 0
    assert {path.name: path.read_bytes() for path in made.iterdir()} == before
    capsys.readouterr()


def made_by_hand(folder: Path, steps: Callable[[Cell], float], text: str = EXPERIMENT) -> Maps:
    """Returns a map in which every run of a cell has solved after so many steps."""

    def ends(cell: Cell) -> Ends:
        n_steps, budget = steps(cell), 1e6 if cell.variant == "table" else 1e5
        points = np.unique([0.0, min(n_steps, 1e5), 1e5, min(max(n_steps, 1e5), budget), budget])
        curve = np.where(points < n_steps, 0.0, 1.0)
        spent = np.array([points, points / 10, points / 1000])[:, None].repeat(16, axis=1)
        return Ends(np.array([curve] * 16), spent, np.full(16, np.nan), 0.9)

    experiment = experiment_of(folder / "hand.toml", text)
    return Maps(experiment, {cell: ends(cell) for cell in cells(experiment) if cell.variant != "check"})


def test_ratios_and_short_budgets_by_hand(tmp_path: Path) -> None:
    x, y = (Cell("default/places/places=16", "Anywhere", *name.split(", ")) for name in (OFFSETS, TABLE))
    data = made_by_hand(tmp_path, lambda cell: 1000.0 if cell.variant == "shared" else 1600.0)
    assert data.ratio(x, y, "disagreements") == pytest.approx((1.6, 1.6, 1.6))
    assert (data.decided[x, y].verdict, data.is_bound(x, y)) == ("better", False)
    # Runs that never learn: the smaller budget counts.
    data = made_by_hand(tmp_path, lambda cell: 1000.0 if cell.variant == "shared" else np.inf)
    assert data.ratio(x, y, "steps") == (100.0, 100.0, 100.0)
    assert data.is_bound(x, y)
    # The table learns, but not within the budget of the other, which never does.
    data = made_by_hand(tmp_path, lambda cell: np.inf if cell.variant == "shared" else 5e5)
    assert data.decided[x, y].verdict == "too short"
    assert np.isnan(data.ratio(x, y, "steps").value)
    assert made_by_hand(tmp_path, lambda _: np.inf).decided[x, y].verdict == "neither"


def found_in(data: Maps, folder: Path) -> str:
    """Writes tables and figures of a map made by hand; returns what is found in them."""
    tables = tables_of(REPORT.items, data)
    for name, frame in tables.items():
        write_csv(frame, folder / f"{name}.csv")
    for item in REPORT.items:
        draw_figure(item, tables, data, folder / f"{item.name}.svg")
    algorithms = {
        name: {"title": each.title, "family": "tabular"} for name, each in data.experiment.algorithms.items()
    }
    manifest = {"facts": data.facts, "report": {"kind": "map"}, "scenarios": {}, "algorithms": algorithms}
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    found = headline(Folder(folder))
    assert found is not None
    return plain(found.text)


@pytest.mark.parametrize("steps", [0.0, np.inf], ids=["all learn at once", "nobody learns"])
def test_an_axis_of_two_values_without_a_difference_has_a_report(steps: float, tmp_path: Path) -> None:
    text = re.sub(r"\naxes.places.16.*", "", EXPERIMENT)
    found = found_in(made_by_hand(tmp_path, lambda _: steps, text), tmp_path)
    start = "Neither the shared table of offsets nor the table learns at" if steps else "It is undecided"
    assert found.startswith(start)
    assert "median" not in found


def test_what_is_undecided_has_no_winner_however_large_the_ratio_of_medians(tmp_path: Path) -> None:
    text = EXPERIMENT.replace("looks = [12, 16]", "looks = [2]").replace("seeds = 12", "seeds = 2")
    data = made_by_hand(tmp_path, lambda cell: 1000.0 if cell.variant == "shared" else np.inf, text)
    data = Maps(data.experiment, {cell: ends.first(2) for cell, ends in data.ends.items()})
    found = found_in(data, tmp_path)
    assert found.startswith("It is undecided which of the shared table of offsets and the table needs fewer")
    assert "needs fewer" not in found.partition(".")[2]


def test_both_sides_of_a_contrast_have_the_same_budget() -> None:
    spent = np.array([[0.0, 100.0, 200.0, 400.0, 800.0]] * 3)[:, None]
    ends = Ends(np.array([[0.0, 0.0, 1.0, 0.0, 1.0]]), spent, np.array([np.nan]), 0.9)
    assert ends.took()[0].tolist() == [800.0]
    assert ends.took(200)[0].tolist() == [200.0]  # to the end of that budget
    assert ends.took(400)[0].tolist() == [np.inf]
    assert ends.spent_within(500)[0].tolist() == [400.0]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("looks = [12, 16]", "looks = [16, 12]", "report.looks = [16, 12]: accepted: increasing numbers"),
        ("looks = [12, 16]", "", "report.looks is missing"),
        ("solved = ", "# ", "[solved] is missing"),
        ("seeds = 12", "seeds = 13", "algorithms.shared.seeds = 13: accepted: report.looks[0] = 12, as"),
        ('"shared, offset", "t', '"mesh, offset", "t', "contrasts: mesh, offset: accepted: shared, offset"),
        ("horizon = 60", "horizon = 2", "in Anywhere at places/places=1 no policy succeeds more"),
        ("seeds = 12", "seeds = 12\nfirst_seed = 5", "accepted: the same first_seed"),
        ('kind = "map"', 'kind = "comparison"', "solved with report.kind = comparison: accepted: "),
        ('["Anywhere"]', '["Anywhere", "AnywhereHidden"]', "scenarios: 2: accepted: exactly one"),
        ("axes.places.2 = {", 'axes.places.2 = { "grid.rows" = 5, ', "grid.rows: accepted: different keys"),
        ("axes.permuted.100", "axes.permuted.all", 'axes.permuted.all.[key] = "all"'),
        ("room=6x7/places=2", "room=6x7", "without: room=6x7: accepted: points such as room=5x6/places=1"),
        ("[grids.code]", '[grids.code]\nlearners = ["dqn"]', "grids.code.learners: dqn: accepted: "),
        ("[grids.code]", "[grids.code]\naxes.spare.1 = {}", "axes.spare: accepted: at least one value that"),
        ('"issuer.unseen" = 13', '"issuer.unseen" = 14', "issuer.places = 8 with issuer.unseen = 14"),
    ],
)  # fmt: skip
def test_mistakes_are_named(
    old: str, new: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert old in EXPERIMENT
    (tmp_path / "mine.toml").write_text(EXPERIMENT.replace(old, new, 1), encoding="utf-8")
    assert main(["run", str(tmp_path / "mine.toml"), "--report", "--results", str(tmp_path)]) == 2
    errors = capsys.readouterr().err
    assert message in errors
    assert len(errors.splitlines()) == 1
    assert not (tmp_path / "runs.db").exists()


def test_other_seeds_are_refused(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(made.parent / "small.toml")
    assert main(["run", path, "--seeds", "0-3", "--results", str(made.parent)]) == 2
    assert "remove --seeds" in capsys.readouterr().err
    assert json.loads((made / "manifest.json").read_text())["facts"]["looks"] == [12, 16]
