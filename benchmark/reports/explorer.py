"""Items of any report: what the page's explorer shows of every learner, one agent over training among it."""

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from benchmark.analysis import snapshots
from benchmark.analysis.snapshots import Shown
from benchmark.drawing import tables
from benchmark.reports.item import Frames, Item
from envs import ACTIONS

Lister = Callable[[Any], Iterable[Shown]]  # of a report's data: what is shown


def explorer_items(lister: Lister) -> tuple[Item, ...]:
    """Returns the items with the explorer's files.

    Args:
      lister: A module's function, see `Item`.
    """
    return (
        Item(
            name="agent",
            description="score of the agent of the first seed, at every step of which there is a map",
            compute=partial(_agents, lister),
        ),
        Item(
            name="agents",
            description="final greedy policy of every agent, its score and success (of a large population, "
            f"of the first {snapshots.MOST_AGENTS}); `greedy` has a letter per cell, row by row: A to Z and "
            "a to f stand for 0 to 31, the sum of "
            f"{', '.join(f'{1 << i} ({name})' for i, name in enumerate(ACTIONS))} over the greedy actions",
            compute=partial(_final_policies, lister),
        ),
        Item(
            name="agent_maps",
            description="what the agent in `agent.csv` values and does in every cell over training, one file "
            "per scenario",
            files=("agent_*.csv",),
            write=partial(_write_maps, lister),
        ),
        Item(
            name="optimum",
            description="exact optimal values and actions, by discount",
            compute=partial(_optimum, lister),
        ),
    )


def _agents(lister: Lister, data: Any, _: Frames) -> pd.DataFrame | None:
    shown = list(lister(data))
    return snapshots.agents(shown) if shown else None


def _final_policies(lister: Lister, data: Any, _: Frames) -> pd.DataFrame | None:
    shown = list(lister(data))
    return snapshots.final_policies(shown) if shown else None


def _optimum(lister: Lister, data: Any, _: Frames) -> pd.DataFrame | None:
    shown = list(lister(data))
    return snapshots.optimum(shown) if shown else None


def _write_maps(lister: Lister, data: Any, _: Frames, directory: Path) -> None:
    shown = list(lister(data))
    for scenario in dict.fromkeys(each.population.scenario for each in shown):
        there = [each for each in shown if each.population.scenario == scenario]
        tables.write_csv(snapshots.values(there), directory / f"agent_{scenario}.csv")
