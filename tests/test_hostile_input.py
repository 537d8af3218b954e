"""What is too large, too deep, of another kind or in the way is refused by one line, before any work."""

import copy
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NoReturn

import pytest

from benchmark.__main__ import main
from benchmark.execution import driver
from benchmark.execution.store import Store
from benchmark.experiments import EXPERIMENT_DIRECTORY
from envs import InputError
from envs.inputs import read_toml
from envs.scenario import SCENARIO_DIRECTORY
from tests.support import ROOT, small_experiment, toml, variant

EXPERIMENT = small_experiment(horizon=200)
VALUES: Final[tuple[Any, ...]] = (
    *(True, -1, 0, 1.5, float("nan"), 10**400, "", "x" * 5000, "\u001b[31m", "a\nb", "../x", "marker:x"),
    *([], [[]], [1] * 1000, {}, {"a": {"a": 1}}),
)


def up(_: object) -> int:
    """An agent."""
    return 0


def refused(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """Returns the one line by which the command line refuses arguments."""
    assert main([str(argument) for argument in arguments]) == 2
    line = capsys.readouterr().err
    assert line.startswith("error: ")
    assert line.endswith(".\n")
    assert line.count("\n") == 1
    assert len(line) <= len("error: \n") + 300
    return line


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (f"a = {'[' * 500}{']' * 500}", "not valid TOML: maximum recursion depth"),
        (f"{'.'.join('a' * 3000)} = 1", "not valid TOML: maximum recursion depth"),
        (small_experiment(horizon=int("9" * 4000)), "horizon = 9999"),
        # From [0, 0], the target region of S1 is ten steps away.
        (small_experiment(horizon=10), "S1: no policy succeeds within horizon = 10; "),
        (
            small_experiment(algorithms={"table": variant("q_learning", "index", "offset", seeds=100_000)}),
            "200,000 runs; accepted: at most 100,000.",
        ),
        (small_experiment(algorithms={"table": variant("exiting:a")}), "would end this process"),
        (small_experiment(report="exiting:a"), "would end this process"),
    ],
)
def test_files_that_are_too_much(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, expected: str
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


def check_changed(
    path: Path, arguments: list[str], file: Path, capsys: pytest.CaptureFixture[str], accepted: int
) -> None:
    """Checks that changed files are accepted, with this code, or refused by a line for each mistake."""
    codes = []
    for text in changed(path, 25):
        file.write_text(text, encoding="utf-8")
        codes.append(main(arguments))
        said = capsys.readouterr().err.splitlines()
        errors = [line for line in said if line.startswith("error: ")]
        assert codes[-1] in (2, accepted), text
        assert codes[-1] != 2 or (1 <= len(errors) <= 11 and said[-1] == errors[-1]), text
        assert all(len(line) <= len("error: ") + 300 for line in errors), text
    assert codes.count(2) > 10


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("sb3", "tuning")]


@pytest.mark.parametrize("name", ["reproduce", *SLOW])
def test_changed_experiments_are_run_or_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def would_begin(*_: object) -> NoReturn:
        raise InputError("the runs would begin.")

    monkeypatch.setattr(driver, "run", would_begin)
    file = tmp_path / "mine.toml"
    arguments = ["run", str(file), "--results", str(tmp_path / "results")]
    check_changed(EXPERIMENT_DIRECTORY / f"{name}.toml", arguments, file, capsys, accepted=2)


@pytest.mark.parametrize("name", ["Moody", "Walls"])
def test_changed_scenarios_are_used_or_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.toml"
    arguments = ["assess", "--agent", f"{__name__}:up", "--observation", "index", "--scenario", str(file)]
    check_changed(SCENARIO_DIRECTORY / f"{name}.toml", arguments, file, capsys, accepted=0)


def test_all_mistakes_of_a_file_are_reported_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = EXPERIMENT.replace("horizon = 200", "horizont = 200\nstream = 7").replace(", seeds = 2", "")
    (tmp_path / "mine.toml").write_text(text)
    assert main(["run", f"{tmp_path}/mine.toml", "--results", str(tmp_path)]) == 2
    stream, horizon, seeds, unknown = (
        line.removeprefix(f"error: {tmp_path}/mine.toml: ") for line in capsys.readouterr().err.splitlines()
    )
    assert unknown.startswith("unknown key horizont (did you mean horizon?)")
    missing = ["the key horizon is missing.", "the key algorithms.table.seeds is missing."]
    assert [stream.split(":")[0], horizon, seeds] == ["stream = 7", *missing]


def test_scores_that_are_undefined(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """If every step and every PING pays the same, the optimal policy earns no more than the random one."""
    table = read_toml(SCENARIO_DIRECTORY / "S1.toml")
    table["rewards"] = dict.fromkeys(table["rewards"], 0.0)
    (tmp_path / "Flat.toml").write_text(toml(table))
    (tmp_path / "mine.toml").write_text(small_experiment(scenarios=[f"{tmp_path}/Flat.toml"]))
    run = ["run", f"{tmp_path}/mine.toml", "--results", f"{tmp_path}/out"]
    flat = ["--agent", f"{__name__}:up", "--scenario", f"{tmp_path}/Flat.toml", "--observation", "index"]
    for arguments in (run, ["assess", *flat]):
        assert "so scores" in refused(capsys, *arguments)
    assert not (tmp_path / "out").exists()


def test_arguments(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--seeds 999" in refused(capsys, "run", "reproduce", "--seeds", "9" * 5000)
    assert "EXPERIMENT; 'python -m benchmark run --help'" in refused(capsys, "run")


@pytest.mark.slow
def test_closed_and_full_outputs(tmp_path: Path) -> None:
    def bash(command: str) -> subprocess.CompletedProcess[str]:
        text = command.replace("benchmark", f"{sys.executable} -m benchmark")
        return subprocess.run(["bash", "-c", text], cwd=ROOT, capture_output=True, text=True)

    # With its output closed, the first file that is opened would get it: the store.
    (tmp_path / "mine.toml").write_text(EXPERIMENT)
    assert bash(f">&- 2>&- benchmark run {tmp_path}/mine.toml --jobs 1 --results {tmp_path}").returncode == 0
    with Store(tmp_path / "runs.db", read_only=True) as store:
        assert len(store.ended()) == 2
        assert store.problem() == ""
    done = bash(">/dev/full benchmark list")
    assert (done.returncode, done.stderr) == (2, "error: No space left on device.\n")
    done = bash("benchmark list | head -1; exit ${PIPESTATUS[0]}")
    assert (done.returncode, done.stdout, done.stderr) == (0, "scenarios\n", "")
