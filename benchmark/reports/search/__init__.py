"""The report of a search for settings: what was chosen, what that bought, and what it cost."""

from pathlib import Path
from typing import Final

from benchmark.analysis.search import COLUMNS
from benchmark.drawing.tables import link
from benchmark.experiments import Experiment
from benchmark.reports.folder import Folder
from benchmark.reports.item import Report
from benchmark.reports.search import results
from envs import InputError


def check(experiment: Experiment) -> None:
    """Refuses, by an InputError, an experiment without a search, or with a planner in it."""
    if experiment.declared.search is None:
        raise InputError(f"{experiment.argument}: it has no table [search], which this report needs.")
    for learner in experiment.learners.values():
        if learner.family == "planner":
            where = f"{experiment.argument}: algorithms.{learner.variant}"
            raise InputError(
                f"{where}.algorithm = {learner.declared.algorithm}: it is a planner, which learns nothing; "
                "accepted: learning algorithms."
            )


def headline(folder: Folder) -> str:
    """Says what the best table and the best net gain by chosen settings."""
    table, search, parts = folder.frame("chosen"), folder.manifest["search"], []
    families = table["algorithm"].map(
        {name: variant["family"] for name, variant in folder.manifest["algorithms"].items()}
    )
    for family, kind in {"tabular": "table", "deep": "net"}.items():
        rows = table[families == family]
        if len(rows):
            best = rows.iloc[int(rows["chosen"].argmax())]
            default, chosen = (link(f"{best[key]:.2f}", "chosen", best) for key in ("default", "chosen"))
            learner = folder.phrase(f"{best['algorithm']}, {best['observation']}")
            parts.append(f"from {default} to {chosen} for the best {kind}, {learner}")
    return (
        f"With the best of the defaults and {search['trials']} trials, success averaged over training goes "
        f"{', and '.join(parts)}."
    )


REPORT: Final = Report(
    name="search",
    question="What does tuning buy, and what does it cost?",
    check=check,
    items=(
        results.chosen,
        results.best_of,
        results.cost,
        results.trials,
        results.around,
        results.spaces,
        results.scenes,
    ),
    document=Path(__file__).parent / "document.md.jinja",
    headline=headline,
    lead="best_of",
    columns=COLUMNS,
)
