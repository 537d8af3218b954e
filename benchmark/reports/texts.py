"""Writes what a report says: its sentences and README, from the published files alone.

So texts can be corrected without a single run, and a sentence cannot say what its table does not.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd

from benchmark.drawing import tables
from benchmark.reports import files, load_items, load_report
from benchmark.reports.item import Item, Report
from benchmark.reports.published import MANIFEST, Published
from envs import InputError


def load(published: Published) -> tuple[Report, tuple[Item, ...]]:
    """Returns the report and the items that a folder of results was made of.

    Raises:
      InputError: One of them cannot be imported.
    """
    manifest, source = published.manifest, str(published.path / MANIFEST)
    report = load_report(manifest["report"], source)
    return report, load_items(report, manifest.get("items", ()), source)


def write(directory: Path) -> None:
    """Writes the tables of sentences and README of a folder of results again.

    Raises:
      InputError: A text cannot be written.
    """
    published = Published(directory)
    report, items = load(published)
    try:
        for item in items:
            if item.tell is not None:
                tables.write_csv(item.tell(published), directory / f"{item.name}.csv")
        files.write_text(directory / "README.md", readme(Published(directory), report, items))
    except PermissionError as error:
        raise InputError(f"{error.filename}: cannot be written: {error.strerror}.") from error


def readme(published: Published, report: Report, items: Sequence[Item]) -> str:
    """Returns README of a folder of results: what was found, and what each file is."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(report.template.parent),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters["paragraph"] = tables.paragraph
    listed = [(item.label(published), item.description) for item in items]
    listed.append((MANIFEST, "what made the runs: versions, commit, machine, times, digest"))
    table = pd.DataFrame([row for row in listed if row[0]], columns=["file", "what it is"])
    measured = [f"`{item.name}`" for item in items if item.is_measured]
    text = environment.get_template(report.template.name).render(
        manifest=published.manifest,
        headline=tables.plain(report.headline(published)),
        sentences=[tables.plain(sentence) for sentence in report.sentences(published)],
        sections=_sections(published, report, items),
        files=tables.to_markdown(table),
        measured=measured,
        words=report.words(published),
    )
    return re.sub(r"\n{3,}", "\n\n", text).rstrip("\n") + "\n"


def _sections(published: Published, report: Report, items: Sequence[Item]) -> list[dict[str, Any]]:
    """Returns the sections in which there is something to show, with their tables and figures."""
    sections = []
    for section in report.sections:
        shown = []
        for item in report.items_of(section, items):
            has_table = item.view is not None and f"{item.name}.csv" in published
            has_figure = bool(item.caption) and f"{item.name}.png" in published
            if item.is_folded or not (has_table or has_figure):
                continue
            table = item.view(published) if has_table and item.view is not None else None
            rows = table.rows if table else []
            notes = [(row[0].text, tables.plain(row[0].note)) for row in rows if row[0].note]
            figure = f"{item.name}.png" if has_figure else ""
            shown.append({"table": table, "notes": notes, "figure": figure, "caption": item.caption})
        if shown:
            terms = section.terms(published) if section.terms is not None else ()
            sections.append(
                {
                    "heading": section.heading,
                    "text": section.text,
                    "shown": shown,
                    "terms": terms,
                    "terms_title": section.terms_title,
                }
            )
    return sections
