"""What a report is made of: items, each with its table, its figure and its sentences in one place.

    @item("steps", "how many steps an episode takes after training", {"n": "runs", "steps": ""})
    def steps(runs):
        for cell in runs:
            yield cell.row(n=cell.n, steps=cell.final("steps").mean())

    @steps.figure("Steps of an episode.")
    def _(tables, data): ...  # all tables of the report, and what they were computed from

    @steps.sentence
    def _(table, folder): ...

The folder of results, its README, the page and the certificate iterate over items; nothing else lists them.
"""

import html
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

import pandas as pd

from benchmark.analysis.intervals import Estimate as Estimate
from benchmark.drawing.tables import decimals_of, inert, link, plain, show

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from benchmark.execution.store import Store
    from benchmark.experiments import Experiment
    from benchmark.reports.folder import Folder

Rows = Iterable[Mapping[str, Any]] | pd.DataFrame | None
Frames = Mapping[str, pd.DataFrame]  # by the item's name
PICTURES: Final = ("svg", "png")  # forms of a figure, of which a folder has the smaller one
_NO_NUMBER: Final = "-"
_PLACES: Final = ("scenario", "condition", "grid", "point")  # columns that say where learners are compared


@dataclass(frozen=True)
class Finding:
    """A sentence in Markdown. Its numbers are links to the rows that they come from, see `tables.link`.

    Words that judge are verdicts, and used for nothing else.
    """

    text: str
    verdict: str = ""  # "" if it only describes, "several" if there are


@dataclass(eq=False)
class Item:
    """A table, a figure, or both, with its sentences; or files of another form. Made by `item`."""

    compute: Callable[[Any], Rows] | None
    name: str
    description: str
    columns: Mapping[str, str] | None = None  # that readers see; by default all
    where: Callable[[pd.DataFrame], pd.DataFrame] | None = None
    is_measured: bool = False
    best: str = ""  # the column by which readers see rows sorted within a place; "-": the smallest first
    files: tuple[str, ...] = ()  # of another form
    write: Callable[[Any, Path], None] | None = None
    caption: str = ""  # of the figure
    draw: "Callable[[Frames, Any], Figure | None] | None" = None

    def __post_init__(self) -> None:
        self.display: Callable[[pd.DataFrame], pd.DataFrame] = self._chosen
        self._tell: list[Callable[[pd.DataFrame, Folder], Any]] = []

    def figure(self, caption: str) -> Callable[[Any], Any]:
        """Decorates what draws the figure: a function of all tables and the data; it may return None."""

        def register(function: Any) -> Any:
            self.caption, self.draw = caption, function
            return function

        return register

    def sentence(self, function: Any) -> Any:
        """Decorates what tells a finding, several, or None: a function of the published table and folder."""
        self._tell.append(function)
        return function

    def shown(self, function: Any) -> Any:
        """Decorates what readers see of the table: a function that returns a data frame of Markdown texts."""
        self.display = function
        return function

    def table(self, data: Any) -> pd.DataFrame | None:
        """Computes the table; None if there is nothing to tabulate."""
        rows = None if self.compute is None else self.compute(data)
        if rows is None or isinstance(rows, pd.DataFrame):
            return rows
        flat = [expanded(row) for row in rows]
        return pd.DataFrame(flat) if flat else None

    def findings(self, folder: "Folder") -> Iterator[Finding]:
        """Yields what there is to tell, from published files alone."""
        if self._tell and f"{self.name}.csv" in folder:
            for function in self._tell:
                told = function(folder.frame(self.name), folder)
                for each in [told] if isinstance(told, str | Finding) else told or ():
                    yield each if isinstance(each, Finding) else Finding(each)

    def patterns(self) -> tuple[str, ...]:
        """Lists the names that its files can have, as patterns."""
        return self.files or tuple(f"{self.name}.{end}" for end in ("csv", "tex", *PICTURES, "pdf"))

    def _chosen(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Shows the chosen columns of a table: numbers with their intervals, and with links to their rows."""
        if self.where is not None:
            frame = self.where(frame)
        columns = self.columns or {
            str(name): ""
            for name in frame
            if "learner" not in frame or name not in ("algorithm", "observation")
        }
        decimals = {
            key: decimals_of(frame[key], is_bounded=f"{key}_low" in frame) for key in columns if key in frame
        }
        rows = [row for _, row in self._sorted(frame).iterrows()]
        shown = {
            columns[key] or key.replace("_", " "): [entry(row, key, self.name, digits) for row in rows]
            for key, digits in decimals.items()
        }
        return pd.DataFrame(shown)

    def _sorted(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Returns the rows with the best first; those of a place stay together."""
        by = self.best.removeprefix("-")
        if by not in frame or frame.empty:
            return frame
        is_ascending = by != self.best
        places = [key for key in _PLACES if key in frame]
        parts = frame.groupby(places, sort=False, dropna=False) if places else [("", frame)]
        return pd.concat(rows.sort_values(by, ascending=is_ascending, kind="stable") for _, rows in parts)


def item(
    name: str,
    description: str,
    columns: Mapping[str, str] | None = None,
    *,
    where: Callable[[pd.DataFrame], pd.DataFrame] | None = None,
    is_measured: bool = False,
    best: str = "",
) -> Callable[[Callable[[Any], Rows]], Item]:
    """Makes an item of the function that computes its table.

    The function takes the report's data and yields rows, whose values may be `Estimate`s, or returns a data
    frame, or None.

    Args:
      name: The stem of its files.
      description: What its files hold.
      columns: Those that readers see, with their labels ("": the name); by default all.
      where: Chooses the rows that readers see.
      is_measured: Whether it holds measured times or memory, which differ every time.
      best: The column by which readers see the rows of a place sorted, the largest first; with "-" before it,
        the smallest. The CSV file has them in the order in which they are yielded.
    """
    return lambda function: Item(function, name, description, columns, where, is_measured, best)


def no_rows(frame: pd.DataFrame) -> pd.DataFrame:
    """Chooses no rows for readers, since the figure shows them."""
    return frame.iloc[:0]


def drawing(name: str, description: str, caption: str) -> Callable[[Any], Item]:
    """Makes an item of a figure without a table of its own; its function is one for `Item.figure`."""
    return lambda function: Item(None, name, description, caption=caption, draw=function)


def writing(name: str, description: str, *files: str) -> Callable[[Callable[[Any, Path], None]], Item]:
    """Makes an item of a function that writes files of another form: of the data and a folder."""
    return lambda function: Item(None, name, description, files=files, write=function)


def expanded(row: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a row with an estimate's interval in columns of their own.

    >>> expanded({"n": 2, "share": Estimate(0.5, 0.1, 0.9)})
    {'n': 2, 'share': 0.5, 'share_low': 0.1, 'share_high': 0.9}
    """
    flat: dict[str, Any] = {}
    for key, value in row.items():
        if isinstance(value, Estimate):
            flat |= {key: value.value, f"{key}_low": value.low, f"{key}_high": value.high}
        else:
            flat[key] = value
    return flat


def entry(row: pd.Series, key: str, table: str, decimals: int | None = None) -> str:
    """Returns an entry of a table as Markdown: a text, or a number with its interval and a link."""
    value = row[key]
    if isinstance(value, str):
        return inert(value)
    text = number(value, decimals)
    if text == _NO_NUMBER:
        return text
    low, high = row.get(f"{key}_low"), row.get(f"{key}_high")
    is_open = low is None or high is None or math.isnan(low) or math.isinf(low)
    ends = "" if is_open else f" [{show(low, decimals)}, {show(high, decimals)}]"
    return link(text, table, row) + ends


def as_written(entry: str) -> str:
    """Returns an entry of a table without links, and as its text was before it was escaped.

    >>> as_written("a &#60;b>"), as_written("[0.63](summary.csv#row=13) [0.5, 0.7]")
    ('a <b>', '0.63 [0.5, 0.7]')
    """
    return html.unescape(plain(entry))


def number(value: Any, decimals: int | None = None) -> str:
    """Returns a number as readers see it, see `show`.

    >>> number(0.7), number(math.nan), number(math.inf), number(1200)
    ('0.7', '-', 'never', '1,200')
    """
    if pd.isna(value):
        return _NO_NUMBER
    if isinstance(value, float) and math.isinf(value):
        return "never"  # of steps until something happens
    return f"{value:,}" if isinstance(value, int) else show(value, decimals)


class Data(Protocol):
    """What a report computes its items from: the records of an experiment, as populations."""

    @property
    def note(self) -> str:
        """What readers must know of missing runs or seeds, as a sentence; empty if nothing."""

    @property
    def is_incomplete(self) -> bool:
        """Whether runs are missing: tables and figures are then marked as partial."""

    @property
    def facts(self) -> Mapping[str, object]:
        """What README and page need in addition to the tables, for the manifest; numbers and texts only."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Report:
    """A kind of report: what it demands of an experiment, how it loads it, and what it shows."""

    name: str
    question: str  # the page's heading
    check: Callable[["Experiment"], None]  # raises InputError if it cannot report on the experiment
    # Of an experiment, its store, other seeds than declared and whether runs may be missing, returns a `Data`
    load: Callable[["Experiment", "Store", Sequence[int] | None, bool], Any]
    items: tuple[Item, ...]
    document: Path  # a template of Markdown with places for the items, see `benchmark.reports.document`
    headline: Callable[["Folder"], Finding | None] = lambda _: None
    forecast: Callable[["Experiment"], str] = lambda _: ""  # what its runs cannot show; or empty
    lead: str = ""  # the item whose figure stands above the headline on the page
    packages: tuple[str, ...] = ()  # that it needs beyond the basic ones
    reads_curves: bool = (
        False  # whether curves alone are enough, see `Solved` in `benchmark.experiments.schema`
    )
