"""What is too large, too deep, of another kind or in the way is refused by one line."""

import copy
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import pytest

from benchmark import run
from benchmark.__main__ import main
from benchmark.experiment import EXPERIMENT_DIRECTORY
from benchmark.store import Store
from envs import InputError
from envs.inputs import read_toml
from envs.scenario import SCENARIO_DIRECTORY
from tests.support import ROOT, small_experiment, toml, variant

EXPERIMENT = small_experiment(horizon=200)
NUMBERS = True, -1, 0, 1.5, float("nan"), 10**400
TEXTS = "", "x" * 5000, "\u001b[31m", "a\nb", "../x", "marker:x"
VALUES: tuple[Any, ...] = (*NUMBERS, *TEXTS, [], [[]], [1] * 1000, {}, {"a": {"a": 1}})


def up(_: object) -> int:
    """An agent."""
    return 0


AGENT = ["--agent", f"{__name__}:up", "--observation", "index", "--scenario"]


def refused(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """Returns the one line by which the command line refuses arguments."""
    assert main([str(argument) for argument in arguments]) == 2
    line = capsys.readouterr().err
    assert line.startswith("error: ")
    assert line.endswith(".\n")
    assert line.count("\n") == 1
    assert len(line) <= len("error: \n") + 300
    return line


MANY = {"table": variant("q_learning", "index", "offset", seeds=100_000)}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (f"a = {'[' * 500}{']' * 500}", "not valid TOML: maximum recursion depth"),
        (f"{'.'.join('a' * 3000)} = 1", "not valid TOML: maximum recursion depth"),
        (small_experiment(horizon=int("9" * 4000)), "horizon = 9999"),
        # From [0, 0], the target region of S1 is ten steps away.
        (small_experiment(horizon=10), "S1: no policy succeeds within horizon = 10; "),
        (small_experiment(algorithms=MANY), "seeds = 100000: input should be less than"),
        (small_experiment(algorithms={"a": variant("exiting:a")}), "would end this process"),
        (small_experiment(report={"kind": "exiting"}), "would end this process"),
    ],
)
def test_files_that_are_too_much(
    text: str, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "exiting.py").write_text("raise SystemExit('bye')\n")
    (tmp_path / "mine.toml").write_text(text)
    assert expected in refused(capsys, "run", tmp_path / "mine.toml", "--results", tmp_path)


def places(table: Any) -> Iterator[tuple[Any, Any]]:
    """Yields each table or list in a table, and a key or number in it."""
    for key in table if isinstance(table, dict) else range(len(table)):
        yield table, key
        if isinstance(table[key], dict | list):
            yield from places(table[key])


def changed(path: Path, n: int) -> Iterator[str]:
    """Yields texts of a TOML file in which a value is replaced, removed or of another name."""
    whole, rng = read_toml(path), random.Random(path.name)
    for _ in range(n):
        table = copy.deepcopy(whole)
        where, key = rng.choice([*places(table)])
        what = rng.randrange(5)
        if what < 3:
            where[key] = rng.choice(VALUES)
        else:
            value = where.pop(key)
            if what == 4 and isinstance(where, dict):
                where[f"{key}s"] = value
        yield toml(table)


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("compare_deep", "tuning")]


@pytest.mark.parametrize("name", ["Moody", "Walls", "reproduce", *SLOW])
def test_changed_files_are_used_or_refused_by_a_line_for_each_mistake(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def would_begin(*_: object) -> NoReturn:
        raise InputError("the runs would begin.")

    monkeypatch.setattr(run, "execute", would_begin)
    file, codes = tmp_path / "mine.toml", list[int]()
    arguments = ["assess", *AGENT, str(file)]
    path = SCENARIO_DIRECTORY / f"{name}.toml"
    if not path.exists():
        arguments = ["run", str(file), "--results", str(tmp_path / "results")]
        path = EXPERIMENT_DIRECTORY / f"{name}.toml"
    for text in changed(path, 25):
        file.write_text(text, encoding="utf-8")
        codes.append(main(arguments))
        said = capsys.readouterr().err.splitlines()
        errors = [line for line in said if line.startswith("error: ")]
        assert codes[-1] in (0, 2), text
        assert codes[-1] != 2 or (1 <= len(errors) <= 11 and said[-1] == errors[-1]), text
        assert all(len(line) <= len("error: ") + 300 for line in errors), text
    assert codes.count(2) > 10


def test_all_mistakes_of_a_file_are_reported_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = EXPERIMENT.replace("horizon = 200", "horizont = 200\nstream = 7")
    (tmp_path / "mine.toml").write_text(text.replace(", seeds = 2", ""))
    assert main(["run", f"{tmp_path}/mine.toml", "--results", str(tmp_path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    said = sorted(line.removeprefix(f"error: {tmp_path}/mine.toml: ") for line in lines)
    assert [text.partition(" (")[0].partition(":")[0] for text in said] == [
        "stream = 7",
        "the key algorithms.table.seeds is missing.",
        "the key horizon is missing.",
        "unknown key horizont",
    ]
    assert "(did you mean horizon?)" in said[-1]


@pytest.mark.slow
def test_closed_and_full_outputs(tmp_path: Path) -> None:
    def bash(command: str) -> subprocess.CompletedProcess[str]:
        text = command.replace("benchmark", f"{sys.executable} -m benchmark")
        return subprocess.run(["bash", "-c", text], cwd=ROOT, capture_output=True, text=True)

    # With its output closed, the first file that is opened would get it: the store.
    (tmp_path / "mine.toml").write_text(EXPERIMENT)
    command = f"benchmark run {tmp_path}/mine.toml --jobs 1 --results {tmp_path}"
    assert bash(f">&- 2>&- {command}").returncode == 0
    with Store(tmp_path / "runs.db") as store:  # which refuses a damaged file
        assert len(store.ended()) == 2
    done = bash(">/dev/full benchmark list")
    assert (done.returncode, done.stderr) == (2, "error: No space left on device.\n")
    done = bash("benchmark list | head -1; exit ${PIPESTATUS[0]}")
    assert (done.returncode, done.stdout, done.stderr) == (0, "scenarios\n", "")
