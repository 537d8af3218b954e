"""How long runs take: an estimate before they start, and a display while they are trained."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.text import Text

from benchmark.experiments import RunSpecification
from benchmark.folder import Folder
from envs import InputError

_LINE_EVERY_S: Final = 30.0  # where the output is not a terminal


def estimate(
    missing: Sequence[RunSpecification], folder: Path, workers: int
) -> tuple[str, Mapping[str, float]]:
    """Estimates how long runs take on some workers, from the results of the same learners in a folder.

    Returns the time in words, and the seconds of each run by digest. If there are no such results, each run
    counts as a second.
    """
    try:
        published = _seconds(Folder(folder))
        costs = {run.digest: published[run.variant, run.observation] for run in missing}
    except (InputError, KeyError):
        text = f"for an unknown time: {folder} has no results of these learners"
        return text, dict.fromkeys((run.digest for run in missing), 1.0)
    time_s = max(sum(costs.values()) / workers, *costs.values())
    by = f"{workers} worker{'s' * (workers > 1)}"
    return f"{about(time_s)} with {by}, if as fast as for the results in {folder}", costs


def _seconds(folder: Folder) -> dict[tuple[str, str], float]:
    """Returns the seconds of a published run, by variant and observation.

    The total time is divided in proportion to CPU time or, without a table of costs, equally.
    """
    manifest = folder.manifest
    mean = manifest["busy_time_s"] / manifest["runs"]
    forms = ((name, form) for name, variant in manifest["algorithms"].items() for form in variant["settings"])
    seconds = dict.fromkeys(forms, mean)
    if "cost.csv" in folder:
        cost = folder.frame("cost").set_index(["variant", "observation"])
        cpu, runs = cost["cpu_ms" if "cpu_ms" in cost else "cpu_time_s"], cost["runs"]
        seconds |= (cpu * (mean * runs.sum() / (cpu @ runs))).to_dict()
    return seconds


class Display(ProgressColumn):
    """A bar, or occasional lines where the output is not a terminal.

    The time left is extrapolated from the work done so far, and counts down between updates.
    """

    def __init__(self, name: str, costs: Mapping[str, float], n_done: int) -> None:
        """Takes each item's cost, in any unit, and the number already done."""
        super().__init__()
        self._costs, self._n = costs, n_done + len(costs)
        self._n_done, self._n_failed = n_done, 0
        self._console = Console(stderr=True)
        columns = TextColumn("{task.description}", markup=False), BarColumn(), self
        self._progress = Progress(*columns, console=self._console, disable=not self._console.is_terminal)
        self._task = self._progress.add_task(name, total=sum(costs.values()))
        self._line_s = self._started_s = time.monotonic()
        self._end_s: float | None = None

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()
        if not self._console.is_terminal:
            self._print_line()

    def advance(self, ended: Sequence[str], n_failed: int = 0) -> None:
        """Counts items that have ended, and failures among them."""
        self._n_done, self._n_failed = self._n_done + len(ended) - n_failed, self._n_failed + n_failed
        task, now_s = self._progress.tasks[0], time.monotonic()
        self._progress.update(self._task, advance=sum(self._costs[key] for key in ended))
        if task.percentage:
            self._end_s = self._started_s + (now_s - self._started_s) / (task.percentage / 100)
        if not self._console.is_terminal and now_s - self._line_s > _LINE_EVERY_S:
            self._line_s = now_s
            self._print_line()

    def render(self, task: Task) -> Text:  # noqa: ARG002
        """Says how many are done and the time left."""
        return Text(self._text())

    def _text(self) -> str:
        text = f"{self._n_done:,} of {self._n:,} done" + f", {self._n_failed} failed" * (self._n_failed > 0)
        if self._n_done + self._n_failed == self._n or self._end_s is None:
            return text
        return f"{text}, {about(self._end_s - time.monotonic())} left"

    def _print_line(self) -> None:
        line = f"{self._progress.tasks[0].description}: {self._text()}"
        self._console.print(line, markup=False, soft_wrap=True)


def about(seconds: float) -> str:
    """Returns a time for readers, such as "about 17 minutes"."""
    if seconds < 90:
        return "about a minute" if seconds > 40 else "less than a minute"
    return f"about {seconds / 60:.0f} minutes" if seconds < 6000 else f"about {seconds / 3600:.1f} hours"
