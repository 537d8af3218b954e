"""How long runs take: an estimate before they start, and a display while they are trained."""

import heapq
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

# How often progress is shown
_REWRITTEN_S: Final = 0.5  # in a terminal
_LINE_S: Final = 30.0


class Forecast:
    """When jobs end that some workers take in order.

    How much longer or shorter than expected the ended jobs took is assumed of all others.
    """

    def __init__(self, jobs: Sequence[Job], published: Path, workers: int) -> None:
        """Expects the mean time per step of the same learners in a folder of results.

        If it has none, how long a step takes is unknown until the first job has ended.
        """
        self._costs = [float(job[0].settings.budget * len(job)) for job in jobs]
        self._rate: float | None = None  # seconds per unit of costs
        with suppress(InputError, KeyError):  # there are no results, or none of a learner
            runs = read_table(published, RUNS)
            sums = runs.groupby("learner")[["wall_time_s", "budget"]].sum()
            seconds = sums["wall_time_s"] / sums["budget"]  # of a step
            names = [f"{job[0].variant}, {job[0].observation}" for job in jobs]
            self._costs = (np.array(self._costs) * seconds[names]).tolist()
            self._rate = 1.0
        self._waiting = [*reversed(range(len(jobs)))]
        self._running: dict[int, float] = {}  # when each started
        self._workers, self._published = workers, published
        self._spent = self._expected = 0.0

    def start(self, now: float) -> None:
        """Starts jobs on free workers."""
        while self._waiting and len(self._running) < self._workers:
            self._running[self._waiting.pop()] = now

    def end(self, job: int, now: float) -> None:
        """Counts a job that has ended, and starts the next one."""
        if job in self._waiting:  # a worker was free after all
            self._waiting.remove(job)
        self._spent += now - self._running.pop(job, now)
        self._expected += self._costs[job]
        self._rate = self._spent / self._expected
        self.start(now)

    def seconds(self, now: float) -> float | None:
        """Returns in how many seconds the last job ends; None if that is unknown."""
        if (rate := self._rate) is None:
            return None
        running = self._running.items()
        left = [max(rate * self._costs[job] - (now - started), 0.0) for job, started in running]
        left += [0.0] * (self._workers - len(left))
        heapq.heapify(left)
        for job in reversed(self._waiting):
            heapq.heapreplace(left, left[0] + rate * self._costs[job])
        return max(left)

    def __str__(self) -> str:
        seconds = self.seconds(0.0)
        if seconds is None:
            return f"duration unknown, since {self._published} has no results of these learners"
        by = f"{self._workers} worker{'s' * (self._workers > 1)}"
        return f"{about(seconds)} with {by}, if as fast as for the results in {self._published}"


class Display:
    """A line that says how many runs are done: it is rewritten in a terminal, else it comes again.

    While no job ends, it stays as it is.
    """

    def __init__(self, name: str, jobs: Sequence[Job], forecast: Forecast, n_done: int) -> None:
        """Takes the jobs to come, and how many runs are done already."""
        self._index = {run.digest: i for i, job in enumerate(jobs) for run in job}
        self._name, self._forecast = name, forecast
        self._n, self._n_done, self._n_failed = n_done + len(self._index), n_done, 0
        self._shown_s, self._is_terminal = time.monotonic(), sys.stderr.isatty()
        forecast.start(self._shown_s)

    def advance(self, ended: Sequence[str], n_failed: int = 0) -> None:
        """Counts the runs of a job that has ended, by digest, and failures among them."""
        self._n_done += len(ended) - n_failed
        self._n_failed += n_failed
        now = time.monotonic()
        self._forecast.end(self._index[ended[0]], now)
        is_last = self._n_done + self._n_failed == self._n
        if is_last or now - self._shown_s > (_REWRITTEN_S if self._is_terminal else _LINE_S):
            self._shown_s = now
            start, end = ("\r\x1b[K", "") if self._is_terminal else ("", "\n")
            print(f"{start}{self.text(now)}", end=end, file=sys.stderr, flush=True)

    def close(self) -> None:
        """Ends the line."""
        if self._is_terminal:
            print(file=sys.stderr)

    def text(self, now: float) -> str:
        """Says how many runs are done, how many have failed, and the time left, if it is known."""
        text = f"{self._name}: {self._n_done:,} of {self._n:,} done"
        if self._n_failed:
            text += f", {self._n_failed} failed"
        left = self._forecast.seconds(now)
        if self._n_done + self._n_failed < self._n and left is not None:
            text += f", {about(left)} left"
        return text


def about(seconds: float) -> str:
    """Returns a time for readers, such as "about 17 minutes"."""
    if seconds < 90:
        return "about a minute" if seconds > 40 else "less than a minute"
    hours, minutes = f"{seconds / 3600:.1f} hours", f"{seconds / 60:.0f} minutes"
    return f"about {minutes if seconds < 6000 else hours}"
