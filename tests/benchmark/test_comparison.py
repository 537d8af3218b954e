"""The comparison: worker processes, grids, tables and findings by themselves, and all of it in miniature."""

import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmark.execution import driver as runner
from benchmark.execution.driver import pending, plan, run
from benchmark.execution.store import Record, Store
from benchmark.experiments import (
    EXPERIMENT_DIRECTORY,
    Experiment,
    RunSpecification,
    all_specifications,
    load_experiment,
    specifications,
)
from envs import InputError
from envs.inputs import override, parse, read_toml
from tests.benchmark.test_benchmark import check_refused

ROOT = Path(__file__).parents[2]
SMOKE = load_experiment("compare_deep_smoke")


def changed(**changes: Any) -> Experiment:
    """The miniature with some values changed, its name kept."""
    base = read_toml(EXPERIMENT_DIRECTORY / "compare_deep.toml")
    small = read_toml(EXPERIMENT_DIRECTORY / "compare_deep_smoke.toml")["changes"]
    dotted = {key.replace("__", "."): value for key, value in changes.items()}
    return parse(Experiment, override(base, small | dotted, "test"), "test", name=SMOKE.name)


def command(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "benchmark", *map(str, arguments)], cwd=ROOT, capture_output=True, text=True
    )


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of `make compare-deep` in miniature."""
    directory = tmp_path_factory.mktemp("results")
    settings = ["EXPERIMENT=compare_deep_smoke", f"RESULTS={directory}", f"PY={sys.executable}"]
    arguments = ["make", "compare-deep", *settings, "BASE=", "DEEP="]
    done = subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert f"{len(all_specifications(SMOKE))} runs done, 0 were done already" in done.stdout
    return directory


def arrays_of(results: Path) -> dict[str, dict[str, bytes]]:
    with Store(results / "runs.db", read_only=True) as store:
        records = store.get(sorted(store.statuses()))
    return {one.digest: {name: values.tobytes() for name, values in one.arrays.items()} for one in records}


# What is declared


def test_comparison_declares_what_it_should() -> None:
    full = load_experiment("compare_deep")
    assert full.scenarios == ("S1", "S2", "S3")
    seeds = {name: arm.seeds for name, arm in full.algorithms.items()}
    assert seeds.pop("q_learning") == seeds.pop("q_learning_tuned") == 100
    assert set(seeds.values()) == {10}
    runs = all_specifications(full)
    settings = [one.settings.model_dump() for one in runs]
    assert {one["budget"] for one in settings} == {10_000}
    assert {one["time_limit"] for one in settings} == {200}  # of every algorithm alike
    assert {one.horizon for one in runs} == {200}
    assert len(runs[0].evaluation_steps) == 51
    reproduce = load_experiment("reproduce").algorithms["q_learning"].settings
    paper = full.algorithms["q_learning"].settings
    for key in ("learning_rate", "discount", "epsilon"):  # the paper's constants
        assert paper[key] == reproduce[key]


def test_defaults_are_sb3s_own_but_for_what_the_budget_forces() -> None:
    full = load_experiment("compare_deep")
    assert full.algorithms["dqn_default"].settings == {}
    assert full.algorithms["ppo_default"].settings == {"n_steps": 2000}


def test_experiments_have_miniatures_of_the_same_learners() -> None:
    for name in ("compare_deep", "compare_deep_long"):
        full, small = load_experiment(name), load_experiment(f"{name}_smoke")
        assert full.populations == small.populations
        assert len(all_specifications(small)) < 100
    assert load_experiment("compare_deep_long").settings["budget"] == 100_000


def test_every_learner_has_streams_of_its_own() -> None:
    runs = all_specifications(SMOKE)
    words = {one.seed_sequence.generate_state(4, np.uint64).tobytes() for one in runs}
    assert len(words) == len(runs)


def test_early_results_cover_the_whole_grid() -> None:
    jobs = plan(all_specifications(SMOKE))
    first = jobs[: len(SMOKE.populations)]
    assert {(j[0].scenario.name, j[0].arm, j[0].observation) for j in first} == set(SMOKE.populations)
    assert all(len(job) == 1 for job in jobs if job[0].algorithm != "q_learning")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("gamma = 0.9", "gama = 0.9", "unknown key gama (did you mean gamma?)"),
        ('algorithm = "ppo"', 'algorithm = "pqo"', "unknown algorithm pqo (did you mean ppo?); accepted"),
        ('"coordinates"]', '"one_hat"]', "observation for dqn one_hat (did you mean one_hot?)"),
        ('["index"]', '["one_hot"]', "unknown observation for q_learning one_hot; accepted: index"),
        ("n_steps = 2000", "n_steps = 2048", "budget = 10000 is not a whole number of rollouts of 2048"),
        ("net_arch = []", "net_arc = []", "unknown key net_arc (did you mean net_arch?)"),
        ("budget = 10000", "budget = 9999", "budget = 9999 is not a whole number of rollouts"),
        ('"every_cell"]', '"anywhere"]', "evaluated_from"),
        ("time_limit = 200", "time_limits = 200", "[settings], of q_learning too: unknown key time_limits"),
    ],
)
def test_mistakes_in_a_comparison_get_one_sentence(tmp_path: Path, old: str, new: str, expected: str) -> None:
    check_refused("compare_deep", tmp_path, old, new, expected)


def test_experiments_that_extend_themselves_are_refused(tmp_path: Path) -> None:
    for name, base in (("one", "two"), ("two", "one")):
        text = f'extends = "{tmp_path}/{base}.toml"\ndescription = ""\nchanges = {{}}\n'
        (tmp_path / f"{name}.toml").write_text(text)
    with pytest.raises(InputError, match=r"two\.toml: extends = .*one\.toml\": it extends itself"):
        load_experiment(tmp_path / "one.toml")


# Worker processes


def cell(
    name: str, observation: str, seeds: list[int], experiment: Experiment = SMOKE
) -> list[RunSpecification]:
    return specifications(experiment, "default", "S1", name, observation, seeds)


def test_seed_0_is_the_same_alone_in_a_pool_and_after_a_resume(tmp_path: Path) -> None:
    runs = cell("dqn", "one_hot", [0, 1, 2]) + cell("ppo", "coordinates", [0, 1])
    with Store(tmp_path / "runs.db") as store:
        calls = []

        def interrupt(records: list[Record]) -> None:
            calls.append(records)
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            run(runs, store, 2, interrupt)
        assert 1 <= len(store.statuses()) < len(runs)
        assert multiprocessing.active_children() == []
        assert run(runs, store, 2) == []
        assert pending(runs, store) == []
        pooled = store.get([one.digest for one in runs])
    for i in (0, 3):
        alone = runner.execute_job([runs[i]], {})[0]
        assert alone.arrays.keys() == pooled[i].arrays.keys()
        for name, values in alone.arrays.items():
            assert values.tobytes() == pooled[i].arrays[name].tobytes(), name
    weights = {record.arrays["weights"].tobytes() for record in pooled}
    assert len(weights) == len(runs)


def test_killed_worker_costs_its_run_alone_and_is_tried_again(tmp_path: Path) -> None:
    long = changed(settings__budget=4000, algorithms__ppo_default__settings__n_steps=2000)
    runs = cell("dqn", "one_hot", [0, 1, 2, 3], long)

    def kill() -> None:
        deadline = time.monotonic() + 60
        while not multiprocessing.active_children() and time.monotonic() < deadline:
            time.sleep(0.01)
        child = multiprocessing.active_children()[0]
        assert child.pid is not None
        os.kill(child.pid, signal.SIGKILL)

    with Store(tmp_path / "runs.db") as store:
        killer = threading.Thread(target=kill)
        killer.start()
        errors = run(runs, store, 2)
        killer.join()
        assert len(errors) == 1
        assert "its process was killed by signal 9" in errors[0]
        statuses = store.statuses()
        assert sorted(statuses.values()) == ["done", "done", "done", "failed"]
        (failed,) = (one for one in runs if statuses[one.digest] == "failed")
        (kept,) = store.get([failed.digest])
        assert kept.error == errors[0]
        assert pending(runs, store) == [failed]
        assert run(runs, store, 2) == []
        assert set(store.statuses().values()) == {"done"}


def test_error_in_a_worker_is_kept_and_told(tmp_path: Path) -> None:
    runs = cell("dqn", "one_hot", [0, 1])
    broken = [one for one in runs if one.seed == 1]
    object.__setattr__(broken[0], "observation", "nonsense")
    with Store(tmp_path / "runs.db") as store:
        (error,) = run(runs, store, 1)
        assert error.startswith("InputError: observation: unknown form nonsense")
        assert store.statuses()[runs[0].digest] == "done"


def children(pid: int) -> list[int]:
    tasks = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for task in tasks for child in task.read_text().split()]


def started(results: Path) -> tuple[subprocess.Popen[str], list[int]]:
    """Starts the miniature, and waits until both workers are at it and some runs are kept."""
    process = subprocess.Popen(
        [sys.executable, "-m", "benchmark", "run", SMOKE.name, "--results", str(results), "--jobs", "2"],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        start_new_session=True,  # so that an interrupt reaches it and its workers, as from a terminal
    )
    deadline = time.monotonic() + 90
    while time.monotonic() < deadline:
        time.sleep(0.05)
        if (results / "runs.db").exists():
            try:
                with Store(results / "runs.db", read_only=True) as store:
                    kept = len(store.statuses())
            except InputError:
                continue  # not made yet
            if kept > 30:
                return process, children(process.pid)
    raise AssertionError("too slow")


def gone(pids: list[int], within_s: float = 20) -> bool:
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        if not any(Path(f"/proc/{pid}/stat").exists() for pid in pids):
            return True
        time.sleep(0.1)
    return False


@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_stopped_driver_loses_runs_in_flight_alone(
    results: Path, tmp_path: Path, number: signal.Signals
) -> None:
    process, workers = started(tmp_path)
    python = [pid for pid in workers if "spawn_main" in Path(f"/proc/{pid}/cmdline").read_text()]
    assert len(python) == 2
    for pid in python:  # none of them hears the terminal's interrupt
        blocked = int(Path(f"/proc/{pid}/status").read_text().split("SigBlk:")[1].split()[0], 16)
        assert blocked >> (signal.SIGINT - 1) & 1
    if number == signal.SIGINT:
        os.killpg(process.pid, number)
    else:
        process.kill()
    _, stderr = process.communicate(timeout=60)
    assert gone(workers)
    assert process.returncode == (130 if number == signal.SIGINT else -number)
    if number == signal.SIGINT:
        assert "interrupted: finished runs are kept" in stderr
        assert "Traceback" not in stderr
    with Store(tmp_path / "runs.db", read_only=True) as store:
        kept = len(store.ended())
    done = command("run", SMOKE.name, "--results", tmp_path)
    assert done.returncode == 0, done.stderr
    n = len(all_specifications(SMOKE))
    assert f"{n - kept} runs done, {kept} were done already" in done.stdout
    assert arrays_of(tmp_path) == arrays_of(results)


def test_missing_packages_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def version(name: str) -> str:
        if name == "torch":
            raise PackageNotFoundError
        return "1"

    monkeypatch.setattr(runner, "version", version)
    told = pytest.raises(InputError, match="torch is not installed, which the experiment needs; make")
    with Store(tmp_path / "runs.db") as store, told:
        run(cell("dqn", "one_hot", [0, 1]), store, 1)


def test_adding_seeds_reuses_what_is_there(results: Path, tmp_path: Path) -> None:
    shutil.copy(results / "runs.db", tmp_path)
    experiment = changed(algorithms__dqn_linear__seeds=3)
    runs = specifications(experiment, "default", "S1", "dqn_linear", "one_hot")
    with Store(tmp_path / "runs.db") as store:
        assert pending(runs, store) == [runs[2]]
