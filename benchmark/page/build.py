"""Writes the page: one HTML file with every report's items and the explorer, made of published files alone.

Nothing is computed here. A number on the page is an entry of a CSV file beside it, and links to its row,
counted as by RFC 7111. So the page can be made from folders of results without a single run. README and the
tables of sentences are written again first, from the same files.
"""

import base64
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import jinja2
from markupsafe import Markup
from PIL import Image

from benchmark.drawing.tables import plain
from benchmark.execution.provenance import digest_of_file, digest_of_source
from benchmark.page import explorer, script
from benchmark.page.sources import Folder, open_folder, section
from benchmark.page.words import Marker, words_of
from benchmark.reports import certificate, files, stamp, texts
from benchmark.reports.item import Item
from benchmark.reports.published import Published
from benchmark.reports.view import Columns, Entry, Table
from envs import InputError

STAMP: Final = ".page-stamp"  # beside the page, see `benchmark.reports.stamp`
# The experiments that `results/index.html` shows, those of them that are there; the first of them leads it.
PUBLISHED: Final = ("compare_deep", "beyond", "ablation", "equivalence", "reproduce")
_TEMPLATES: Final = Path(__file__).parent / "templates"
_FIGURE_COLOURS: Final = 64  # of a figure's palette on the page; more look the same
_ASIDE: Final = re.compile(r"\[[^\]]*\]|\([^)]*\)|`[^`]*`")  # in which no sentence ends
_SENTENCE_END: Final = re.compile(r"(?<=[.?!])\s+(?=[A-Z`])")
_MOST_KEYS: Final = 3  # columns that name a row, and share one column on a narrow screen
_LINKED: Final = re.compile(r'href="([^"#]*\.csv)#row=')  # a file whose rows the page links to
_SPEED: Final = Columns(
    file="speed.csv",
    caption="Speed of this project against a common alternative, measured in the same run",
    keys=("name", "unit", "against"),
    numbers={"per_second": "per second", "baseline": "alternative, per second", "ratio": "ratio"},
)


@dataclass(frozen=True)
class _Entry:
    """An entry of a table on the page."""

    text: Markup
    order: str
    href: str
    kind: str
    note: Markup
    details: Markup
    details_title: str
    others: str = ""  # what names the row besides, on a narrow screen: a line each


@dataclass(frozen=True)
class _Table:
    """A table on the page."""

    caption: str
    source: str  # the CSV file, as the page links to it
    columns: Sequence[tuple[str, bool]]  # label, and whether it holds numbers
    rows: Sequence[Sequence[_Entry]]
    n_keys: int  # columns that name a row; a narrow screen shows them as one
    other_keys: str  # labels of these but the first, a line each


@dataclass(frozen=True)
class _Figure:
    """A picture in the page."""

    caption: str
    source: str  # the SVG file, as the page links to it
    data: str
    width: int
    height: int


def published(results: Path) -> list[str]:
    """Lists the published experiments whose results are there."""
    return [name for name in PUBLISHED if (results / name / "manifest.json").exists()]


def update(results: Path, experiment: str, *, is_published: bool) -> str:
    """Writes the page of an experiment unless it is up to date, or as published.

    Args:
      results: The folder of results.
      experiment: Whose results were just made, see `write`.
      is_published: Whether these are identical to the published ones. If then no other result and no code
        differs from the last commit, the published page is left as it is.

    Returns:
      The page's path, and whether it was left as it was.

    Raises:
      InputError: See `write`.
    """
    names, target = _subjects(results, experiment)
    note = target.with_name(STAMP)
    if stamp.is_up_to_date(note, _inputs(results, names)):
        return f"{target}, up to date"
    if is_published and target.parent == results and certificate.is_as_published(results):
        return f"{target}, as published"
    write(results, experiment)
    stamp.write(note, _inputs(results, names), [target, results / "README.md"])
    return str(target)


def _inputs(results: Path, names: Sequence[str]) -> str:
    """Returns the digest of all files that a page is made of."""
    paths = [path for name in [*names, "speed", "growth"] for path in sorted((results / name).glob("[!.]*"))]
    parts = [f"{path.relative_to(results)} {digest_of_file(path)}" for path in paths if path.is_file()]
    manifests = [open_folder(results / name, "").manifest for name in names]
    named = [name for each in manifests for name in (each["report"], *each.get("items", ()))]
    sources = [digest_of_source(name.partition(":")[0]) for name in named if ":" in name]
    return stamp.digest_of(*(part for part in parts if "index.html" not in part), *sources)


def _subjects(results: Path, experiment: str | None) -> tuple[list[str], Path]:
    """Returns the experiments that a page shows, and the page."""
    if experiment is None or experiment in PUBLISHED:
        return published(results), results / "index.html"
    return [experiment], results / experiment / "index.html"


def write(results: Path, experiment: str | None = None) -> Path:
    """Writes the page of the published experiments, or of another one, and the list of all results.

    Args:
      results: The folder of results.
      experiment: One that is published, or None: the page shows all of these that are there, and is
        `index.html` of `results`. Another one: the page shows that alone, and lies in its folder.

    Returns:
      The page's path.

    Raises:
      InputError: There is nothing to show, or the page cannot be written.
    """
    names, target = _subjects(results, experiment)
    prefix = "{}/" if target.parent == results else ""  # from the page to a folder
    folders = [open_folder(results / name, prefix.format(name)) for name in names]
    if not folders:
        others = ", ".join(sorted(path.parent.name for path in results.glob("*/manifest.json")))
        hint = f"; the page of {others} is in its folder" if others else ""
        raise InputError(
            f"{results}: there are no results of {' or '.join(PUBLISHED)} to report; make reproduce and make "
            f"compare-deep make them{hint}."
        )
    is_measured = target.parent == results and (results / "speed" / "speed.csv").exists()
    speed = Folder(results / "speed", "speed/", {"command": "make speed"}) if is_measured else None
    with files.alone(results):
        for folder in folders:
            section(folder, lambda folder: texts.write(folder.path))
        files.write_text(target, _render(folders, speed))
        files.write_text(results / "README.md", _index(results))
    return target


def _render(folders: Sequence[Folder], speed: Folder | None) -> str:
    """Returns the page, with the project's own speed if that was measured."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    ids: set[str] = set()
    reports = [section(folder, lambda folder: _report(folder, ids)) for folder in folders]
    explored = next((folder for folder in folders if "agent.csv" in folder), None)
    data = explorer.collect(folders)
    content = {
        "question": reports[0]["question"],
        "answer": reports[0]["answer"],
        "reports": reports,
        "made": [section(folder, _made) for folder in folders],
        "speed": section(speed, lambda folder: _table(folder, _SPEED(Published(folder.path))))
        if speed
        else None,
        "partial": [note for note in (folder.manifest.get("partial") for folder in folders) if note],
        "scenarios": {
            name: declared["description"]
            for folder in folders
            for name, declared in folder.manifest["scenarios"].items()
        },
        "horizon": folders[0].manifest["horizon"],
        "has_explorer": data is not None,
        "maps_link": explored.link("README.md") if explored is not None else "",
        "css": (_TEMPLATES / "page.css").read_text(encoding="utf-8"),
        "js": script.read(),
        "ramp": ", ".join(explorer.COLOURS),
    }
    template = environment.get_template("page.html")
    text = template.render(**content, data="")
    linked = {
        folder.link(path.name): path.read_text(encoding="utf-8")
        for folder in ([*folders, speed] if speed is not None else folders)
        for path in sorted(folder.path.glob("*.csv"))
        if folder.link(path.name) in _LINKED.findall(text)
    }
    embedded = {link: csv for folder in folders for link, csv in folder.embedded.items()}
    return template.render(**content, data=script.pack({"explorer": data, "csv": embedded | linked}))


def _report(folder: Folder, ids: set[str]) -> dict[str, Any]:
    """Returns what the page shows of a folder of results, in the order of its report's sections.

    Args:
      folder: Of the results.
      ids: Of sections that the page has already; those of this report are added.
    """
    results = Published(folder.path)
    report, items = texts.load(results)
    name = folder.manifest["experiment"]
    explained = ((term, folder.as_html(text)) for term, text in report.words(results))
    words = words_of(f"word-{name}", explained)
    mark, mark_answer = Marker(words), Marker(words)
    lead = next((item for item in items if item.name == report.lead and _has_figure(results, item)), None)
    first, *rest = [mark_answer(folder.as_html(text)) for text in _paragraphs(report.headline(results))]
    sentences = [mark(folder.as_html(sentence)) for sentence in report.sentences(results)]
    sections = []
    for part in report.sections:
        shown = [_item(folder, results, item, lead) for item in report.items_of(part, items)]
        shown = [item for item in shown if item["table"] or item["figure"]]
        if not shown and part is not report.sections[0]:
            continue
        key = part.key if part.key not in ids else f"{name}-{part.key}"
        ids.add(key)
        terms = part.terms(results) if part.terms is not None else ()
        sections.append(
            {
                "id": key,
                "heading": folder.as_html(part.heading),
                "text": mark(folder.as_html(part.text)),
                "items": shown,
                "terms": [(name, folder.as_html(text)) for name, text in terms],
                "terms_title": part.terms_title,
            }
        )
    return {
        "question": report.question,
        "answer": {"figure": _figure(folder, lead) if lead else None, "first": first, "rest": rest},
        "description": folder.manifest["description"],
        "note": folder.manifest.get("note", ""),
        "sentences": sentences,
        "readme": folder.link("README.md"),
        "sections": sections,
        "words": words,
    }


def _paragraphs(headline: str) -> list[str]:
    r"""Returns a headline's first sentence, or its first paragraph if it has several, and what follows.

    >>> _paragraphs("It has [0.9](a.csv#row=2) [0.8, 1.0]. It wins (vs. A). `b` loses.")
    ['It has [0.9](a.csv#row=2) [0.8, 1.0].', 'It wins (vs. A). `b` loses.']
    >>> _paragraphs("One. Two.\n\nThree."), _paragraphs("")
    (['One. Two.', 'Three.'], [''])
    """
    if "\n\n" in headline:
        return headline.split("\n\n")
    masked = _ASIDE.sub(lambda match: match[0][0] + "x" * (len(match[0]) - 1), headline)
    end = _SENTENCE_END.search(masked)
    return [headline] if end is None else [headline[: end.start()], headline[end.end() :]]


def _has_figure(results: Published, item: Item) -> bool:
    """Returns whether there is a figure of an item, for README and page."""
    return bool(item.caption) and f"{item.name}.png" in results


def _item(folder: Folder, results: Published, item: Item, lead: Item | None) -> dict[str, Any]:
    """Returns an item's table and figure, so far as there are any to show; the lead's figure is elsewhere.

    What is shown on demand is shown as a table, if there is one, and not as a figure, too: figures make the
    page large.
    """
    table = item.view(results) if item.view is not None and f"{item.name}.csv" in results else None
    has_figure = (
        _has_figure(results, item) and item is not lead and not (item.is_folded and table is not None)
    )
    return {
        "table": _table(folder, table) if table is not None else None,
        "figure": _figure(folder, item) if has_figure else None,
        "is_folded": item.is_folded,
    }


def _table(folder: Folder, table: Table) -> _Table:
    """Returns a table with its links and its marked texts."""
    n_keys = _n_keys(table)
    rows = []
    for row in table.rows:
        others = "\n".join(plain(entry.text).replace("`", "") for entry in row[1:n_keys])
        first, *rest = [_entry(folder, entry) for entry in row]
        rows.append([replace(first, others=others), *rest])
    other_keys = "\n".join(label for label, _ in table.columns[1:n_keys])
    return _Table(table.caption, folder.link(table.file), table.columns, rows, n_keys, other_keys)


def _n_keys(table: Table) -> int:
    """Returns how many columns at the left hold nothing but names; at least one, at most `_MOST_KEYS`."""
    n_keys = 0
    for i, (_, is_number) in enumerate(table.columns[:_MOST_KEYS]):
        entries = [row[i] for row in table.rows]
        if is_number or any(entry.row or entry.kind or entry.note or entry.details for entry in entries):
            break
        n_keys += 1
    return max(n_keys, 1)


def _entry(folder: Folder, entry: Entry) -> _Entry:
    """Returns an entry with its link and its marked texts."""
    return _Entry(
        text=folder.as_html(entry.text),
        order=entry.order,
        href=folder.link(entry.row) if entry.row else "",
        kind=entry.kind,
        note=folder.as_html(entry.note),
        details=folder.as_html(entry.details),
        details_title=entry.details_title,
    )


def _figure(folder: Folder, item: Item) -> _Figure:
    """Returns a figure small enough for the page; the link leads to the drawing itself."""
    with Image.open(folder.path / f"{item.name}.png") as image:
        small = image.convert("RGB").quantize(_FIGURE_COLOURS, dither=Image.Dither.NONE).convert("RGB")
    buffer = io.BytesIO()
    small.save(buffer, "WEBP", lossless=True, method=4)
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    return _Figure(item.caption, folder.link(f"{item.name}.svg"), data, *small.size)


def _made(folder: Folder) -> dict[str, Any]:
    """Returns what made a folder of results."""
    manifest = folder.manifest
    return {
        "name": manifest["experiment"],
        "description": manifest["description"],
        "command": manifest["command"],
        "link": folder.link("manifest.json"),
        "readme": folder.link("README.md"),
        "commits": [commit or "unknown" for commit in manifest["commits"]],
        "machines": manifest["machines"],
        "versions": manifest["versions"],
        "runs": manifest["runs"],
        "digest": manifest["digest"],
        "first": manifest["first_started_at"],
        "last": manifest["last_started_at"],
        "settings": {
            name: {key: value for key, value in arm["settings"].items() if value is not None}
            for name, arm in manifest["algorithms"].items()
        },
    }


# The list of all results


def _index(results: Path) -> str:
    """Returns the page that lists all folders of results."""
    lines = []
    for path in sorted(results.iterdir()):
        if any(map(path.match, (".*", "*_smoke", "*_partial", "*_seeds_*"))):
            continue
        if not (path / "README.md").exists():
            continue
        paragraphs = (path / "README.md").read_text(encoding="utf-8").split("\n\n")
        first = next((paragraph for paragraph in paragraphs if not paragraph.startswith("#")), "")
        description = first.replace("\n", " ").replace("|", r"\|").strip()
        if (path / "index.html").exists():
            description += f" Its page: [index.html]({path.name}/index.html)."
        lines.append(f"| [{path.name}]({path.name}/README.md) | {description} |")
    folders = "\n".join(lines)
    page = """
[index.html](index.html) shows all experiments on one page: download it, or open it from a clone. It needs no
server and no network. Every number links to the row of the CSV file that it comes from, and the explorer
shows what one agent of every learner knows over training, cell by cell, and how every agent walks in the end.
"""
    return f"""# Results
{page if (results / "index.html").exists() else ""}
| folder | what it holds |
|---|---|
{folders}

The README of a folder says what each file is, what made it, and with which command. Tables are `.csv` (six
digits, all columns) and, for reading, `.md` and `.tex`; figures are `.png` and `.svg`. `manifest.json` holds
versions, commit, machine and times. `runs.db`, which is not in the repository, holds every run made here.
"""
