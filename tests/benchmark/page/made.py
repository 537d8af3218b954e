"""A small report of one's own, whose page is tested: two items, sentences, agents for the explorer."""

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
from benchmark.reports.item import Estimate, Finding, Frames, Report, item

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAMES = ("scenario", "algorithm", "observation")


@dataclass(frozen=True)
class Learners:
    """All learners of an experiment."""

    shown: Sequence[Shown]
    note: str = ""
    is_incomplete: bool = False
    context: Any = None

    @property
    def facts(self) -> dict[str, object]:
        """How many there are."""
        return {"learners": len(self.shown)}

    @property
    def rows(self) -> Iterator[tuple[dict[str, str], Population]]:
        """What names each of them in a table, and its runs."""
        for each in self.shown:
            names = each.population.scenario, each.algorithm, each.observation
            yield dict(zip(NAMES, names, strict=True)), each.population


def _load(experiment: Experiment, store: Store, seeds: Sequence[int] | None, partial: bool) -> Learners:
    shown = []
    for scenario, arm, observation in experiment.populations:
        runs = specifications(experiment, DEFAULT_CONDITION, scenario, arm, observation, seeds)
        shown.append(Shown(arm, observation, load_population(runs, store)))
    return Learners(shown, note="Partial: of a test." if partial else "")


@item("summary", "success and score after training", {**dict.fromkeys(NAMES, ""), "score": "", "reached": "steps to 0.5", "verdict": ""})
def summary(data: Learners) -> Iterator[dict[str, Any]]:
    """A table with intervals, a missing number and one that is never reached."""
    for names, population in data.rows:
        good = population.scores.mean(axis=0) >= 0.5
        reached = population.evaluation_steps[int(good.argmax())] if good.any() else float("inf")
        final = population.scores[:, -1].clip(0, 1)
        score = Estimate(final.mean(), final.min(), final.max())
        verdict = "holds" if good.any() else "does not hold"
        yield names | {"n": len(population.seeds), "score": score, "reached": float(reached), "verdict": verdict}


@summary.sentence
def _(table: pd.DataFrame, folder: Folder) -> Iterator[Finding]:
    row = table.iloc[0]
    yield Finding(f"In {row['scenario']} the score of `{row['algorithm']}` is {link(show(row['score']), 'summary', row)}.")
    yield Finding(f"The mean score of all is {link(show(table['score'].mean()), 'summary', table)}.")


@item("curves", "mean score over training")
def curves(data: Learners) -> Iterator[dict[str, Any]]:
    """A table that is shown on demand, with a figure."""
    for names, population in data.rows:
        for step, scores in zip(population.evaluation_steps, population.scores.T, strict=True):
            yield names | {"step": step, "score": Estimate(scores.mean(), scores.min(), scores.max())}


@curves.figure("Mean score over training.")
def _(frames: Frames, context: Any) -> "Figure":
    with figure_of(1, 1, (6.0, 3.0)) as (figure, axes):
        for _, rows in frames["curves"].groupby([*NAMES]):
            axes[0, 0].plot(rows["step"], rows["score"].clip(0, 1))
    return figure


def _headline(folder: Folder) -> Finding:
    table = folder.frame("summary")
    best = table.loc[table["score"].idxmax()]
    return Finding(f"The best score is {link(show(best['score']), 'summary', best)} (a test).\n\nThis is the rest.")


REPORT = Report(
    name="tested",
    question="Is the page right?",
    check=lambda _: None,
    load=_load,
    items=(summary, curves, explorer_item(lambda data: data.shown)),
    document=Path(__file__).parent / "made.md.jinja",
    headline=_headline,
    lead="curves",
)
