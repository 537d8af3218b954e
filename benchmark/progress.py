"""How long runs take: an estimate before they start, and a display while they are trained."""

import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from benchmark.job import Job
from benchmark.tables import RUNS, read_table
from envs import InputError

# How often progress is shown
_REWRITTEN_S = 0.5  # in a terminal
_LINE_S = 30.0


class Display:
    """A line that says how many runs are done: it is rewritten in a terminal, else it comes again.

    While no job ends, it stays as it is.
    """

    def __init__(
        self, name: str, jobs: Sequence[Job], n_done: int, published: Path, workers: int
    ) -> None:
        """Expects the mean time per step of the same learners in a folder of results.

        If it has none, how long a step takes is unknown until the first job has ended.

        Args:
          name: The experiment's.
          jobs: Those to come.
          n_done: How many runs are done already.
          published: A folder of results.
          workers: How many jobs are executed at a time.
        """
        self._name, self._published, self._workers = name, published, workers
        self._n, self._n_done, self._n_failed = n_done + sum(map(len, jobs)), n_done, 0
        costs = [float(job[0].settings.budget * len(job)) for job in jobs]
        self._rate: float | None = None  # seconds until a unit of costs is done
        with suppress(InputError, KeyError):  # there are no results, or none of a learner
            runs = read_table(published, RUNS)
            sums = runs.groupby("learner")[["wall_time_s", "budget"]].sum()
            seconds = sums["wall_time_s"] / sums["budget"]  # of a step
            names = [f"{job[0].variant}, {job[0].observation}" for job in jobs]
            costs = (np.array(costs) * seconds[names]).tolist()
            self._rate = 1.0 / workers
        self._costs = {job[0].digest: cost for job, cost in zip(jobs, costs, strict=True)}
        self._total, self._started_s = sum(costs), time.monotonic()
        self._shown_s, self._is_terminal = self._started_s, sys.stderr.isatty()

    def forecast(self) -> str:
        """Says how long all jobs take."""
        if self._rate is None:
            return f"duration unknown, since {self._published} has no results of these learners"
        by = f"{self._workers} worker{'s' * (self._workers > 1)}"
        took = f"if as fast as for the results in {self._published}"
        return f"{about(self._rate * self._total)} with {by}, {took}"

    def advance(self, ended: Sequence[str], n_failed: int = 0) -> None:
        """Counts the runs of a job that has ended, by digest, and failures among them."""
        self._n_done += len(ended) - n_failed
        self._n_failed += n_failed
        del self._costs[ended[0]]
        now, left = time.monotonic(), sum(self._costs.values())
        self._rate = (now - self._started_s) / (self._total - left)
        pause = _REWRITTEN_S if self._is_terminal else _LINE_S
        if not self._costs or now - self._shown_s > pause:
            self._shown_s = now
            failed = f", {self._n_failed} failed" if self._n_failed else ""
            time_left = f", {about(self._rate * left)} left" if self._costs else ""
            text = f"{self._name}: {self._n_done:,} of {self._n:,} done{failed}{time_left}"
            start, end = ("\r\x1b[K", "") if self._is_terminal else ("", "\n")
            print(f"{start}{text}", end=end, file=sys.stderr, flush=True)

    def close(self) -> None:
        """Ends the line."""
        if self._is_terminal:
            print(file=sys.stderr)


def about(seconds: float) -> str:
    """Returns a time for readers, such as "about 17 minutes"."""
    if seconds < 90:
        return "about a minute" if seconds > 40 else "less than a minute"
    hours, minutes = f"{seconds / 3600:.1f} hours", f"{seconds / 60:.0f} minutes"
    return f"about {minutes if seconds < 6000 else hours}"
