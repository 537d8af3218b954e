"""Shows the progress of an experiment: runs done, running and failed, speed, and time left."""

import threading
import time
from collections import Counter
from collections.abc import Sequence
from typing import Final, Self

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from benchmark.execution.plan import Job
from benchmark.execution.store import Record
from benchmark.experiments import Experiment, specifications

_LINE_EVERY_S: Final = 30.0  # where the output is not a terminal


class Display:
    """A table of all populations with a bar below, or occasional lines where the output is not a terminal.

    The table has a column per scenario. Its rows are learners or conditions, or pairs of them if there are
    several of both.
    """

    def __init__(
        self,
        experiment: Experiment,
        seeds: Sequence[int] | None,
        ended: set[str],
        jobs: Sequence[Job],
        console: Console | None = None,
    ) -> None:
        """Lays out the table.

        Args:
          experiment: What is executed.
          seeds: Other seeds than the declared ones.
          ended: Digests of the runs that have a valid record.
          jobs: What will be executed.
          console: Where to show it; standard error by default.
        """
        self._console = console or Console(stderr=True)
        self._lock = threading.Lock()
        self._place: dict[str, tuple[str, str]] = {}  # of a run, by its digest: row and column
        conditions = list(experiment.conditions)
        learners = dict.fromkeys((arm, observation) for _, arm, observation in experiment.populations)
        for condition in conditions:
            for scenario, arm, observation in experiment.populations:
                names = [condition] if len(conditions) > 1 else []
                names += [arm, observation] if len(learners) > 1 or not names else []
                for run in specifications(experiment, condition, scenario, arm, observation, seeds):
                    # Runs that several conditions share are counted under the first.
                    self._place.setdefault(run.digest, (", ".join(names), run.scenario.name))
        self._rows = list(dict.fromkeys(row for row, _ in self._place.values()))
        self._columns = list(dict.fromkeys(column for _, column in self._place.values()))
        self._all = Counter(self._place.values())
        self._done = Counter(place for digest, place in self._place.items() if digest in ended)
        self._running: Counter[tuple[str, str]] = Counter()
        self._failed: Counter[tuple[str, str]] = Counter()
        self._title = experiment.name
        self._updates = 0
        self._started_s = self._line_s = time.monotonic()
        self._bar = Progress(
            TextColumn("{task.fields[runs]} of " + f"{len(self._place):,} runs,"),
            *([BarColumn()] if self._console.width >= 90 else []),
            TextColumn("{task.fields[speed]} updates/s,"),
            TimeElapsedColumn(),
            TextColumn("elapsed,"),
            TimeRemainingColumn(),
            TextColumn("left"),
            console=self._console,
            speed_estimate_period=120,
        )
        # The time left is estimated from jobs, not runs: a job of many tables ends all at once.
        self._task = self._bar.add_task("", total=len(jobs), runs=f"{self._done.total():,}", speed="0")
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
            self._running.update(self._place[run.digest] for run in job)

    def advance(self, records: list[Record]) -> None:
        """Notes that a job has ended, with these records."""
        with self._lock:
            for record in records:
                place = self._place[record.digest]
                self._running[place] -= 1
                (self._failed if record.status == "failed" else self._done)[place] += 1
                self._updates += int(record.arrays.get("updates", 0))  # a failed run has none
            speed = f"{self._updates / (time.monotonic() - self._started_s):,.0f}"
            self._bar.update(self._task, advance=1, runs=f"{self._done.total():,}", speed=speed)
            if not self._console.is_terminal and time.monotonic() - self._line_s > _LINE_EVERY_S:
                self._line_s = time.monotonic()
                self._print_line()

    def _print_line(self) -> None:
        """Prints the progress as one line."""
        task = self._bar.tasks[0]
        line = f"{self._title}: {task.fields['runs']} of {len(self._place):,} runs"
        line += f", {self._failed.total()} failed" if self._failed else ""
        line += f", {task.fields['speed']} updates/s"
        line += f", about {task.time_remaining:,.0f} s left" if task.time_remaining is not None else ""
        self._console.print(line, markup=False, soft_wrap=True)

    def __rich__(self) -> Group:
        """Returns the table and the bar."""
        with self._lock:
            title = Text(self._title)
            table = Table(title=title, title_justify="left", box=None, header_style="", pad_edge=False)
            table.add_column("", no_wrap=True)
            for column in self._columns:
                table.add_column(Text(column), justify="right", min_width=16, no_wrap=True)
            for row in self._rows:
                table.add_row(Text(row), *(self._entry((row, column)) for column in self._columns))
        note = Text("done/all   > running   ! failed, will be tried again", style="dim")
        return Group(table, note, self._bar)

    def _entry(self, place: tuple[str, str]) -> Text:
        """Returns an entry of the table."""
        if not self._all[place]:  # its runs are counted under another condition
            return Text("-", style="dim")
        is_done = self._done[place] == self._all[place]
        text = Text(f"{self._done[place]}/{self._all[place]}", style="green" if is_done else "")
        if self._running[place]:
            text.append(f" >{self._running[place]}", style="bold cyan")
        if self._failed[place]:
            text.append(f" !{self._failed[place]}", style="bold red")
        return text
