"""Writes the page: one HTML file with every report and the explorer, made of published files.

Nothing is computed here, so no run is needed. A report has the same document as its README, with a figure or
a sortable table in the place of every item. Every number is an entry of a CSV file beside the page, and links
to its row, numbered as in RFC 7111.
"""

import base64
import fnmatch
import gzip
import hashlib
import json
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Final
from urllib.parse import quote

import jinja2
from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup

from benchmark import __version__
from benchmark.drawing.maps import shipped
from benchmark.drawing.style import in_dark, learner_style, svg
from benchmark.drawing.tables import inert, local_only, plain
from benchmark.experiments import PUBLISHED
from benchmark.folder import MANIFEST, Folder
from benchmark.publish import files, sameness
from benchmark.publish.document import SPEED, Document, document_of, templates_in
from benchmark.studies import AnyItem, AnyStudy, explorer
from envs import InputError

CHAPTERS: Final = tuple(name for name, has_chapter in PUBLISHED.items() if has_chapter)
SCENES: Final = "scenes.svg"  # the picture of all shipped scenarios, beside the list of published results
_TEMPLATES: Final = Path(__file__).parent / "templates"
_SIZE: Final = re.compile(r' (?:width|height)="([\d.]+)pt"')  # in an SVG
_ESCAPED: Final = {ord(each): quote(each) for each in "%#&'\n"}  # in an address in single quotes
_MAX_ROWS: Final = 60  # in a table; for longer ones, the page shows the CSV file on demand
_MAX_KEYS: Final = 3  # columns that name a row, and share one column on a narrow screen
_MARK: Final = "\ue000"  # around an item's name, until its HTML takes its place; FOLD: shown on demand
_MARKED: Final = re.compile(f"(?:<p>)?{_MARK}(FOLD )?([^{_MARK}]*){_MARK}(?:</p>)?")
_TABLE: Final = re.compile("<table>.*?</table>", re.DOTALL)  # which a document has as Markdown
_BOX: Final = r'<div class="scroll" role="group" tabindex="0" aria-label="Table">\g<0></div>'
_MINUS: Final = re.compile(r"(?<![\w-])-(?=\d)")
# A cell of a column of numbers: a number, perhaps with its interval or a sign.
_NUMBER: Final = re.compile(r"((-|never|[−+]?[\d,.]+(e[-+]\d+)?)( ?[%(\[✓✗?].*)?)?")
_IMPORT: Final = re.compile(r'^import (?:\{[^}]*\} from )?"\./(\w+\.js)";\n', re.MULTILINE)
_EXPORT: Final = re.compile(r"^export ", re.MULTILINE)


def published(results: Path) -> list[Path]:
    """Lists the folders of published results that are there, in the order of `PUBLISHED`."""
    folders = [results / name for name in (*PUBLISHED, SPEED)]
    return [folder for folder in folders if Folder(folder).is_there]


def chapters(results: Path) -> list[str]:
    """Lists the folders that the page of all results shows; none if there is no chapter."""
    names = [folder.name for folder in published(results)]
    return names if {*names} & {*CHAPTERS} else []


def write(results: Path, experiment: str | None = None, study: AnyStudy | None = None) -> Path:
    """Writes what `texts` returns; returns the page's path.

    In this repository, git ignores folders that are not published, by a `.gitignore` in them.

    Raises:
      InputError: There is nothing to show, or the page cannot be written.
    """
    with files.alone(results):
        (page, text), *others = texts(results, experiment, study)
        for path, content in ((page, text), *others):
            files.write_text(path, content)
        for name in PUBLISHED:
            (results / name / ".gitignore").unlink(missing_ok=True)
        if experiment not in (None, *PUBLISHED) and results.resolve() == sameness.REPOSITORY / "results":
            files.write_text(page.with_name(".gitignore"), "*\n")
    return page


def texts(
    results: Path, experiment: str | None = None, study: AnyStudy | None = None
) -> Iterator[tuple[Path, str]]:
    """Yields the paths and texts of a page, of the list of published results and of a picture of scenarios.

    The page shows all published results that are there, those with a chapter with their whole documents, and
    is `index.html` of `results`. The page of an experiment without a chapter shows it alone, and lies in its
    folder; its `study` is needed if it is not one of this project. It may raise an `InputError`.
    """
    has_own_page = experiment not in (None, *CHAPTERS)
    folders = [results / str(experiment)] if has_own_page else [results / name for name in chapters(results)]
    if not folders:
        raise InputError(
            f"{results}: there are no results of {' or '.join(CHAPTERS)} to report; make reproduce and make "
            "compare-deep make them."
        )
    page = (folders[0] if has_own_page else results) / "index.html"
    own = study if has_own_page else None
    parts = [_Part(folder, "" if has_own_page else f"{folder.name}/", own) for folder in folders]
    yield page, _render(parts)
    if listed := published(results):
        template = templates_in(_TEMPLATES).get_template("index.md.jinja")
        documents = {part.name: part.document for part in parts}
        findings = {folder.name: _finding(folder, documents.get(folder.name)) for folder in listed}
        has = {"page": bool(chapters(results)), "leaderboard": any(results.glob("leaderboard/README.md"))}
        yield results / "README.md", template.render(findings=findings, has=has)
        yield results / SCENES, _scenes()


@cache
def _scenes() -> str:
    return svg(shipped())


class _Part:
    """A folder of results on the page."""

    def __init__(self, path: Path, prefix: str, study: AnyStudy | None) -> None:
        """Reads its manifest and checks its files; `prefix` leads from the page to the folder."""
        self.document = document_of(path, study)
        self.document.folder.check()
        self.folder = self.document.folder
        self.name = path.name
        self.prefix = prefix
        self._parser = MarkdownIt("commonmark", {"html": False}).enable("table").disable("image")

    @property
    def is_whole(self) -> bool:
        """Whether the page has its whole document."""
        return not self.prefix or self.name in (*CHAPTERS, SPEED)

    def report(self, templates: jinja2.Environment) -> dict[str, object]:
        """Returns what the page shows of the report, by the page's templates."""
        document, manifest = self.document, self.folder.manifest
        items = {item.name: item for item in document.items}
        headline = (document.headline or "").split("\n\n")
        drawn = [item for item in document.items if self.folder.figure(item.name)]
        drawn.sort(key=lambda item: item.name != document.lead)
        lead = drawn[0] if drawn else None

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
        report = {
            "name": self.name,
            "id": f"report-{self.name}",  # no other part has an id that begins so
            "question": document.question,
            "headline": [self.inline(text) for text in headline if text],
            "map": self._map(),
            "lead": self._figure(lead) if lead is not None else None,
            "description": self.inline(inert(manifest["description"])),
            "note": self.inline(inert(manifest.get("note", ""))),
            "body": self._body(markdown, content) if self.is_whole else "",
            "readme": f"{self.prefix}README.md",
            "made": manifest,
            "manifest": f"{self.prefix}{MANIFEST}",
            "partial": self.inline(manifest.get("partial") or ""),
            "year": manifest.get("last_started_at", "")[:4],
        }
        return report | {"making": Markup(templates.get_template("made.html").render(report=report))}

    def _map(self) -> dict[str, object] | None:
        """Returns what the page's map needs besides tables; None if this is no map of a single scene."""
        report = self.folder.manifest["report"]
        panels = report.get("panels", ())
        is_plain = all(not panel.get("grid") and panel.get("shows", "steps") == "steps" for panel in panels)
        if report["kind"] != "map" or not is_plain:
            return None
        looks, variants = {}, self.folder.manifest["algorithms"]
        colours = {name: variant.get("colour") for name, variant in variants.items()}
        for learner, title in self.folder.titles.items():
            variant, observation = learner.split(", ")
            if variants[variant]["reference_for"]:
                continue
            style = learner_style(variant, observation, colours, variants[variant]["family"])
            looks[learner] = {
                "name": title,
                "colour": f"light-dark({style['color']}, {in_dark(style['color'])})",
                "dash": "" if style["ls"] == "-" else " ".join(f"{4 * n:g}" for n in style["ls"][1]),
            }
        return {"folder": self.prefix, "looks": looks}

    def inline(self, text: str) -> Markup:
        """Returns a text in Markdown as HTML within a paragraph; HTML in the text itself is escaped."""
        return self._html(self._parser.parseInline(local_only(text)))

    def _html(self, tokens: Sequence[Token]) -> Markup:
        """Returns parsed Markdown as HTML, with links that lead from the page to files of the folder."""
        for token in [child for block in tokens for child in (block.children or [])]:
            target = str(token.attrGet("href") or "")
            if target and ":" not in target and not target.startswith(("#", "/")):
                token.attrSet("href", f"{self.prefix}{target}")
                if ".csv" in target:
                    token.attrSet("class", "n" if "#row=" in target else "file")
            if token.type == "text":
                token.content = _MINUS.sub("−", token.content)
        return Markup(self._parser.renderer.render(tokens, self._parser.options, {}))

    def _body(self, markdown: str, content: Callable[[re.Match[str]], str]) -> Markup:
        """Returns a document as HTML, with the content of marked items."""
        tokens = self._parser.parse(markdown)
        for token in tokens:
            token.tag = re.sub(r"^h(\d)$", lambda match: f"h{int(match[1]) + 2}", token.tag)
        return Markup(_MARKED.sub(content, _TABLE.sub(_BOX, str(self._html(tokens)))))

    def _table(self, item: AnyItem) -> dict[str, object] | None:
        """Returns an item's table: its columns, the kind of each, and its rows; None without rows to show.

        A long one, which is shown on demand, has its number of rows alone.
        """
        shown = self.document.shown(item)
        if shown.empty:
            return None
        if len(shown) > _MAX_ROWS:
            return {"n_rows": len(shown)}
        cells = [[self.inline(str(text)) for text in row] for row in shown.itertuples(index=False)]
        kinds = []  # the class of each column's cells: names have none
        for name, column in zip(shown, zip(*cells, strict=True), strict=True):
            is_number = all(_NUMBER.fullmatch(cell.striptags()) for cell in column)
            kinds.append("number" if is_number else "verdict" if str(name).startswith("verdict") else "")
        n_keys = next((i for i, kind in enumerate(kinds[:_MAX_KEYS]) if kind), min(len(kinds), _MAX_KEYS))
        kinds[1:n_keys] = ["key"] * (n_keys - 1)
        columns = [self.inline(str(name)) for name in shown]
        return {"columns": columns, "kinds": kinds, "rows": cells, "n_rows": len(cells), "n_keys": n_keys}

    def _figure(self, item: AnyItem) -> dict[str, object]:
        """Returns a figure as the page shows it: its file as an address, and its natural size in pixels."""
        drawn = self.folder.content(self.folder.figure(item.name)).decode()
        width, height = (round(float(size) * 4 / 3) for size in _SIZE.findall(drawn)[:2])
        address = Markup(f"svg+xml,{drawn.translate(_ESCAPED)}")
        texts = {"caption": self.inline(item.caption), "alt": item.caption}
        return {**texts, "address": address, "width": width, "height": height}


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")


def _render(parts: Sequence[_Part]) -> str:
    templates = templates_in(_TEMPLATES, is_html=True)
    templates.filters["slug"] = _slug
    templates.filters["sha256"] = lambda text: _base64(hashlib.sha256(text.encode()).digest())
    reports, explored, tables, scenarios = [], [], dict[str, str](), dict[str, Markup]()
    templates.globals |= {"inside": tables, "root": "results/" if parts[0].prefix else ""}
    for part in parts:
        with part.folder.reading():
            for file in fnmatch.filter(part.folder.manifest["files"], "*.csv"):
                tables[f"{part.prefix}{file}"] = part.folder.content(file).decode()
            reports.append(part.report(templates))
            if explorer.FILE in part.folder:
                explored.append((part.name, part.prefix, _base64(_agents(part.folder))))
            for name, declared in part.folder.manifest["scenarios"].items() if part.is_whole else ():
                scenarios[name] = part.inline(inert(declared["description"]))
    first = parts[0].folder.manifest
    horizons = {part.folder.manifest.get("horizon") for part in parts} - {None}
    with parts[0].folder.reading():
        return templates.get_template("page.html").render(
            reports=reports,
            is_own=not parts[0].prefix,
            scenarios=scenarios,
            horizon=horizons.pop() if len(horizons) == 1 else None,
            agents=explored,
            command="make report" if len(parts) > 1 else first["command"],
            version=__version__,
            year=max(str(report["year"]) for report in reports),
            css=Markup((_TEMPLATES / "page.css").read_text(encoding="utf-8")),
            js=Markup("\n".join(_scripts("main.js").values())),
            data=_base64(explorer.compressed(tables)),
        )


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")


def _agents(folder: Folder) -> bytes:
    shown = json.loads(gzip.decompress(folder.content(explorer.FILE)))
    for agent in shown["agents"]:
        variant = agent["variant"]
        agent["label"] = folder.title(f"{variant}, {agent['observation']}")
        agent["family"] = folder.manifest["algorithms"][variant]["family"]
    return explorer.compressed(shown)


def _scripts(name: str) -> dict[str, str]:
    """Returns a module of the script after those that it imports, since the page can import no files.

    All share one scope, so their top-level names must differ.
    """
    text = (_TEMPLATES / "script" / name).read_text(encoding="utf-8")
    texts: dict[str, str] = {}
    for needed in _IMPORT.findall(text):
        texts |= _scripts(needed)
    return texts | {name: _EXPORT.sub("", _IMPORT.sub("", text))}


def _finding(path: Path, document: Document | None) -> str:
    folder = Folder(path)
    with suppress(InputError), folder.reading():  # it may be damaged
        headline = (document or document_of(path)).headline or inert(folder.manifest["description"])
        return local_only(plain(headline.partition("\n\n")[0]))
    return ""
