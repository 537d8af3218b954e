"""What a report is computed from: the tables of runs and curves, and the records behind them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import pandas as pd

from benchmark.analysis.frames import RecordsOf, tables
from benchmark.analysis.records import Records, load_records
from benchmark.analysis.stages import groups, stages
from benchmark.execution import driver
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, Population
from envs import InputError

_LISTED: Final = 4  # populations that a sentence on missing runs names


@dataclass(frozen=True, eq=False)
class Data:
    """What the tables and figures of a report are computed from."""

    experiment: Experiment
    runs: pd.DataFrame  # see `benchmark.analysis.frames`
    curves: pd.DataFrame
    records: RecordsOf
    note: str = ""  # what readers must know of missing runs or other seeds; empty if nothing
    is_partial: bool = False  # whether runs are missing: figures are then marked


def load(
    experiment: Experiment,
    store: Store,
    seeds: Sequence[int] | None = None,
    *,
    partial: bool = False,
    columns: Sequence[str] = (),
) -> Data:
    """Reads what is stored of an experiment.

    Args:
      experiment: As loaded.
      store: Where its records are.
      seeds: Other seeds than the declared ones.
      partial: Whether runs may be missing. Then learners with fewer than two runs somewhere are left out.
      columns: Results of runs that are needed; by default all.

    Raises:
      InputError: Runs are missing, and which; or there are too few.
    """
    if seeds is not None and experiment.has_stages:
        raise InputError(
            f"{experiment.name}: --seeds: an experiment with stages uses only its declared seeds."
        )
    missing = _missing(experiment, store, seeds)
    if missing and not partial:
        raise InputError(f"{experiment.name}: {missing}: run the experiment first.")
    ended = store.ended()
    found = [
        replace(group, runs=[run for run in group.runs if run.digest in ended])
        for group in groups(experiment, store, seeds)
    ]
    few = set[str]()
    if not experiment.has_stages:
        few = {group.population.learner.name for group in found if len(group.runs) < 2}
        few |= {each.name for each in experiment.learners.values() if each.reference_for in few}
    shown = [group for group in found if group.runs and group.population.learner.name not in few]
    if not shown or (few and not partial):
        reason = missing or "a single run has no interval"
        raise InputError(
            f"{experiment.name}: too few runs ({reason}); accepted: at least two of every learner."
        )
    runs, curves = tables(shown, store, columns)
    runs_of = {_names(group.population): group.runs for group in shown if not group.more}

    def records(population: Population) -> Records:
        return load_records(runs_of[_names(population)], store)

    notes = [f"Partial: {missing}."] if missing else []
    notes += [f"Left out, since there are fewer than two runs: {', '.join(sorted(few))}."] if few else []
    if seeds is not None:
        notes.append(f"Every learner has the seeds {min(seeds)} to {max(seeds)} instead of those declared.")
    return Data(experiment, runs, curves, records, " ".join(notes), bool(missing))


def _names(population: Population) -> tuple[str, str, str]:
    return population.condition.name, population.scenario.name, population.learner.name


def _missing(experiment: Experiment, store: Store, seeds: Sequence[int] | None) -> str:
    """Says which runs are missing; empty if none is."""
    for stage, runs in enumerate(stages(experiment, store, seeds), start=1):
        pending = {run.digest for run in driver.pending(runs, store)}
        if not pending:
            continue
        where = f" of stage {stage}" if experiment.has_stages else ""
        text = f"{len(pending)} of {len(runs)} runs{where} are missing"
        statuses = store.statuses()
        if n_failed := sum(statuses.get(digest) == "failed" for digest in pending):
            text += f", {n_failed} of them failed"
        lacking = []
        for population in experiment.populations:
            own = population.runs(seeds)
            if n := sum(run.digest in pending for run in own):
                names = f"{population.learner.name} in {population.scenario.name}"
                lacking.append(f"{names} has {len(own) - n} of {len(own)}")
        more = f"; and {len(lacking) - _LISTED} more populations" if len(lacking) > _LISTED else ""
        return f"{text} ({'; '.join(lacking[:_LISTED])}{more})"
    return ""
