"""Builds the site: `python -m benchmark.publish.page.site RESULTS SITE`, or `make docs`.

The page, this project's documents and a list of all columns of tables are laid out as in the repository,
beside the API, which pdoc writes. What is there from before stays, unless it has the same name.
"""

import posixpath
import re
import shutil
import sys
import warnings
from collections.abc import Collection, Sequence
from importlib import import_module
from itertools import chain
from pathlib import Path
from pkgutil import walk_packages
from typing import Final

from pdoc import pdoc, render
from pdoc.render_helpers import to_html
from tabulate import tabulate

from benchmark import leaderboard
from benchmark.publish import sameness
from benchmark.publish.document import document_of
from benchmark.publish.page import build
from envs import InputError

ROOT: Final = Path(__file__).parents[3]
PACKAGES: Final = ("envs", "agents", "benchmark")
_GUIDES: Final = {  # documents in the navigation
    "README.md": "Overview",
    "benchmark/guide.md": "Your scene in ten minutes",
    "agents/README.md": "Your own learner",
    "benchmark/commands/README.md": "Running experiments",
    "envs/scenarios/README.md": "Scenario files",
    "benchmark/experiments/README.md": "Experiment files",
    "benchmark/studies/README.md": "Studies",
    "columns.md": "Columns of tables",
    "CONTRIBUTING.md": "Contributing",
    "benchmark/glossary.md": "Glossary",
    "results/README.md": "Folders of results",
}
_KEYS: Final = {  # modules that have every key of a kind of file
    "envs/scenarios/README.md": ["envs.scenario", "envs.people", "envs.regions"],
    "benchmark/experiments/README.md": [
        "benchmark.experiments.schema",
        "benchmark.experiments.search",
        *(f"benchmark.studies.{name}.declared" for name in ("comparison", "map")),
    ],
}
_TEMPLATES: Final = Path(__file__).parent / "templates" / "site"
_LINK: Final = re.compile(r'(href|src)="(?![a-z]+:)([^"#]+)')


def write(results: Path, site: Path, packages: Sequence[str] = PACKAGES) -> None:
    """Writes the site.

    Args:
      results: The folder of published results; its page is written, too.
      site: The folder of the site.
      packages: What has API pages, with all modules inside.

    Raises:
      InputError: There is nothing to show.
    """
    build.write(results)
    for folder in build.published(results):
        for name in sameness.listed(folder):
            _copy(folder / name, site / "results" / folder.name / name)
    _copy(results / "index.html", site / "results" / "index.html")
    render.configure(docformat="google", template_directory=_TEMPLATES, show_source=False)
    with warnings.catch_warnings():
        # Annotations that only type checkers understand are shown as they are.
        warnings.filterwarnings("ignore", "Error parsing type annotation")
        # pdoc finds some of the modules inside packages by itself, too.
        warnings.filterwarnings("ignore", "The module specification")
        pdoc(*chain(*map(_modules, packages)), output_directory=site / "api")
    template, documents = render.env.get_template("document.html.jinja2"), _documents(results)
    for path, text in documents.items():
        page = (site / path).with_suffix(".html")
        page.parent.mkdir(parents=True, exist_ok=True)
        known = {"documents": _GUIDES, "packages": packages}
        html = template.render(path=path, up="../" * path.count("/"), body=to_html(text), **known)
        page.write_text(_linked(html, Path(path).parent, site, documents), encoding="utf-8")
    _copy(site / "README.html", site / "index.html")


def _modules(package: str) -> list[str]:
    inside = walk_packages(import_module(package).__path__, f"{package}.")
    return [package, *(module.name for module in inside if not module.name.endswith("__main__"))]


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(source, target)


def _documents(results: Path) -> dict[str, str]:
    """Returns all documents in Markdown, by their paths in the repository."""
    made = {"columns.md": columns(results)}
    files = {path: ROOT / path for path in _GUIDES if path not in made}
    files["results/README.md"] = results / "README.md"
    texts = {path: file.read_text(encoding="utf-8") for path, file in files.items()} | made
    # Made again, as those in the folders may have been edited by hand.
    again = {folder / "README.md": document_of(folder).readme() for folder in build.published(results)}
    again |= leaderboard.texts(results, print)
    texts |= {f"results/{path.parent.name}/README.md": text for path, text in again.items()}
    for path, modules in _KEYS.items():
        up = "../" * path.count("/")
        links = ", ".join(f"[{name}]({up}api/{name.replace('.', '/')}.html)" for name in modules)
        texts[path] += f"\n## Every key\n\nAll keys, with what they accept: {links}.\n"
    return texts


def columns(results: Path) -> str:
    """Returns the reference of all columns of the published tables in a folder of results."""
    parts = [
        "# Columns of the tables",
        "Tables of results are CSV files with six significant digits. `NAME_low` and `NAME_high` are the "
        "ends of the 95 % interval of `NAME`. An empty field means that there is no number, and inf that it "
        "never happens.",
    ]
    tables = dict[tuple[str, str, str], dict[str, str | None]]()
    for folder in build.published(results):
        document = document_of(folder)
        for item in document.items:
            file = item.file or f"{item.name}.csv"
            if ".csv" in file and file in document.folder:
                meanings = {
                    f"`{name}`": item.meaning(str(name), document.name)
                    for name in document.folder.frame(file)
                }
                tables.setdefault((document.name, file, item.description), {}).update(meanings)
    for (report, name, description), meanings in tables.items():
        grid = tabulate(meanings.items(), ["column", "meaning"], "github")
        parts += [f"## `{name}` ({report})", description, grid]
    return "\n\n".join(parts)


def _linked(html: str, folder: Path, site: Path, documents: Collection[str]) -> str:
    """Returns a page whose links lead to the pages of documents; copies other files that it links to."""

    def moved(match: re.Match[str]) -> str:
        path = posixpath.normpath(folder / match[2])
        if path in documents:
            return f'{match[1]}="{match[2].removesuffix(".md")}.html'
        if (ROOT / path).is_file() and not (site / path).exists():
            _copy(ROOT / path, site / path)
        return match[0] if (site / path).exists() else ""

    return _LINK.sub(moved, html)


if __name__ == "__main__":
    try:
        write(Path(sys.argv[1]), Path(sys.argv[2]))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    print(f"the site is {sys.argv[2]}/index.html")
