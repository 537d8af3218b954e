"""A small report, whose page is tested: tables, figures, sentences, and agents for the explorer."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from benchmark.analysis.population import Population, load_population
from benchmark.drawing.style import figure_of
from benchmark.drawing.tables import link, show
from benchmark.execution.store import Store
from benchmark.experiments import DEFAULT_CONDITION, Experiment, specifications
from benchmark.reports.explorer import Shown, explorer_item
from benchmark.reports.folder import Folder
from benchmark.reports.item import Estimate, Finding, Frames, Report, drawing, item

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# HTML, an entity, a script's link, a picture of somebody else's, and blocks of Markdown.
TEXT = r"""<script>alert(1)</script> | a & b &lt; ![x](javascript:alert(1)) <img src=x onerror=alert(1)>
![y](https://example.com/y.png) # heading"""
NAMES = ("scenario", "algorithm", "observation")
SHOWN = {**dict.fromkeys(NAMES, ""), "score": "", "reached": "steps to 0.5", "remark": "", "verdict": ""}


@dataclass(frozen=True)
class Learners:
    """All learners of an experiment."""

    shown: Sequence[Shown]
    note: str = ""
    is_incomplete: bool = False
    context: Any = None

    @property
    def facts(self) -> dict[str, object]:
        """Nothing."""
        return {}

    @property
    def rows(self) -> Iterator[tuple[dict[str, str], Population]]:
        """What names each of them in a table, and its runs."""
        for each in self.shown:
            names = each.population.scenario, each.algorithm, each.observation
            yield dict(zip(NAMES, names, strict=True)), each.population


def load(experiment: Experiment, store: Store, seeds: Sequence[int] | None, partial: bool) -> Learners:
    """Loads all runs; a partial report is not partial."""
    shown = []
    for scenario, variant, observation in experiment.populations:
        runs = specifications(experiment, DEFAULT_CONDITION, scenario, variant, observation, seeds)
        shown.append(Shown(variant, observation, load_population(runs, store)))
    return Learners(shown, note="Partial: said a test." if partial else "")


@item("summary", "success and score after training", SHOWN)
def summary(data: Learners) -> Iterator[dict[str, Any]]:
    """A table with intervals, and with steps that are never reached."""
    for names, population in data.rows:
        good = population.unbounded_scores.mean(axis=0) >= 0.5
        reached = population.evaluation_steps[int(good.argmax())] if good.any() else float("inf")
        final = population.unbounded_scores[:, -1].clip(0, 1)
        values = {"score": Estimate(final.mean(), final.min(), final.max()), "reached": float(reached)}
        yield names | values | {"remark": TEXT, "verdict": "holds" if good.any() else "does not hold"}


@summary.sentence
def _(table: pd.DataFrame, _: Folder) -> Iterator[Finding]:
    row = table.iloc[0]
    yield Finding(f"`{row['algorithm']}` has {link(show(row['score']), 'summary', row)}. {TEXT}")
    yield Finding(f"The mean score of all is {link(show(table['score'].mean()), 'summary', table)}.")


@item("curves", "mean score over training")
def curves(data: Learners) -> Iterator[dict[str, Any]]:
    """A table that is shown on demand."""
    for names, population in data.rows:
        for step, scores in zip(population.evaluation_steps, population.unbounded_scores.T, strict=True):
            yield names | {"step": step, "score": Estimate(scores.mean(), scores.min(), scores.max())}


def _lines(frames: Frames, column: str) -> "Figure":
    with figure_of(1, 1, (6.0, 3.0)) as (figure, axes):
        for _, rows in frames["curves"].groupby([*NAMES]):
            axes[0, 0].plot(rows["step"], rows[column].clip(0, 1))
    return figure


@curves.figure("Mean score over training.")
def _(frames: Frames, _: Any) -> "Figure":
    return _lines(frames, "score")


@drawing("highest", "highest score of any run", "Highest score over training.")
def highest(frames: Frames, _: Any) -> "Figure":
    """A figure without a table."""
    return _lines(frames, "score_high")


def _headline(folder: Folder) -> Finding:
    table = folder.frame("summary")
    worst = table.iloc[int(table["score"].argmin())]
    return Finding(f"The worst score is {link(show(worst['score']), 'summary', worst)}.\n\nThis is the rest.")


REPORT = Report(
    name="tested",
    question="Is the page right?",
    check=lambda _: None,
    load=load,
    items=(summary, curves, highest, explorer_item(lambda data: data.shown)),
    document=Path(__file__).parent / "made.md.jinja",
    headline=_headline,
    lead="curves",
)
