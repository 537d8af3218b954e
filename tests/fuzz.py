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
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final, NamedTuple
from unittest import mock

import hypothesis
from hypothesis import HealthCheck, Phase
from hypothesis import strategies as st
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
from tests.support import ROOT, small_experiment, toml, variant

MAX_LINE: Final = 300 + len("error: \n")
MAX_LINES: Final = 11  # ten mistakes, and how many more there are
MAX_CPU_S: Final = 30.0
MAX_MEMORY_MB: Final = 1000
CHUNK: Final = 500
MINE: Final = "@FOLDER@/mine.toml"
RESULTS: Final = ("--results", "@FOLDER@/results")

# A comparison, an extension, maps, a replication and searches.
EXPERIMENTS: Final = ("compare_deep", "groups", "when", "reproduce", "tuning")
OPTIONS: Final = {
    "run": ["--seeds", "--jobs", "--report"],
    "report": ["--seeds", "--partial"],
    "verify": ["--runs", "--seed", "--jobs"],
    "watch": ["--scenario", "--learner", "--observation", "--seed", "--experiment", "--save"],
    "assess": ["--agent", "--model", "--algorithm", "--stochastic", "--scenario", "--observation", "--save"],
    "growl": ["--loud"],
}
# Each leaves a folder `marker.ran`, if it is run: a module, its name, or a template.
MODULE: Final = b"import os; os.mkdir('@FOLDER@/marker.ran')"
TEMPLATE: Final = "{{ cycler.__init__.__globals__.os.mkdir('@FOLDER@/marker.ran') }}"
HOSTILE: Final = ("marker:x", "../marker", "@FOLDER@/marker", "@FOLDER@/marker.toml", TEMPLATE)
PLAIN: Final = """
- -- = .. ~ con 0 7 0-9 9-0 -1 1.5 0x10 a.b S1 S9 index one_hot coordinates anywhere first kind seeds settings
observe phases others walk group q_learning reproduce film.webp film.txt /nowhere/film.gif /dev/null
math:sqrt math:pi json: :dumps nowhere:x a:b:c =1+1 $x$ a|b %s {}
"""
WORDS: Final = (
    *PLAIN.split(),
    *("", " ", "a, b", "a\nb", "\t", "\0", "\x1b[31m", "\u202e", "<script>", "{{ 7 * 7 }}", "x" * 5000),
    *HOSTILE,
)
PIECES: Final = (
    *(b"", b"\n", b"=", b"#", b"[x]\n" * 3, b'"""', b"'''", b"\xff\xfe", b"\x00", b"1979-05-27", b"1e999"),
    *(b"[" * 500, b"{a=" * 400, b"9" * 5000, b"0x" + b"f" * 400, b"a." * 2000 + b"a = 1\n"),
)
texts = st.sampled_from(WORDS) | st.text(st.characters(codec="utf-8"), max_size=9)
numbers = st.integers(-3, 1001) | st.integers() | st.floats() | st.sampled_from([10**6, 10**9 + 1, 10**400])
values = st.recursive(
    st.booleans() | numbers | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=6,
) | st.just([*range(1000)])


class TooLongError(BaseException):
    """An input takes too long."""


class AcceptedError(InputError):
    """The runs of an experiment would begin."""

    def __str__(self) -> str:
        return "the runs would begin"


class Input(NamedTuple):
    """A command line, and the files that it is about."""

    arguments: Sequence[str]  # with @FOLDER@ for the folder of the files
    files: Mapping[str, bytes] = {}
    changed: Sequence[str] = ()  # files of which one or two are changed
    is_data: bool = False  # whether the files may not name code that is run


# What is drawn


def draw(seed: int, number: int) -> Input:
    """Draws an input. The first example of hypothesis is always the simplest, so it is the second."""
    drawn: list[Input] = []
    given = (shipped_scenarios(), shipped_experiments(), copied_search(), published_results())
    kinds = [(command_lines(), 2), *zip(map(changed_inputs, given), (8, 7, 1, 1), strict=True)]
    weighted = st.sampled_from([kind for kind, weight in kinds for _ in range(weight)])

    @hypothesis.seed(f"{seed} {number}")
    @hypothesis.settings(
        max_examples=2, phases=[Phase.generate], database=None, suppress_health_check=[*HealthCheck]
    )
    @hypothesis.given(weighted.flatmap(lambda kind: kind))
    def collect(given: Input) -> None:
        drawn.append(given)

    collect()
    return drawn[-1]


@st.composite
def command_lines(draw: st.DrawFn) -> Input:
    """Draws options and their values, or others."""
    command = draw(st.sampled_from([*OPTIONS]))
    arguments = [command]
    for _ in range(draw(st.integers(0, 4))):
        option, value = draw(st.sampled_from(OPTIONS[command])), draw(texts | numbers.map(str))
        value = value.replace("\0", "0")  # no argument can have it
        arguments += draw(st.sampled_from([[option, value], [f"{option}={value}"], [value], [option]]))
    return Input(arguments if "--results" in " ".join(arguments) else [*arguments, *RESULTS])


@cache
def shipped_scenarios() -> Sequence[Input]:
    """Lists commands that assess an agent in a scenario."""
    command, files = ["assess", "--agent", "tests.fuzz:up", "--scenario", MINE, *RESULTS], []
    for name in scenario_names():
        table = read_toml(SCENARIO_DIRECTORY / f"{name}.toml")
        if "group" in table:
            table["issuer"]["places"] = 6  # of thousands
        files.append({"mine.toml": toml(table).encode()})
    forms = [["--observation", form] for form in OBSERVATIONS]
    return [Input(command + form, file, ["mine.toml"]) for form in forms for file in files]


@cache
def shipped_experiments() -> Sequence[Input]:
    """Lists commands that run or report an experiment."""
    tables = [read_toml(EXPERIMENT_DIRECTORY / f"{name}.toml") for name in EXPERIMENTS]
    files = [{"mine.toml": toml(table).encode()} for table in tables]
    commands = [["run"], ["run", "--report"], ["report"], ["run", "--seeds", "0-12"]]
    return [Input([*command, MINE, *RESULTS], file, ["mine.toml"]) for command in commands for file in files]


@cache
def copied_search() -> Sequence[Input]:
    """Lists a command that runs an experiment whose settings come from a copy of a shipped search."""
    shipped, tuned = (
        EXPERIMENT_DIRECTORY / "tuning",
        variant(first_seed=900, tuned_by="@FOLDER@/search.toml:q_learning"),
    )
    files = {f"search{end}": Path(f"{shipped}{end}").read_bytes() for end in (".toml", ".chosen.json")}
    files["mine.toml"] = small_experiment(algorithms={"table": tuned}).encode()
    declared = load_experiment("tuning").declared.model_copy(update={"name": "search"})
    chosen = json.loads(files["search.chosen.json"]) | {"search": digest_of_search(declared)}
    files["search.chosen.json"] = sealed(chosen, indent=1).encode()
    return [Input(["run", MINE, *RESULTS], files, ["search.chosen.json"], is_data=True)]


@cache
def published_results() -> Sequence[Input]:
    """Lists commands that make texts and the page from published files, which may name code."""
    paths = [path for name in ("sb3", "leaderboard") for path in (ROOT / "results" / name).iterdir()]
    files = {f"results/{path.parent.name}/{path.name}": path.read_bytes() for path in paths}
    tables = [name for name in files if not name.endswith((".svg", ".md"))]
    manifest = "results/sb3/manifest.json"
    given = Input(["report", *RESULTS], files, [*tables, *[manifest] * len(tables)], is_data=True)
    inputs = [given] * 15
    for key, code in product(("argument", "experiment", "kind"), HOSTILE):
        content = json.loads(files[manifest])
        (content["report"] if key == "kind" else content)[key] = code
        inputs.append(given._replace(files=files | {manifest: sealed(content, indent=1).encode()}))
    return inputs


@st.composite
def changed_inputs(draw: st.DrawFn, given: Sequence[Input]) -> Input:
    """Draws one of these inputs with changed files, whose digests may be right all the same."""
    one = draw(st.sampled_from(given))
    files = {**one.files}
    for name in draw(st.lists(st.sampled_from(one.changed), min_size=1, max_size=2)):
        files[name] = draw(changed(name, files[name]))
    for name in [name for name in files if name.endswith(".json")] if draw(st.booleans()) else ():
        with contextlib.suppress(ValueError, TypeError, LookupError, AttributeError, RecursionError):
            content = json.loads(files[name])
            for file in content.get("files", ()):
                digest = hashlib.sha256(files[f"{name.rpartition('/')[0]}/{file}"])
                content["files"][file] = digest.hexdigest()
            files[name] = sealed(content, indent=1).encode()
    return one._replace(files=files)


@st.composite
def changed(draw: st.DrawFn, name: str, content: bytes) -> bytes:
    """Draws a file with other values in it, or other bytes."""
    with contextlib.suppress(ValueError, TypeError, RecursionError):  # it is damaged already
        if draw(st.integers(0, 4)):
            if name.endswith(".toml"):
                return toml(draw(mutated(tomllib.loads(content.decode())))).encode()
            if name.endswith(".json"):
                return json.dumps(draw(mutated(json.loads(content)))).encode()
            if name.endswith(".csv"):
                rows = draw(mutated([line.split(",") for line in content.decode().splitlines()]))
                lines = (",".join(map(str, row if isinstance(row, list) else [row])) for row in rows)
                return "\n".join(lines).encode(
                    draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-7"]))
                )
    start = draw(st.integers(0, len(content)))
    piece = draw(st.sampled_from(PIECES) | st.binary(max_size=8))
    return content[:start] + piece + content[start + draw(st.integers(0, 20)) :]


@st.composite
def mutated(draw: st.DrawFn, data: Any) -> Any:
    """Draws a copy of tables or lists in which up to three values are replaced, removed or added."""
    data = copy.deepcopy(data)
    for _ in range(draw(st.integers(1, 3))):
        places = [*_places(data)]
        if not places:
            break
        table, key = draw(st.sampled_from(places))
        other, other_key = draw(st.sampled_from(places))
        value = copy.deepcopy(draw(values | nudged(table[key]) | st.just(other[other_key])))
        match draw(st.sampled_from(["replace", "replace", "replace", "remove", "add"])):
            case "replace":
                table[key] = value
            case "remove":
                del table[key]
            case "add" if isinstance(table, dict):
                table[draw(texts)] = value
            case "add":
                table.append(value)
    return data


def _places(table: Any) -> Iterator[tuple[Any, Any]]:
    for key in table if isinstance(table, dict) else range(len(table)):
        yield table, key
        if isinstance(table[key], dict | list):
            yield from _places(table[key])


def nudged(value: Any) -> st.SearchStrategy[Any]:
    """Draws values that are nearly this one."""
    if isinstance(value, bool):
        return st.just(not value)
    if isinstance(value, int | float):
        return st.sampled_from([value + 1, value - 1, value * 10, value // 3, -value])
    if isinstance(value, str):
        return st.sampled_from([value[:-1], value + "x", value.upper(), value * 2])
    return values


# What is done with it


def up(observation: object) -> int:  # noqa: ARG001
    """An agent that walks up, for `assess`."""
    return 0


def check(given: Input) -> tuple[str, str]:
    """Returns whether an input is "accepted", "refused" or "failed"; and what is wrong, or the message."""
    memory_mb = peak_memory_mb() or 0
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        markers = {"marker.py": MODULE, "marker.md.jinja": TEMPLATE.encode()}
        for name, content in {**given.files, **markers}.items():
            (Path(folder) / name).parent.mkdir(parents=True, exist_ok=True)
            (Path(folder) / name).write_bytes(content.replace(b"@FOLDER@", folder.encode()))
        errors = io.StringIO()
        try:
            with (
                contextlib.redirect_stdout(io.StringIO()),
                contextlib.redirect_stderr(errors),
                mock.patch.object(sys, "path", [*sys.path, folder]),
                mock.patch.object(driver, "run", side_effect=AcceptedError),
                mock.patch.object(watch, "run", side_effect=AcceptedError),
                _limited_time(),
            ):
                code = benchmark([argument.replace("@FOLDER@", folder) for argument in given.arguments])
        except SystemExit as ended:  # of --help
            code = int(ended.code or 0)
        except BaseException:
            return "failed", traceback.format_exc()
        finally:
            sys.modules.pop("marker", None)
        if given.is_data and (Path(folder) / "marker.ran").exists():
            return "failed", "runs code that data name"
    if (peak_memory_mb() or 0) > memory_mb + MAX_MEMORY_MB:
        return "failed", f"takes more than {MAX_MEMORY_MB} MB"
    return _judged(code, errors.getvalue())


def _judged(code: int, message: str) -> tuple[str, str]:
    if TooLongError.__name__ in message:
        return "failed", f"takes more than {MAX_CPU_S} s"
    if code == 0 or message.endswith(f"error: {AcceptedError()}\n"):
        return "accepted", ""
    lines = message.splitlines(keepends=True)
    is_refused = code == 2 and 1 <= len(lines) <= MAX_LINES
    for line in lines:
        is_refused &= line.startswith("error: ") and line.endswith("\n") and len(line) <= MAX_LINE
    return "refused" if is_refused else "failed", f"exit code {code}: {message}"


@contextlib.contextmanager
def _limited_time() -> Iterator[None]:
    """Raises TooLongError after too much CPU time, which other processes do not change."""

    def stop(*_: object) -> None:
        raise TooLongError

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, MAX_CPU_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def check_many(seed: int, numbers: Sequence[int]) -> tuple[Counter[str], list[str]]:
    """Returns how many inputs have which outcome, and what failed."""
    with contextlib.suppress(ValueError):
        resource.setrlimit(resource.RLIMIT_DATA, (4 * 2**30, resource.RLIM_INFINITY))
    counts: Counter[str] = Counter()
    failures = []
    drawn = {number: draw(seed, number) for number in numbers}  # before commands load further modules
    for number, given in drawn.items():
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
    # A new process for each chunk, since the peak of its memory hides smaller ones.
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), max_tasks_per_child=1) as pool:
        done = pool.map(partial(check_many, options.seed), chunks)
        for some, failed in track(done, "checking inputs", total=len(chunks)):
            counts += some
            print(*failed, sep="\n", end="\n" if failed else "")
    print(f"inputs accepted: {counts['accepted']:,}, refused: {counts['refused']:,}")
    print(f"failed: {counts['failed']:,} (--first N --inputs 1 repeats input N)")
    return 1 if counts["failed"] else 0


if __name__ == "__main__":
    sys.exit(main())
