"""The tables of a map: what every population took, and which learner needs fewer steps."""

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Final

import numpy as np
import pandas as pd

from benchmark.analysis.intervals import Estimate, median
from benchmark.experiments import Population
from benchmark.studies.item import COLUMNS, Item, item, no_rows
from benchmark.studies.map.analysis import MapAnalysis, learner_of
from benchmark.studies.map.declared import name_of

Row = Mapping[str, object]

_LABELS: Final = COLUMNS["map_labels"]
_item: Final = partial(Item, labels=_LABELS)
_NONE: Final = Estimate(math.nan, math.nan, math.nan)


@_item(
    "cells",
    "every point and learner: the share of runs that learn, and medians of what they take",
    "grid point learner n solved success steps steps_fastest steps_slowest disagreements unseen_success "
    "unseen_budget",
    best="-steps",
)
def cells(analysis: MapAnalysis) -> pd.DataFrame:
    """Tabulates all populations."""
    return analysis.cells.reset_index(drop=True)


@item(
    "cpu", "measured: median CPU seconds of training until a run has learned", is_measured=True, where=no_rows
)
def cpu(analysis: MapAnalysis) -> Iterator[Row]:
    """Tabulates the time of training, without evaluations."""
    for population, runs in analysis.learned.items():
        times = runs["cpu_time_s"]
        yield {**learner_of(population), "n": len(times), "cpu_time_s": median(times)}


@item(
    "contrasts",
    "which learner needs fewer steps",
    "grid point x y n verdict faster picks picks_faster ratio failures_verdict fewer_failures",
    labels=_LABELS | {"n": "pairs of runs"},
)
def contrasts(analysis: MapAnalysis) -> Iterator[Row]:
    """Tabulates the declared contrasts."""
    for contrast in analysis.contrasts:
        steps, failures = contrast.decisions["steps"], contrast.decisions.get("failures")
        yield {
            **contrast.names,
            "n": len(contrast.learned[0]["steps"]),
            "verdict": steps.verdict,
            "why_none": steps.why,
            "faster": steps.faster,
            "picks": len(contrast.shares),
            "picks_faster": sum(share > 0.5 for share in contrast.shares),
            "ratio": contrast.ratio,
            "failures_verdict": failures.verdict if failures else "",
            "fewer_failures": failures.faster if failures else _NONE,
        }


@item("runs", "every run: what it took until it had learned", where=no_rows)
def runs(analysis: MapAnalysis) -> pd.DataFrame:
    """Tabulates all runs, numbered by seed; empty where a run never solves its scenario."""
    tables = []
    for population, took in analysis.learned.items():
        tables.append(_numbered(population, {unit: took[unit] for unit in ("steps", "disagreements")}))
    return pd.concat(tables, ignore_index=True)


@item("unseen", "every run with unseen places: success in them by both policies", where=no_rows)
def unseen(analysis: MapAnalysis) -> pd.DataFrame | None:
    """Tabulates all runs of the points that have unseen places."""
    tables = []
    for population, rows in analysis.runs.items():
        if population.scenario.issuer.unseen:
            tables.append(_numbered(population, {**rows.filter(like="unseen_").reset_index(drop=True)}))
    return pd.concat(tables, ignore_index=True) if tables else None


def _numbered(population: Population, values: Row) -> pd.DataFrame:
    """Returns values of a population's runs as a table, with their names, and NaN for infinite values."""
    numbers = pd.DataFrame(values).replace(np.inf, np.nan)
    names = name_of(population) | {"learner": population.learner.name}
    return pd.DataFrame({**names, "run": range(len(numbers)), **numbers})
