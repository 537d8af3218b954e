"""Shows an experiment's grid while it runs: what is done, running and failed, how fast, and how long yet."""

import json
import threading
import time
from collections import Counter
from collections.abc import Sequence
from types import TracebackType
from typing import Final, Self

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from benchmark.execution.driver import Job
from benchmark.execution.store import Record
from benchmark.experiments.specification import Experiment, specifications

_LINE_EVERY_S: Final = 30.0  # where the output is no terminal


class Display:
    """A table of the grid and a bar below; where the output is no terminal, a line now and then."""

    def __init__(
        self,
        experiment: Experiment,
        seeds: Sequence[int] | None,
        ended: set[str],
        jobs: Sequence[Job],
        console: Console | None = None,
    ) -> None:
        """Lays out the grid: a row each learner, or each reading where there are several.

        Args:
          experiment: What is run.
          seeds: Other seeds than the declared ones.
          ended: Digests of the runs that need not be run.
          jobs: What is going to be run.
          console: Where to show it; standard error by default.
        """
        self._console = console or Console(stderr=True)
        self._lock = threading.Lock()
        self._place: dict[str, tuple[str, str]] = {}  # of a run: row and column
        self._columns: list[str] = []
        for reading in experiment.readings:
            for scenario, arm, observation in experiment.cells:
                row = reading if len(experiment.readings) > 1 else f"{arm}, {observation}"
                for run in specifications(experiment, reading, scenario, arm, observation, seeds):
                    self._place.setdefault(run.digest, (row, run.scenario.name))
                    self._columns = list(dict.fromkeys([*self._columns, run.scenario.name]))
        self._rows = list(dict.fromkeys(row for row, _ in self._place.values()))
        self._all = Counter(self._place.values())
        self._done = Counter(place for digest, place in self._place.items() if digest in ended)
        self._running: Counter[tuple[str, str]] = Counter()
        self._failed: Counter[tuple[str, str]] = Counter()
        self._title = experiment.name
        self._steps = 0
        self._started_s = self._told_s = time.monotonic()
        self._bar = Progress(
            TextColumn("{task.fields[runs]} of " + f"{len(self._place):,} runs,"),
            *([BarColumn()] if self._console.width >= 90 else []),
            TextColumn("{task.fields[speed]} steps/s,"),
            TimeElapsedColumn(),
            TextColumn("gone,"),
            TimeRemainingColumn(),
            TextColumn("to go"),
            console=self._console,
            speed_estimate_period=120,
        )
        # By jobs, not runs: a job of many tables is over at once.
        self._task = self._bar.add_task("", total=len(jobs), runs=f"{sum(self._done.values()):,}", speed="0")
        self._live = Live(get_renderable=self._render, console=self._console, refresh_per_second=4)

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._running.clear()  # after an interrupt, nothing is
        if self._console.is_terminal:
            self._live.stop()
        else:
            self._console.print(self.line(), markup=False, soft_wrap=True)

    def start(self, job: Job) -> None:
        """Notes that a job has begun, in whatever thread."""
        with self._lock:
            self._running.update(self._place[run.digest] for run in job)

    def advance(self, records: list[Record]) -> None:
        """Notes the records of a job that has ended."""
        with self._lock:
            for record in records:
                place = self._place[record.digest]
                self._running[place] -= 1
                (self._failed if record.status == "failed" else self._done)[place] += 1
                self._steps += _steps(record)
            speed = f"{self._steps / (time.monotonic() - self._started_s):,.0f}"
            self._bar.update(self._task, advance=1, runs=f"{sum(self._done.values()):,}", speed=speed)
            if not self._console.is_terminal and time.monotonic() - self._told_s > _LINE_EVERY_S:
                self._told_s = time.monotonic()
                self._console.print(self.line(), markup=False, soft_wrap=True)

    def line(self) -> str:
        """Returns how far it is, in a line."""
        task = self._bar.tasks[0]
        failed = f", {sum(self._failed.values())} failed" if any(self._failed.values()) else ""
        left = task.time_remaining
        to_go = "" if left is None else f", about {left:,.0f} s to go"
        return (
            f"{self._title}: {task.fields['runs']} of {len(self._place):,} runs{failed}, "
            f"{task.fields['speed']} steps/s{to_go}"
        )

    def _render(self) -> Group:
        """Returns the grid and the bar."""
        with self._lock:
            table = Table(
                title=Text(self._title), title_justify="left", box=None, header_style="", pad_edge=False
            )
            table.add_column("", no_wrap=True)
            for column in self._columns:
                table.add_column(Text(column), justify="right", min_width=16, no_wrap=True)
            for row in self._rows:
                table.add_row(Text(row), *(self._cell((row, column)) for column in self._columns))
        note = Text("done/all, > running, ! failed and to be tried again", style="dim")
        return Group(table, note, self._bar)

    def _cell(self, place: tuple[str, str]) -> Text:
        """Returns one place of the grid."""
        if not self._all[place]:  # its runs are another reading's, too, and counted there
            return Text("-", style="dim")
        is_done = self._done[place] == self._all[place]
        text = Text(f"{self._done[place]}/{self._all[place]}", style="green" if is_done else "")
        if self._running[place]:
            text.append(f" >{self._running[place]}", style="bold cyan")
        if self._failed[place]:
            text.append(f" !{self._failed[place]}", style="bold red")
        return text


def _steps(record: Record) -> int:
    """Returns how many environment steps a run took."""
    if "steps_taken" in record.arrays:
        return int(record.arrays["steps_taken"])
    return int(json.loads(record.specification)["settings"]["budget"]) if record.arrays else 0
