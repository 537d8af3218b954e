"""Writes the page: one HTML file with every report's document and the explorer, made of published files.

Nothing is computed here, so no run is needed. A document is that of README, with a figure or a sortable
table in the place of every item. A number is an entry of a CSV file beside the page, and links to its row,
counted as by RFC 7111.
"""

import base64
import gzip
import io
import json
import re
import tomllib
import zlib
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, Final

import jinja2
import pandas as pd
from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup
from PIL import Image

from benchmark.drawing.style import in_dark, learner_style
from benchmark.drawing.tables import inert
from benchmark.execution.provenance import digest_of_file, digest_of_source
from benchmark.page import episode
from benchmark.reports import explorer, files, sameness
from benchmark.reports.document import Document, templates_in
from benchmark.reports.folder import MANIFEST, Folder
from benchmark.reports.item import Item
from envs import InputError, load_scenario

STAMP: Final = ".page-stamp"  # beside the page, see `benchmark.reports.sameness`
# The experiments that `results/index.html` shows, those of them that are there; the first of them leads it.
PUBLISHED: Final = ("when", "compare_deep", "beyond", "reproduce")
SPEED: Final = "speed"  # the folder with measurements of this project, at the end of that page
_TEMPLATES: Final = Path(__file__).parent / "templates"
_TASK: Final = Path(__file__).parents[1] / "reports" / "task.md"
_SIZE: Final = re.compile(r' (?:width|height)="([\d.]+)pt"')  # of an SVG
_MOST_PIXELS: Final = 16_383  # of a side of a WebP image
_MOST_ROWS: Final = 60  # of a table; of longer ones, the page shows the CSV file on demand
_MOST_KEYS: Final = 3  # columns that name a row, and share one column on a narrow screen
_PLACE: Final = "\ue000"  # around the name of an item, for which its HTML is put in at the end
_PLACED: Final = re.compile(f"(?:<p>)?{_PLACE}([^{_PLACE}]*){_PLACE}(?:</p>)?")
_FOLDED: Final = "Terms"  # heading of a section that is shown on demand
_MINUS: Final = re.compile(r"(?<![\w-])-(?=\d)")
# A cell of a column of numbers: a number, perhaps with its interval or a sign.
_NUMBER: Final = re.compile(r"((-|never|[−+]?[\d,.]+(e[-+]\d+)?)( ?[%(\[✓✗?].*)?)?")
_IMPORT: Final = re.compile(r'^import (?:\{[^}]*\} from )?"\./(\w+\.js)";\n', re.MULTILINE)
_EXPORT: Final = re.compile(r"^export ", re.MULTILINE)


def published(results: Path) -> list[str]:
    """Lists the published experiments whose results are there."""
    return [name for name in PUBLISHED if (results / name / MANIFEST).exists()]


def update(results: Path, experiment: str) -> str:
    """Writes the page of an experiment, whose results were just made, unless it is up to date; see `write`.

    Returns:
      The page's path, and whether it was left as it was.

    Raises:
      InputError: See `write`.
    """
    names, target = _subjects(results, experiment)
    stamp, inputs = target.with_name(STAMP), _inputs(results, names)
    if sameness.is_up_to_date(stamp, inputs):
        return f"{target}, up to date"
    write(results, experiment)
    sameness.write_stamp(stamp, inputs, [target, results / "README.md"])
    return str(target)


def write(results: Path, experiment: str | None = None) -> Path:
    """Writes what `texts` returns; returns the page's path.

    Raises:
      InputError: There is nothing to show, or the page cannot be written.
    """
    with files.alone(results):
        for path, text in texts(results, experiment):
            files.write_text(path, text)
    return _subjects(results, experiment)[1]


def texts(results: Path, experiment: str | None = None) -> Iterator[tuple[Path, str]]:
    """Yields the page of the published experiments, or of another one, and the list of all results.

    Args:
      results: The folder of results.
      experiment: One that is published, or None: the page shows all of these that are there, and is
        `index.html` of `results`. Another one: the page shows that alone, and lies in its folder.

    Yields:
      Where each is, and its text. The list comes last, as it says which pages are there.

    Raises:
      InputError: There is nothing to show.
    """
    names, target = _subjects(results, experiment)
    if not names:
        others = ", ".join(sorted(path.parent.name for path in results.glob(f"*/{MANIFEST}")))
        hint = f"; the page of {others} is in its folder" if others else ""
        raise InputError(
            f"{results}: there are no results of {' or '.join(PUBLISHED)} to report; make reproduce and make "
            f"compare-deep make them{hint}."
        )
    parts = [_Part(results / name, "" if target.parent != results else f"{name}/") for name in names]
    yield target, _render(parts)
    yield results / "README.md", _index(results)


def _subjects(results: Path, experiment: str | None) -> tuple[list[str], Path]:
    """Returns the folders that a page shows, and the page."""
    if experiment is not None and experiment not in PUBLISHED:
        return [experiment], results / experiment / "index.html"
    names = published(results)
    if names and (results / SPEED / MANIFEST).exists():
        names.append(SPEED)
    return names, results / "index.html"


def _inputs(results: Path, names: Sequence[str]) -> str:
    """Returns the digest of all files that a page is made of, and of the code that lies elsewhere."""
    paths = [path for name in names for path in sorted((results / name).glob("[!.]*")) if path.is_file()]
    parts = [
        f"{path.relative_to(results)} {digest_of_file(path)}" for path in paths if path.suffix != ".html"
    ]
    declared = [Document(results / name).folder.manifest["report"] for name in names]
    named = [name for each in declared for name in (each["kind"], *each["items"]) if ":" in name]
    return sameness.digest_of_inputs(*parts, *(digest_of_source(name.partition(":")[0]) for name in named))


class _Part:
    """A folder of results on the page."""

    def __init__(self, path: Path, prefix: str) -> None:
        """Reads its manifest; `prefix` leads from the page to the folder."""
        self.document = Document(path)
        self.folder = self.document.folder
        self.name = path.name
        self.prefix = prefix
        self.root = f"results/{path.name}/"  # in the repository
        self._parser = MarkdownIt("commonmark", {"html": False}).enable("table").disable("image")

    def report(self, templates: jinja2.Environment) -> dict[str, Any]:
        """Returns what the page shows of the report.

        Args:
          templates: Those of the page, with what all of them need among their globals.
        """
        document, items = self.document, {item.name: item for item in self.document.items}
        lead = items.get(document.report.lead)
        has_lead = lead is not None and document.has_figure(lead)
        folded: set[str] = set()

        def place(item: Item, is_folded: bool) -> str:
            folded.update([item.name] * is_folded)
            return f"\n\n{_PLACE}{item.name}{_PLACE}\n\n"

        def content(match: "re.Match[str]") -> str:
            item = items[match[1]]
            table = self._table(item)
            # What is shown on demand is a table, if there is one, and no figure: figures make the page large.
            is_drawn = document.has_figure(item) and not (has_lead and item is lead)
            figure = self._figure(item) if is_drawn and not (table and item.name in folded) else None
            text = templates.get_template("item.html").render(
                item=item,
                table=table,
                figure=figure,
                is_folded=item.name in folded,
                most_rows=_MOST_ROWS,
                source=self.link(f"{item.name}.csv"),
            )
            return text.strip()

        headline, sections = document.headline, self._sections(document.render(place))
        description = self.inline(inert(self.folder.manifest["description"]))
        return {
            "id": self.name,
            "question": document.question,
            "headline": [self.inline(text) for text in headline.text.split("\n\n")] if headline else [],
            "map": self._map(),
            "lead": self._figure(lead) if lead is not None and has_lead else None,
            "description": description,
            "note": self.inline(inert(self.folder.manifest.get("note", ""))),
            "findings": [self.inline(inert(finding.text)) for finding in document.findings],
            # The HTML is ours.
            "sections": [each | {"body": Markup(_PLACED.sub(content, each["body"]))} for each in sections],
            "readme": self.link("README.md"),
            "made": self.folder.manifest,
            "partial": self.inline(self.folder.manifest.get("partial") or ""),
            "year": self.folder.manifest.get("last_started_at", "")[:4],
            "making": Markup(
                templates.get_template("made.html").render(
                    made=self.folder.manifest,
                    description=description,
                    manifest=self.link(MANIFEST),
                )
            ),
        }

    def _map(self) -> dict[str, Any] | None:
        """Returns what the page's map needs but for its tables; None if this is no map."""
        if self.folder.manifest["report"]["kind"] != "map":
            return None
        names, variants = self.folder.names, self.folder.manifest["algorithms"]
        looks = {}
        for variant, declared in variants.items():
            for observation in declared["settings"]:
                style = learner_style(variant, observation, [*variants])
                dash = " ".join(f"{4 * part:g}" for part in style["ls"][1]) if style["ls"] != "-" else ""
                colour = f"light-dark({style['color']}, {in_dark(style['color'])})"
                name = names(variant, observation)
                told = names.told(f"{variant}, {observation}")
                looks[f"{variant}, {observation}"] = {
                    "name": name, "told": told, "colour": colour, "dash": dash,
                }  # fmt: skip
        return {"folder": self.prefix, "looks": looks}

    def link(self, file: str) -> str:
        """Returns where a file of the folder is, seen from the page."""
        return f"{self.prefix}{file}"

    def inline(self, text: str) -> Markup:
        """Returns a text in Markdown as HTML within a paragraph; what it has of HTML is shown as it is."""
        return self._html(self._parser.parseInline(text))

    def _html(self, tokens: Sequence[Token]) -> Markup:
        """Returns parsed Markdown as HTML, with links from the page to what can be reached from it."""
        bare = ""  # the file of a link that leads nowhere from the page, which is then named
        for token in [child for each in tokens for child in (each.children or [])]:
            target = str(token.attrGet("href") or "")
            if token.type == "link_close" and bare:
                token.type, token.content, bare = "text", f" ({bare})", ""
            if target and ":" not in target and not target.startswith(("#", "/")):
                if ".csv" in target:
                    token.attrSet("href", self.link(target))
                    token.attrSet("class", "n" if "#row=" in target else "file")
                elif self.prefix and (repository := about()["repository"]):
                    token.attrSet("href", f"{repository}/blob/main/{self.root}{target}")
                else:
                    token.type, token.content, bare = "text", "", f"{self.root}{target}"
            if token.type == "text":
                token.content = _MINUS.sub("−", token.content)
        return Markup(self._parser.renderer.render(tokens, self._parser.options, {}))

    def _sections(self, markdown: str) -> list[dict[str, Any]]:
        """Returns a document's sections: heading, id and body of each; what stands first has no heading."""
        sections: list[tuple[Markup, str, list[Token]]] = [(Markup(), "", [])]
        tokens = self._parser.parse(markdown)
        for token, following in zip(tokens, [*tokens[1:], Token("", "", 0)], strict=True):
            if token.type == "heading_open" and (token.tag == "h2" or following.content == _FOLDED):
                sections.append((self._html([following]), f"{self.name}-{_slug(following.content)}", []))
                continue
            token.tag = re.sub(r"^h(\d)$", lambda match: f"h{int(match[1]) + 2}", token.tag)
            sections[-1][2].append(token)
            if token.type == "heading_close" and len(sections[-1][2]) == 2:
                sections[-1][2].clear()  # of the section itself
        return [
            {"heading": heading, "id": key, "is_folded": heading == _FOLDED, "body": self._html(parsed)}
            for heading, key, parsed in sections
            if key or parsed
        ]

    def _table(self, item: Item) -> dict[str, Any] | None:
        """Returns an item's table: its columns, the kind of each, and its rows; None without rows to show."""
        shown = self.document.shown(item) if self.document.has_table(item) else pd.DataFrame()
        if shown.empty:
            return None
        cells = [[self.inline(str(text)) for text in row] for row in shown.itertuples(index=False)]
        kinds = [_kind(str(name), [row[i].striptags() for row in cells]) for i, name in enumerate(shown)]
        n_keys = next((i for i, kind in enumerate(kinds[:_MOST_KEYS]) if kind), min(len(kinds), _MOST_KEYS))
        kinds[1:n_keys] = ["key"] * (n_keys - 1)
        return {
            "columns": [self.inline(str(name)) for name in shown],
            "kinds": kinds,
            "rows": cells,
            "n_keys": n_keys,
        }

    def _figure(self, item: Item) -> dict[str, Any]:
        """Returns a figure as the page shows it: an SVG as it is, another one as WebP, without any loss."""
        path = self.folder.path / self.document.figure(item)
        content = path.read_bytes()
        if path.suffix == ".svg":
            form = "image/svg+xml"
            width, height = (round(float(each) * 4 / 3) for each in _SIZE.findall(content.decode())[:2])
        else:
            form, buffer = "image/webp", io.BytesIO()
            with Image.open(path) as image:
                small = image.convert("RGB")
            small.thumbnail((_MOST_PIXELS, _MOST_PIXELS))
            width, height = small.size
            small.save(buffer, "WEBP", lossless=True, method=4)
            content = buffer.getvalue()
        return {
            "caption": self.inline(item.caption),
            "alt": item.caption,
            "type": form,
            "data": _base64(content),
            "width": width,
            "height": height,
        }


def _slug(text: str) -> str:
    """Returns a text's letters and digits, for an id or a class."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")


def _kind(name: str, texts: Iterable[str]) -> str:
    """Returns the class of a column's cells: names have none."""
    if all(_NUMBER.fullmatch(text) for text in texts):
        return "number"
    return "verdict" if name.startswith("verdict") else ""


def _render(parts: Sequence[_Part]) -> str:
    """Returns the page."""
    templates = templates_in(_TEMPLATES, is_html=True)
    templates.filters |= {"slug": _slug, "signed": lambda number: f"{number:.3g}".replace("-", "−")}
    names = {part.link(path.name) for part in parts for path in part.folder.path.glob("*.csv")}
    templates.globals |= {
        "inside": names,
        "root": "results/" if parts[0].prefix else parts[0].root,
        "hosted": about()["repository"] if parts[0].prefix else "",  # which has published folders alone
        **about(),
    }
    reports, explored, texts, scenarios = [], [], dict[str, str](), dict[str, Markup]()
    for part in parts:
        with part.folder.reading():
            reports.append(part.report(templates))
            if explorer.FILE in part.folder:
                explored.append((part.name, part.prefix, pack(_agents(part.folder))))
            for path in sorted(part.folder.path.glob("*.csv")):
                texts[part.link(path.name)] = path.read_text(encoding="utf-8")
            for name, declared in part.folder.manifest["scenarios"].items():
                scenarios[name] = part.inline(inert(declared["description"]))
    scene, steps = episode.episode()
    manifests = [part.folder.manifest for part in parts]
    usual = load_scenario(episode.SCENARIO).model_dump(mode="json")
    # The page of a user's experiment is not about a scenario that it does not have.
    own = {} if parts[0].prefix else manifests[0]["scenarios"]
    is_told = not own or own.get(episode.SCENARIO) == usual
    with parts[0].folder.reading():
        content = {
            "reports": reports,
            "task": parts[0].inline(_TASK.read_text(encoding="utf-8")),
            "moving": episode.moving(scene, steps),
            "steps": [(step, episode.still(scene, steps, step)) for step in episode.told(steps) if is_told],
            "rate": episode.RATE,
            "discount": episode.DISCOUNT,
            "scenarios": scenarios,
            "horizon": manifests[0].get("horizon"),
            "agents": explored,
            "command": "make report" if len(parts) > 1 else manifests[0]["command"],
            "year": max((each["year"] for each in reports), default=""),
            "css": Markup((_TEMPLATES / "page.css").read_text(encoding="utf-8")),
            "js": Markup(_script()),
        }
        return templates.get_template("page.html").render(**content, data=pack(texts))


@cache
def about() -> dict[str, str]:
    """Returns the version of this project, and the address of its repository, which may be empty."""
    try:
        declared = tomllib.loads((_TEMPLATES.parents[2] / "pyproject.toml").read_text(encoding="utf-8"))
    except OSError:  # an installed package
        return {"version": metadata.version("proxemic-benchmark"), "repository": ""}
    return {
        "version": declared["project"]["version"],
        "repository": declared.get("tool", {})
        .get("proxemic-benchmark", {})
        .get("repository", "")
        .rstrip("/"),
    }


def pack(data: object) -> str:
    """Returns data as compressed JSON in base64."""
    return _base64(explorer.compressed(data))


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")


def _agents(folder: Folder) -> dict[str, Any]:
    """Returns what the explorer shows of a folder, with what readers call the learners."""
    content = (folder.path / explorer.FILE).read_bytes()
    with folder.reading():
        names = folder.names
        try:
            shown: dict[str, Any] = json.loads(gzip.decompress(content))
        except (EOFError, zlib.error) as error:
            raise ValueError(f"{explorer.FILE} cannot be unpacked") from error
        if "sights" not in shown:  # made by an earlier version
            raise KeyError("sights")
        for agent in shown["agents"]:
            variant = agent["algorithm"]
            agent |= {"label": names(variant, agent["observation"]), "family": names.families[variant]}
    return shown


def _script() -> str:
    """Returns `main.js` and all modules that it needs as one script, each module after those that it imports.

    The page is one file, which cannot import others. All modules share one scope, so their top-level names
    must differ.
    """
    texts: dict[str, str] = {}

    def add(name: str) -> None:
        text = (_TEMPLATES / "script" / name).read_text(encoding="utf-8")
        for needed in _IMPORT.findall(text):
            if needed not in texts:
                add(needed)
        texts[name] = _EXPORT.sub("", _IMPORT.sub("", text))

    add("main.js")
    return "\n".join(texts.values())


# The list of all results


def _index(results: Path) -> str:
    """Returns the page that lists all folders of results, among the published ones no others."""
    folders = {}
    for path in sameness.published_folders(results):
        if not (path / "README.md").exists():
            continue
        paragraphs = (path / "README.md").read_text(encoding="utf-8").split("\n\n")
        first = next((paragraph for paragraph in paragraphs if not paragraph.startswith("#")), "")
        folders[path.name] = first.replace("\n", " ").replace("|", r"\|").strip()
    template = templates_in(_TEMPLATES).get_template("index.md.jinja")
    return template.render(folders=folders, has_page=bool(published(results)))
