"""Shows the progress of an experiment: how many runs are done and failed, and the time left."""

import time
from collections.abc import Collection
from typing import Final, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from benchmark.execution.store import Record
from benchmark.experiments import RunSpecification

_LINE_EVERY_S: Final = 30.0  # where the output is not a terminal
_RECENT_S: Final = 600.0  # the time left is estimated from runs that ended so recently


class Display:
    """A bar, or occasional lines where the output is not a terminal."""

    def __init__(
        self, name: str, runs: Collection[RunSpecification], ended: set[str], console: Console | None = None
    ) -> None:
        """Counts all runs of an experiment, of which some have ended."""
        self._console = console or Console(stderr=True)
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[failed]} failed"),
            TimeRemainingColumn(elapsed_when_finished=True),
            console=self._console,
            disable=not self._console.is_terminal,
            speed_estimate_period=_RECENT_S,
        )
        done = sum(run.digest in ended for run in runs)
        self._task = self._progress.add_task(name, total=len(runs), completed=done, failed=0)
        self._line_s = time.monotonic()

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()
        if not self._console.is_terminal:
            self._print_line()

    def advance(self, records: list[Record]) -> None:
        """Notes that a job has ended, with these records."""
        failed = sum(record.status == "failed" for record in records)
        all_failed = self._progress.tasks[0].fields["failed"] + failed
        self._progress.update(self._task, advance=len(records) - failed, failed=all_failed)
        if not self._console.is_terminal and time.monotonic() - self._line_s > _LINE_EVERY_S:
            self._line_s = time.monotonic()
            self._print_line()

    def _print_line(self) -> None:
        task = self._progress.tasks[0]
        failed = f", {task.fields['failed']} failed" if task.fields["failed"] else ""
        left = f", about {task.time_remaining / 60:,.1f} min left" if task.time_remaining else ""
        line = f"{task.description}: {task.completed:,.0f} of {task.total:,.0f} runs{failed}{left}"
        self._console.print(line, markup=False, soft_wrap=True)
