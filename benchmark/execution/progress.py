"""Shows the progress of an experiment: how many runs are done, running and failed, and the time left."""

import time
from collections import Counter
from collections.abc import Iterable
from typing import Final, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from benchmark.execution.plan import Job
from benchmark.execution.store import Record
from benchmark.experiments import RunSpecification

_LINE_EVERY_S: Final = 30.0  # where the output is not a terminal
_RECENT_S: Final = 600.0  # the time left is estimated from runs that ended so recently


class Display:
    """A bar for all runs and one per learner, or occasional lines where the output is not a terminal."""

    def __init__(
        self, name: str, runs: Iterable[RunSpecification], ended: set[str], console: Console | None = None
    ) -> None:
        """Counts all runs of an experiment, of which some have ended."""
        self._console = console or Console(stderr=True)
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[running]} running, {task.fields[failed]} failed"),
            TimeRemainingColumn(elapsed_when_finished=True),
            console=self._console,
            disable=not self._console.is_terminal,
            speed_estimate_period=_RECENT_S,
        )
        learners = {run.digest: f"{run.variant}, {run.observation}" for run in runs}
        done = Counter(learner for digest, learner in learners.items() if digest in ended)
        counts = [(learner, n, done[learner]) for learner, n in Counter(learners.values()).items()]
        tasks = {
            label: self._progress.add_task(label, total=total, completed=completed, running=0, failed=0)
            for label, total, completed in [(name, len(learners), done.total()), *counts]
        }
        self._all = tasks[name]
        self._task = {digest: tasks[learner] for digest, learner in learners.items()}
        self._line_s = time.monotonic()

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        for task in self._progress.task_ids:
            self._progress.update(task, running=0)  # nothing is running after an interrupt
        self._progress.stop()
        if not self._console.is_terminal:
            self._print_line()

    def start(self, job: Job) -> None:
        """Notes that a job has started."""
        for run in job:
            self._count(run.digest, running=1)

    def advance(self, records: list[Record]) -> None:
        """Notes that a job has ended, with these records."""
        for record in records:
            is_failed = record.status == "failed"
            self._count(record.digest, running=-1, done=1 - is_failed, failed=int(is_failed))
        if not self._console.is_terminal and time.monotonic() - self._line_s > _LINE_EVERY_S:
            self._line_s = time.monotonic()
            self._print_line()

    def _count(self, digest: str, running: int, done: int = 0, failed: int = 0) -> None:
        for task in (self._task[digest], self._all):
            now = self._progress.tasks[task].fields
            running_now, failed_now = now["running"] + running, now["failed"] + failed
            self._progress.update(task, advance=done, running=running_now, failed=failed_now)

    def _print_line(self) -> None:
        task = self._progress.tasks[self._all]
        failed = f", {task.fields['failed']} failed" if task.fields["failed"] else ""
        left = time_left(task.time_remaining) if task.time_remaining else ""
        line = f"{task.description}: {task.completed:,.0f} of {task.total:,.0f} runs{failed}{left}"
        self._console.print(line, markup=False, soft_wrap=True)


def time_left(seconds: float) -> str:
    """Returns what a display adds about the time left."""
    return f", about {seconds:,.0f} s left" if seconds < 120 else f", about {seconds / 60:,.0f} min left"
