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
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from types import ModuleType
from typing import Final

from pdoc import doc, render

from benchmark.page import build, reference
from benchmark.reports import sameness
from benchmark.reports.folder import MANIFEST
from envs import InputError

ROOT: Final = Path(__file__).parents[2]
PACKAGES: Final = ("envs", "agents", "benchmark")
TOUR: Final = ROOT / "benchmark" / "tour.ipynb"
_TEMPLATES: Final = Path(__file__).parent / "templates" / "site"
_LINK: Final = re.compile(r"(!?)\[((?:\\.|[^\]\\])*)\]\(([^)\s]+)\)")
_CODE: Final = re.compile(r"(^```.*?^```$|`[^`\n]*`)", re.DOTALL | re.MULTILINE)
_MARK: Final = "search.js"  # which every site has, and nothing else that could be deleted


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
    for folder in _folders(results):
        shutil.copytree(folder, site / "results" / folder.name, ignore=shutil.ignore_patterns(".*"))
    for name in ("index.html", "README.md"):
        shutil.copy(results / name, site / "results")
    documents = {name: (title, source, text) for name, title, source, text in _documents(results)}
    pages = {source: f"{name}.html" for name, (_, source, _) in documents.items()}
    address = build.about()["repository"]
    api = {name: doc.Module.from_name(name) for package in packages for name in _modules(package)}
    texts = {}
    for name, (_, source, text) in documents.items():
        target = f"{name.replace('.', '/')}.html"
        module = ModuleType(name, _linked(text, source, results, target, pages, address))
        module.__dict__.update(__all__=[], __docformat__="markdown")
        texts[name] = doc.Module(module)
    render.configure(docformat="google", template_directory=_TEMPLATES, show_source=False)
    titles = {name: title for name, (title, *_) in documents.items()}
    render.env.globals |= {"documents": titles, "packages": packages}
    with warnings.catch_warnings():  # annotations that only type checkers understand are shown as they are
        warnings.filterwarnings("ignore", "Error parsing type annotation")
        for name, each in (texts | api).items():
            path = site / f"{name.replace('.', '/')}.html"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(render.html_module(each, api), encoding="utf-8")
        (site / _MARK).write_text(render.search_index(texts | api), encoding="utf-8")
    shutil.copy(TOUR, site)


def _modules(package: str) -> list[str]:
    """Lists a package and all modules inside, also those that its `__all__` does not name."""
    paths = import_module(package).__path__
    inside = [each.name for each in walk_packages(paths, f"{package}.")]
    return [package, *(name for name in inside if not name.endswith("__main__"))]


def _documents(results: Path) -> Iterator[tuple[str, str, Path, str]]:
    """Yields every document: its name, its title in the navigation, its file, and its Markdown."""

    def file(path: Path) -> tuple[Path, str]:
        return path, path.read_text(encoding="utf-8")

    yield "index", "Overview", *file(ROOT / "README.md")
    yield "tour", "Tour in ten cells", TOUR, tour()
    path, text = file(ROOT / "envs" / "scenarios" / "README.md")
    yield "scenarios", "Scenario files", path, f"{text}\n{reference.scenarios()}"
    yield "experiments", "Experiment files", ROOT / "benchmark" / "experiments", reference.experiments()
    yield (
        "columns",
        "Columns of tables",
        ROOT / "benchmark" / "reports" / "columns.py",
        reference.columns(results),
    )
    yield "contributing", "Contributing", *file(ROOT / "CONTRIBUTING.md")
    yield "results", "Folders of results", *file(results / "README.md")
    for folder in _folders(results):
        yield f"results.{folder.name}", folder.name, *file(folder / "README.md")


def _folders(results: Path) -> list[Path]:
    """Lists the published folders that hold results."""
    return [path for path in sameness.published_folders(results) if (path / MANIFEST).exists()]


def tour() -> str:
    """Returns the notebook as Markdown."""
    cells = json.loads(TOUR.read_text(encoding="utf-8"))["cells"]
    texts = ["".join(cell["source"]) for cell in cells]
    shown = [
        text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```"
        for cell, text in zip(cells, texts, strict=True)
    ]
    return "\n\n".join([*shown, f"[Download the notebook]({TOUR.name})"])


def _linked(text: str, source: Path, results: Path, target: str, pages: dict[Path, str], address: str) -> str:
    """Returns a document whose links lead to the site's own pages and files, or to the repository.

    A link to a file of the repository whose address is not known becomes its text.
    """
    up = "../" * target.count("/")

    def moved(found: re.Match[str]) -> str:
        mark, label, link = found.groups()
        if re.match(r"[a-z]+:|#", link) or link == TOUR.name:
            return found[0]
        file, hash_, row = link.partition("#")
        path = Path(os.path.normpath(source.parent / file))
        if path in pages:
            link = pages[path].replace(".", "/", pages[path].count(".") - 1)
        elif path.is_relative_to(results) and path.exists():
            link = f"results/{path.relative_to(results).as_posix()}"
        elif address and path.is_relative_to(ROOT):
            return f"{mark}[{label}]({address}/blob/main/{path.relative_to(ROOT).as_posix()})"
        else:
            return label
        return f"{mark}[{label}]({up}{link}{hash_}{row})"

    parts = _CODE.split(text)
    return "".join(part if i % 2 else _LINK.sub(moved, part) for i, part in enumerate(parts))


if __name__ == "__main__":
    try:
        write(Path(sys.argv[1]).resolve(), Path(sys.argv[2]), sys.argv[3:] or PACKAGES)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    print(f"the site is {sys.argv[2]}/index.html")
