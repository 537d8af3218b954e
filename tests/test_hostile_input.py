"""What is too large, too deep, of another kind or in the way is refused by one line, before any work."""

import subprocess
import sys
from itertools import product
from pathlib import Path

import pytest

from benchmark.__main__ import main
from benchmark.execution.store import Store
from benchmark.experiments import EXPERIMENT_DIRECTORY
from envs.inputs import read_toml
from envs.scenario import SCENARIO_DIRECTORY
from tests.support import ROOT, small_experiment, variant

EXPERIMENT = small_experiment(horizon=200)
LONG = {"evaluation_every": 20_000, "map_every": 20_000}
LARGE = {"question": "?", "answer": "!", "scenario": {"grid.rows": 250, "grid.columns": 400, "ping_limit": 1}}
AXES = {f"a{axis}": {str(i): {"settings": {f"key{axis}": i}} for i in range(10)} for axis in range(7)}
FOUR = dict([*AXES.items()][:4])
READINGS = {name: {"question": "?", "answer": "!"} for name in ("default", *(f"r{i}" for i in range(10)))}


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
        (small_experiment(horizon=int("9" * 4000)), "horizon = 9999"),
        (
            small_experiment(grids={"all": {"axes": AXES}}),
            "axes: more than 10,000 points: accepted: at most 10,000 points",
        ),
        (
            small_experiment(grids={"all": {"axes": FOUR}}, readings=READINGS),
            "grids: 110,000 conditions: accepted: at most 100,000",
        ),
        (small_experiment(solved={"growth": 1.0000001}), "solved.growth = 1.0000001: "),
        # From [0, 0], the target region of S1 is ten steps away.
        (small_experiment(horizon=10), "S1: no policy succeeds within horizon = 10; "),
        (small_experiment(scenarios=["S" * 5000]), "unknown scenario SSSSS"),
        # By hand: 120 observations, 50,001 times 1 byte of greedy actions and 5 values of 4 bytes.
        (
            small_experiment(**LONG, settings={"budget": 10**9, "record_every": 1000}),
            f"records of {120 * 50_001 * 21 / 1e6:,.0f} MB",
        ),
        (
            small_experiment(evaluation_every=10**9, map_every=10**9, settings={"budget": 10**9}),
            "record_every = 1 with budget = 1000000000: ",
        ),
        # By hand: 100,000 for each of two forms; the days are 200,000 / (24 * 60 * 60).
        (
            small_experiment(algorithms={"table": variant("q_learning", "index", "offset", seeds=100_000)}),
            "up to 200,000 runs, which take 2.3 days at a second each; accepted: at most 100,000.",
        ),
        (
            small_experiment(
                algorithms={"table": variant("compiled_dqn", "coordinates", "one_hot")},
                readings={"default": LARGE},
            ),
            "algorithms.table: observation one_hot: 100,000 observations of 100,000 numbers each",
        ),
    ],
)
def test_files_that_are_too_much(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, expected: str
) -> None:
    (tmp_path / "mine.toml").write_text(text)
    assert expected in refused(capsys, "run", tmp_path / "mine.toml", "--results", tmp_path)


def test_module_that_exits_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    places: list[dict[str, object]] = [
        {"report": "exiting:a"},
        {"algorithms": {"table": variant("exiting:a")}},
    ]
    for ending, place in product(("SystemExit(None)", "GeneratorExit()", "SystemExit('bye')"), places):
        (tmp_path / "exiting.py").write_text(f"raise {ending}\n")
        (tmp_path / "mine.toml").write_text(small_experiment(**place))
        line = refused(capsys, "run", tmp_path / "mine.toml", "--results", tmp_path)
        reason = f"{ending} would end this process"
        assert f"exiting:a cannot be imported: {reason}" in line


def test_all_mistakes_of_a_file_are_reported_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def errors(text: str) -> list[str]:
        (tmp_path / "mine.toml").write_text(text)
        assert main(["run", f"{tmp_path}/mine.toml", "--results", str(tmp_path)]) == 2
        lines = capsys.readouterr().err.splitlines()
        assert all(line.startswith("error: ") for line in lines)
        return [line.removeprefix(f"error: {tmp_path}/mine.toml: ") for line in lines]

    text = EXPERIMENT.replace("horizon = 200", "horizont = 200\nstream = 7").replace(", seeds = 2", "")
    found = errors(text)
    for expected in (
        "unknown key horizont (did you mean horizon?)",
        "stream = 7",
        "the key algorithms.table.seeds is missing.",
    ):
        assert any(line.startswith(expected) for line in found), expected
    compared = (EXPERIMENT_DIRECTORY / "compare_deep.toml").read_text(encoding="utf-8")
    found = errors(
        compared.replace("budget = 10000", "budget = 9999").replace("first_seed = 400", "first_seed = 0")
    )
    for expected in ("the search has used the seeds 0 to 5 and", "is not a whole number of rollouts of 2000"):
        assert any(expected in line for line in found), expected
    assert len(found) == 11
    assert found[-1].startswith("error: and ")


def test_scores_that_are_undefined(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """If every step and every PING pays the same, the optimal policy earns no more than the random one."""
    text = (SCENARIO_DIRECTORY / "S1.toml").read_text(encoding="utf-8")
    zeros = "".join(f"{key} = 0.0\n" for key in read_toml(SCENARIO_DIRECTORY / "S1.toml")["rewards"])
    (tmp_path / "Flat.toml").write_text(f"{text[: text.index('[rewards]')]}[rewards]\n{zeros}")
    (tmp_path / "mine.toml").write_text(small_experiment(scenarios=[f"{tmp_path}/Flat.toml"]))
    flat = ["--agent", "tests.fuzz:up", "--scenario", f"{tmp_path}/Flat.toml", "--observation", "index"]
    for arguments in (["run", f"{tmp_path}/mine.toml"], ["assess", *flat]):
        assert "so scores" in refused(capsys, *arguments, "--results", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["watch", "--save=--"], "the value --"),
        (["run", "reproduce", "--seeds", "9" * 5000], "--seeds 999"),
        (["run", "reproduce", "--seeds", "٣"], "--seeds ٣: "),
        (["verify", "reproduce", "--runs", "-1"], "--runs -1: "),
        (["run", "\u001b[31mred"], "unknown experiment"),
        (["run"], "EXPERIMENT; 'python -m benchmark run --help'"),
        ([], "COMMAND"),
    ],
)
def test_arguments(capsys: pytest.CaptureFixture[str], arguments: list[str], expected: str) -> None:
    assert expected in refused(capsys, *arguments)


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
