"""A small report, whose page is tested: tables, figures, a finding, and agents for the explorer."""

from collections.abc import Iterator
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from benchmark.drawing.style import figure_of
from benchmark.drawing.tables import show
from benchmark.folder import Folder
from benchmark.studies import Data, Declared, Study, explorer
from benchmark.studies.item import Estimate, drawing, item

# HTML, an entity, a script's link, a picture of somebody else's, and blocks of Markdown.
TEXT = r"""<script>alert(1)</script> | a & b &lt; ![x](javascript:alert(1)) <img src=x onerror=alert(1)>
![y](https://example.com/y.png) # heading"""
NAMES = ["scenario", "variant", "observation"]
SHOWN = "scenario variant observation score reached remark verdict"


@item("summary", "success and score after training", SHOWN, labels={"reached": "steps to 0.5"})
def summary(analysis: Data[Declared]) -> Iterator[dict[str, object]]:
    """A table with intervals, and with steps that are never reached."""
    for names, rows in analysis.curves.groupby(NAMES, sort=False):
        means = rows.groupby("step")["unbounded_score"].mean()
        good, final = means[means >= 0.5], rows.loc[rows["step"] == rows["step"].max(), "score"]
        yield dict(zip(NAMES, names, strict=True)) | {
            "score": Estimate(final.mean(), final.min(), final.max()),
            "reached": float(good.index[0]) if len(good) else float("inf"),
            "remark": TEXT,
            "verdict": "holds" if len(good) else "does not hold",
        }


@item("curves", "mean score over training")
def mean_curves(analysis: Data[Declared]) -> Iterator[dict[str, object]]:
    """A table that is shown on demand."""
    for names, scores in analysis.curves.groupby([*NAMES, "step"], sort=False)["unbounded_score"]:
        keys = dict(zip([*NAMES, "step"], names, strict=True))
        yield keys | {"score": Estimate(scores.mean(), scores.min(), scores.max())}


def _lines(frame: pd.DataFrame, column: str) -> Figure:
    with figure_of(1, 1, (6.0, 3.0)) as (figure, axes):
        for _, rows in frame.groupby(NAMES):
            axes[0, 0].plot(rows["step"], rows[column].clip(0, 1))
    return figure


@mean_curves.figure("Mean score over training.")
def draw_curves(_: Data[Declared], table: pd.DataFrame) -> Figure:
    """Draws the mean."""
    return _lines(table, "score")


@drawing("highest", "highest score of any run", "Highest score over training.")
def highest(analysis: Data[Declared], _: pd.DataFrame) -> Figure:
    """A figure without a table."""
    return _lines(pd.DataFrame(mean_curves.tabulate(analysis)), "score_high")


def _headline(folder: Folder) -> str:
    table = folder.frame("summary")
    worst = table.iloc[int(table["score"].argmin())]
    finding = f"The worst score is {show(worst['score'])}. {' '.join(TEXT.split())}"
    return f"{finding}\n\nThe mean score of all is {show(table['score'].mean())}."


@explorer.explorer_item
def agents(analysis: Data[Declared], path: Path) -> None:
    """What all learners know."""
    explorer.write([analysis.records(population) for population in analysis.experiment.populations], path)


STUDY = Study(
    name="tested",
    question="Is the page right?",
    declared=Declared,
    check=lambda _, __: None,
    analyse=lambda data: data,
    items=(summary, mean_curves, highest, agents),
    document=Path(__file__).parent / "made.md.jinja",
    headline=_headline,
    lead="curves",
)
