"""What a report is made of: items, each a table, a figure or both, in sections.

Nothing else lists a report's tables and figures. The folder of results, its README and the page iterate over
the items, and so does the certificate of reproduction. Functions of an item are functions of a module, not
lambdas, so that an item can be sent to another process.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

import pandas as pd

from benchmark.reports.published import Published
from benchmark.reports.view import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from benchmark.execution.store import Store
    from benchmark.experiments import Experiment

Frames = Mapping[str, pd.DataFrame]  # by item name
TEMPLATE: Final = Path(__file__).parent / "README.md.jinja"
_FIGURE: Final = (".png", ".svg")


class Data(Protocol):
    """What a report computes its items from: the records of an experiment, as populations."""

    @property
    def note(self) -> str:
        """What readers must know of missing runs or seeds, as a sentence; empty if nothing."""

    @property
    def is_incomplete(self) -> bool:
        """Whether runs are missing: tables and figures are then marked as partial."""

    @property
    def context(self) -> Any:
        """What figures need in addition to the tables: light, and picklable."""

    @property
    def facts(self) -> Mapping[str, object]:
        """What README and page need in addition to the tables, for the manifest; numbers and texts only."""


def whole(frame: pd.DataFrame) -> pd.DataFrame:
    """Displays a table as it is."""
    return frame


@dataclass(frozen=True, eq=False, kw_only=True)
class Item:
    """A table, a figure of it, or both; or files of another form.

    Its table is what `compute` or `tell` returns. `compute` may return None if there is nothing to tabulate,
    and `draw` if there is nothing to draw; the item then has no such file.
    """

    name: str  # the stem of its files
    description: str  # what its files hold, for README's list
    section: str = (
        ""  # where README and page show it, a key of the report's sections; "" in the first of them
    )
    # Of the data, and the tables of the items before it.
    compute: Callable[[Any, Frames], pd.DataFrame | None] | None = None
    # Of published files alone, so that sentences can be written again without a run.
    tell: Callable[[Published], pd.DataFrame] | None = None
    display: Callable[[pd.DataFrame], pd.DataFrame] | None = None  # what .md and .tex show; None: CSV alone
    draw: Callable[[Frames, Any], "Figure | None"] | None = None  # of all tables and the data's context
    caption: str = ""  # of the figure; README and page show a figure that has one
    view: Callable[[Published], Table] | None = None  # the table as README and page show it
    # Whether the page shows it on demand, as its table if it has one, else as its figure; README omits it.
    is_folded: bool = False
    is_measured: bool = False  # whether it holds measured times or memory, which differ every time
    write: Callable[[Any, Frames, Path], None] | None = None  # files of another form, into a folder
    files: tuple[str, ...] = ()  # their names, as patterns

    def patterns(self) -> tuple[str, ...]:
        """Lists the names that its files can have, as patterns."""
        ends = (".csv", ".md", ".tex", *_FIGURE)
        return self.files or tuple(f"{self.name}{end}" for end in ends)

    def label(self, published: Published) -> str:
        """Returns what README calls its files; empty if there are none."""
        if self.files:
            return ", ".join(self.files) if any(map(published.matches, self.files)) else ""
        has_table, has_figure = f"{self.name}.csv" in published, f"{self.name}{_FIGURE[0]}" in published
        if has_table and self.display is not None:
            return self.name
        ends = [".csv"] * has_table + list(_FIGURE) * has_figure
        return f"{self.name}{', '.join(ends)}" if ends else ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Section:
    """A part of README and page."""

    key: str
    heading: str
    text: str = ""  # above its items: Markdown with `code` and links
    # Terms with an explanation each, below its items, and what they are
    terms: Callable[[Published], Sequence[tuple[str, str]]] | None = None
    terms_title: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Report:
    """A kind of report: what it demands of an experiment, how it loads it, and what it shows."""

    name: str
    question: str  # the page's heading
    check: Callable[["Experiment"], None]  # raises InputError if it cannot report on the experiment
    load: Callable[["Experiment", "Store", Sequence[int] | None, bool], Any]  # returns a `Data`
    items: tuple[Item, ...]  # an item may use the tables of those before it
    sections: tuple[Section, ...]  # in the order in which README and page show them
    headline: Callable[[Published], str]  # the finding in a sentence or two, with links; may be empty
    sentences: Callable[[Published], Sequence[str]]  # further findings
    words: Callable[[Published], Sequence[tuple[str, str]]]  # terms that README explains
    lead: str = ""  # name of the item whose figure leads its part of the page, above the headline
    template: Path = TEMPLATE  # of README
    packages: tuple[str, ...] = ()  # that it needs beyond the basic ones

    def items_of(self, section: Section, items: Sequence[Item]) -> Iterator[Item]:
        """Returns the items that a section shows."""
        first = self.sections[0].key
        return (item for item in items if (item.section or first) == section.key)


def measured_files(items: Sequence[Item]) -> tuple[str, ...]:
    """Lists patterns of the files that hold measured times or memory, and so differ every time.

    README repeats the sentences, and so is among them if a measured item has sentences.
    """
    measured = [item for item in items if item.is_measured]
    patterns = [pattern for item in measured for pattern in item.patterns()]
    if any(item.tell is not None for item in measured):
        patterns.append("README.md")
    return tuple(patterns)
