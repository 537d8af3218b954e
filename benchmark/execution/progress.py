"""Shows the progress of an experiment: runs done, running and failed, speed, and time left."""

import threading
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Final, Self

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.text import Text

from benchmark.execution.plan import Job
from benchmark.execution.store import Record
from benchmark.experiments import RunSpecification

_LINE_EVERY_S: Final = 30.0  # where the output is not a terminal


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
        self._started_s = self._line_s = time.monotonic()
        self._bar = Progress(
            TextColumn("{task.description}"),
            *([BarColumn()] if self._console.width >= 90 else []),
            TimeElapsedColumn(),
            TextColumn("elapsed,"),
            TimeRemainingColumn(),
            TextColumn("left"),
            console=self._console,
            speed_estimate_period=120,
        )
        # The time left is estimated from jobs, not runs: a job of many tables ends all at once.
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

    def advance(self, records: list[Record]) -> None:
        """Notes that a job has ended, with these records."""
        with self._lock:
            for record in records:
                learner = self._learner[record.digest]
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

    def _print_line(self) -> None:
        left = self._bar.tasks[0].time_remaining
        about = "" if left is None else f", about {left:,.0f} s left"
        self._console.print(f"{self._name}: {self._summary()}{about}", markup=False, soft_wrap=True)

    def __rich__(self) -> Group:
        """Returns the counts of every learner, and the bar."""
        with self._lock:
            lines = [Text(self._name, style="bold")]
            for learner, n in self._all.items():
                running, failed = self._running[learner], self._failed[learner]
                line = f"{learner}: {self._done[learner]:,} of {n:,} done"
                line += f", {running:,} running" * (running > 0)
                lines.append(Text(line).append(f", {failed:,} failed" * (failed > 0), style="bold red"))
        return Group(*lines, self._bar)
