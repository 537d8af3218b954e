"""Draws the figures of a report on several cores."""

from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Self

from benchmark.execution.executors.processes import interrupts_blocked
from benchmark.reports.item import Frames, Item


class Drawing:
    """Draws figures in worker processes and in this one; used as a context manager.

    Workers import what they need while this process still computes the tables.
    """

    def __init__(self, jobs: int) -> None:
        """Starts the workers: one fewer than there are jobs, since this process draws, too."""
        self._pool = ProcessPoolExecutor(jobs - 1, get_context("spawn")) if jobs > 1 else None
        self._here: list[partial[None]] = []
        self._there: list[tuple[Future[None], partial[None]]] = []
        self._jobs = jobs
        if self._pool is not None:
            with interrupts_blocked():
                for _ in range(jobs - 1):
                    self._pool.submit(import_module, "benchmark.drawing.style")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def start(
        self, items: Sequence[Item], frames: Frames, context: Any, directory: Path, *, is_partial: bool
    ) -> None:
        """Has the workers start drawing their share; see `draw_figure`."""
        tasks = [
            partial(draw_figure, item, frames, context, directory, is_partial=is_partial)
            for item in items
            if item.draw is not None
        ]
        self._here = tasks[:: self._jobs]
        if self._pool is not None:
            there = [task for i, task in enumerate(tasks) if i % self._jobs]
            try:
                with interrupts_blocked():
                    self._there = [(self._pool.submit(task), task) for task in there]
            except BrokenProcessPool:
                self._here = tasks

    def finish(self) -> None:
        """Draws the share of this process, and waits for the others."""
        for task in self._here:
            task()
        for future, task in self._there:
            try:
                future.result()
            except BrokenProcessPool:  # a worker was killed, and with it the pool
                task()


def draw_figure(item: Item, frames: Frames, context: Any, directory: Path, *, is_partial: bool) -> None:
    """Draws an item's figure if it has one; needs nothing but its arguments.

    Args:
      item: Of a report.
      frames: The tables of all items.
      context: Of the report's data.
      directory: Where to write it.
      is_partial: Whether it is marked as drawn from some of the runs.
    """
    if item.draw is None:
        return
    from benchmark.drawing.style import write_figure

    figure = item.draw(frames, context)
    if figure is not None:
        if is_partial:
            figure.suptitle("PARTIAL: runs are missing", color="firebrick")
        write_figure(figure, directory / item.name)
