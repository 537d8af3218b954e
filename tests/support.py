"""What tests of several rooms call: the project's commands, as users run them, and its packages."""

import json
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmark.experiment import Experiment, interleaved, load_experiment
from benchmark.specification import RunSpecification
from benchmark.store import Record, Store
from envs import InputError, load_scenario

ROOT = Path(__file__).parents[1]
_PYPROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
PROJECT: dict[str, Any] = tomllib.loads(_PYPROJECT)["project"]


def variant(
    algorithm: str = "q_learning", *observations: str, seeds: int = 2, **keys: object
) -> dict[str, object]:
    """Returns a variant's table in an experiment: by default, Q-learning from cells."""
    return {
        "algorithm": algorithm,
        "observations": [*observations] or ["index"],
        "seeds": seeds,
        **keys,
    }


def small_experiment(**changes: object) -> str:
    """Returns the text of an experiment's file: short runs of a table in S1, with changes."""
    keys: dict[str, object] = {
        "description": "A small experiment.",
        "scenarios": ["S1"],
        "horizon": 50,
        "evaluation_every": 100,
        "map_every": 200,
        "settings": {"budget": 200},
        "algorithms": {"table": variant()},
    }
    if "solved" in changes:  # records no maps
        del keys["map_every"]
    return toml(keys | changes)


def made(path: Path, text: str) -> Experiment:
    """Loads an experiment, which is written to a file."""
    path.write_text(text, encoding="utf-8")
    return load_experiment(path)


def toml(table: Mapping[str, object]) -> str:
    """Writes a table as TOML, with a line for each key."""
    return "".join(f"{_key(key)} = {_inline(value)}\n" for key, value in table.items())


def _key(key: str) -> str:
    return key if re.fullmatch(r"[\w-]+", key, re.ASCII) else json.dumps(key, ensure_ascii=False)


def _inline(value: object) -> str:
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{_key(key)} = {_inline(each)}' for key, each in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_inline, value))}]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else f"{value}".lower()


PATIENCE_S = 180  # on a loaded machine; nothing waits that long elsewhere
# Eight jobs of a fifth of a second each, in plain Python
SLOW_EXPERIMENT = small_experiment(
    evaluation_every=60000,
    map_every=60000,
    settings={"budget": 60000},
    algorithms={"plain": variant("tests.agents.plain:Q_LEARNING", seeds=8)},
)


def until(is_true: Callable[[], object]) -> None:
    """Waits until something is true."""
    deadline = time.monotonic() + PATIENCE_S
    while not is_true():
        assert time.monotonic() < deadline, "too slow"
        time.sleep(0.05)


def n_stored(results: Path) -> int:
    """Returns how many runs are stored in a folder of results so far."""
    try:
        with Store(results / "runs.db", read_only=True) as store:
            return len(store.statuses())
    except InputError:
        return 0  # not created yet


def arrays_of(records: Iterable[Record]) -> dict[str, dict[str, bytes]]:
    """Returns the bytes of all arrays of records, by digest and name."""
    return {
        record.digest: {name: values.tobytes() for name, values in record.arrays.items()}
        for record in records
    }


def specifications(
    experiment: Experiment,
    condition: str,
    scenario: str,
    variant: str,
    observation: str,
    seeds: Iterable[int] | None = None,
) -> list[RunSpecification]:
    """Lists the runs of a population, as the experiment names it."""
    names = condition, scenario, f"{variant}, {observation}"
    (population,) = (
        each
        for each in experiment.populations
        if (each.condition.name, each.scenario.name, each.learner.name) == names
    )
    return population.runs(seeds)


def all_specifications(
    experiment: Experiment, seeds: Sequence[int] | None = None
) -> list[RunSpecification]:
    """Lists every run of an experiment once, see `interleaved`; of a search, those of trials."""
    return interleaved(each.runs(each.taken(seeds)) for each in experiment.populations)


def few_places(name: str, n: int = 6) -> dict[str, Any]:
    """Returns overrides with which a scenario is small: people stand in few of many ways."""
    scenario = load_scenario(name)
    onlookers = {"onlookers.ways": n} if scenario.onlookers else {}
    return {"issuer.places": n} | onlookers if scenario.group or onlookers else {}


def git(folder: Path, *arguments: str) -> str:
    """Runs git in a folder, as somebody."""
    identity = ["-c", "user.name=A", "-c", "user.email=a@example.org"]
    command = ["git", "-C", str(folder), *identity, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def make(*arguments: str, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Runs make with this Python, which has all it needs, instead of one that make installs."""
    settings = [f"PY={sys.executable}", "BASE=", "DEEP=", "DEV="]
    command = ["make", "--no-print-directory", *arguments, *settings]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True)


def copy_sources(folder: Path | None) -> set[str]:
    """Returns the files of this repository, new ones, too; copies them into a folder if given."""
    listed = git(ROOT, "ls-files", "-z", "--cached", "--others", "--exclude-standard").split("\0")
    names = {name for name in listed if name and (ROOT / name).is_file()}
    if folder is not None:
        for name in names:
            (target := folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, target)
    return names


def copy_compiled(folder: Path) -> None:
    """Copies what numba has compiled in this checkout into a copy of it."""
    for source in (ROOT / "agents").rglob("*"):
        target = folder / source.relative_to(ROOT)
        if source.suffix == ".nbc":
            target.parent.mkdir(exist_ok=True)
            shutil.copy(source, target)
        elif source.suffix == ".py":
            shutil.copystat(source, target)  # by which numba knows a source
