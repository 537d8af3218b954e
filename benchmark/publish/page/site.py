"""Builds the site: `python -m benchmark.publish.page.site RESULTS SITE [PACKAGE ...]`, or `make docs`.

The page, this project's documents, the references of files and columns and the API are laid out as in the
repository. pdoc writes all but the page: to it, a document is a module that has nothing but a text.
"""

import re
import shutil
import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from types import ModuleType
from typing import Final

from pdoc import doc, render

from benchmark import leaderboard
from benchmark.publish import sameness
from benchmark.publish.document import document_of
from benchmark.publish.page import build, reference
from envs import InputError

ROOT: Final = Path(__file__).parents[3]
PACKAGES: Final = ("envs", "agents", "benchmark")
_GUIDES: Final = {  # in the navigation, by their names on the site
    "README": "Overview",
    "benchmark.guide": "Your scene in ten minutes",
    "agents.README": "Your own learner",
    "benchmark.commands.README": "Running experiments",
    "envs.scenarios.README": "Scenario files",
    "benchmark.experiments.README": "Experiment files",
    "benchmark.studies.README": "Reports",
    "columns": "Columns of tables",
    "CONTRIBUTING": "Contributing",
    "benchmark.glossary": "Glossary",
    "results.README": "Folders of results",
}
_TEMPLATES: Final = Path(__file__).parent / "templates" / "site"
_LINK: Final = re.compile(r'(href|src)="(?![a-z]+:)([^"#]+)')
_MARK: Final = "search.js"  # which every site has, and nothing else that could be deleted


def write(results: Path, site: Path, packages: Sequence[str] = PACKAGES) -> None:
    """Writes the site, in place of what is there.

    Args:
      results: The folder of published results; its page is written, too.
      site: The folder of the site: a new one, or one with a site.
      packages: What has API pages, with all modules inside.

    Raises:
      InputError: There is nothing to show, or the folder has something else.
    """
    if not (site / _MARK).is_file() and (site.is_file() or any(site.glob("*"))):
        raise InputError(f"SITE={site}: not a site; accepted: a new or empty folder, or an earlier site.")
    build.write(results)
    site.mkdir(parents=True, exist_ok=True)
    (site / _MARK).touch()  # before all else, and never removed: an interrupted site stays one
    for path in {*site.iterdir()} - {site / _MARK}:
        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
    for folder in build.published(results):
        listed, to = sameness.listed(folder), site / "results" / folder.name
        shutil.copytree(folder, to, ignore=lambda _, names, listed=listed: {*names} - listed)
    shutil.copy(results / "index.html", site / "results")
    modules = {}
    for name, text in _documents(results).items():
        module = ModuleType(name, text)
        module.__dict__.update(__all__=[], __docformat__="markdown")
        modules[name] = doc.Module(module)
    api = {name: doc.Module.from_name(name) for package in packages for name in _modules(package)}
    render.configure(docformat="google", template_directory=_TEMPLATES, show_source=False)
    render.env.globals |= {"documents": _GUIDES, "packages": packages}
    with warnings.catch_warnings():  # annotations that only type checkers understand are shown as they are
        warnings.filterwarnings("ignore", "Error parsing type annotation")
        for name, shown in (modules | api).items():
            path = _page(name, site)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(render.html_module(shown, api), encoding="utf-8")
        (site / _MARK).write_text(render.search_index(modules | api), encoding="utf-8")
    for name in modules:
        _link(_page(name, site), site)
    shutil.copy(site / "README.html", site / "index.html")


def _page(name: str, site: Path) -> Path:
    return site / f"{name.replace('.', '/')}.html"


def _modules(package: str) -> list[str]:
    inside = walk_packages(import_module(package).__path__, f"{package}.")
    return [package, *(module.name for module in inside if not module.name.endswith("__main__"))]


def _documents(results: Path) -> dict[str, str]:
    made = {"columns": reference.columns(results)}
    files = {name: ROOT / f"{name.replace('.', '/')}.md" for name in _GUIDES if name not in made}
    files["results.README"] = results / "README.md"
    texts = {name: path.read_text(encoding="utf-8") for name, path in files.items()} | made
    # Made again, as those in the folders may have been edited by hand.
    again = {folder / "README.md": document_of(folder).readme() for folder in build.published(results)}
    again |= leaderboard.texts(results, print)
    texts |= {f"results.{path.parent.name}.README": text for path, text in again.items()}
    texts["envs.scenarios.README"] += f"\n{reference.scenarios()}"
    texts["benchmark.experiments.README"] += f"\n{reference.experiments()}"
    return texts


def _link(path: Path, site: Path) -> None:
    """Turns a document's links to other documents into links to their pages; copies other linked files."""

    def moved(match: re.Match[str]) -> str:
        target = path.parent / match[2]
        if target.suffix == ".md" and target.with_suffix(".html").exists():
            return f'{match[1]}="{match[2].removesuffix(".md")}.html'
        original = ROOT / target.resolve().relative_to(site.resolve())
        if original.is_file() and not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(original, target)
        return match[0] if target.exists() else ""

    path.write_text(_LINK.sub(moved, path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    try:
        write(Path(sys.argv[1]).resolve(), Path(sys.argv[2]), sys.argv[3:] or PACKAGES)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    print(f"the site is {sys.argv[2]}/index.html")
