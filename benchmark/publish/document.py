"""A report as a document: Markdown with places for items. README is one rendering of it, the page another.

The template of a kind of report can use the functions `show` and `fold`, which place an item by its name
(README has the figure of a folded one, and a link to its table), `has`, which says whether there is such an
item, and `others`, which places the items that an experiment adds, as well as `manifest`, `folder`
and `document`. Documents are made from published files
alone, so texts can be corrected without a single run.
"""

import re
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import cached_property, partial
from pathlib import Path
from typing import Final

import pandas as pd

from benchmark.drawing import tables
from benchmark.folder import MANIFEST, README, Folder, with_titles
from benchmark.publish import files, prose
from benchmark.publish.templates import mistakes_in
from benchmark.publish.templates import templates_in as templates_in
from benchmark.studies import STUDIES, Item, Study, load_study
from benchmark.studies.study import with_items
from envs import InputError

_FRAME: Final = Path(__file__).parent / "README.md.jinja"


def _naming_mistakes(path: Path) -> AbstractContextManager[None]:
    """Names file and line of mistakes in a file of users; this project's fail if a folder is damaged."""
    return nullcontext() if path.is_relative_to(Path(__file__).parents[1]) else mistakes_in(path)


class Document:
    """The document of a folder of results."""

    def __init__(self, path: Path, study: Study | None = None) -> None:
        """Takes the study of an experiment, see `report_of`, or finds one of this project.

        Manifests can come from anywhere, so they may only name code of this project. An InputError says what
        is damaged or missing.
        """
        self.folder = Folder(path)
        declared, source = self.folder.manifest["report"], str(path / MANIFEST)
        with self.folder.reading():
            if study is None:
                for name in (declared["kind"], *declared["items"]):
                    if name not in STUDIES and not name.startswith("benchmark.studies."):
                        reason = f"report: {name}: code of users runs only if you name its experiment"
                        raise InputError(f"{source}: {reason}, as in: report EXPERIMENT.")
                study = with_items(load_study(declared["kind"], source), declared["items"], source)
            self.study, self.items = study, study.items
            self.question = declared["question"] or study.question

    @cached_property
    def headline(self) -> str | None:
        """The finding in Markdown: as it is written by hand, or else the sentence that the report makes."""
        try:
            if written := prose.written(self.folder, self.study.finding):
                return written
        except prose.ClaimError:
            pass
        return self.study.headline(self.folder)

    def has(self, name: str) -> bool:
        """Returns whether there is an item with something to show."""
        has_files = f"{name}.csv" in self.folder or self.folder.figure(name)
        return bool(has_files) and name in [item.name for item in self.items]

    def shown(self, item: Item) -> pd.DataFrame:
        """Returns an item's table as readers see it, of Markdown texts; empty if there is none here."""
        if f"{item.name}.csv" not in self.folder:
            return pd.DataFrame()
        return item.display(with_titles(self.folder.frame(item.name), self.folder.titles))

    def render(
        self, insert: Callable[[Item, bool], str], template: Path | None = None, **more: object
    ) -> str:
        """Returns the document as Markdown.

        `insert` returns the text for an item, given whether it is only shown on demand. The template is by
        default that of the report; `more` has further variables of it.
        """
        n_own = len(self.items) - len(self.folder.manifest["report"]["items"])
        named = {item.name: item for item in self.items}

        def show(name: str, *, is_folded: bool = False) -> str:
            return insert(named[name], is_folded) if self.has(name) else ""

        def others() -> str:
            return "\n\n".join(insert(item, False) for item in self.items[n_own:])

        template = template or self.study.document
        functions = {"show": show, "fold": partial(show, is_folded=True), "has": self.has, "others": others}
        known = {"manifest": self.folder.manifest, "folder": self.folder, "document": self, **functions}
        with _naming_mistakes(template):
            text = templates_in(template.parent).get_template(template.name).render(**known, **more)
        return re.sub(r"\n{3,}", "\n\n", text).strip("\n")

    def readme(self) -> str:
        """Returns README of the folder; raises an InputError if it cannot be made, or a file was changed."""
        self.folder.check()

        def insert(item: Item, is_folded: bool) -> str:
            file, frame = self.folder.figure(item.name), self.shown(item)
            parts, table = [f"![{item.caption}]({file})"] if file else [], f"{item.name}.csv"
            if is_folded and table in self.folder:
                parts.append(f"[{table}]({table}): {item.description}.")
            elif not frame.empty:
                parts += [f"{item.description[:1].upper()}{item.description[1:]}:", tables.to_markdown(frame)]
            return "\n\n".join(parts)

        with self.folder.reading():
            return self.render(insert, _FRAME, body=self.render(insert)) + "\n"

    @property
    def learners(self) -> str:
        """Markdown that lists the learners: their names, and where their settings come from; or empty."""
        manifest, rows = self.folder.manifest, []
        for variant, declared in manifest["algorithms"].items():
            search = declared["tuned_by"].partition(":")[0]
            settings = f"search `{search}`" if search else "declared"
            more = {} if manifest["search"] else {"settings": settings, "runs": str(declared["runs"])}
            for name in (f"{variant}, {observation}" for observation in declared["settings"]):
                row = {"learner": self.folder.title(name), "name in CSV files": f"`{name}`"}
                rows.append({**row, "policy": declared["policy"], **more})
        return tables.to_markdown(pd.DataFrame(rows)) if rows else ""

    @property
    def listed(self) -> str:
        """A Markdown table of the files."""
        there = [(item, [file for file in item.files() if file in self.folder]) for item in self.items]
        rows = [(", ".join(files), item.description) for item, files in there if files]
        rows.append((MANIFEST, "what made the runs: versions, commit, machine, times; digests of files"))
        return tables.to_markdown(pd.DataFrame(rows, columns=["file", "what it is"]))


def write(path: Path, study: Study | None = None) -> None:
    """Writes README of a folder of results; raises an InputError if it cannot be made or written."""
    files.write_text(path / README, Document(path, study).readme())
