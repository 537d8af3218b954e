"""The comparison: worker processes, grids, tables and findings by themselves, and all of it in miniature."""

import json
import multiprocessing
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from rliable import metrics
from scipy import stats

from agents.policy import ALL_ACTIONS
from benchmark.analysis.population import Population
from benchmark.drawing.tables import LINK, link, plain, write_csv
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
from benchmark.reports import draw as report
from benchmark.reports.comparison import findings
from benchmark.reports.comparison import report as report_comparison
from benchmark.reports.comparison import tables as comparison
from benchmark.reports.comparison.tables import Grid, Learner, load_grid
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


# The miniature


TABLES = (
    "scores", "summary", "aggregate", "improvement", "profile", "curves", "curves_cpu", "threshold",
    "region", "cost", "maps",
)  # fmt: skip
FIGURES = (
    "curves", "curves_cpu", "disagreements", "aggregate", "profile", "improvement", "threshold",
    "region", "maps", "maps_moves", "maps_probability",
)  # fmt: skip


def test_everything_is_there(results: Path) -> None:
    names = {path.name for path in (results / SMOKE.name).iterdir()}
    expected = {f"{name}.{end}" for name in TABLES for end in ("csv", "md", "tex")}
    expected |= {f"{name}.{end}" for name in FIGURES for end in ("png", "svg")}
    others = {"README.md", "manifest.json", "findings.csv", "index.html", "learning.webp"}
    others |= {"agent.csv", "agent_S1.csv", "agent_S2.csv", "agent_S3.csv", "optimum.csv"}
    assert names == expected | others
    scores = pd.read_csv(results / SMOKE.name / "scores.csv")
    assert len(scores) == len(all_specifications(SMOKE))
    assert scores["score"].notna().all()
    assert scores["stochastic_score"].notna().equals(scores["algorithm"].str.startswith("ppo"))
    page = (results / SMOKE.name / "README.md").read_text(encoding="utf-8")
    assert [line.split(".")[0] for line in page.splitlines() if line[:1].isdecimal()] == [
        str(i) for i in range(1, 11)
    ]
    cost = pd.read_csv(results / SMOKE.name / "cost.csv")
    assert cost["peak_memory_mb"].between(50, 700).all()
    manifest = json.loads((results / SMOKE.name / "manifest.json").read_text())
    assert {"torch", "stable_baselines3"} <= set(manifest["versions"][0]) | set(manifest["versions"][-1])


def test_drawing_again_changes_nothing(results: Path, tmp_path: Path) -> None:
    shutil.copy(results / "runs.db", tmp_path)
    assert command("report", SMOKE.name, "--results", tmp_path).returncode == 0
    for path in (tmp_path / SMOKE.name).iterdir():
        assert path.read_bytes() == (results / SMOKE.name / path.name).read_bytes(), path.name


def test_incomplete_grid_is_refused_and_partial_is_marked(results: Path, tmp_path: Path) -> None:
    with Store(results / "runs.db", read_only=True) as store, Store(tmp_path / "runs.db") as other:
        runs = all_specifications(SMOKE)
        lost = [cell("dqn", "one_hot", [1])[0], *cell("ppo", "coordinates", [0, 1])]
        gone_missing = {one.digest for one in lost}
        other.add(store.get([one.digest for one in runs if one.digest not in gone_missing and one.seed < 2]))
        other.add([Record(lost[0].digest, lost[0].content, "failed", {}, {}, "RuntimeError: oh")])
        kept = len(other.ended())
    wanted = len(all_specifications(SMOKE, range(2)))
    done = command("report", SMOKE.name, "--results", tmp_path, "--seeds", "0-1")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert f"{wanted - kept} of {wanted} runs are missing, 1 of them failed" in done.stderr
    assert "dqn, one_hot in S1 has 1 of 2; ppo, coordinates in S1 has 0 of 2" in done.stderr
    assert "--partial" in done.stderr
    assert not (tmp_path / SMOKE.name).exists()
    done = command("report", SMOKE.name, "--results", tmp_path, "--seeds", "0-1", "--partial")
    assert done.returncode == 0, done.stderr
    folder = tmp_path / f"{SMOKE.name}_partial"
    assert "**Partial: 3 of " in (folder / "README.md").read_text()
    assert (folder / "summary.md").read_text().startswith("Partial: 3 of ")
    whole = (results / SMOKE.name / "aggregate.svg").read_text()
    assert 'style="fill: #b22222"' in (folder / "aggregate.svg").read_text()  # the mark's colour
    assert "#b22222" not in whole
    shown = pd.read_csv(folder / "summary.csv")
    learners = set(zip(shown["algorithm"], shown["observation"], strict=True))
    assert ("ppo", "coordinates") not in learners  # no run in S1
    assert ("dqn", "one_hot") not in learners  # one run, which has no spread


def test_partial_takes_the_seeds_that_every_scenario_has() -> None:
    one, other = with_scores(np.array([0.1, 0.2, 0.3])), with_scores(np.array([0.4, 0.5]), "S2")
    one, other = (
        Population(p.specification, p.arrays, seeds, p.provenance)
        for p, seeds in ((one, [0, 1, 2]), (other, [2, 1]))
    )
    scores = grid_of(a={"S1": one, "S2": other}).scores(Learner("a", "index"))
    assert scores == pytest.approx(np.array([[0.2, 0.5], [0.3, 0.4]]))


def test_partial_leaves_out_who_has_no_seeds_in_common(results: Path, tmp_path: Path) -> None:
    lost = {("S1", 0), ("S1", 1), ("S2", 2), ("S2", 3)}
    runs = [
        one
        for one in all_specifications(SMOKE)
        if not (one.arm == "q_learning" and (one.scenario.name, one.seed) in lost)
    ]
    with Store(results / "runs.db", read_only=True) as store, Store(tmp_path / "runs.db") as other:
        other.add(store.get([one.digest for one in runs]))
        grid = load_grid(SMOKE, other, partial=True)
    assert Learner("q_learning", "index") not in grid.learners
    assert grid.missing.endswith("; left out: `q_learning, index`")
    assert len(grid.learners) == 10


def test_replication_knows_no_partial(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.db"):
        pass
    done = command("report", "reproduce_smoke", "--results", tmp_path, "--partial")
    assert done.returncode == 2
    assert "--partial: reproduce_smoke is a replication" in done.stderr


def test_comparison_without_tables_of_values_is_drawn_too(results: Path, tmp_path: Path) -> None:
    arms = {name: arm for name, arm in SMOKE.algorithms.items() if name == "ppo"}
    with Store(results / "runs.db", read_only=True) as store:
        nets = SMOKE.model_copy(update={"algorithms": arms})
        report_comparison.write(nets, store, tmp_path, None, partial=False)
    names = {path.name for path in tmp_path.iterdir()}
    assert "maps_probability.png" in names
    assert "maps.png" not in names
    assert "maps.png" not in (tmp_path / "README.md").read_text()


def test_missing_packages_are_told(results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = (
        "import sys; sys.modules['rliable'] = None\n"
        "from benchmark.__main__ import main\n"
        f"sys.exit(main(['report', '{SMOKE.name}', '--results', {str(results)!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2
    assert "its report needs the package rliable, which is not installed; make compare-deep" in done.stderr
    assert done.stderr.count("\n") == 1

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


def test_divergence_is_recorded_told_and_not_tried_again(tmp_path: Path) -> None:
    experiment = changed(algorithms__dqn_linear__settings__learning_rate=1e38)
    arms = {name: arm for name, arm in experiment.algorithms.items() if name in ("q_learning", "dqn_linear")}
    experiment = experiment.model_copy(update={"algorithms": arms})
    runs = all_specifications(experiment)
    with Store(tmp_path / "runs.db") as store:
        assert run(runs, store, 2) == []
        statuses = store.statuses()
        assert {statuses[one.digest] for one in runs if one.arm == "dqn_linear"} == {"diverged"}
        assert {statuses[one.digest] for one in runs if one.arm == "q_learning"} == {"done"}
        assert pending(runs, store) == []
        grid = load_grid(experiment, store)
    summary = comparison.summary(grid)
    nets = summary[summary["algorithm"] == "dqn_linear"]
    assert nets["diverged"].tolist() == [2, 2, 2]
    assert summary["diverged"].sum() == 6
    assert nets["score_mean"].to_numpy() == pytest.approx(0, abs=1e-9)  # as the random policy
    scores = comparison.scores(grid)
    assert (scores.loc[scores["algorithm"] == "dqn_linear", "diverged_at"] > 0).all()
    maps = comparison.maps(grid)
    assert maps.loc[maps["algorithm"] == "dqn_linear", "value"].isna().all()


# Tables, by hand


def population(name: str = "S1", n: int = 4, **arrays: NDArray[Any]) -> Population:
    """Runs with given arrays, and otherwise nothing learned; evaluated at 0, 100, 200, 300 and 400."""
    specification = specifications(SMOKE, "default", name, "q_learning", "index", [0])[0]
    blank: dict[str, NDArray[Any]] = {
        "q": np.zeros((n, 120, 5)),
        "stochastic": np.zeros((n, 0, 120, 5)),
        "greedy": np.full((n, 5, 120), ALL_ACTIONS, dtype=np.uint8),
        "disagreements": np.zeros((n, 5), dtype=np.int64),
        "diverged_at": np.full(n, -1),
    }
    for prefix, points in (("", 5), ("every_cell_", 5), ("stochastic_", 0), ("stochastic_every_cell_", 0)):
        for field in ("grid_return", "success", "steps", "wrong_pings"):
            blank[f"{prefix}{field}"] = np.zeros((n, points))
        blank[f"{prefix}zone_steps"] = np.zeros((n, points, 4))
    return Population(json.loads(specification.content), blank | arrays, range(n), [{}] * n)


def with_scores(scores: NDArray[np.float64], name: str = "S1") -> Population:
    """A population whose greedy policies have these scores, (N, T) or, at the end of training, (N,)."""
    random, optimal = population().anchors["grid_return"]
    if scores.ndim == 1:
        scores = np.column_stack([np.zeros((len(scores), 4)), scores])
    return population(name, len(scores), grid_return=random + scores * (optimal - random))


def grid_of(**learners: Mapping[str, Population]) -> Grid:
    return Grid({Learner(name, "index"): populations for name, populations in learners.items()}, "")


def test_threshold_by_hand() -> None:
    scores = np.array(
        [
            [0, 0.96, 0.2, 0.95, 1.0],  # reached at 100, for good from 300 on
            [0, 0, 0, 0, 0.95],  # at the end
            [0, 1, 1, 1, 0.9],  # reached, and lost
            [0, 0.9, 0.949, 0, -3],  # never
        ]
    )
    row = comparison.threshold(grid_of(a={"S1": with_scores(scores)})).iloc[0]
    assert row["n"] == 4
    assert row["reached_share"] == 0.75
    assert row["stays_share"] == 0.5
    assert row["reached_step_median"] == (100 + 400) / 2
    assert np.isinf(row["stays_step_median"])
    always = comparison.threshold(grid_of(a={"S1": with_scores(np.ones((3, 5)))})).iloc[0]
    assert always["stays_step_median"] == always["reached_step_median"] == 0


def test_disagreements_are_told_per_1000_steps_since_the_last_evaluation() -> None:
    counts = np.array([[0, 10, 10, 40, 50], [0, 30, 30, 40, 50]])
    frame = comparison.curves(grid_of(a={"S1": population(n=2, disagreements=counts)}))
    assert np.isnan(frame["disagreements"][0])
    assert frame["disagreements"][1:].tolist() == [200, 0, 200, 100]


def test_region_by_hand() -> None:
    target = population().in_target
    assert target.sum() == 16
    q = np.full((2, 120, 5), -1.0)
    q[0, np.flatnonzero(target)[:8], 4] = 0.5  # half of the region and nothing else
    q[1, np.flatnonzero(target), 4] = 0.5  # all of it, and 8 cells more
    q[1, np.flatnonzero(~target)[:8], 4] = 0.1
    row = comparison.region(grid_of(a={"S1": population(n=2, q=q)})).iloc[0]
    assert row["cells_marked"] == (8 + 24) / 2
    assert row["precision"] == (8 + 16) / (8 + 24)
    assert row["recall"] == (0.5 + 1) / 2
    assert row["overlap"] == pytest.approx((8 / 16 + 16 / 24) / 2)
    none = comparison.region(grid_of(a={"S1": population(n=2)})).iloc[0]
    assert np.isnan(none["precision"])
    assert none["overlap"] == 0


def random_grid(n: int = 10) -> Grid:
    rng = np.random.default_rng(0)
    return grid_of(
        a={name: with_scores(rng.normal(0.5, 0.3, n), name) for name in ("S1", "S2", "S3")},
        b={name: with_scores(rng.normal(0.6, 0.3, 3 * n), name) for name in ("S1", "S2", "S3")},
    )


def test_aggregates_by_a_second_method() -> None:
    grid = random_grid()
    frame = comparison.aggregate(grid)
    own = frame[(frame["evaluated_from"] == "start") & (frame["policy"] == "greedy")]
    for name in ("a", "b"):
        scores = grid.scores(Learner(name, "index"))
        rows = own[own["algorithm"] == name].set_index("metric")
        assert rows["value"]["iqm"] == pytest.approx(stats.trim_mean(scores, 0.25, axis=None))
        assert rows["value"]["mean"] == pytest.approx(scores.mean())
        assert rows["value"]["median"] == pytest.approx(np.median(scores.mean(axis=0)))
        assert rows["value"]["optimality_gap"] == pytest.approx(1 - np.minimum(scores, 1).mean())
        error = scores.std(axis=0).mean() / np.sqrt(scores.size)  # of the mean, stratified
        assert rows["high"]["mean"] - rows["low"]["mean"] == pytest.approx(2 * 1.96 * error, rel=0.25)
    again = comparison.aggregate(grid)
    assert again.equals(frame)  # seeded


def test_resampling_leaves_numpys_global_generator_alone() -> None:
    np.random.seed(3)  # noqa: NPY002
    expected = np.random.rand()  # noqa: NPY002
    np.random.seed(3)  # noqa: NPY002
    comparison.improvement(random_grid())
    assert np.random.rand() == expected  # noqa: NPY002


def test_improvement_is_rliables() -> None:
    grid = random_grid()
    frame = comparison.improvement(grid).set_index(["x", "y"])
    a, b = (grid.scores(Learner(name, "index")) for name in ("a", "b"))
    expected = metrics.probability_of_improvement(a, b)
    assert frame["probability"]["a, index", "b, index"] == pytest.approx(expected)
    assert frame["probability"]["b, index", "a, index"] == pytest.approx(1 - expected)
    assert frame["low"]["a, index", "b, index"] < expected < frame["high"]["a, index", "b, index"]
    ties = np.array([[1.0], [1.0], [0.0]])
    assert comparison._probability_of_improvement(ties, ties[:2]) == pytest.approx(
        metrics.probability_of_improvement(ties, ties[:2])
    )


def test_profile_is_the_share_of_runs_above() -> None:
    scores = np.array([0.0, 0.25, 0.5, 1.0])
    frame = comparison.profile(grid_of(a={"S1": with_scores(scores)}, b={"S1": with_scores(scores)}))
    own = frame[frame["algorithm"] == "a"].set_index("score")["share"]
    assert own[0.0] == 0.75
    assert own[0.5] == 0.25  # above, not at
    assert own[0.98] == 0.25
    assert own[1.0] == 0  # rounding does not lift an optimum above 1


def test_scores_that_differ_by_rounding_alone_are_ties() -> None:
    grid = grid_of(
        a={"S1": with_scores(np.array([1.0, 1.0]))}, b={"S1": with_scores(np.array([1 + 1e-13, 1 - 1e-13]))}
    )
    assert comparison.improvement(grid)["probability"].tolist() == [0.5, 0.5]


# Findings


def verdict(p: float, low: float, high: float) -> str:
    frame = pd.DataFrame([{"x": "a, index", "y": "b, index", "probability": p, "low": low, "high": high}])
    return findings._verdict({"improvement": frame}, Learner("a", "index"), Learner("b", "index"))


def test_words_follow_numbers() -> None:
    told = "does better than `b, index` (P = [0.90](improvement.csv#row=2) [0.80, 1.00])"
    assert verdict(0.9, 0.8, 1.0) == told
    assert verdict(0.1, 0.0, 0.4).startswith("does worse than")
    assert verdict(0.6, 0.45, 0.7).startswith("cannot be told from")
    assert verdict(0.5, 0.5, 0.5).startswith("cannot be told from")
    assert findings._times(3456.0) == "3,500 times"
    assert findings._times(12.4) == "12 times"
    frame = pd.DataFrame({"scenario": ["S1", "S2"], "step": [1200.0, 7.0]})
    frame = frame.assign(algorithm="a", observation="index")
    said = findings._by_scenario({"t": frame}, "t", Learner("a", "index"), "step", "{:.0f}".format)
    assert said == "[1200](t.csv#row=2) in S1, [7](t.csv#row=3) in S2"
    assert plain(said) == "1200 in S1, 7 in S2"
    assert link("x", "t", frame.iloc[[0, 1]], pd.Series(name=5)) == "[x](t.csv#row=2-3;7)"


def test_every_number_of_the_findings_is_in_the_row_that_it_links_to() -> None:
    folder = ROOT / "results" / "compare_deep"
    texts = pd.read_csv(folder / "findings.csv")["text"]
    assert len(texts) == 11
    links = [match for text in texts for match in LINK.findall(text)]
    assert len(links) > 80
    checked = 0
    for text, file, rows in links:
        frame = pd.read_csv(folder / file)
        places: list[int] = []
        for part in rows.split(";"):
            first, _, last = part.partition("-")
            places += range(int(first), int(last or first) + 1)
        # Of several rows a number is the mean; a share may be told in per cent.
        means = frame.iloc[[place - 2 for place in places]].mean(numeric_only=True)
        decimals = len(text.partition(".")[2])
        told = {f"{mean:,.{decimals}f}" for mean in means} | {f"{mean:.0%}" for mean in means}
        if re.fullmatch(r"[-\d,.]+%?", text):
            assert text in told, (text, file, rows)
            checked += 1
        else:
            assert re.fullmatch(r"[\d,]+ times|[\d.]+ m?s|never|only at the very end|none", text), text
    assert checked > 70


def test_sentences_of_the_miniature_bear_its_numbers(results: Path) -> None:
    page = (results / SMOKE.name / "README.md").read_text(encoding="utf-8")
    folder = results / SMOKE.name
    aggregate = pd.read_csv(folder / "aggregate.csv").query(
        "policy == 'greedy' and evaluated_from == 'start' and metric == 'mean'"
    )
    tables = aggregate[aggregate["algorithm"].str.startswith("q_learning")]
    assert len(tables) == 2
    for row in tables.itertuples():
        assert f"{row.value:.2f} [{row.low:.2f}, {row.high:.2f}]" in page
    cost = pd.read_csv(folder / "cost.csv").set_index("algorithm")
    assert f"{cost['parameters']['dqn_linear']:,} numbers" in page


# What is published


def test_published_comparison_is_of_the_declared_runs_and_its_tables_are_what_the_code_makes(
    tmp_path: Path,
) -> None:
    folder = ROOT / "results" / "compare_deep"
    full = load_experiment("compare_deep")
    manifest = json.loads((folder / "manifest.json").read_text())
    runs = all_specifications(full)
    assert manifest["runs"] == len(runs)
    assert manifest["digest"] == report._digest([one.digest for one in runs])
    tabular = {name: arm for name, arm in full.algorithms.items() if arm.algorithm == "q_learning"}
    tables = full.model_copy(update={"algorithms": tabular})
    with Store(tmp_path / "runs.db") as store:
        assert run(all_specifications(tables), store, 2) == []
        made = comparison.scores(load_grid(tables, store))
    write_csv(made, tmp_path / "scores.csv")
    published = pd.read_csv(folder / "scores.csv")
    published = published[published["algorithm"].isin(list(tabular))].reset_index(drop=True)
    columns = [name for name in map(str, published) if not name.startswith("stochastic")]
    again = pd.read_csv(tmp_path / "scores.csv")
    keys = ["scenario", "algorithm", "seed"]
    pd.testing.assert_frame_equal(
        published[columns].sort_values(keys, ignore_index=True),
        again[columns].sort_values(keys, ignore_index=True),
    )


def test_published_aggregates_follow_from_published_scores() -> None:
    folder = ROOT / "results" / "compare_deep"
    scores = pd.read_csv(folder / "scores.csv")
    aggregate = pd.read_csv(folder / "aggregate.csv")
    for name, prefix in (("start", ""), ("every_cell", "every_cell_")):
        shown = aggregate.query(f"policy == 'greedy' and evaluated_from == '{name}'")
        for (algorithm, observation), own in scores.groupby(["algorithm", "observation"]):
            rows = shown[(shown["algorithm"] == algorithm) & (shown["observation"] == observation)]
            value = rows.set_index("metric")["value"]
            assert value["mean"] == pytest.approx(own[f"{prefix}score"].mean(), abs=1e-5)
            trimmed = stats.trim_mean(own[f"{prefix}score"], 0.25)
            assert value["iqm"] == pytest.approx(trimmed, abs=1e-5)
