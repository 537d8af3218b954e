"""Progress: how many runs are done, and how long the others take."""

import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

import numpy as np

from benchmark.job import Job
from benchmark.tables import RUNS, read_table
from envs import InputError

_LINE_S: Final = 30.0  # how often progress is shown


class Display:
    """Lines that say how many runs are done."""

    def __init__(self, name: str, jobs: Sequence[Job], n_done: int, published: Path) -> None:
        """Weighs jobs by the mean time per step of the same learners in a folder of results.

        If it lacks some, all steps count the same.

        Args:
          name: The experiment's.
          jobs: Those to come.
          n_done: How many runs are done already.
          published: A folder of results.
        """
        self._name, self._n = name, n_done + sum(map(len, jobs))
        self._n_done, self._n_failed = n_done, 0
        costs = [float(job[0].settings.budget * len(job)) for job in jobs]
        with suppress(InputError, KeyError):  # there are no results, or none of a learner
            runs = read_table(published, RUNS)
            sums = runs.groupby("learner")[["wall_time_s", "budget"]].sum()
            seconds = sums["wall_time_s"] / sums["budget"]  # of a step
            names = [f"{job[0].variant}, {job[0].observation}" for job in jobs]
            costs = (np.array(costs) * seconds[names]).tolist()
        self._costs = {job[0].digest: cost for job, cost in zip(jobs, costs, strict=True)}
        self._total, self._started_s = sum(costs), time.monotonic()
        self._shown_s = self._started_s

    def advance(self, ended: Sequence[str], n_failed: int = 0) -> None:
        """Counts the runs of a job that has ended, by digest, and failures among them."""
        self._n_done += len(ended) - n_failed
        self._n_failed += n_failed
        del self._costs[ended[0]]
        now, left = time.monotonic(), sum(self._costs.values())
        if not self._costs or now - self._shown_s > _LINE_S:
            self._shown_s = now
            failed = f", {self._n_failed} failed" if self._n_failed else ""
            left_s = (now - self._started_s) * left / (self._total - left)
            time_left = f", {about(left_s)} left" if self._costs else ""
            text = f"{self._name}: {self._n_done:,} of {self._n:,} done{failed}{time_left}"
            print(text, file=sys.stderr, flush=True)


def about(seconds: float) -> str:
    """Returns a time for readers, such as "about 17 minutes"."""
    if seconds < 90:
        return "about a minute" if seconds > 40 else "less than a minute"
    hours, minutes = f"{seconds / 3600:.1f} hours", f"{seconds / 60:.0f} minutes"
    return f"about {minutes if seconds < 6000 else hours}"
