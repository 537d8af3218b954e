"""Shows progress: how many runs, say, are done and failed, and the time left."""

import time
from collections.abc import Mapping, Sequence
from typing import Final, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.text import Text

_LINE_EVERY_S: Final = 30.0  # where the output is not a terminal
_TRUST: Final = 0.1  # an expected time counts as much as the time that this share of the whole has taken
_STARTING: Final = 0.01  # while less than this share is done, code is imported and compiled, only once


class Display(ProgressColumn):
    """A bar, or occasional lines where the output is not a terminal."""

    def __init__(self, name: str, costs: Mapping[str, float], expected_s: float, n_done: int = 0) -> None:
        """Takes what each thing to do costs, the time of all, 0 if unknown, and how many are done already."""
        super().__init__()
        self._costs, self._expected_s = costs, expected_s
        self._n, self._n_done, self._n_failed = n_done + len(costs), n_done, 0
        self._console = Console(stderr=True)
        columns = TextColumn("{task.description}", markup=False), BarColumn(), self
        self._progress = Progress(*columns, console=self._console, disable=not self._console.is_terminal)
        self._task = self._progress.add_task(name, total=sum(costs.values()))
        self._line_s = self._started_s = time.monotonic()
        self._started = 0.0  # the share that was done then
        self._end_s = self._started_s + expected_s if expected_s else None

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()
        if not self._console.is_terminal:
            self._print_line()

    def advance(self, ended: Sequence[str], n_failed: int = 0, name: str | None = None) -> None:
        """Notes what has ended, how many of that have failed, and perhaps what follows."""
        self._n_done, self._n_failed = self._n_done + len(ended) - n_failed, self._n_failed + n_failed
        self._progress.update(self._task, advance=sum(self._costs[key] for key in ended), description=name)
        now_s, share = time.monotonic(), self._progress.tasks[0].percentage / 100
        if share < _STARTING:
            self._started_s, self._started = now_s, share
        trust = _TRUST if self._expected_s else 0.0
        if weight := share - self._started + trust:
            whole_s = (now_s - self._started_s + trust * self._expected_s) / weight
            self._end_s = now_s + (1 - share) * whole_s
        if not self._console.is_terminal and time.monotonic() - self._line_s > _LINE_EVERY_S:
            self._line_s = time.monotonic()
            self._print_line()

    def render(self, task: Task) -> Text:  # noqa: ARG002
        """Says how many are done and the time left, which falls while they run."""
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
