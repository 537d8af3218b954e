"""The finding of a map: how the contrasts ended along its first axis, and who needs fewest steps there."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from benchmark.drawing.tables import link
from benchmark.reports.folder import Folder
from benchmark.reports.item import Finding
from envs.words import listed

_ENDED = {
    "faster": "{x} needs fewer steps than {y}",
    "slower": "{x} needs more steps than {y}",
    "equally fast": "{x} and {y} need equally many steps, within the margin",
    "neither learns": "neither {x} nor {y} learns",
    "budget too short": "the smaller budget is too short for {x} and {y}",
    "undecided": "it is undecided which of {x} and {y} needs fewer steps",
}


def headline(folder: Folder) -> Finding | None:
    """Says how each contrast ended along the first axis; None if no grid with one axis has contrasts."""
    facts = folder.manifest["facts"]
    table = folder.frame("contrasts")
    grids = [name for name in table["grid"].unique() if len(facts["axes"][name]) == 1]
    if not grids:
        return None
    rows = table[table["grid"] == grids[0]]
    ended = [
        _sentence(folder, rows[(rows["x"] == x) & (rows["y"] == y)])
        for x, y in rows[["x", "y"]].drop_duplicates().itertuples(index=False)
    ]
    level = facts["solved"]["success"]
    parts = [*ended, *_fewest(folder, rows), f"A run has *learned* when success stays at or above {level:g}."]
    return Finding(" ".join(parts), "several")


def _sentence(folder: Folder, rows: pd.DataFrame) -> str:
    """Says at which points a contrast ended how."""
    x, y = (folder.names.told(rows[side].iloc[0]) for side in "xy")
    parts = []
    for verdict, text in _ENDED.items():
        found = rows[rows["verdict"] == verdict]
        if len(found):
            parts.append(f"{text.format(x=x, y=y)} at {_points(found, 'contrasts')}")
    told = "; ".join(parts)
    return f"{told[:1].upper()}{told[1:]}."


def _fewest(folder: Folder, rows: pd.DataFrame) -> Iterator[str]:
    """Says whose median is the smallest at each point of the contrasts, if it is known."""
    cells, facts = folder.frame("cells"), folder.manifest["facts"]
    cells = cells[(cells["grid"] == rows["grid"].iloc[0]) & ~cells["algorithm"].isin(facts["references"])]
    best: dict[str, list[pd.Series]] = {}
    for point in rows["point"].unique():
        here = cells[cells["point"] == point]
        least = here[here["steps"] == here["steps"].min()]
        if len(least) == 1 and np.isfinite(least["steps"].iloc[0]):
            row = least.iloc[0]
            best.setdefault(f"{row['algorithm']}, {row['observation']}", []).append(row)
    parts = [
        f"{folder.names.told(name)} at {_points(pd.DataFrame(found), 'cells')}"
        for name, found in best.items()
    ]
    if parts:
        yield f"The smallest median, which is not tested, is that of {'; '.join(parts)}."


def _points(rows: pd.DataFrame, table: str) -> str:
    """Returns the points of rows of a grid with one axis, with a link: "places 1 and 4"."""
    axis = rows["point"].iloc[0].split()[0]
    return f"{axis} {link(listed(point.split()[-1] for point in rows['point']), table, rows)}"
