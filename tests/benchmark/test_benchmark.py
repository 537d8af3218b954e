"""Experiments, store, runner, aggregation, claims and tables, each by itself."""

import json
import sqlite3
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy import stats

from agents.dynamic_programming import evaluate
from agents.policy import mask_policy
from agents.tabular import learner as q_learning
from benchmark.analysis import intervals
from benchmark.analysis import population as aggregate
from benchmark.analysis.population import Population
from benchmark.drawing import tables
from benchmark.execution import driver as runner
from benchmark.execution.driver import pending, run
from benchmark.execution.store import Record, Store
from benchmark.experiments import (
    EXPERIMENT_DIRECTORY,
    Experiment,
    RunSpecification,
    all_specifications,
    experiment_names,
    load_experiment,
    specifications,
)
from envs import InputError, compile_scenario
from envs.inputs import override, parse, read_toml

SMOKE = load_experiment("reproduce_smoke")


# Experiments


@pytest.mark.parametrize("name", experiment_names())
def test_shipped_experiments_are_sound(name: str) -> None:
    experiment = load_experiment(name)
    runs = all_specifications(experiment)
    assert len({run.digest for run in runs}) == len(runs)


def test_reproduce_has_a_miniature_of_all_its_readings() -> None:
    full = load_experiment("reproduce")
    assert SMOKE.readings == full.readings
    assert SMOKE.scenarios == full.scenarios


def test_reproduce_declares_what_the_paper_says() -> None:
    experiment = load_experiment("reproduce")
    runs = specifications(experiment, "default", "S1", "q_learning", "index")
    assert len(runs) == 100
    settings = runs[0].settings.model_dump()
    assert settings | {"record_every": 1} == q_learning.Settings().model_dump()
    assert settings["learning_rate"] == settings["epsilon"] == 0.6
    assert settings["discount"] == 0.9
    assert settings["budget"] == 10_000
    # Every alternative of the specification, one of them a matter of measuring alone.
    assert set(experiment.readings) == {
        "default", "epsilon", "max_q", "ping_discomfort", "budget", "ties", "origin", "time_limit",
        "equal_pay",
    }  # fmt: skip
    assert len(all_specifications(experiment)) == 7 * 3 * 100 + 2 * 100  # the control changes S1 and S2


def test_identity_is_content_and_streams_have_names() -> None:
    runs = all_specifications(SMOKE)
    by_digest = {run.digest: run for run in runs}
    again = {run.digest: run for run in all_specifications(load_experiment("reproduce_smoke"), range(3))}
    assert set(again) < set(by_digest)  # fewer seeds are the same runs, and none is a position in a list
    states: dict[tuple[str, int], set[bytes]] = {}
    for one in runs:
        words = one.seed_sequence.generate_state(4, np.uint64).tobytes()
        states.setdefault((one.scenario.name, one.seed), set()).add(words)
    assert all(len(words) == 1 for words in states.values())  # readings share streams ...
    assert len(set.union(*states.values())) == len(states) == 18  # ... scenarios and seeds do not


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("seeds = 100", "seeds = 0", "algorithms.q_learning.seeds = 0: input should be greater than"),
        ("seeds = 100", "sedes = 6", "[algorithms.q_learning]: unknown key sedes (did you mean seeds?)"),
        ("epsilon = 0.6 ", "epsilon = 6.0 ", "algorithms.q_learning.settings: epsilon = 6.0"),
        ("epsilon = 0.4", "epsilon = -1.0", "readings.epsilon.settings: epsilon = -1.0"),
        ('"S1", "S2"', '"S1", "S7"', "unknown scenario S7"),
        ('["index"]', '["indx"]', "unknown observation for q_learning indx (did you mean index?)"),
        ('"q_learning"\nobs', '"q_lerning"\nobs', "unknown algorithm q_lerning (did you mean q_learning?)"),
        ("[8, 6]", "[8, 60]", "mine.toml: readings.origin.scenario: "),
        ("[8, 6]", "[8, 60]", "issuer.position = [8, 60] is off the grid"),
        ('"S1", "S2"', '"S1", "S7"', "mine.toml: scenarios: "),
        ('answer = "by the lowest index"', 'answer = ""', "readings.ties.answer"),
        ("[readings.default]", "[readings.plain]", "the table readings.default is missing"),
        ('scenarios = ["S1", "S2", "S3"]', "scenarios = []", "scenarios = []"),
        ('["index"]', '["one_hot"]', "unknown observation for q_learning one_hot; accepted: index"),
        ('["S1", "S2"]', '["S1", "S4"]', "readings.equal_pay.scenarios: unknown scenario S4"),
        ('"S2", "S3"]', '"S2", "S2"]', "scenarios: S2 is named twice"),
        ("evaluation_every = 250", "evaluation_every = 1e3", "evaluation_every = 1000.0"),
        (
            "map_every = 1000",
            "map_every = 600",
            "map_every = 600: accepted: a multiple of evaluation_every = 250",
        ),
        ("horizon = 200", 'name = "x"\nhorizon = 200', "unknown key name"),
    ],
)
def test_mistakes_in_an_experiment_get_one_sentence(
    tmp_path: Path, old: str, new: str, expected: str
) -> None:
    check_refused("reproduce", tmp_path, old, new, expected)


def check_refused(experiment: str, tmp_path: Path, old: str, new: str, expected: str) -> None:
    """Checks what is said of a shipped experiment with a mistake put into a copy of it."""
    text = (EXPERIMENT_DIRECTORY / f"{experiment}.toml").read_text()
    assert old in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError) as caught:
        load_experiment(path)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


# Store and runner


def record(digest: str, status: str = "done", arrays: dict[str, NDArray[Any]] | None = None) -> Record:
    arrays = arrays or {}
    return Record(digest, "{}", status, {"wall_time_s": 1.0}, arrays, "oh" if status == "failed" else None)


def test_store_gives_back_what_was_kept(tmp_path: Path) -> None:
    arrays = {"a": np.arange(6.0).reshape(2, 3), "b": np.array(7, dtype=np.int64), "c": np.empty((0, 3))}
    with Store(tmp_path / "deep" / "runs.db") as store:
        store.add([record("x", arrays=arrays), record("y")])
        store.add([record("x", "failed")])
        store.add([record("x", arrays=arrays)])
    with Store(tmp_path / "deep" / "runs.db") as store:
        assert store.statuses() == {"x": "done", "y": "done"}
        second, first = store.get(["y", "x"])
        assert (second.arrays, first.status) == ({}, "done")
        for name, values in arrays.items():
            assert first.arrays[name].dtype == values.dtype
            assert np.array_equal(first.arrays[name], values)
            assert first.arrays[name].shape == values.shape
        with pytest.raises(KeyError):
            store.get(["z"])


def test_store_keeps_all_of_a_group_or_none(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.db") as store:
        store.add([record("x")])
        with pytest.raises(InputError, match="CHECK constraint"):
            store.add([record("x", "failed"), record("y"), record("z", "odd")])
        assert store.statuses() == {"x": "done"}


def test_foreign_and_broken_stores_are_refused_and_left_alone(tmp_path: Path) -> None:
    text = tmp_path / "text.db"
    text.write_text("these are my notes, and no database at all\n" * 100)
    with pytest.raises(InputError, match=r"text\.db: cannot be used as the store of runs: file is not"):
        Store(text)
    assert text.read_text().startswith("these are my notes")
    other = tmp_path / "other.db"
    with sqlite3.connect(other) as connection:
        connection.execute("CREATE TABLE cats (name TEXT)")
    connection.close()
    before = other.read_bytes()
    with pytest.raises(InputError, match=r"other\.db: a database of something else"):
        Store(other)
    assert other.read_bytes() == before
    with pytest.raises(InputError, match="cannot be used as the store"):
        Store(tmp_path)  # a folder
    with pytest.raises(InputError, match="cannot be made"):
        Store(text / "runs.db")


def test_damaged_store_is_told_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "runs.db"
    with Store(path) as store:
        store.add([record(str(i), arrays={"a": np.zeros(500)}) for i in range(50)])
    content = bytearray(path.read_bytes())
    content[8192:] = b"\x5a" * (len(content) - 8192)
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"runs\.db: cannot be used"), Store(path) as store:
        store.get(list(store.statuses()))


@pytest.mark.parametrize(
    "damage",
    ["DELETE FROM arrays WHERE name = 'q'", "UPDATE arrays SET data = substr(data, 1, 13) WHERE name = 'q'"],
)
def test_damaged_records_are_told_in_a_sentence(tmp_path: Path, damage: str) -> None:
    runs = specifications(SMOKE, "default", "S1", "q_learning", "index")
    with Store(tmp_path / "runs.db") as store:
        run(runs, store, jobs=1)
    connection = sqlite3.connect(tmp_path / "runs.db")
    with connection:
        connection.execute(damage)
    connection.close()
    told = pytest.raises(InputError, match=r"runs\.db: the record of run [0-9a-f]{12} is damaged; remove")
    with Store(tmp_path / "runs.db", read_only=True) as store, told:
        aggregate.load_population(runs, store)


def test_interrupt_keeps_the_jobs_that_are_running(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = all_specifications(SMOKE)
    executed: list[str] = []
    execute = runner.execute_job
    together = threading.Barrier(3, timeout=60)

    def slow(group: list[RunSpecification], provenance: dict[str, Any], logs: None) -> list[Record]:
        records = execute(group, provenance, logs)
        executed.extend(one.digest for one in group)
        if len(executed) <= 3 * len(group):  # the first three jobs end at once, and are not alone
            together.wait()
        else:
            time.sleep(0.2)  # so that the interrupt comes before the last of them
        return records

    calls: list[int] = []

    def interrupt(records: list[Record]) -> None:
        calls.append(len(records))
        if len(calls) == 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(runner, "execute_job", slow)
    with Store(tmp_path / "runs.db") as store:
        with pytest.raises(KeyboardInterrupt):
            run(runs, store, 3, interrupt)
        assert len(executed) >= 18
        assert set(store.statuses()) == set(executed)
        assert len(executed) < len(runs)
        assert run(runs, store, 3) == []
        assert pending(runs, store) == []


class Interrupted:
    """A connection whose user presses Ctrl-C once, just before or after a statement."""

    def __init__(self, connection: sqlite3.Connection, statement: str, *, before: bool) -> None:
        self._connection = connection
        self._statement = statement
        self._before = before

    def execute(self, statement: str, *arguments: Any) -> Any:
        strikes = statement == self._statement
        if strikes:
            self._statement = ""
        if strikes and self._before:
            raise KeyboardInterrupt
        result = self._connection.execute(statement, *arguments)
        if strikes:
            raise KeyboardInterrupt
        return result

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)


@pytest.mark.parametrize("before", [True, False])
@pytest.mark.parametrize("statement", ["BEGIN IMMEDIATE", "COMMIT"])
def test_interrupt_around_a_transaction_leaves_the_store_usable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, statement: str, before: bool
) -> None:
    with Store(tmp_path / "runs.db") as store:
        interrupted = Interrupted(store._connection, statement, before=before)
        monkeypatch.setattr(store, "_connection", interrupted)
        with pytest.raises(KeyboardInterrupt):
            store.add([record("x")])
        store.add([record("x")])  # as the runner does with what had ended by then
        store.add([record("y")])
    with Store(tmp_path / "runs.db", read_only=True) as store:
        assert store.statuses() == {"x": "done", "y": "done"}


def test_long_runs_are_jobs_of_their_own() -> None:
    changes = {"algorithms.q_learning.seeds": 30, "algorithms.q_learning.settings.budget": 4_000_000}
    data = override(read_toml(EXPERIMENT_DIRECTORY / "reproduce.toml"), changes, "test")
    experiment = parse(Experiment, data, "test", name="long")
    runs = specifications(experiment, "default", "S1", "q_learning", "index")
    assert [len(group) for group in runner.plan(runs)] == [2] * 15
    assert [len(group) for group in runner.plan(all_specifications(SMOKE))] == [6] * 23


def test_what_is_done_stays_done(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.db") as store:
        store.add([record("x", arrays={"a": np.ones(3)})])
        store.add([record("x", "failed"), record("y", "failed")])  # by another driver, say
        assert store.statuses() == {"x": "done", "y": "failed"}
        assert store.get(["x"])[0].arrays["a"].tolist() == [1, 1, 1]


def test_reading_needs_a_store_and_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "runs.db"
    with pytest.raises(InputError, match=r"runs\.db: there are no runs yet"):
        Store(path, read_only=True)
    assert not path.exists()
    with Store(path) as store:
        store.add([record("x")])
    before = path.read_bytes()
    with Store(path, read_only=True) as store:
        assert store.statuses() == {"x": "done"}
        with pytest.raises(InputError, match="readonly"):
            store.add([record("y")])
    assert path.read_bytes() == before


def test_records_hold_what_training_gave(tmp_path: Path) -> None:
    runs = specifications(SMOKE, "budget", "S2", "q_learning", "index")
    model = compile_scenario(runs[0].scenario)
    training = q_learning.train(
        model,
        q_learning.Settings.model_validate(runs[0].settings.model_dump()),
        [one.seed_sequence for one in runs],
        runs[0].schedule,
        record_table=True,
    )
    evaluation = evaluate(model, mask_policy(training.greedy), SMOKE.horizon)
    none = evaluate(model, training.stochastic, SMOKE.horizon)
    with Store(tmp_path / "runs.db") as store:
        run(runs, store, jobs=2)
        population = aggregate.load_population(runs, store)
    expected = vars(training) | vars(evaluation)
    expected |= {f"stochastic_{name}": values for name, values in vars(none).items()}
    del expected["cpu_time_s"]  # measured, and kept apart
    assert population.arrays.keys() == expected.keys()
    for name, values in expected.items():
        assert np.array_equal(population.arrays[name], values), name
    assert (population.arrays["episodes_ended"] == 600).all()


def test_one_run_has_no_interval(tmp_path: Path) -> None:
    runs = specifications(SMOKE, "default", "S1", "q_learning", "index", [0])
    with Store(tmp_path / "runs.db") as store:
        run(runs, store, jobs=1)
        with pytest.raises(InputError, match="1 run a scenario: accepted: at least 2"):
            aggregate.load_population(runs, store)


def test_failed_runs_are_kept_told_and_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = specifications(SMOKE, "default", "S1", "q_learning", "index")

    def broken(*_: object, **__: object) -> None:
        raise FloatingPointError("diverged")

    with Store(tmp_path / "runs.db") as store:
        with monkeypatch.context() as patch:
            patch.setattr(q_learning, "train", broken)
            errors = run(runs, store, jobs=1)
        assert errors == ["FloatingPointError: diverged"] * 6
        assert set(store.statuses().values()) == {"failed"}
        with pytest.raises(InputError, match="6 of 6 runs of q_learning in S1 are not done"):
            aggregate.load_population(runs, store)
        assert pending(runs, store) == runs
        assert run(runs, store, jobs=1) == []
        assert pending(runs, store) == []


def test_incomplete_populations_are_refused(tmp_path: Path) -> None:
    runs = specifications(SMOKE, "default", "S2", "q_learning", "index")
    with Store(tmp_path / "runs.db") as store:
        run(runs[:2] + runs[3:], store, jobs=2)
        with pytest.raises(InputError, match=r"1 of 6 runs .* \(the first is seed 2\)"):
            aggregate.load_population(runs, store)
        assert pending(runs, store) == [runs[2]]


def test_progress_counts_every_run_once(tmp_path: Path) -> None:
    runs = all_specifications(SMOKE)
    told: list[int] = []
    with Store(tmp_path / "runs.db") as store:
        for _ in range(2):  # nothing is run, or told, again
            run(runs, store, 2, lambda records: told.append(len(records)))
            assert sum(told) == len(runs)


# Aggregation


def population(name: str = "S1", n: int = 4, **arrays: NDArray[Any]) -> Population:
    """A population with given arrays and otherwise nothing learned."""
    specification = specifications(SMOKE, "default", name, "q_learning", "index")[0]
    blank: dict[str, NDArray[Any]] = {
        "q": np.zeros((n, 120, 5)),
        "stochastic": np.zeros((n, 0, 120, 5)),
        "greedy": np.full((n, 4, 120), 31, dtype=np.uint8),
        "max_q": np.zeros((n, 60)),
        "table_max_q": np.zeros((n, 60)),
        "grid_return": np.zeros((n, 4)),
        "success": np.zeros((n, 4)),
        "scenario_return": np.zeros((n, 4)),
    }
    return Population(json.loads(specification.content), blank | arrays, range(n), [{}] * n)


def test_scores_lie_between_the_exact_anchors() -> None:
    random, optimal = population().anchors["grid_return"]
    assert optimal == pytest.approx(0.0, abs=1e-12)
    returns = np.array([[optimal, random, (optimal + random) / 2, random - (optimal - random)]])
    assert population(n=1, grid_return=returns).scores[0] == pytest.approx([1, 0, 0.5, -1])


def test_bootstrap_interval_agrees_with_scipy() -> None:
    values = np.random.default_rng(0).normal(size=60)
    low, high = intervals.interval(intervals.resample(60, "S1") @ values / 60)
    other = stats.bootstrap((values,), np.mean, method="percentile", n_resamples=20_000, rng=1)
    width = other.confidence_interval.high - other.confidence_interval.low
    assert low == pytest.approx(other.confidence_interval.low, abs=0.08 * width)
    assert high == pytest.approx(other.confidence_interval.high, abs=0.08 * width)


# Tables


def test_tables_come_in_three_forms(tmp_path: Path) -> None:
    frame = pd.DataFrame({"name": ["a_b", "c"], "value": [1 / 3, -1e-17], "n": [2, 3]})
    tables.write_table(frame, tmp_path / "t")
    assert (tmp_path / "t.csv").read_text() == "name,value,n\na_b,0.333333,2\nc,0,3\n"
    assert (tmp_path / "t.md").read_text().splitlines()[2] == "| a_b    |   0.333 |   2 |"
    tex = (tmp_path / "t.tex").read_text()
    assert r"a\_b" in tex
    assert r"\toprule" in tex
