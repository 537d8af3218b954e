"""The whole way through the real commands, at miniature size and at the paper's."""

import json
import os
import platform
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

ROOT = Path(__file__).parents[1]


def command(*arguments: str | Path, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "benchmark", *map(str, arguments)], cwd=cwd, capture_output=True, text=True
    )


def make(*arguments: str, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Runs make with this Python, which has all it needs, in place of one that make installs."""
    settings = [f"PY={sys.executable}", "BASE=", "DEEP=", "DEV="]
    return subprocess.run(["make", *arguments, *settings], cwd=cwd, capture_output=True, text=True)


def contents(directory: Path, *, manifest: bool = False) -> dict[str, bytes]:
    files = {path.name: path.read_bytes() for path in directory.iterdir()}
    if not manifest:
        for name in ("manifest.json", "index.html"):  # times and machine
            files.pop(name, None)
    return files


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of `make reproduce` in miniature."""
    directory = tmp_path_factory.mktemp("results")
    done = make("reproduce", "EXPERIMENT=reproduce_smoke", f"RESULTS={directory}")
    assert done.returncode == 0, done.stderr
    assert "138 runs done, 0 were done already" in done.stdout
    return directory


def test_everything_is_there(results: Path) -> None:
    names = set(contents(results / "reproduce_smoke", manifest=True))
    tables = {
        f"{t}.{end}" for t in ("claims", "sensitivity", "learning", "optimal") for end in ("csv", "md", "tex")
    }
    figures = {
        f"{f}.{end}" for f in ("figure", "learning", "optimal", "sensitivity") for end in ("png", "svg")
    }
    others = {"q_values.csv", "max_q.csv", "optimal_cells.csv", "README.md", "manifest.json", "index.html"}
    others |= {"agent.csv", "agent_S1.csv", "agent_S2.csv", "agent_S3.csv", "optimum.csv"}
    assert names == tables | figures | others


def test_csv_files_have_the_published_form(results: Path) -> None:
    folder = results / "reproduce_smoke"
    q_values = pd.read_csv(folder / "q_values.csv")
    assert list(q_values) == ["scenario", "row", "column", "action", "mean", "std", "min", "max"]
    assert len(q_values) == 1800
    max_q = pd.read_csv(folder / "max_q.csv")
    assert list(max_q) == [
        "scenario", "step", "mean", "std", "min", "max", "table_mean", "table_min", "table_max",
    ]  # fmt: skip
    assert max_q[max_q["scenario"] == "S2"]["step"].tolist() == list(range(0, 600, 10))
    claims = pd.read_csv(folder / "claims.csv")
    assert list(claims) == [
        "claim", "says", "measure", "value", "low", "high", "threshold", "verdict", "parts", "agents",
        "because",
    ]  # fmt: skip
    sensitivity = pd.read_csv(folder / "sensitivity.csv")
    assert len(sensitivity) == 9 * 9
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["runs"] == 138
    assert manifest["versions"][0]["numpy"]


def test_second_time_only_redraws_and_changes_nothing(results: Path) -> None:
    before = contents(results / "reproduce_smoke", manifest=True)
    done = make("reproduce", "EXPERIMENT=reproduce_smoke", f"RESULTS={results}")
    assert done.returncode == 0, done.stderr
    assert "all 138 runs are done already" in done.stdout
    assert contents(results / "reproduce_smoke", manifest=True) == before


def test_results_do_not_depend_on_how_the_work_was_split(results: Path, tmp_path: Path) -> None:
    for arguments in (["--seeds", "4-5", "--jobs", "3"], ["--seeds", "1"], ["--jobs", "1"]):
        done = command("run", "reproduce_smoke", "--results", tmp_path, *arguments)
        assert done.returncode == 0, done.stderr
    assert command("report", "reproduce_smoke", "--results", tmp_path).returncode == 0
    assert contents(tmp_path / "reproduce_smoke") == contents(results / "reproduce_smoke")


def test_report_of_fewer_seeds(results: Path, tmp_path: Path) -> None:
    shutil.copy(results / "runs.db", tmp_path)
    done = command("report", "reproduce_smoke", "--results", tmp_path, "--seeds", "0-1")
    assert done.returncode == 0, done.stderr
    assert pd.read_csv(tmp_path / "reproduce_smoke" / "optimal.csv")["agents"].tolist() == [2, 2, 2]
    assert "**Partial: 2 of the 6 agents" in (tmp_path / "reproduce_smoke" / "README.md").read_text()


def test_results_of_shipped_experiments_are_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "reproduce.toml").write_text("")
    done = command("run", tmp_path / "reproduce.toml", "--results", tmp_path)
    assert done.returncode == 2
    assert "reproduce is a shipped one; rename it" in done.stderr


def test_list_tells_what_is_done(results: Path, tmp_path: Path) -> None:
    done = command("list", "--results", results)
    assert done.returncode == 0, done.stderr
    assert re.search(r"reproduce_smoke +138 of 138 runs done", done.stdout)
    assert re.search(r"reproduce +0 of 2300 runs done", done.stdout)
    assert re.search(r"S2 +The issuer gives random feedback", done.stdout)
    assert command("list", "--results", tmp_path / "nowhere").returncode == 0
    assert not (tmp_path / "nowhere").exists()


def digest_of_runs(database: Path) -> list[tuple[str, str, bytes]]:
    connection = sqlite3.connect(database)
    rows = connection.execute("SELECT digest, name, data FROM arrays ORDER BY digest, name").fetchall()
    connection.close()
    return rows


def interrupted(results: Path, number: signal.Signals) -> tuple[int, int, str]:
    """Starts the full run, signals it once some runs are kept; returns exit code, runs kept, stderr."""
    process = subprocess.Popen(
        [sys.executable, "-m", "benchmark", "run", "reproduce", "--results", str(results)],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    )
    count = 0
    deadline = time.monotonic() + 60
    while count < 100 and time.monotonic() < deadline:
        time.sleep(0.02)
        if (results / "runs.db").exists():
            connection = sqlite3.connect(results / "runs.db", timeout=10)
            try:
                (count,) = connection.execute("SELECT count(*) FROM runs").fetchone()
            except sqlite3.OperationalError:
                count = 0  # not made yet
            connection.close()
    process.send_signal(number)
    _, stderr = process.communicate(timeout=60)
    return process.returncode, count, stderr


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of the replication at the paper's size, uninterrupted."""
    directory = tmp_path_factory.mktemp("full")
    done = make("reproduce", f"RESULTS={directory}")
    assert done.returncode == 0, done.stderr
    return directory


def test_killed_run_goes_on_where_it_was(full: Path, tmp_path: Path) -> None:
    code, count, _ = interrupted(tmp_path, signal.SIGKILL)
    assert code == -signal.SIGKILL
    assert 100 <= count < 2300
    done = command("run", "reproduce", "--results", tmp_path)
    assert done.returncode == 0, done.stderr
    kept = re.search(r"(\d+) runs done, (\d+) were done already", done.stdout)
    assert kept is not None
    assert int(kept[2]) >= count  # nothing finished was lost or repeated
    assert int(kept[1]) + int(kept[2]) == 2300
    assert digest_of_runs(tmp_path / "runs.db") == digest_of_runs(full / "runs.db")


def test_interrupt_is_polite(tmp_path: Path) -> None:
    code, count, stderr = interrupted(tmp_path, signal.SIGINT)
    assert code == 130
    assert count >= 100
    assert "interrupted: finished runs are kept" in stderr
    assert "Traceback" not in stderr


def test_published_results_are_what_the_code_makes(full: Path) -> None:
    published = contents(ROOT / "results" / "reproduce")
    made = contents(full / "reproduce")
    assert set(published) == set(made)
    endings = [".csv", ".md", ".tex"]
    if (platform.system(), platform.machine()) == ("Linux", "x86_64"):
        endings.append(".svg")  # elsewhere a coordinate's last digit may differ
    for name in made:
        if Path(name).suffix in endings:
            assert published[name] == made[name], f"{name} is out of date: run make reproduce"


def unwritable(tmp_path: Path) -> Path:
    """Returns a folder that cannot be written even by root."""
    (tmp_path / "file").write_text("")
    return tmp_path / "file" / "results"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["run", "reproduct"], "unknown experiment reproduct (did you mean reproduce?)"),
        (["report", "nothing.toml"], "nothing.toml: cannot be read"),
        (["run", "reproduce", "--jobs", "0"], "--jobs 0: accepted: at least 1"),
        (["run", "reproduce", "--seeds", "9-2"], "--seeds 9-2: accepted: A-B"),
        (["run", "reproduce", "--seeds", "x"], "--seeds x: accepted: A-B"),
        (["run", "reproduce", "--seeds", ""], "--seeds : accepted: A-B"),
        (["report", "reproduce"], "there are no runs yet; run the experiment first"),
        (["run", "reproduce", "--seeds", "7-2000000"], "accepted: seeds below 1,000,000"),
    ],
)
def test_mistakes_get_one_sentence_and_exit_code_2(
    tmp_path: Path, arguments: list[str], expected: str
) -> None:
    done = command(*arguments, "--results", tmp_path)
    assert done.returncode == 2
    assert expected in done.stderr
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("arguments", [["run", "reproduce"], ["speed", "--smoke"]])
def test_unwritable_results_are_refused_before_any_work(tmp_path: Path, arguments: list[str]) -> None:
    done = command(*arguments, "--results", unwritable(tmp_path))
    assert done.returncode == 2
    assert re.fullmatch(r"error: .*file/results.*: cannot be (made|written): .*--results\.\n", done.stderr)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_read_only_results_are_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    done = command("run", "reproduce", "--results", tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1


def test_failed_drawing_leaves_the_old_results(results: Path, tmp_path: Path) -> None:
    folder = tmp_path / "reproduce_smoke"
    shutil.copytree(results, tmp_path, dirs_exist_ok=True)
    before = contents(folder, manifest=True)
    code = (
        "import sys; from benchmark import __main__ as m; from benchmark.reports.replication import report\n"
        "def broken(*_): raise OSError('disk full')\n"
        "report.write_figure = broken\n"
        f"sys.exit(m.main(['report', 'reproduce_smoke', '--results', {str(tmp_path)!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2
    assert "cannot be written: disk full" in done.stderr
    assert contents(folder, manifest=True) == before  # nor is anything left lying about


# Every target of make and every command


def run_make(target: str, tmp_path: Path) -> str:
    """Runs a target in miniature."""
    if target == "clean":  # in a copy, since it removes what other tests use
        ignored = shutil.ignore_patterns(".*", "__pycache__")
        shutil.copytree(ROOT, tmp_path / "copy", ignore=ignored)
        (tmp_path / "copy" / "envs" / "__pycache__").mkdir()
        (tmp_path / "copy" / "results" / "runs.db").touch()
        done = make("clean", cwd=tmp_path / "copy")
        assert not (tmp_path / "copy" / "envs" / "__pycache__").exists()
        assert not (tmp_path / "copy" / "results" / "runs.db").exists()
        assert (tmp_path / "copy" / "results" / "reproduce" / "claims.csv").exists()
    else:
        if target == "report":
            shutil.copytree(ROOT / "results" / "reproduce", tmp_path / "reproduce")
        miniature = {
            "help": [],
            "reproduce": ["EXPERIMENT=reproduce_smoke", f"RESULTS={tmp_path}"],
            "report": [f"RESULTS={tmp_path}"],
            "compare-deep": ["EXPERIMENT=compare_deep_long_smoke", "SEEDS=2", f"RESULTS={tmp_path}"],
            "test": ["TESTS=tests/test_layering.py"],
            "check": ["CHECKED=envs/inputs.py"],
            "speed": ["SPEED=--smoke", f"RESULTS={tmp_path}"],
        }
        done = make(target, *miniature[target])
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


TARGETS = re.findall(r"^([a-z-]+):.*##", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)


@pytest.mark.parametrize("target", TARGETS)
def test_every_make_target(target: str, tmp_path: Path) -> None:
    output = run_make(target, tmp_path)
    if target == "help":
        assert all(f"make {name}" in output for name in TARGETS)
    if target == "speed":
        speed = pd.read_csv(tmp_path / "speed_smoke" / "speed.csv")
        assert list(speed)[:4] == ["name", "per_second", "baseline", "ratio"]
        assert {
            "q_learning_kernel", "q_learning_threads", "vector_env_1000", "evaluate", "sb3_dqn", "sb3_ppo",
            "vec_env_8", "vec_env_64", "map_all_cells",
        } <= set(speed["name"])  # fmt: skip
    if target == "report":
        assert {path.name for path in tmp_path.iterdir()} == {"README.md", "index.html", "reproduce"}
    if target == "compare-deep":
        summary = pd.read_csv(tmp_path / "compare_deep_long_smoke" / "summary.csv")
        assert set(summary["n"]) == {2}


@pytest.mark.parametrize("name", ["list", "run", "report", "speed", "watch"])
def test_every_command_explains_itself(name: str) -> None:
    done = command(name, "--help")
    assert done.returncode == 0
    assert "--results" in done.stdout
