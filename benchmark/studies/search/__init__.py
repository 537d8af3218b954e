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
    """Says what the best learner gains by chosen settings, if a gain is shown."""
    table = folder.frame("chosen")
    best = table.iloc[int(table["chosen"].argmax())]
    default, chosen = (show(best[key]) for key in ("default", "chosen"))
    share = "the share of the logarithm of the budget that is saved"
    measure = share if folder.manifest["solved"] else "success averaged over training"
    n_trials = folder.manifest["search"]["trials"]
    searched = f"the best of the declared settings and {n_trials:,} trial{'s' * (n_trials != 1)}"
    if best["chosen"] == 0:
        return f"No learner has learned in the search: with {searched}, {measure} is {chosen} for all."
    learner = folder.phrase(f"{best['variant']}, {best['observation']}")
    is_alone = (table["chosen"] == best["chosen"]).sum() == 1 < len(table)
    who = f"the best learner, {learner}" if is_alone else learner
    if best["gain_low"] > 0:
        return f"With {searched}, {measure} goes from {default} to {chosen} for {who}."
    if best["trial"] == 0:
        return f"For {who}, the settings as declared stay {searched}: {measure} is {chosen}."
    return f"With {searched}, no gain is shown for {who}: {measure} is {chosen}, and {default} as declared."


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
