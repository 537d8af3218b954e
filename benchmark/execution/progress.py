"""Shows the progress of an experiment: runs done, running and failed, speed, and time left."""

import threading
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Final, Self

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from benchmark.execution.plan import Job
from benchmark.execution.store import Record
from benchmark.experiments import RunSpecification

_LINE_EVERY_S: Final = 30.0  # where the output is not a terminal
_ENOUGH: Final = 0.1  # of the work, after which the time left is shown


class Display:
    """A line per learner and a bar below, or occasional lines where the output is not a terminal."""

    def __init__(
        self,
        name: str,
        runs: Iterable[RunSpecification],
        ended: set[str],
        jobs: Sequence[Job],
        console: Console | None = None,
    ) -> None:
        """Counts all runs of an experiment, of which some have ended; these jobs will be executed."""
        self._name = name
        self._console = console or Console(stderr=True)
        self._lock = threading.Lock()
        self._learner = {run.digest: f"{run.variant}, {run.observation}" for run in runs}
        self._all = Counter(self._learner.values())
        self._done = Counter(learner for digest, learner in self._learner.items() if digest in ended)
        self._running: Counter[str] = Counter()
        self._failed: Counter[str] = Counter()
        self._updates = 0
        self._kind = {run.digest: kind_of(job[0]) for job in jobs for run in job}
        self._todo = Counter(self._kind.values())  # runs by kind
        self._ended: Counter[tuple[str, ...]] = Counter()
        self._seconds: Counter[tuple[str, ...]] = Counter()  # that the runs which have ended took
        self._began: dict[str, tuple[float, int]] = {}  # when a job started and its size, by its first run
        self._started_s = self._line_s = time.monotonic()
        self._bar = Progress(
            TextColumn("{task.description}"),
            *([BarColumn()] if self._console.width >= 90 else []),
            TimeElapsedColumn(),
            TextColumn("elapsed"),
            console=self._console,
        )
        self._task = self._bar.add_task(self._summary(), total=len(jobs))
        self._live = Live(get_renderable=self.__rich__, console=self._console, refresh_per_second=4)

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._running.clear()  # nothing is running after an interrupt
        if self._console.is_terminal:
            self._live.stop()
        else:
            self._print_line()

    def start(self, job: Job) -> None:
        """Notes that a job has started."""
        with self._lock:
            self._running.update(self._learner[run.digest] for run in job)
            self._began[job[0].digest] = time.monotonic(), len(job)

    def advance(self, records: list[Record]) -> None:
        """Notes that a job has ended, with these records."""
        with self._lock:
            for record in records:
                learner, kind = self._learner[record.digest], self._kind[record.digest]
                self._began.pop(record.digest, None)
                self._ended[kind] += 1
                self._seconds[kind] += record.provenance.get("wall_time_s", 0.0)
                self._running[learner] -= 1
                (self._failed if record.status == "failed" else self._done)[learner] += 1
                self._updates += int(record.arrays.get("updates", 0))  # a failed run has none
            self._bar.update(self._task, advance=1, description=self._summary())
            if not self._console.is_terminal and time.monotonic() - self._line_s > _LINE_EVERY_S:
                self._line_s = time.monotonic()
                self._print_line()

    def _summary(self) -> str:
        failed = f", {self._failed.total()} failed" if self._failed else ""
        speed = self._updates / max(time.monotonic() - self._started_s, 1e-3)
        return f"{self._done.total():,} of {len(self._learner):,} runs{failed}, {speed:,.0f} updates/s"

    def seconds_left(self) -> float | None:
        """Estimates the time until all jobs have ended; None before a tenth of the work has been done.

        A run is expected to take as long as those of its kind that have ended, which must be some of every
        kind. Work is counted in seconds of runs: how many are done in a second is known from the time so far.
        """
        if any(self._ended[kind] == 0 for kind in self._todo):
            return None
        mean = {kind: self._seconds[kind] / self._ended[kind] for kind in self._todo}
        total = sum(mean[kind] * n for kind, n in self._todo.items())
        now, done = time.monotonic(), float(self._seconds.total())
        for digest, (began, size) in self._began.items():
            done += min(now - began, mean[self._kind[digest]] * size)
        if total == 0 or done < _ENOUGH * total:
            return None
        return (total - done) / done * (now - self._started_s)

    def _left(self) -> str:
        """Returns what to say of the time left: for these jobs, which may be one stage of several."""
        left = self.seconds_left()
        return "" if left is None else time_left(left)

    def _print_line(self) -> None:
        self._console.print(f"{self._name}: {self._summary()}{self._left()}", markup=False, soft_wrap=True)

    def __rich__(self) -> Group:
        """Returns the counts of every learner, and the bar."""
        with self._lock:
            lines = [Text(self._name, style="bold")]
            for learner, n in self._all.items():
                running, failed = self._running[learner], self._failed[learner]
                line = f"{learner}: {self._done[learner]:,} of {n:,} done"
                line += f", {running:,} running" * (running > 0)
                lines.append(Text(line).append(f", {failed:,} failed" * (failed > 0), style="bold red"))
            self._bar.update(self._task, description=self._summary() + self._left())
        return Group(*lines, self._bar)


def time_left(seconds: float) -> str:
    """Returns what a display adds about the time left."""
    return f", about {seconds:,.0f} s left" if seconds < 120 else f", about {seconds / 60:,.0f} min left"


def kind_of(run: RunSpecification) -> tuple[str, ...]:
    """Returns what runs have in common that are expected to take equally long: learner and settings."""
    return run.algorithm, run.settings.model_dump_json(), run.observation
