"""Reports extended from outside: an item of one's making, and a report kind, all of it in this file."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import pytest

from benchmark.__main__ import main
from benchmark.analysis.population import Population, load_population
from benchmark.drawing.style import figure_of
from benchmark.execution.store import Store
from benchmark.experiments import DEFAULT_CONDITION, Experiment, specifications
from benchmark.reports.item import Frames, Item, Report, Section, whole
from benchmark.reports.published import Published
from benchmark.reports.view import Columns
from envs import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EXPERIMENT = """
description = "A small experiment of somebody else."
report = "{report}"
items = [{items}]
scenarios = ["S1", "S3"]
horizon = 200
evaluation_every = 200
map_every = 200

[algorithms.q_learning]
algorithm = "q_learning"
observations = ["index"]
seeds = 3

[algorithms.q_learning.settings]
budget = 400
record_every = 100
"""


# An item of the replication: a table with a figure


def _visits(data: Any, _: Frames) -> pd.DataFrame:
    wrong = [(p.scenario, p.arrays["disagreements"][:, -1].mean()) for p in data.default]
    return pd.DataFrame(wrong, columns=["scenario", "wrong_pings"])


def _draw_visits(frames: Frames, context: Any) -> "Figure":
    frame = frames["wrong_pings"]
    assert set(context.models) == set(frame["scenario"])
    with figure_of(1, 1, (4.0, 2.0)) as (figure, axes):
        axes[0, 0].bar(frame["scenario"], frame["wrong_pings"])
    return figure


WRONG_PINGS = Item(
    name="wrong_pings",
    description="how often the issuer disagreed in all of training",
    section="learning",
    compute=_visits,
    display=whole,
    draw=_draw_visits,
    caption="Mean number of disagreements in all of training.",
    view=Columns(
        file="wrong_pings.csv",
        caption="Disagreements in all of training",
        keys=("scenario",),
        numbers={"wrong_pings": "mean number"},
    ),
)


# A report kind: the final success of every run


class Successes:
    """The populations of an experiment by scenario."""

    note = ""
    is_incomplete = False
    context = None

    def __init__(self, populations: Sequence[Population]) -> None:
        """Takes the populations, all of the same algorithm."""
        self.populations = populations
        self.facts = {"scenarios": len(populations)}


def _load(experiment: Experiment, store: Store, seeds: Sequence[int] | None, partial: bool) -> Successes:
    assert not partial
    return Successes(
        [
            load_population(specifications(experiment, DEFAULT_CONDITION, *names, seeds), store)
            for names in experiment.populations
        ]
    )


def _check(experiment: Experiment) -> None:
    if len(experiment.algorithms) > 1:
        raise InputError(f"{experiment.argument}: algorithms: accepted: a single one.")


def _successes(data: Successes, _: Frames) -> pd.DataFrame:
    rows = [(p.scenario, p.arrays["success"][:, -1].mean()) for p in data.populations]
    return pd.DataFrame(rows, columns=["scenario", "success"])


def _headline(published: Published) -> str:
    row = published.frame("success").iloc[0]
    return f"Success in {row['scenario']} is [{row['success']:g}](success.csv#row=2)."


def _nothing(_: Published) -> list[Any]:
    return []


REPORT = Report(
    name="successes",
    question="How often does it succeed?",
    check=_check,
    load=_load,
    items=(
        Item(
            name="success",
            description="success probability by scenario",
            compute=_successes,
            display=whole,
            view=Columns(
                file="success.csv",
                caption="Success probability",
                keys=("scenario",),
                numbers={"success": "success"},
            ),
        ),
    ),
    sections=(Section(key="successes", heading="Successes"),),
    headline=_headline,
    sentences=_nothing,
    words=_nothing,
)

NO_ITEM = "text"


def experiment_file(tmp_path: Path, report: str, *items: str) -> Path:
    path = tmp_path / "mine.toml"
    names = ", ".join(f'"{__name__}:{item}"' for item in items)
    path.write_text(EXPERIMENT.format(report=report, items=names), encoding="utf-8")
    return path


def test_item_appears_in_readme_and_on_the_page(tmp_path: Path) -> None:
    path = experiment_file(tmp_path, "replication", "WRONG_PINGS")
    assert main(["run", str(path), "--report", "--jobs", "1", "--results", str(tmp_path)]) == 0
    folder = tmp_path / "mine"
    names = {file.name for file in folder.iterdir()}
    assert {f"wrong_pings.{end}" for end in ("csv", "md", "tex", "png", "svg")} <= names
    counts = pd.read_csv(folder / "wrong_pings.csv")
    assert counts["scenario"].tolist() == ["S1", "S3"]
    assert (counts["wrong_pings"] > 0).all()
    readme = (folder / "README.md").read_text(encoding="utf-8")
    assert "| wrong_pings " in readme  # in the list of files
    assert "how often the issuer disagreed in all of training" in readme
    assert "![Mean number of disagreements in all of training.](wrong_pings.png)" in readme
    assert "Disagreements in all of training:" in readme
    learning = readme.index("## Learning")
    assert learning < readme.index("wrong_pings.png") < readme.index("## Files")
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert '<a class="n" href="wrong_pings.csv#row=2">' in page
    assert 'alt="Mean number of disagreements in all of training."' in page
    # The page and README can be made again from the files alone.
    (tmp_path / "runs.db").unlink()
    from benchmark.page import build

    build.write(tmp_path, "mine")
    assert (folder / "README.md").read_text(encoding="utf-8") == readme
    assert (folder / "index.html").read_text(encoding="utf-8") == page


def test_report_of_another_kind_has_readme_and_page(tmp_path: Path) -> None:
    path = experiment_file(tmp_path, f"{__name__}:REPORT")
    assert main(["run", str(path), "--report", "--jobs", "1", "--results", str(tmp_path)]) == 0
    folder = tmp_path / "mine"
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["report"] == f"{__name__}:REPORT"
    assert manifest["facts"] == {"scenarios": 2}
    success = pd.read_csv(folder / "success.csv")["success"]
    readme = (folder / "README.md").read_text(encoding="utf-8")
    assert f"**Success in S1 is {success[0]:g}.**" in readme
    assert "## Successes" in readme
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert "<h1>How often does it succeed?</h1>" in page
    assert '<section id="successes">' in page
    assert 'id="explorer"' not in page  # it has no maps of agents
    assert 'href="success.csv#row=3"' in page


@pytest.mark.parametrize(
    ("report", "items", "expected"),
    [
        ("replicasion", (), "unknown report replicasion (did you mean replication?)"),
        ("nowhere.to:be_found", (), "report nowhere.to:be_found cannot be imported"),
        ("envs:ACTIONS", (), "envs:ACTIONS is not a report"),
        ("replication", ("NO_ITEM",), "is not an item"),
        ("replication", ("NOWHERE",), "cannot be imported"),
        ("replication", ("WRONG_PINGS", "WRONG_PINGS"), "the report has an item wrong_pings already"),
        (f"{__name__}:REPORT", ("WRONG_PINGS",), "unknown section of a successes learning"),
    ],
)
def test_mistakes_get_one_sentence_before_any_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], report: str, items: tuple[str, ...], expected: str
) -> None:
    path = experiment_file(tmp_path, report, *items)
    assert main(["run", str(path), "--report", "--jobs", "1", "--results", str(tmp_path)]) == 2
    message = capsys.readouterr().err
    assert expected in message
    assert message.count("\n") == 1
    assert not (tmp_path / "runs.db").exists()
