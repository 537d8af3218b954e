"""Writes the page: one HTML file with every report and the explorer, made of published files.

Nothing is computed here, so no run is needed. A report has the same document as its README, with a figure or
a sortable table in the place of every item. Links lead to files beside the page, which needs none of them.
"""

import base64
import gzip
import hashlib
import json
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final
from urllib.parse import quote

import jinja2
from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup

from benchmark import __version__
from benchmark.drawing.maps import shipped
from benchmark.drawing.style import svg
from benchmark.experiments import PUBLISHED
from benchmark.folder import Folder
from benchmark.publish import files
from benchmark.publish.document import Document, templates_in
from benchmark.studies import Item, Study, explorer
from envs import InputError

SCENES: Final = "scenes.svg"  # the picture of all shipped scenarios, beside the list of published results
_TEMPLATES: Final = Path(__file__).parent / "templates"
_ESCAPED: Final = {ord(each): quote(each) for each in "%#&'\n"}  # in an address in single quotes
_MAX_ROWS: Final = 100  # in a table; of longer ones, there is a link to the CSV file
_MARK: Final = "\ue000"  # around an item's name, until its HTML takes its place; FOLD: shown on demand
_MARKED: Final = re.compile(f"(?:<p>)?{_MARK}(FOLD )?([^{_MARK}]*){_MARK}(?:</p>)?")
_TABLE: Final = re.compile("<table>.*?</table>", re.DOTALL)  # which a document has as Markdown
_BOX: Final = r'<div class="scroll" role="group" tabindex="0" aria-label="Table">\g<0></div>'
# A cell of a column of numbers: a number, perhaps with its interval or a sign.
_NUMBER: Final = re.compile(r"((-|never|[-+]?[\d,.]+(e[-+]\d+)?)( ?[%(\[✓✗?].*)?)?")
# The page's script: these share one scope, in this order.
_SCRIPTS: Final = ("elements", "room", "agent", "scene", "walk", "panel", "main")

_DOCUMENTS: Final = MarkdownIt("commonmark", {"html": False}).enable("table").disable("image")
_TEXTS: Final = MarkdownIt("commonmark", {"html": False}).disable(["image", "link", "autolink"])


def published(results: Path) -> list[Path]:
    """Lists the folders of published results that are there, in the order of `PUBLISHED`."""
    folders = [results / name for name in PUBLISHED]
    return [folder for folder in folders if Folder(folder).is_there]


def write(results: Path, experiment: str | None = None, study: Study | None = None) -> Path:
    """Writes what `texts` returns; returns the page's path.

    Raises:
      InputError: There is nothing to show, or the page cannot be written.
    """
    with files.alone(results):
        written = dict(texts(results, experiment, study))
        for path, text in written.items():
            files.write_text(path, text)
    return next(iter(written))


def texts(
    results: Path, experiment: str | None = None, study: Study | None = None
) -> Iterator[tuple[Path, str]]:
    """Yields paths and texts: a page and, for published results, their list and a picture of scenarios.

    `index.html` of `results` shows all published results that are there. The page of another experiment shows
    it alone, and lies in its folder; its `study` is needed if it is not one of this project. It may raise an
    `InputError`.
    """
    is_own = experiment not in (None, *PUBLISHED)
    folders = [results / str(experiment)] if is_own else published(results)
    if not folders:
        raise InputError(f"{results}: there are no published results to report; make reproduce makes some.")
    study = study if is_own else None
    parts = [_Part(folder, "" if is_own else f"{folder.name}/", study) for folder in folders]
    yield (folders[0] if is_own else results) / "index.html", _render(parts)
    if not is_own:
        template = templates_in(_TEMPLATES).get_template("index.md.jinja")
        yield results / "README.md", template.render(findings={part.name: part.finding for part in parts})
        yield results / SCENES, svg(shipped())


class _Part:
    """A folder of results on the page."""

    def __init__(self, path: Path, prefix: str, study: Study | None) -> None:
        """Reads its manifest and checks its files; `prefix` leads from the page to the folder."""
        self.document = Document(path, study)
        self.document.folder.check()
        self.folder, self.name, self.prefix = self.document.folder, path.name, prefix

    @property
    def finding(self) -> str:
        """The first paragraph of the headline."""
        return (self.document.headline or str(self.folder.manifest["description"])).partition("\n\n")[0]

    def report(self, templates: jinja2.Environment) -> dict[str, object]:
        """Returns what the page shows of the report, by the page's templates."""
        document, manifest = self.document, self.folder.manifest
        items = {item.name: item for item in document.items}
        drawn = [item for item in document.items if self.folder.figure(item.name)]
        lead = next((item for item in drawn if item.name == document.study.lead), None)

        def content(match: re.Match[str]) -> str:
            is_folded, item = bool(match[1]), items[match[2]]
            table = self._table(item)
            # A folded item with a table is shown without its figure, since figures make the page large.
            has_figure = item in drawn and item is not lead and not (table and is_folded)
            shown = {"item": item, "table": table, "is_folded": is_folded}
            shown |= {"figure": self._figure(item) if has_figure else None}
            source = f"{self.prefix}{item.name}.csv"
            return templates.get_template("item.html").render(shown, source=source).strip()

        place = f"\n\n{_MARK}%s{_MARK}\n\n"
        markdown = document.render(lambda item, is_folded: place % f"{'FOLD ' * is_folded}{item.name}")
        return {
            "id": f"report-{self.name}",  # no other part has an id that begins so
            "question": document.question,
            "headline": [self.inline(text) for text in (document.headline or "").split("\n\n") if text],
            "lead": self._figure(lead) if lead is not None else None,
            "description": self.inline(manifest["description"]),
            "note": self.inline(manifest.get("note", "")),
            "body": self._body(markdown, content),
            "folder": self.prefix,
            "made": manifest,
        }

    def inline(self, text: str) -> Markup:
        """Returns a text in Markdown as HTML within a paragraph; its own HTML and links are inert."""
        return self._html(_TEXTS.parseInline(text))

    def _html(self, tokens: Sequence[Token]) -> Markup:
        """Returns parsed Markdown as HTML, with links that lead from the page to files of the folder."""
        for token in [child for block in tokens for child in (block.children or [])]:
            target = str(token.attrGet("href") or "")
            if target and ":" not in target and not target.startswith(("#", "/")):
                token.attrSet("href", f"{self.prefix}{target}")
        return Markup(_DOCUMENTS.renderer.render(tokens, _DOCUMENTS.options, {}))

    def _body(self, markdown: str, content: Callable[[re.Match[str]], str]) -> Markup:
        """Returns a document as HTML, with the content of marked items."""
        tokens = _DOCUMENTS.parse(markdown)
        for token in tokens:
            token.tag = re.sub(r"^h(\d)$", lambda match: f"h{int(match[1]) + 2}", token.tag)
        return Markup(_MARKED.sub(content, _TABLE.sub(_BOX, str(self._html(tokens)))))

    def _table(self, item: Item) -> dict[str, object] | None:
        """Returns an item's table: its columns, the class of each, and its rows; None without rows to show.

        Of a long one, there is the number of rows alone.
        """
        shown = self.document.shown(item)
        if shown.empty:
            return None
        if len(shown) > _MAX_ROWS:
            return {"n_rows": len(shown)}
        cells = [[self.inline(str(text)) for text in row] for row in shown.itertuples(index=False)]
        are_numbers = [
            all(_NUMBER.fullmatch(cell.striptags()) for cell in column) for column in zip(*cells, strict=True)
        ]
        columns = [self.inline(str(name)) for name in shown]
        return {"columns": columns, "are_numbers": are_numbers, "rows": cells, "n_rows": len(cells)}

    def _figure(self, item: Item) -> dict[str, object]:
        """Returns a figure as the page shows it, with its file as an address."""
        drawn = self.folder.content(self.folder.figure(item.name)).decode()
        address = Markup(f"svg+xml,{drawn.translate(_ESCAPED)}")
        return {"address": address, "caption": self.inline(item.caption), "alt": item.caption}

    def agents(self) -> str:
        """Returns what the explorer shows of the folder, compressed; empty if there is nothing."""
        if explorer.FILE not in self.folder:
            return ""
        shown = json.loads(gzip.decompress(self.folder.content(explorer.FILE)))
        for agent in shown["agents"]:
            learner = f"{agent['variant']}, {agent['observation']}"
            agent["learner"] = self.folder.title(learner)
            agent["family"] = self.folder.manifest["algorithms"][agent["variant"]]["family"]
            agent["experiment"] = self.name
        return _base64(explorer.compressed(shown))


def _render(parts: Sequence[_Part]) -> str:
    templates = templates_in(_TEMPLATES, is_html=True)
    templates.filters["sha256"] = lambda text: _base64(hashlib.sha256(text.encode()).digest())
    reports, agents, scenarios = [], [], dict[str, Markup]()
    for part in parts:
        with part.folder.reading():
            reports.append(part.report(templates))
            agents.append(part.agents())
            for name, declared in part.folder.manifest["scenarios"].items():
                scenarios[name] = part.inline(declared["description"])
    scripts = [(_TEMPLATES / f"{name}.js").read_text(encoding="utf-8") for name in _SCRIPTS]
    with parts[0].folder.reading():
        return templates.get_template("page.html").render(
            reports=reports,
            is_own=not parts[0].prefix,
            scenarios=scenarios,
            agents=[packed for packed in agents if packed],
            command="make report" if len(parts) > 1 else parts[0].folder.manifest["command"],
            version=__version__,
            css=Markup((_TEMPLATES / "page.css").read_text(encoding="utf-8")),
            js=Markup("\n".join(scripts)),
        )


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")
