"""Items: a table, its figure, and what its columns mean, in one place.

The function of a table takes the analysis of its study; that of a figure takes the analysis and the table.
"""

import math
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Any, Final

import pandas as pd
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from benchmark.analysis.intervals import Estimate as Estimate
from benchmark.drawing.style import save_figure, settings
from benchmark.drawing.tables import decimals_of, show

Frames = Mapping[str, pd.DataFrame]  # by the item's name
Rows = Iterable[Mapping[str, object]] | pd.DataFrame | None  # values may be `Estimate`s
Draw = Callable[..., Figure | None]
Show = Callable[[pd.DataFrame], pd.DataFrame]
# What columns mean: in any table, and in those of single studies.
COLUMNS: Final[Mapping[str, dict[str, str]]] = tomllib.loads(
    Path(__file__).with_name("columns.toml").read_text(encoding="utf-8")
)
_KEYS: Final = ("scenario", "condition", "grid", "point")  # columns that say where learners are compared


@dataclass(eq=False)
class Item:
    """A table, a figure, both, or a file in another format. A decorator of the table's function."""

    name: str  # the stem of its files
    description: str  # what its files hold
    columns: str = ""  # that readers see, which spaces separate; by default all
    _: KW_ONLY
    labels: Mapping[str, str] = field(default_factory=dict)  # of columns, if not the name
    where: Show | None = None  # chooses the rows that readers see
    is_measured: bool = False  # whether it holds measured times or memory, which differ every time
    best: str = ""  # the column by which rows are shown sorted, largest first; with "-": smallest first
    compute: Callable[..., Rows] | None = None
    file: str = ""  # of another form
    write: Callable[..., None] | None = None
    caption: str = ""  # of the figure
    draw: Draw | None = None

    def __call__(self, compute: Callable[..., Rows]) -> "Item":
        """Takes the function of the table."""
        self.compute = compute
        return self

    def figure(self, caption: str) -> Callable[[Draw], Draw]:
        """Decorates what draws the figure; it may return None."""

        def register(function: Draw) -> Draw:
            self.caption, self.draw = caption, function
            return function

        return register

    def tabulate(self, analysis: Any) -> pd.DataFrame | None:
        """Computes the table; None if there is nothing to tabulate."""
        rows = None if self.compute is None else self.compute(analysis)
        if rows is None or isinstance(rows, pd.DataFrame):
            return rows
        rows = [rows] if isinstance(rows, Mapping) else [*rows]
        return pd.DataFrame(map(expanded, rows)) if rows else None

    def save(self, analysis: Any, tables: Frames, directory: Path) -> None:
        """Writes the figure or the other file."""
        with settings():
            table = tables.get(self.name, pd.DataFrame() if self.compute is None else None)
            figure = self.draw(analysis, table) if self.draw and table is not None else None
            if figure is not None:
                save_figure(figure, directory / f"{self.name}.svg")
                plt.close(figure)  # if its author made it in pyplot
        if self.write is not None:
            self.write(analysis, directory / self.file)

    def files(self) -> tuple[str, ...]:
        """Lists the names that its files can have."""
        return (self.file,) if self.file else (f"{self.name}.csv", f"{self.name}.svg")

    def display(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Returns the table as readers see it: numbers with their intervals."""
        if self.where is not None:
            frame = self.where(frame)
        hidden = {"variant", "observation"} if "learner" in frame else set[str]()
        columns = self.columns.split() or [str(name) for name in frame if name not in hidden]
        decimals = {key: decimals_of(frame, key) for key in columns if key in frame}
        rows = [row for _, row in self._sorted(frame).iterrows()]
        shown = {key: [entry(row, key, n) for row in rows] for key, n in decimals.items()}
        return pd.DataFrame(shown).rename(columns=lambda key: self.labels.get(key, key.replace("_", " ")))

    def _sorted(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Returns the rows with the best first; those of a scenario and condition stay together."""
        by = self.best.removeprefix("-")
        if by not in frame or frame.empty:
            return frame
        keys = [key for key in _KEYS if key in frame]
        parts = frame.groupby(keys, sort=False, dropna=False) if keys else [("", frame)]
        return pd.concat(rows.sort_values(by, ascending=by != self.best, kind="stable") for _, rows in parts)


item: Final = Item  # as a decorator


def no_rows(frame: pd.DataFrame) -> pd.DataFrame:
    """Chooses no rows for readers, since the figure shows them."""
    return frame.iloc[:0]


def drawing(name: str, description: str, caption: str) -> Callable[[Draw], Item]:
    """Makes an item of a figure without a table of its own; its function is one for `Item.figure`."""
    return lambda function: Item(name, description, caption=caption, draw=function)


def writing(name: str, description: str, file: str) -> Callable[[Callable[..., None]], Item]:
    """Makes an item of a function that writes a file of another form, whose argument `path` is its path."""
    return lambda function: Item(name, description, file=file, write=function)


def expanded(row: Mapping[str, object]) -> dict[str, object]:
    """Returns a row with an estimate's interval in columns of their own.

    >>> expanded({"n": 2, "share": Estimate(0.5, 0.1, 0.9)})
    {'n': 2, 'share': 0.5, 'share_low': 0.1, 'share_high': 0.9}
    """
    flat: dict[str, object] = {}
    for key, value in row.items():
        names = (key, f"{key}_low", f"{key}_high") if isinstance(value, Estimate) else (key,)
        flat |= zip(names, value if isinstance(value, Estimate) else (value,), strict=True)
    return flat


def entry(row: pd.Series, key: str, decimals: int | None = None) -> str:
    """Returns an entry of a table as Markdown: a text, or a number with its interval.

    >>> entry(pd.Series({"score": 0.5, "score_low": 0.25, "score_high": 1.0}), "score")
    '0.5 [0.25, 1]'
    """
    value = row[key]
    if isinstance(value, str):
        return value
    if pd.isna(value):
        return "-"
    text = f"{value:,}" if isinstance(value, int) else show(value, decimals)
    if math.isinf(value):
        text = "never"  # of steps until something happens
    low, high = row.get(f"{key}_low"), row.get(f"{key}_high")
    is_open = low is None or high is None or math.isnan(low) or math.isinf(low)
    ends = "" if is_open else f" [{show(low, decimals)}, {show(high, decimals)}]"
    return text + ends
