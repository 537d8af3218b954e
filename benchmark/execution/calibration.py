"""Estimates what missing runs cost, judged by the published results of the same experiment."""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from benchmark.execution.plan import plan
from benchmark.execution.progress import about
from benchmark.experiments import RunSpecification
from envs.inputs import shortened


class Estimate(NamedTuple):
    """How long it takes to execute missing runs."""

    text: str
    time_s: float  # 0 if unknown
    costs: Mapping[str, float]  # seconds of every run, by digest; 1 of each if that of some is unknown


def estimate(missing: Sequence[RunSpecification], folder: Path, workers: int) -> Estimate:
    """Returns how long it takes so many workers to execute these runs, by the results in a folder."""
    published = _published(folder)
    costs = {run.digest: published.get((run.variant, run.observation), 0.0) for run in missing}
    if unknown := dict.fromkeys(run.variant for run in missing if not costs[run.digest]):
        what = shortened(", ".join(unknown)) if published else "this experiment"
        text = f"for an unknown time: there are no results of {what} yet"
        return Estimate(text, 0.0, dict.fromkeys(costs, 1.0))
    times = [sum(costs[run.digest] for run in job) for job in plan(missing)]
    time_s = max(sum(times) / workers, *times)
    by = f"{workers} worker{'s' * (workers > 1)}"
    return Estimate(f"{about(time_s)} with {by}, if as fast as for the results in {folder}", time_s, costs)


def _published(folder: Path) -> dict[tuple[str, str], float]:
    """Returns the seconds of a run by variant and observation, as far as they are known.

    Runs share all the time that they took by their CPU time, or, without a table of costs, equally.
    """
    costs = dict[tuple[str, str], float]()
    with suppress(OSError, ValueError, KeyError):  # nothing is published, or no costs
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        for variant, its in manifest["algorithms"].items():
            costs |= {(variant, form): manifest["busy_time_s"] / manifest["runs"] for form in its["settings"]}
        cost = pd.read_csv(folder / "cost.csv", index_col=["variant", "observation"])
        cpu = cost["cpu_ms" if "cpu_ms" in cost else "cpu_time_s"]  # of a run
        share = cost["runs"].sum() / manifest["runs"]  # of all runs, that the table is about
        costs |= (cpu * (share * manifest["busy_time_s"] / (cpu @ cost["runs"]))).to_dict()
    return costs
