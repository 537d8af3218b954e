"""The published tables of runs: what they are made of, and what is refused."""

import gzip
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import benchmark
from agents.dynamic_programming import evaluate
from agents.policy import mask_policy
from benchmark.executors import Threads
from benchmark.experiment import Experiment, load_experiment
from benchmark.folder import MANIFEST, csv_text, write_manifest
from benchmark.records import Records, anchors
from benchmark.run import execute
from benchmark.store import Record, Store
from benchmark.tables import CURVES, RUNS, Group, check_declared, publish, read, tables
from envs import ZONES, InputError
from envs.observations import compile_seen
from tests.benchmark.populations import population
from tests.support import made, small_experiment, variant

PPO = {"n_steps": 100, "batch_size": 50, "n_epochs": 1}
TWO = small_experiment(
    scenarios=["S1", "S3"],
    horizon=100,
    settings={"budget": 400, "time_limit": 100},
    algorithms={
        "table": variant(seeds=3),
        "ppo": variant("compiled_ppo", "one_hot", policy="stochastic", settings=PPO),
    },
)
MADE: dict[str, Any] = {
    **{"cpu_time_s": [0.5, 2.0], "peak_memory_mb": None, "wall_time_s": 3.0, "commit": None},
    **{"started_at": "2026-01-01", "machine": "m", "processor": "p", "versions": {"b": 1, "a": 2}},
}


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    return made(tmp_path_factory.mktemp("two") / "mine.toml", TWO)


@pytest.fixture(scope="module")
def results(two: Experiment) -> Path:
    """The folder beside the experiment's file, with stored and published runs."""
    groups = [Group(each, each.runs()) for each in two.populations]
    with Store(two.path.parent / "runs.db") as store:
        runs = [run for group in groups for run in group.runs]
        assert execute(runs, store, 1, executor=Threads(1)) == []
        publish(two.path.parent / "mine", *tables(groups, store))
    return two.path.parent


def test_tables_have_what_records_hold(two: Experiment, results: Path) -> None:
    """Success by a second method: recorded policies, evaluated again; scores from the anchors."""
    runs, curves = read(results / "mine")
    with Store(results / "runs.db") as store:
        for each in two.populations:
            names = f"scenario == {each.scenario.name!r} and learner == {each.learner.name!r}"
            own, curve = runs.query(names), curves.query(names)
            records = [record.arrays for record in store.get([run.digest for run in each.runs()])]
            assert own["run"].tolist() == [run.digest[:16] for run in each.runs()]
            model = compile_seen(each.scenario, each.learner.observation)
            final = [
                arrays["stochastic"][-1] if len(arrays["stochastic"]) else greedy
                for arrays in records
                for greedy in [mask_policy(arrays["greedy"][-1])]
            ]
            found = evaluate(model, np.stack(final), 100)
            random, best = anchors(model, 100)
            expected = {
                "success": found.success,
                "steps": found.steps,
                "unbounded_score": (found.grid_return - random) / (best - random),
            }
            for name, values in expected.items():
                assert own[name].to_numpy() == pytest.approx(values, rel=1e-5, abs=1e-6)
            assert (own["score"] == own["unbounded_score"].clip(0, 1)).all()
            assert curve["step"].tolist() == [0, 100, 200, 300, 400] * len(own)
            last = curve[curve["step"] == 400]
            for name in ("success", "score", "training_wrong_pings"):
                assert last[name].tolist() == own[name].tolist()


def tabulated(records: Records, path: Path) -> dict[str, Any]:
    """Returns the first row of the table of runs that are made by hand, and stored."""
    fixed = {"updates": np.array(7), "parameters": np.array(600), "diverged_at": np.array(-1)}
    (run,), (arrays,) = records.runs, records.agents
    with Store(path / "runs.db") as store:
        store.add([Record(run.digest, run.content, "done", MADE, {**arrays, **fixed})])
        group = Group(load_experiment("reproduce", smoke=True).populations[0], [run])
        runs, _ = tables([group], store)
    return dict(runs.iloc[0])


def test_results_after_training_by_hand(tmp_path: Path) -> None:
    zones = {"outside": 30.0, "target": 1.0, "uncomfortable": 4.0, "issuer": 0.5}
    zone_steps = np.zeros((1, 4, 4))  # (N, T, zones)
    zone_steps[:, -1] = [zones[zone] for zone in ZONES]
    row = tabulated(population(n=1, zone_steps=zone_steps), tmp_path)
    keys = {"scenario": "S1", "reading": "default", "learner": "q_learning, index", "seed": 0}
    results = {"uncomfortable_steps": 4, "diverged_at": np.inf, "updates": 7, "cpu_time_s": 2.0}
    made = {"versions": '{"a": 2, "b": 1}', "machine": "m", "commit": None}
    assert {name: row[name] for name in keys | results | made} == keys | results | made
    assert "cpu_learned_s" not in row


def test_runs_until_solved_by_hand(tmp_path: Path) -> None:
    """Success in unseen places and in new ways is that of the policy that counts."""
    curve, unseen = np.array([[0.0, 1.0, 1.0, 0.95]]), np.array([[[0.1, 0.2], [0.3, 0.4]]])
    made = population(n=1, success=curve, unseen_success=unseen)
    solved = {"success": 0.9, "growth": 1.2}
    made = replace(made, runs=[replace(run, solved=solved) for run in made.runs])
    expected = {
        **{"unseen_success": 0.1, "new_way_success": 0.3},
        **{"success": 0.95, "cpu_time_s": 2.0, "cpu_learned_s": 2.0},
    }
    row = tabulated(made, tmp_path)
    assert {name: row[name] for name in expected} == expected
    assert "score" not in row


def test_a_policy_that_is_not_learned_is_refused(two: Experiment, results: Path) -> None:
    (table, *_), told = two.populations, "algorithms.table.policy = stochastic: .*accepted: greedy"
    declared = table.learner.declared.model_copy(update={"policy": "stochastic"})
    other = replace(table, learner=replace(table.learner, declared=declared))
    with Store(results / "runs.db") as store, pytest.raises(InputError, match=told):
        tables([Group(other, other.runs())], store)


# Files


def test_files_stay_if_only_measured_columns_or_the_compression_differ(
    results: Path, tmp_path: Path
) -> None:
    """Numbers are rounded once: what was read is written as it was."""
    runs, curves = read(results / "mine")
    publish(tmp_path / "mine", runs, curves)
    for name in (RUNS, CURVES):
        assert (tmp_path / "mine" / name).read_bytes() == (results / "mine" / name).read_bytes()
    content = gzip.compress(csv_text(runs).encode(), 1, mtime=7)
    (tmp_path / "mine" / RUNS).write_bytes(content)
    publish(tmp_path / "mine", runs.assign(wall_time_s=1e9, machine="another"), curves)
    assert (tmp_path / "mine" / RUNS).read_bytes() == content
    (tmp_path / "mine" / MANIFEST).write_text("{}")
    publish(tmp_path / "mine", runs.assign(success=0.5), curves)
    assert (read(tmp_path / "mine")[0]["success"] == 0.5).all()


def replaced(name: str, old: str, new: str) -> Callable[[Path], object]:
    """Changes a table, and the manifest with it."""

    def damage(folder: Path) -> None:
        text = gzip.decompress((folder / name).read_bytes()).decode()
        assert old in text
        (folder / name).write_bytes(gzip.compress(text.replace(old, new).encode()))
        write_manifest(folder, {})

    return damage


@pytest.mark.parametrize(
    ("damage", "problem"),
    [
        (lambda folder: (folder / CURVES).unlink(), "there are no runs yet"),
        (lambda folder: (folder / RUNS).write_text("a"), "manifest.json lists another digest"),
        (lambda folder: (folder / MANIFEST).write_text("a"), "manifest.json: damaged"),
        (replaced(RUNS, ",success,", ",failure,"), "success' is missing"),
        (replaced(CURVES, ",400,", ",400,7"), "success is not a probability"),
    ],
)
def test_damaged_and_foreign_files_are_refused(
    results: Path, tmp_path: Path, damage: Callable[[Path], object], problem: str
) -> None:
    publish(tmp_path / "mine", *read(results / "mine"))
    damage(tmp_path / "mine")
    with pytest.raises(InputError, match=problem):
        read(tmp_path / "mine")


def test_published_runs_are_those_that_are_declared(two: Experiment, results: Path) -> None:
    runs, _ = read(results / "mine")
    check_declared(two, runs)
    changed = [
        (runs[2:], r"2 of 10 declared runs are missing, 0 others are there; .* run .*mine\.toml"),
        (runs.replace({"scenario": {"S1": "S2"}}), "5 of 10 .* missing, 5 others are there"),
        (runs.drop(columns="learner"), "10 of 10 declared runs are missing"),
    ]
    for table, what in changed:
        with pytest.raises(InputError, match=f"^mine: .*{what}"):
            check_declared(two, table)


def test_users_get_the_published_tables(
    two: Experiment, results: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = read(results / "mine")
    for found, table in zip((benchmark.runs, benchmark.curves), expected, strict=True):
        pd.testing.assert_frame_equal(found(two.path, results), table)
    monkeypatch.chdir(results)
    (results / "results").symlink_to(results)
    assert len(benchmark.runs("mine.toml")) == 10
    with pytest.raises(InputError, match="there are no runs yet"):
        benchmark.runs(two.path, results / "mine")
