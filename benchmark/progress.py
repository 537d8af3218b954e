"""How long runs take: an estimate before they start, and a display while they are trained."""

import heapq
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.text import Text

from benchmark.job import Job
from benchmark.tables import RUNS, read_table
from envs import InputError

_LINE_EVERY_S: Final = 30.0  # where the output is not a terminal


class Forecast:
    """When jobs end that some workers take in order.

    How much longer or shorter than expected the ended jobs took is assumed of all others.
    """

    def __init__(self, jobs: Sequence[Job], published: Path, workers: int) -> None:
        """Expects the mean time per step of the same learners in a folder of results.

        If it has none, how long a step takes is unknown until the first job has ended.
        """
        per_step = _seconds_per_step(published)
        names = [f"{job[0].variant}, {job[0].observation}" for job in jobs]
        is_known = {*names} <= per_step.keys()
        steps = [job[0].settings.budget * len(job) for job in jobs]
        pairs = zip(names, steps, strict=True)
        self.costs = [n * per_step[name] for name, n in pairs] if is_known else [*map(float, steps)]
        self._rate = 1.0 if is_known else None  # seconds per unit of costs
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
        self._expected += self.costs[job]
        self._rate = self._spent / self._expected
        self.start(now)

    def seconds(self, now: float) -> float | None:
        """Returns in how many seconds the last job ends; None if that is unknown."""
        if (rate := self._rate) is None:
            return None
        running = self._running.items()
        left = [max(rate * self.costs[job] - (now - started), 0.0) for job, started in running]
        left += [0.0] * (self._workers - len(left))
        heapq.heapify(left)
        for job in reversed(self._waiting):
            heapq.heapreplace(left, left[0] + rate * self.costs[job])
        return max(left)

    def __str__(self) -> str:
        seconds = self.seconds(0.0)
        if seconds is None:
            return f"for an unknown time: {self._published} has no results of these learners"
        by = f"{self._workers} worker{'s' * (self._workers > 1)}"
        return f"{about(seconds)} with {by}, if as fast as for the results in {self._published}"


def _seconds_per_step(published: Path) -> dict[str, float]:
    """Returns the mean seconds per step of published runs, by learner; none if there are none."""
    try:
        runs = read_table(published, RUNS)
    except InputError:
        return {}
    sums = runs.groupby("learner")[["wall_time_s", "budget"]].sum()
    return dict((sums["wall_time_s"] / sums["budget"]).items())


class Display(ProgressColumn):
    """A bar with the time left, or occasional lines where the output is not a terminal."""

    def __init__(self, name: str, jobs: Sequence[Job], forecast: Forecast, n_done: int) -> None:
        """Takes the jobs to come, and how many runs are done already."""
        super().__init__()
        self._index = {run.digest: i for i, job in enumerate(jobs) for run in job}
        self._n, self._n_done, self._n_failed = n_done + len(self._index), n_done, 0
        self._forecast, self._line_s = forecast, time.monotonic()
        self._console = Console(stderr=True)
        columns = TextColumn("{task.description}", markup=False), BarColumn(), self
        hidden = not self._console.is_terminal
        self._progress = Progress(
            *columns, console=self._console, disable=hidden, refresh_per_second=2
        )
        self._task = self._progress.add_task(name, total=sum(forecast.costs))

    def __enter__(self) -> Self:
        self._forecast.start(time.monotonic())
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()
        if not self._console.is_terminal:
            self._print_line()

    def advance(self, ended: Sequence[str], n_failed: int = 0) -> None:
        """Counts the runs of a job that has ended, by digest, and failures among them."""
        self._n_done += len(ended) - n_failed
        self._n_failed += n_failed
        job, now = self._index[ended[0]], time.monotonic()
        self._forecast.end(job, now)
        self._progress.update(self._task, advance=self._forecast.costs[job])
        if not self._console.is_terminal and now - self._line_s > _LINE_EVERY_S:
            self._line_s = now
            self._print_line()

    def render(self, task: Task) -> Text:  # noqa: ARG002
        """Says how many runs are done, how many have failed, and the time left, if it is known."""
        text, left = (
            f"{self._n_done:,} of {self._n:,} done",
            self._forecast.seconds(time.monotonic()),
        )
        if self._n_failed:
            text += f", {self._n_failed} failed"
        if self._n_done + self._n_failed < self._n and left is not None:
            text += f", {about(left)} left"
        return Text(text)

    def _print_line(self) -> None:
        task = self._progress.tasks[0]
        line = f"{task.description}: {self.render(task)}"
        self._console.print(line, markup=False, soft_wrap=True)


def about(seconds: float) -> str:
    """Returns a time for readers, such as "about 17 minutes"."""
    if seconds < 90:
        return "about a minute" if seconds > 40 else "less than a minute"
    return (
        f"about {seconds / 60:.0f} minutes"
        if seconds < 6000
        else f"about {seconds / 3600:.1f} hours"
    )
