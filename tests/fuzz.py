"""Gives the command line random inputs; each must be accepted, or refused by a line for each mistake.

`make fuzz` draws 100,000; `tests/test_fuzz.py` some of them. Every input follows from a seed and its number.
Nothing is trained: an experiment that is accepted ends where its runs would begin.
"""

import argparse
import contextlib
import copy
import hashlib
import io
import json
import os
import resource
import signal
import sys
import tempfile
import tomllib
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final, NamedTuple
from unittest import mock

import numpy as np
from rich.progress import track

from benchmark.__main__ import main as benchmark
from benchmark.commands import watch
from benchmark.execution import driver
from benchmark.execution.provenance import peak_memory_mb
from benchmark.experiments import EXPERIMENT_DIRECTORY, load_experiment
from benchmark.experiments.choices import digest_of_search
from benchmark.sealed import sealed
from envs import OBSERVATIONS, scenario_names
from envs.inputs import InputError, read_toml
from envs.scenario import SCENARIO_DIRECTORY
from tests.support import ROOT

LONGEST_LINE: Final = 300 + len("error: \n")
MOST_LINES: Final = 11  # ten mistakes, and how many more there are
LONGEST_S: Final = 30.0
MOST_MEMORY_MB: Final = 1000
CHUNK: Final = 500

# Every key of an experiment, on scenarios that are quick to load.
EXPERIMENT: Final = """
description = "A table and nets."
note = "For tests."
stream = "fuzz"
scenarios = ["S1", "S2"]
horizon = 200
evaluation_every = 100
map_every = 200
evaluated_from = ["start", "every_cell"]
settings = { budget = 400, time_limit = 200 }
[algorithms.table]
algorithm = "q_learning"
observations = ["index"]
seeds = 12
first_seed = 3
evaluation_every = 50
map_every = 100
policy = "greedy"
group = "tables"
settings = { learning_rate = 0.2, epsilon = 0.1, record_every = 10 }
[algorithms.dqn]
algorithm = "compiled_dqn"
observations = ["one_hot", "coordinates"]
seeds = 10
settings = { gamma = 0.9 }
[algorithms.dqn_check]
algorithm = "sb3_dqn"
reference_for = "dqn"
seeds = 10
[report]
kind = "comparison"
question = "Which?"
items = []
omit = ["maps"]
baseline = ["table, index"]
pool = "none"
margins = { success = 0.1, score = 0.05 }
contrasts = [["dqn, one_hot", "table, index"]]
[readings.default]
question = "How?"
answer = "So."
[readings.other]
question = "How else?"
answer = "Like this."
seeds = 11
scenario = { "issuer.position" = [5, 5] }
scenarios = ["S1"]
settings = { time_limit = 100 }
curve = "table"
[grids.all.axes.size.small]
scenario = { "grid.rows" = 11 }
[grids.all.axes.size.large]
scenario = { "grid.rows" = 12 }
"""
# What is left out of it, since a report takes some of it alone, or none.
WITHOUT: Final = (("readings", "grids"), ("readings",), ("report",), ("report", "readings"))
SHIPPED: Final = ("when", "when_smoke", "reproduce", "tuning_smoke")  # maps, a replication, a search
TUNED: Final = """
description = "With settings from a search."
scenarios = ["S1"]
horizon = 50
evaluation_every = 100
map_every = 100
settings = { budget = 100 }
algorithms.table = { algorithm = "q_learning", observations = ["index"], seeds = 2, first_seed = 900, \
tuned_by = "@FOLDER@/search.toml:q_learning" }
"""
EXTENSION: Final = """
extends = "reproduce_smoke"
description = "Another budget."
[changes]
horizon = 100
"algorithms.q_learning.seeds" = 4
"algorithms.q_learning.settings.budget" = 300
"readings.default.seeds" = 4
"""
COMMANDS: Final[dict[str, list[str]]] = {
    "run": ["--seeds", "--jobs", "--report", "--results"],
    "report": ["--seeds", "--partial", "--results"],
    "verify": ["--runs", "--seed", "--jobs", "--results"],
    "watch": ["--scenario", "--learner", "--observation", "--seed", "--experiment", "--save"],
    "assess": ["--agent", "--model", "--algorithm", "--stochastic", "--scenario", "--observation", "--save"],
    "growl": ["--loud"],
}
WORDS: Final = (
    "reproduce_smoke", "equivalence_smoke", "nothing", "S1", "S9", "index", "one_hot", "coordinates",
    "q_learning", "0", "7", "0-9", "9-0", "1", "-1", "1.5", "0x10", "--", "-", "", "=", "module:attribute",
    "math:sqrt", "math:pi", "json:", ":dumps", "film.webp", "film.txt", "/nowhere/film.gif", "/dev/null",
    "..", "~",
)  # fmt: skip
MARKING: Final = b"{{ cycler.__init__.__globals__.os.mkdir('@FOLDER@/marker.ran') }}"  # a template
HOSTILE: Final = ("marker:x", "../marker", "@FOLDER@/marker", "@FOLDER@/marker.toml", MARKING.decode())
NASTY: Final[tuple[Any, ...]] = (
    0, 1, -1, 2, 3, 7, 50, 1000, 99_999, 100_001, 10**6, 10**9, 10**9 + 1, 2**31, 2**63, -(2**63), 10**400,
    10**4300, 0.5, -0.0, 1e-300, 5e-324, 1e9, 1e308, -1e308, float("inf"), float("nan"), True, False,
    "", " ", "S1", "index", "anywhere", "any", "first", "x" * 5000, "../../x", "/etc/passwd", "...", "con",
    "=1+1", "$x$", "a|b", "a\nb", "\t", "\u0000", "\u001b[31m", "\u202e", "é", "🙂", "a, b", "<script>",
    "{{ 7 * 7 }}", *HOSTILE, "%s", "{}", "json:dumps",
    "math:pi", "nowhere:x", ":", "a:b:c", [], {}, [[]], [[], []],
    [1, 2], [-1, 5], [1.5, 2], [[1, 2], [3, 4]], ["a", "b"], [1, "a"], {"kind": "none"}, {"kind": "x"},
    {"a": {"b": {"c": 1}}}, {"": 1}, {"a.b": 1}, [[[[[[[[1]]]]]]]], list(range(1000)),
)  # fmt: skip


class TooLongError(BaseException):
    """An input takes too long."""


class AcceptedError(InputError):
    """The runs of an experiment would begin."""

    def __str__(self) -> str:
        return "the runs would begin"


class Input(NamedTuple):
    """A command line, and the files that it is about."""

    arguments: list[str]  # with {} for the folder of the files
    files: dict[str, bytes] = {}  # noqa: RUF012
    is_data: bool = False  # whether the files may not name code that is run


def draw(seed: int, number: int) -> Input:
    rng = np.random.default_rng([seed, number])
    kinds = (_command_line, _scenario, _experiment, _chosen, _published)
    kind = kinds[int(rng.choice(len(kinds), p=(0.1, 0.42, 0.38, 0.05, 0.05)))]
    return kind(rng)


def _scenario(rng: np.random.Generator) -> Input:
    data = read_toml(SCENARIO_DIRECTORY / f"{_one(rng, scenario_names())}.toml")
    if "group" in data:
        data["issuer"]["places"] = 6  # of thousands
    arguments = ["assess", "--agent", "tests.fuzz:up", "--observation", _one(rng, OBSERVATIONS)]
    arguments += ["--scenario", "{}/mine.toml", "--results", "{}/results"]
    return Input(arguments, {"mine.toml": _mutated_toml(rng, data)})


def _experiment(rng: np.random.Generator) -> Input:
    path = EXPERIMENT_DIRECTORY / f"{_one(rng, SHIPPED)}.toml"
    texts = (EXPERIMENT, EXPERIMENT, EXTENSION, path.read_text(encoding="utf-8"))
    data = tomllib.loads(_one(rng, texts))
    for key in _one(rng, WITHOUT) if "readings" in data and "grids" in data else ():
        data.pop(key, None)
    arguments = [*_one(rng, (["run"], ["run", "--report"], ["report"], ["run", "--seeds", "0-12"]))]
    arguments += ["{}/mine.toml", "--results", "{}/results"]
    return Input(arguments, {"mine.toml": _mutated_toml(rng, data)})


def _chosen(rng: np.random.Generator) -> Input:
    """An experiment that takes its settings from a search whose file of chosen settings is mutated."""
    name, shipped = "search.chosen.json", EXPERIMENT_DIRECTORY / "tuning"
    files = {f"search{end}": Path(f"{shipped}{end}").read_bytes() for end in (".toml", ".chosen.json")}
    chosen = json.loads(files[name]) | {"search": _search_digest()}
    files["mine.toml"] = TUNED.encode()
    files[name] = _mutated_file(rng, name, sealed(chosen, indent=1).encode())
    with contextlib.suppress(ValueError, TypeError, RecursionError):
        if rng.random() < 0.8:
            files[name] = sealed(json.loads(files[name]), indent=1).encode()
    return Input(["run", "{}/mine.toml", "--results", "{}/results"], files, is_data=True)


@cache
def _search_digest() -> str:
    """Returns the digest of the shipped search under the name of its copy."""
    declared = load_experiment("tuning").declared
    return digest_of_search(declared.model_copy(update={"name": "search"}))


def _published(rng: np.random.Generator) -> Input:
    """Published results, some of whose files are mutated, of which the texts and the page are made."""
    paths = [path for name in ("sb3", "leaderboard") for path in (ROOT / "results" / name).iterdir()]
    files = {f"results/{path.parent.name}/{path.name}": path.read_bytes() for path in paths}
    if rng.random() < 0.5:  # what might lead to code
        manifest = json.loads(files["results/sb3/manifest.json"])
        table = _one(rng, (manifest, manifest["report"]))
        table[_one(rng, ("argument", "experiment", "kind"))] = _one(rng, HOSTILE)
        files["results/sb3/manifest.json"] = sealed(manifest, indent=1).encode()
    tables = [name for name in files if not name.endswith((".svg", ".md"))]
    for name in rng.choice([*tables, *["results/sb3/manifest.json"] * len(tables)], 2):
        files[str(name)] = _mutated_file(rng, str(name), files[str(name)])
    if rng.random() < 0.5:
        rehash(files)
    return Input(["report", "--results", "{}/results"], files, is_data=True)


def rehash(files: dict[str, bytes]) -> None:
    """Writes the digests of published files again, so that it is their content that is refused."""
    name = "results/sb3/manifest.json"
    with contextlib.suppress(ValueError, TypeError, LookupError, AttributeError, RecursionError):
        manifest = json.loads(files[name])
        for file in manifest["files"]:
            manifest["files"][file] = hashlib.sha256(files[f"results/sb3/{file}"]).hexdigest()
        files[name] = sealed(manifest, indent=1).encode()


def _mutated_toml(rng: np.random.Generator, data: dict[str, Any]) -> bytes:
    for _ in range(int(rng.integers(1, 4))):
        _mutate(rng, data)
    text = "\n".join(f"{_key(key)} = {_toml(value)}" for key, value in data.items()).encode()
    for _ in range(int(rng.integers(0, 3)) if rng.random() < 0.3 else 0):
        text = _garble(rng, text)
    return text


def _mutated_file(rng: np.random.Generator, name: str, data: bytes) -> bytes:
    """Returns a file with other values in it, or other bytes."""
    with contextlib.suppress(ValueError, RecursionError):  # it is damaged already
        if rng.random() < 0.8 and name.endswith(".toml"):
            return _mutated_toml(rng, tomllib.loads(data.decode()))
        if rng.random() < 0.8 and name.endswith(".json"):
            content = json.loads(data)
            for _ in range(int(rng.integers(1, 4))):
                _mutate(rng, content)
            return json.dumps(content, ensure_ascii=bool(rng.random() < 0.5)).encode(errors="surrogatepass")
        if rng.random() < 0.8 and name.endswith(".csv"):
            rows: list[Any] = [line.split(",") for line in data.decode().splitlines()]
            for _ in range(int(rng.integers(1, 4))):
                _mutate(rng, rows[0 if rng.random() < 0.2 else int(rng.integers(len(rows)))])
            lines = (",".join(f"{cell}" for cell in row) for row in rows)
            return "\n".join(lines).encode(_one(rng, ("utf-8", "utf-8-sig", "utf-16", "utf-7")))
    return _garble(rng, data)


def up(observation: object) -> int:  # noqa: ARG001
    """An agent that walks up, for `assess`."""
    return 0


def check(given: Input) -> tuple[str, str]:
    """Returns whether an input is "accepted", "refused" or "failed"; and what is wrong, or the message."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        marker = {"marker.py": b"import os; os.mkdir('@FOLDER@/marker.ran')", "marker.md.jinja": MARKING}
        for name, content in (given.files | marker).items():
            (Path(folder) / name).parent.mkdir(parents=True, exist_ok=True)
            (Path(folder) / name).write_bytes(content.replace(b"@FOLDER@", folder.encode()))
        arguments = [argument.replace("{}", folder) for argument in given.arguments]
        output, errors = io.StringIO(), io.StringIO()
        signal.setitimer(signal.ITIMER_REAL, LONGEST_S)
        try:
            with (
                contextlib.redirect_stdout(output),
                contextlib.redirect_stderr(errors),
                mock.patch.object(sys, "path", [*sys.path, folder]),
                _nothing_trained(),
            ):
                code = benchmark(arguments)
        except SystemExit as ended:  # of --help
            code = int(ended.code or 0)
        except TooLongError:
            return "failed", f"takes more than {LONGEST_S} s"
        except BaseException:
            return "failed", traceback.format_exc()
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            sys.modules.pop("marker", None)
        if given.is_data and (Path(folder) / "marker.ran").exists():
            return "failed", "runs code that data name"
        message = errors.getvalue()
        if (peak_memory_mb() or 0) > MOST_MEMORY_MB:
            return "failed", f"takes more than {MOST_MEMORY_MB} MB"
        lines = message.splitlines(keepends=True)
        if TooLongError.__name__ in message:
            return "failed", f"takes more than {LONGEST_S} s"
        is_line = 1 <= len(lines) <= MOST_LINES and all(
            line.startswith("error: ") and line.endswith("\n") and len(line) <= LONGEST_LINE for line in lines
        )
        if code == 0 or message.endswith(f"error: {AcceptedError()}\n"):
            return "accepted", ""
        return ("refused" if is_line and code == 2 else "failed"), f"exit code {code}: {message}"


def check_many(seed: int, numbers: range) -> tuple[Counter[str], list[str]]:
    """Returns how many inputs have which outcome, and what failed."""
    _limit()
    counts: Counter[str] = Counter()
    failures = []
    for number in numbers:
        given = draw(seed, number)
        outcome, what = check(given)
        counts[outcome] += 1
        if outcome == "failed":
            failures.append(f"input {number}: {' '.join(given.arguments)}: {what}")
    return counts, failures


def main(arguments: list[str] | None = None) -> int:
    """Runs the command; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=100_000, help="number of inputs (default: 100,000)")
    parser.add_argument("--first", type=int, default=0, help="number of the first input (default: 0)")
    parser.add_argument("--seed", type=int, default=0, help="seed that all inputs follow from (default: 0)")
    options = parser.parse_args(arguments)
    last = options.first + options.inputs
    chunks = [range(i, min(i + CHUNK, last)) for i in range(options.first, last, CHUNK)]
    counts: Counter[str] = Counter()
    # A new process for each chunk, so that its peak memory is of its own inputs.
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), max_tasks_per_child=1) as pool:
        done = pool.map(partial(check_many, options.seed), chunks)
        for some, failed in track(done, "checking inputs", total=len(chunks)):
            counts += some
            print(*failed, sep="\n", end="\n" if failed else "")
    print(f"inputs accepted: {counts['accepted']:,}, refused: {counts['refused']:,}")
    print(f"failed: {counts['failed']:,} (--first N --inputs 1 repeats input N)")
    return 1 if counts["failed"] else 0


def _limit() -> None:

    def stop(*_: object) -> None:
        raise TooLongError

    signal.signal(signal.SIGALRM, stop)
    with contextlib.suppress(ValueError):
        resource.setrlimit(resource.RLIMIT_DATA, (4 * 2**30, resource.RLIM_INFINITY))


@contextlib.contextmanager
def _nothing_trained() -> Iterator[None]:

    def begin(*_: object, **__: object) -> list[str]:
        raise AcceptedError

    with mock.patch.object(driver, "run", begin), mock.patch.object(watch, "run", begin):
        yield


def _command_line(rng: np.random.Generator) -> Input:
    command = _one(rng, list(COMMANDS))
    arguments = [command]
    for _ in range(int(rng.integers(0, 5))):
        option = _one(rng, COMMANDS[command])
        value = _one(rng, WORDS) if rng.random() < 0.8 else _toml(_one(rng, NASTY)).strip('"')
        value = value.replace("\0", "0")  # no argument can have it
        arguments += _one(rng, ([option, value], [f"{option}={value}"], [value], [option]))
    if "--results" not in " ".join(arguments):
        arguments += ["--results", "{}/results"]
    return Input(arguments)


def _mutate(rng: np.random.Generator, data: dict[str, Any]) -> None:
    places: list[tuple[Any, Any]] = []

    def walk(table: Any) -> None:
        for key in list(table) if isinstance(table, dict) else range(len(table)):
            places.append((table, key))
            if isinstance(table[key], dict | list):
                walk(table[key])

    walk(data)
    if not places:
        return
    table, key = places[int(rng.integers(len(places)))]
    other, other_key = places[int(rng.integers(len(places)))]
    changes: list[Callable[[], None]] = [
        *[lambda: table.__setitem__(key, copy.deepcopy(_one(rng, NASTY)))] * 3,
        *[lambda: table.__setitem__(key, _nudged(rng, table[key]))] * 2,
        lambda: table.__setitem__(key, copy.deepcopy(other[other_key])),
        lambda: table.__delitem__(key),
        lambda: _add(rng, table, copy.deepcopy(table[key])),
    ]
    _one(rng, changes)()


def _nudged(rng: np.random.Generator, value: Any) -> Any:
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return _one(rng, (value + 1, value - 1, value * 10, value // 2, -value))
    if isinstance(value, float):
        return _one(rng, (value / 3, value * 3, -value, value + 1, 0.0))
    if isinstance(value, str):
        return _one(rng, (value[:-1], value + "x", value.upper(), value * 2))
    return copy.deepcopy(value)


def _add(rng: np.random.Generator, table: Any, value: Any) -> None:
    if isinstance(table, dict):
        names = [text for text in NASTY if isinstance(text, str)]
        table[
            _one(rng, [*names, "kind", "seeds", "settings", "observe", "phases", "others", "walk", "group"])
        ] = value
    else:
        table.append(value)


def _garble(rng: np.random.Generator, text: bytes) -> bytes:
    start = int(rng.integers(len(text) + 1))
    stop = min(start + int(rng.integers(0, 20)), len(text))
    pieces = (
        b"", b"[" * 500, b"{a=" * 400, b"9" * 5000, b"\xff\xfe", b"\x00", b'"""', b"'''", b"\n", b"=", b"#",
        b"[x]\n" * 3, b"a.b.c.d = 1\n", b"." .join([b"a"] * 2000) + b" = 1\n", b"1979-05-27", b"1e999",
        b"0x" + b"f" * 400, rng.bytes(8),
    )  # fmt: skip
    piece: bytes = _one(rng, pieces)
    return text[:start] + piece + text[stop:]


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        return f"{value:d}" if abs(value) < 10**4000 else "1" + "0" * 4300
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{_key(key)} = {_toml(each)}' for key, each in value.items())} }}"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "?")


def _key(key: str) -> str:
    return json.dumps(key, ensure_ascii=False)


def _one(rng: np.random.Generator, values: Any) -> Any:
    return values[int(rng.integers(len(values)))]


if __name__ == "__main__":
    sys.exit(main())
