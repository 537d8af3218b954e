"""What tests of several rooms call: the project's commands, as users run them, and its packages."""

import json
import subprocess
import sys
import tomllib
from collections.abc import Iterable
from importlib.metadata import distribution
from pathlib import Path
from typing import Any, Final

import pandas as pd
from markdown_it import MarkdownIt
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from benchmark.experiments import Experiment, RunSpecification
from benchmark.folder import MANIFEST, write_manifest
from envs import load_scenario

ROOT: Final = Path(__file__).parents[1]
_PYPROJECT: Final = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
PROJECT: Final[dict[str, Any]] = tomllib.loads(_PYPROJECT)["project"]


def specifications(
    experiment: Experiment,
    condition: str,
    scenario: str,
    variant: str,
    observation: str,
    seeds: Iterable[int] | None = None,
) -> list[RunSpecification]:
    """Lists the runs of a population, as the experiment names it."""
    return experiment.population(condition, scenario, f"{variant}, {observation}").runs(seeds)


def few_places(name: str, n: int = 6) -> dict[str, Any]:
    """Returns overrides with which a shipped scenario is small: a group stands in few of many ways."""
    return {"issuer.places": n} if load_scenario(name).group else {}


def reseal(folder: Path, **changes: object) -> None:
    """Writes the manifest of a folder of results again, as if its files had been made as they are."""
    manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8")) | changes
    gone = {key for key, value in changes.items() if value is None}
    write_manifest(folder, {key: value for key, value in manifest.items() if key not in gone})


def git(folder: Path, *arguments: str) -> str:
    """Runs git in a folder, as somebody."""
    identity = ["-c", "user.name=A", "-c", "user.email=a@example.org"]
    command = ["git", "-C", str(folder), *identity, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def make(*arguments: str, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Runs make with this Python, which has all it needs, instead of one that make installs."""
    settings = [f"PY={sys.executable}", "BASE=", "DEEP=", "DEV=", "DOCS="]
    return subprocess.run(
        ["make", "--no-print-directory", *arguments, *settings], cwd=cwd, capture_output=True, text=True
    )


def requirements(extra: str | None) -> set[str]:
    """Returns the packages that an extra adds to others, or those of the core."""
    lines = PROJECT["dependencies"] if extra is None else PROJECT["optional-dependencies"][extra]
    names: set[str] = {canonicalize_name(Requirement(line).name) for line in lines}
    return names - {PROJECT["name"]}


def with_all_they_need(packages: Iterable[str]) -> set[str]:
    """Adds to packages what they need, and so on."""
    found: set[str] = set()
    todo = [*packages]
    while todo:
        package = canonicalize_name(todo.pop())
        if package not in found:
            found.add(package)
            needed = map(Requirement, distribution(package).requires or ())
            todo += [each.name for each in needed if not each.marker or each.marker.evaluate({"extra": ""})]
    return found


def install(packages: Iterable[str], folder: Path) -> None:
    """Links packages and all they need into a folder, as if pip had installed only these there."""
    for package in with_all_they_need(packages):
        for file in distribution(package).files or ():
            link = folder / file.parts[0]
            if file.parts[0] not in ("..", "__pycache__") and not link.exists():
                link.symlink_to(distribution(package).locate_file(file.parts[0]))  # type: ignore[arg-type]


def markdown_parser() -> MarkdownIt:
    """Returns a parser of Markdown with tables; it makes links of all targets, safe or not."""
    parser = MarkdownIt("commonmark").enable("table")
    parser.validateLink = bool  # type: ignore[assignment, method-assign]
    return parser


def mistyped_columns(path: Path) -> list[str]:
    """Lists the columns of a CSV file whose type a reader cannot infer from its first hundred rows."""
    whole = pd.read_csv(path, dtype_backend="numpy_nullable", keep_default_na=False, na_values=[""])
    first = pd.read_csv(
        path, nrows=100, dtype_backend="numpy_nullable", keep_default_na=False, na_values=[""]
    )
    return [str(name) for name in whole if first[name].isna().all() or whole[name].dtype != first[name].dtype]
