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
    """Refuses, by an InputError, an experiment without a search, or with looks."""
    if experiment.declared.search is None:
        raise InputError(f"{experiment.argument}: it has no table [search], which this report needs.")
    report, solved = experiment.report, experiment.declared.solved
    of_maps = {key: getattr(report, key) for key in ("looks", "panels", "answer")}
    of_maps |= {"solved.levels": solved and solved.levels}
    for key in (key for key, value in of_maps.items() if value):
        raise InputError(f"{experiment.argument}: {key} with report.kind = search: accepted: kind = map.")


def headline(folder: Folder) -> str:
    """Says what the best learner gains by chosen settings."""
    table = folder.frame("chosen")
    best = table.iloc[int(table["chosen"].argmax())]
    default, chosen = (link(f"{best[key]:.2f}", "chosen", best) for key in ("default", "chosen"))
    learner = folder.phrase(f"{best['algorithm']}, {best['observation']}")
    trials = folder.manifest["search"]["trials"]
    share = "the share of the logarithm of the budget that is saved"
    measure = share if folder.manifest["solved"] else "success averaged over training"
    return (
        f"With the best of the declared settings and {trials} trials, {measure} goes from "
        f"{default} to {chosen} for the best learner, {learner}."
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
    reads_curves=True,
    columns=COLUMNS,
)
