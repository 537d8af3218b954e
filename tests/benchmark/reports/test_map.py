"""The report of a map: real runs of tables, one of which counts as a net, and made ones with known ends."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from benchmark.__main__ import main
from benchmark.analysis.looks import Cell, Ends, cells, runs_of
from benchmark.analysis.stages import stages
from benchmark.execution.store import Store
from benchmark.experiments import load_experiment
from benchmark.reports.document import Document
from benchmark.reports.map.data import Maps
from tests.benchmark.reports.conftest import experiment_of
from tests.benchmark.reports.sentences import check_links
from tests.support import mistyped_columns

NET, TABLE = "net, offset", "table, index"
EXPERIMENT = """
description = "A map in miniature: the table of the offset counts as a net."
scenarios = ["Anywhere"]
horizon = 60
evaluation_every = 100
map_every = 100
solved = { success = 0.9, growth = 1.2 }
settings = { budget = 30000, time_limit = 60, record_every = 30000, epsilon = 0.1 }

[report]
kind = "map"
contrasts = [["net, offset", "table, index"]]
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

[algorithms.net]
algorithm = "q_learning"
observations = ["offset"]
family = "deep"
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
        own = runs[(runs["grid"] == row["grid"]) & (runs["point"] == row["point"])]
        steps = np.sort(own[own["learner"] == learner]["steps"].fillna(np.inf))
        assert (len(steps), np.isfinite(steps).sum()) == (row["n"], row["n_solved"])
        assert row["steps"] == steps[(len(steps) - 1) // 2]
        assert row["steps_low"] <= row["steps"] <= row["steps_high"]
    assert (found["unseen_success"].notna() == (found["grid"] == "unseen")).all()
    last = found[found["grid"] == "unseen"].set_index("algorithm")["unseen_success"]
    assert last["net"] > 0.6 > 0.5 > last["table"]  # what is known of an offset holds everywhere


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
            others = runs_of(experiment, cell._replace(variant="net", observation="offset"), range(2))
            assert places == [run.drawn_scenario.places for run in others]
            curves[cell.condition, cell.learner] = [
                record.arrays["success"].tobytes() for record in store.get([run.digest for run in runs])
            ]
    plain, permuted = (curves[f"default/code/permuted={share}", TABLE] for share in (0, 100))
    assert plain == permuted


def test_document_and_figures(made: Path) -> None:
    document = Document(made)
    check_links(document, fewest=8)
    assert document.headline is not None
    text = document.headline.text
    # Each sentence says which table, and that a smaller median is no verdict.
    assert (
        "In a room of 5 × 6 cells, a net (net on the offset's index) learns in fewer steps than the table (a"
        in text
    )
    assert re.search(r" of 1[26] runs of the net learn within 30,000 steps \(unpermuted: ", text)
    assert {"map.svg", "predictors.svg"} <= {path.name for path in made.iterdir()}
    reference = pd.read_csv(made / "reference.csv")
    assert {*reference["y"]} == {"check, index"}
    assert "5 %" in (made / "README.md").read_text(encoding="utf-8")


def test_drawing_again_gives_the_same_but_for_times(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path.name: path.read_bytes() for path in made.iterdir()}
    (made / "cells.csv").write_text("")
    assert main(["report", str(made.parent / "small.toml"), "--results", str(made.parent)]) == 0
    assert {path.name: path.read_bytes() for path in made.iterdir()} == before
    capsys.readouterr()


def test_crossings_exponents_and_ratios_by_hand(tmp_path: Path) -> None:
    text = EXPERIMENT.replace("budget = 30000", "budget = 1000000")
    experiment = experiment_of(tmp_path / "hand.toml", text)

    def ends(steps: float) -> Ends:
        curve = [0.0, 0.0, 0.0] if np.isinf(steps) else [0.0, 1.0, 1.0]
        points = np.array([0.0, min(steps, 5e5), 1e6])
        spent = np.array([points, points / 10, points / 1000])[:, None].repeat(8, axis=1)
        return Ends(np.array([curve] * 8), spent, np.full(8, np.nan), 0.9)

    # The table needs 100 steps per place, the net 1,000 at all of them: they cross at 10 places.
    found = {
        cell: ends(100.0 * float(cell.condition.split("=")[1]) if cell.variant == "table" else 1000.0)
        for cell in cells(experiment)
        if "/places/" in cell.condition and cell.variant != "check"
    }
    data = Maps(experiment, found)
    lines = {name: sorted(line) for name, line in data.lines["places"].items()}
    crossing = data.crossing(lines[NET], lines[TABLE], "steps")
    assert crossing == pytest.approx((10, 10, 10))
    assert data.crossing(lines[TABLE], lines[NET], "steps") == (np.inf, np.inf, np.inf)  # not at the last one
    for name, expected in ((TABLE, 1.0), (NET, 0.0)):
        n, exponent = data.exponent(lines[name])
        assert n == 3
        assert exponent == pytest.approx((expected,) * 3, abs=1e-12)
    x, y = (Cell("default/places/places=16", "Anywhere", *name.split(", ")) for name in (NET, TABLE))
    assert data.ratio(x, y, "disagreements") == pytest.approx((1.6, 1.6, 1.6))
    assert not data.is_bound(x, y)
    # Runs that never learn: their budget counts.
    found[y] = ends(np.inf)
    data = Maps(experiment, found)
    assert data.ratio(x, y, "steps") == (1000.0, 1000.0, 1000.0)
    assert data.is_bound(x, y)
    # The table's budget of 1,000,000 stands for it at the last place: 1,000 times as many, after 0.4 times.
    lines = {name: sorted(line) for name, line in data.lines["places"].items()}
    expected = 4 * (16 / 4) ** (np.log(2.5) / np.log(2.5 * 1000))
    assert data.crossing(lines[NET], lines[TABLE], "steps") == pytest.approx((expected,) * 3)


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
        ("seeds = 12", "seeds = 13", "algorithms.net.seeds = 13: accepted: report.looks[0] = 12, as"),
        ('"net, offset", "table', '"mesh, offset", "table', "contrasts: mesh, offset: accepted: net, offset"),
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
