"""Builds the site: `python -m benchmark.page.site RESULTS SITE [PACKAGE ...]`, or `make docs`.

The page stands beside this project's documents, the references of files and columns, the tour, and the API.
pdoc writes all but the page: to it, a document is a module that has nothing but a text.
"""

import json
import os
import re
import shutil
import sys
import warnings
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from types import ModuleType
from typing import Final, NamedTuple

from pdoc import doc, render

from benchmark.page import build, reference
from envs import InputError

ROOT: Final = Path(__file__).parents[2]
PACKAGES: Final = ("envs", "agents", "benchmark")
TOUR: Final = ROOT / "benchmark" / "tour.ipynb"
# The project's own documents: name on the site, title in the navigation, file.
_DOCUMENTS: Final = (
    ("index", "Overview", "README.md"),
    ("tour", "Tour in ten cells", "benchmark/tour.ipynb"),
    ("commands", "Running experiments", "benchmark/commands/README.md"),
    ("scenarios", "Scenario files", "envs/scenarios/README.md"),
    ("experiments", "Experiment files", "benchmark/experiments/README.md"),
    ("algorithms", "Algorithms", "agents/README.md"),
    ("reports", "Reports", "benchmark/reports/README.md"),
    ("columns", "Columns of tables", "benchmark/reports/columns.py"),
    ("contributing", "Contributing", "CONTRIBUTING.md"),
    ("glossary", "Glossary", "benchmark/glossary.md"),
)
_TEMPLATES: Final = Path(__file__).parent / "templates" / "site"
_LINK: Final = re.compile(r"(!?)\[((?:\\.|[^\]\\])*)\]\(([^)\s]+)\)")
_CODE: Final = re.compile(r"(^```.*?^```$|`[^`\n]*`)", re.DOTALL | re.MULTILINE)
_MARK: Final = "search.js"  # which every site has, and nothing else that could be deleted


class Document(NamedTuple):
    """A document of the site: its title in the navigation, its file, and its Markdown."""

    title: str
    source: Path
    text: str


def write(results: Path, site: Path, packages: Sequence[str] = PACKAGES) -> None:
    """Writes the site, in place of what is there.

    Args:
      results: The folder of published results; its page is written, too.
      site: The folder of the site; what is there must be a site, or empty.
      packages: What has API pages, with all modules inside.

    Raises:
      InputError: There is nothing to show, see `benchmark.page.build.write`; or the site would delete
        something else.
    """
    for kept in (ROOT.resolve(), results.resolve()):
        if kept.is_relative_to(site.resolve()):
            raise InputError(f"SITE={site}: it has {kept} inside; accepted: a folder of its own.")
    if site.exists() and not (site / _MARK).is_file() and not (site.is_dir() and not any(site.iterdir())):
        raise InputError(f"SITE={site}: it has other files; accepted: a new or empty folder, or a site.")
    build.write(results)
    shutil.rmtree(site, ignore_errors=True)
    for folder in build.published(results):
        shutil.copytree(folder, site / "results" / folder.name, ignore=shutil.ignore_patterns(".*"))
    for name in ("index.html", "README.md"):
        shutil.copy(results / name, site / "results")
    shutil.copy(TOUR, site)
    documents = _documents(results)
    pages = {document.source: _page(name) for name, document in documents.items()}
    modules = {}
    for name, document in documents.items():
        module = ModuleType(name, _linked(document, _page(name).count("/"), results, pages))
        module.__dict__.update(__all__=[], __docformat__="markdown")
        modules[name] = doc.Module(module)
    api = {name: doc.Module.from_name(name) for package in packages for name in _modules(package)}
    render.configure(docformat="google", template_directory=_TEMPLATES, show_source=False)
    titles = {name: document.title for name, document in documents.items()}
    render.env.globals |= {"documents": titles, "packages": packages}
    with warnings.catch_warnings():  # annotations that only type checkers understand are shown as they are
        warnings.filterwarnings("ignore", "Error parsing type annotation")
        for name, shown in (modules | api).items():
            path = site / _page(name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(render.html_module(shown, api), encoding="utf-8")
        (site / _MARK).write_text(render.search_index(modules | api), encoding="utf-8")


def _page(name: str) -> str:
    """Returns the path of a document or module on the site."""
    return f"{name.replace('.', '/')}.html"


def _modules(package: str) -> list[str]:
    """Lists a package and all modules inside, also those that its `__all__` does not name."""
    paths = import_module(package).__path__
    inside = [module.name for module in walk_packages(paths, f"{package}.")]
    return [package, *(name for name in inside if not name.endswith("__main__"))]


def _documents(results: Path) -> dict[str, Document]:
    """Returns all documents by their names on the site."""
    files = {name: (title, ROOT / file) for name, title, file in _DOCUMENTS}
    files["results"] = ("Folders of results", results / "README.md")
    for folder in build.published(results):
        files[f"results.{folder.name}"] = (folder.name, folder / "README.md")
    texts = {name: path.read_text(encoding="utf-8") for name, (_, path) in files.items()}
    texts["tour"] = tour()
    texts["columns"] = reference.columns(results)
    texts["scenarios"] += f"\n{reference.scenarios()}"
    texts["experiments"] += f"\n{reference.experiments()}"
    return {name: Document(title, path, texts[name]) for name, (title, path) in files.items()}


def tour() -> str:
    """Returns the notebook as Markdown."""
    texts = []
    for cell in json.loads(TOUR.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        texts.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
    return "\n\n".join([*texts, f"[Download the notebook]({TOUR.name})"])


def _linked(document: Document, depth: int, results: Path, pages: Mapping[Path, str]) -> str:
    """Returns a document whose links lead to the site's own pages and files, or to the repository.

    A link to a file of the repository whose address is not known becomes its text.

    Args:
      document: The document.
      depth: The number of folders around its page on the site.
      results: The folder of results.
      pages: By file, the pages of all documents.
    """
    repository = build.about()["repository"]

    def moved(match: re.Match[str]) -> str:
        mark, label, link = match.groups()
        if re.match(r"[a-z]+:|#", link) or link == TOUR.name:
            return match[0]
        file, hash_, row = link.partition("#")
        path = Path(os.path.normpath(document.source.parent / file))
        if path in pages:
            target = pages[path]
        elif path.is_relative_to(results) and path.exists():
            target = f"results/{path.relative_to(results).as_posix()}"
        elif repository and path.is_relative_to(ROOT):
            return f"{mark}[{label}]({repository}/blob/main/{path.relative_to(ROOT).as_posix()})"
        else:
            return label
        return f"{mark}[{label}]({'../' * depth}{target}{hash_}{row})"

    parts = _CODE.split(document.text)
    return "".join(part if i % 2 else _LINK.sub(moved, part) for i, part in enumerate(parts))


if __name__ == "__main__":
    try:
        write(Path(sys.argv[1]).resolve(), Path(sys.argv[2]), sys.argv[3:] or PACKAGES)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    print(f"the site is {sys.argv[2]}/index.html")
