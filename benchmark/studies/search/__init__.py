"""The report of a search for settings: what was chosen, what that bought, and what it cost."""

from pathlib import Path
from typing import Final

from benchmark.drawing.tables import show
from benchmark.experiments import Experiment
from benchmark.folder import Folder
from benchmark.studies.search import figures as figures
from benchmark.studies.search import tables
from benchmark.studies.search.analysis import COLUMNS, analyse, stages
from benchmark.studies.study import Declared, Study
from envs import InputError


def check(experiment: Experiment, _: Declared) -> None:
    """Raises an InputError if an experiment has no search."""
    if experiment.declared.search is None:
        raise InputError(f"{experiment.argument}: it has no table [search], which this report needs.")


def headline(folder: Folder) -> str:
    """Says what the best learner gains by chosen settings, and whether a gain is shown."""
    table = folder.frame("chosen")
    best = table.iloc[int(table["chosen"].argmax())]
    default, chosen = (show(best[key]) for key in ("default", "chosen"))
    share = "the share of the logarithm of the budget that is saved"
    measure = share if folder.manifest["solved"] else "success averaged over training"
    n_trials = folder.manifest["search"]["trials"]
    searched = f"the best of the declared settings and {n_trials:,} trial{'s' * (n_trials != 1)}"
    learner = folder.phrase(f"{best['variant']}, {best['observation']}")
    is_alone = (table["chosen"] == best["chosen"]).sum() == 1 < len(table)
    who = f"the best learner, {learner}" if is_alone else learner
    shown = "" if best["gain_low"] > 0 else ", but no gain is shown"
    return f"With {searched}, {measure} goes from {default} to {chosen} for {who}{shown}."


STUDY: Final = Study(
    name="search",
    question="What does tuning buy, and what does it cost?",
    declared=Declared,
    check=check,
    analyse=analyse,
    stages=stages,
    items=(tables.chosen, tables.effort, tables.cost, tables.trials),
    document=Path(__file__).parent / "document.md.jinja",
    headline=headline,
    lead="trials",
    reads_curves=True,
    columns=COLUMNS,
)
