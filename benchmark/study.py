"""What a study is: a module that turns the runs of an experiment into tables, figures and text.

`[report] kind` names a study of this project, such as `comparison`, or any module, for example one
beside the experiment's file. The module has, in this order, what experiments declare, tables,
figures, and text:

    Declared   a class of the table `[report]`, by default `Report`
    check      a function of the experiment and its `[report]`; raises an InputError if they
               do not fit
    TABLES     functions of `Data` that return a data frame, or None, by the name of the CSV file
    FIGURES    functions of `Data` that return a figure, or None, by the name of the SVG file
    SHOWN      columns, separated by spaces, of the tables that README shows, by the table's name
    COLUMNS    what columns mean, by name; a star stands for a part of the name
    headline   a function of `Data` that returns what was found, in Markdown
    reading    a function of `Data` that returns how to read the tables, in Markdown
    READS_STORE  is there if stored runs are needed, too

Only TABLES is necessary. The first line of a table's docstring says what its file holds, that of a
figure is its caption, and that of the module is the question if `[report]` has none.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
from pydantic import AfterValidator

from benchmark.experiment import Experiment, Solved
from benchmark.style import Look, look
from envs import InputError
from envs.inputs import Label, Table, distinct

Pair = Annotated[tuple[str, str], AfterValidator(distinct)]
Pairs = Annotated[tuple[Pair, ...], AfterValidator(distinct)]
"""Learners x, y that are compared."""


class Report(Table):
    """What any experiment declares of its report."""

    kind: str
    """The study: `comparison`, `map`, `replication`, `search`, `suite`, or a module."""
    question: Label = ""
    """The heading of the results; by default the study's."""


@dataclass(frozen=True, eq=False)
class Data:
    """What tables, figures and texts are made of."""

    experiment: Experiment
    declared: Any
    """The table `[report]`, an instance of the study's `Declared`."""
    runs: pd.DataFrame
    """A row per run, as published, see `benchmark.runs`."""
    curves: pd.DataFrame
    """A row per run and evaluation, as published."""
    tables: dict[str, pd.DataFrame] = field(default_factory=dict)
    """The tables that were made before, by name."""
    store: Path | None = None
    """The file of stored records; only a replication reads it, for its tables of Q-values."""

    def title(self, learner: object) -> str:
        """Returns what readers call a learner."""
        return self.experiment.learners[str(learner)].title

    def look(self, learner: object) -> Look:
        """Returns how a learner is drawn."""
        learners = self.experiment.learners
        return look(learners[str(learner)], learners.values())


Functions = Mapping[str, Callable[[Data], Any]]


def described(lines: str) -> dict[str, str]:
    """Returns what columns mean, from lines such as "seed: seed of the run"."""
    return dict(line.split(": ", 1) for line in lines.splitlines())


def solved_of(experiment: Experiment) -> Solved:
    """Returns the declared table `[solved]`; an InputError says if it is missing."""
    if experiment.declared.solved is None:
        raise InputError(f"{experiment.argument}: [solved] is missing; this report needs it.")
    return experiment.declared.solved


def learning(experiment: Experiment) -> str:
    """States when a run has learned, as it is coded, in an experiment with `[solved]`."""
    solved = solved_of(experiment)
    return f"""\
A run *has learned* after *s* of its *B* steps if success is at or above {solved.success:g} at every
evaluation from step *s* until the first one at or after step 2*s* or, if the budget ends before,
until the last one. {giving_up(experiment)}"""


def giving_up(experiment: Experiment) -> str:
    """Says which runs are given up; empty if none is."""
    solved = solved_of(experiment)
    if solved.given_up_after is None:
        return ""
    return f"""\
A run whose success has not reached {solved.success / 2:g} by {100 * solved.given_up_after:.0f} % of
the budget is given up: it counts as one that never learns, even if it would learn late, and is
scored as it was then."""
