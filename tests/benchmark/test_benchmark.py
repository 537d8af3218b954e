"""Experiments, store, runner, aggregation, claims and tables, each by itself."""

import json
import sqlite3
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from agents.dynamic_programming import evaluate
from agents.policy import mask_policy
from agents.tabular import learner as q_learning
from benchmark.analysis import intervals
from benchmark.analysis import population as aggregate
from benchmark.analysis.population import Population
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
from benchmark.reports.replication import claims
from benchmark.reports.replication import tables as replication_tables
from envs import InputError, compile_scenario
from envs.inputs import override, parse, read_toml
from envs.model import PING

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
        with pytest.raises(InputError, match="6 of 6 runs of q_learning in S1 are missing or failed"):
            aggregate.load_population(runs, store)
        assert pending(runs, store) == runs
        assert run(runs, store, jobs=1) == []
        assert pending(runs, store) == []


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


def test_learning_table_by_hand() -> None:
    random, optimal = population().anchors["grid_return"]
    scores = np.array([[0, -9, 0, 1.0], [0, 0.2, 0, 1], [0, 0.4, 0, 1], [0, 0.9, 1, 1]])
    frame = replication_tables.learning([population(grid_return=random + scores * (optimal - random))])
    assert frame["step"].tolist() == [0, 200, 400, 600]
    assert frame["score"].to_numpy() == pytest.approx([0, -1.875, 0.25, 1])
    assert frame["score_iqm"].to_numpy() == pytest.approx([0, 0.3, 0, 1])  # the middle two of four
    assert frame["optimal_share"].tolist() == [0, 0, 0.25, 1]
    assert (frame["score_low"] <= frame["score"] + 1e-12).all()
    assert (frame["score_high"] >= frame["score"] - 1e-12).all()
    assert frame["score_high"].iloc[3] == pytest.approx(1)


def test_value_tables_by_hand() -> None:
    q = np.zeros((4, 120, 5))
    q[:, 13, 4] = [1, 2, 3, 6]  # row 1, column 1, PING
    max_q = np.zeros((4, 60))
    max_q[:, 1] = [0, 0, 4, 4]
    frame = replication_tables.q_values([population(q=q)])
    assert len(frame) == 600
    (row,) = frame[frame["mean"] != 0].to_dict("records")
    assert (row["scenario"], row["row"], row["column"], row["action"]) == ("S1", 1, 1, "PING")
    assert (row["mean"], row["min"], row["max"]) == (3, 1, 6)
    assert row["std"] == pytest.approx(np.sqrt(14 / 3))
    curve = replication_tables.max_q([population(max_q=max_q, table_max_q=max_q + 1)])
    assert curve["step"].tolist() == list(range(0, 600, 10))
    assert curve.iloc[1][["mean", "min", "max", "table_mean", "table_min"]].tolist() == [2, 0, 4, 3, 1]


def test_optimal_tables_compare_with_the_exact_optimum() -> None:
    learned = population(grid_return=np.full((4, 4), -0.5), scenario_return=np.full((4, 4), -0.5))
    (row,) = replication_tables.optimal([learned]).to_dict("records")
    assert row["grid_return_regret"] == pytest.approx(0.5)
    assert row["optimal_share"] == 0
    assert row["start_value_optimal"] == pytest.approx(2 * 0.9**10 - 1)
    q = aggregate.optimal_values(learned)
    best = np.array([1 << int(row.argmax()) for row in q], dtype=np.uint8)
    perfect = population(greedy=np.tile(best, (4, 4, 1)), q=np.tile(q, (4, 1, 1)))
    assert not replication_tables.differing(perfect).any()
    assert abs(replication_tables.optimal_cells([perfect])["difference"]).max() == 0
    # Somebody who always goes UP, and somebody who draws from all five actions, in the start cell,
    # where DOWN and RIGHT are best:
    mixed = np.tile(best, (4, 4, 1))
    mixed[0, -1, 0] = 0b00001
    mixed[1, -1, 0] = 0b11111
    assert replication_tables.differing(population(greedy=mixed))[0] == pytest.approx((1 + 3 / 5) / 4)


# Claims


def one_claim(side: str, threshold: float, *samples: list[float]) -> dict[str, Any]:
    """Judges made-up parts: of each, the value and 1,000 resampled values spread between two ends."""
    parts = [
        claims.Part(str(i), np.concatenate([[value], np.linspace(low, high, intervals.RESAMPLES)]))
        for i, (value, low, high) in enumerate(samples)
    ]
    claim = claims.Claim("c", "", "", side, threshold, "", lambda *_: parts)
    return claims._judge(claim, {"S1": population()}, "visited")


@pytest.mark.parametrize(
    ("side", "threshold", "samples", "verdict", "value"),
    [
        (">", 1.0, [[2.0, 1.5, 2.5]], "holds", 2.0),
        (">", 1.0, [[2.0, 0.5, 3.5]], "holds in part", 2.0),  # right, but not all its interval
        (">", 1.0, [[0.9, 0.5, 3.5]], "holds in part", 0.9),  # wrong, but the interval is not
        (">", 1.0, [[0.9, 0.5, 0.99]], "does not hold", 0.9),
        (">", 1.0, [[2.0, 0.5, 3.5], [0.9, 0.5, 0.99]], "does not hold", 0.9),
        (">", 1.0, [[2.0, 1.5, 2.5], [0.5, 0.4, 0.6]], "holds in part", 0.5),
        (">", 1.0, [[0.2, 0.1, 0.3], [0.5, 0.4, 0.6]], "does not hold", 0.2),
        ("<", 1.0, [[0.2, 0.1, 0.3], [0.5, 0.4, 0.6]], "holds", 0.5),
        ("<", 1.0, [[0.0, 0.0, 0.0]], "holds", 0.0),
        ("<", 1.0, [[1.5, 1.0, 2.0]], "does not hold", 1.5),
        (">", 0.0, [[0.0, 0.0, 0.0]], "does not hold", 0.0),
        ("<", 1.0, [[np.nan, np.nan, np.nan]], "does not hold", np.nan),
    ],
)
def test_verdicts(
    side: str, threshold: float, samples: list[list[float]], verdict: str, value: float
) -> None:
    row = one_claim(side, threshold, *samples)
    assert row["verdict"] == verdict
    assert row["value"] == pytest.approx(value, nan_ok=True)


def measured(id: str, populations: dict[str, Population], curve: str = "visited") -> dict[str, float]:  # noqa: A002
    (claim,) = [claim for claim in claims.CLAIMS if claim.id == id]
    parts = claim.parts(populations, curve)
    return {part.name: part.samples[0] for part in parts}


def trio(**by_scenario: dict[str, NDArray[Any]]) -> dict[str, Population]:
    return {name: population(name, 4, **by_scenario.get(name, {})) for name in ("S1", "S2", "S3")}


def test_variability_by_hand() -> None:
    def curves(spread: float) -> dict[str, NDArray[Any]]:
        return {"max_q": np.outer([-1, -1, 1, 1], np.full(60, spread)), "table_max_q": np.zeros((4, 60))}

    three = trio(S1=curves(1.0), S2=curves(3.0), S3=curves(0.5))
    assert measured("variability-S2", three) == pytest.approx({"S2/S1": 3, "S2/S3": 6})
    assert measured("variability-S3", three) == pytest.approx({"S3/S1": 0.5, "S3/S2": 1 / 6})
    assert all(np.isnan(list(measured("variability-S2", three, "table").values())))


def test_nearness_to_one_by_hand() -> None:
    high = np.zeros((4, 60))
    high[:2, :2] = 0.9  # two of sixty steps are more than one in a hundred
    three = trio(S1={"max_q": high})
    assert measured("max-near-1", three) == pytest.approx({"S1": 0.45, "S3": 0.0})


def test_focus_by_hand() -> None:
    def moves(*cells: tuple[int, int]) -> dict[str, NDArray[Any]]:
        q = np.full((4, 120, 5), -1.0)
        q[:, :, PING] = 9.0  # PING does not count
        for row, column in cells:
            q[:, row * 12 + column, 1] = 0.5
        return {"q": q}

    # From the target region (rows 4 to 8, columns 6 to 10, less its inside) these lie 4, 2, 0 and 1 off.
    three = trio(S1=moves((0, 8)), S2=moves((2, 8), (6, 4)), S3=moves((4, 6), (6, 8), (6, 7)))
    assert measured("moves-focused", three) == pytest.approx({"S3/S1": 1 / 4, "S3/S2": 1 / 2})


def test_ping_maps_by_hand() -> None:
    target = np.flatnonzero(population().model.zone_of_cell == 1)

    def pings(own: list[list[int]]) -> dict[str, NDArray[Any]]:
        q = np.full((4, 120, 5), -0.1)
        for agent, cells in enumerate(own):
            q[agent, cells, PING] = 1.0
        return {"q": q}

    each_a_quarter = [target[i::4].tolist() for i in range(4)]
    one_too_many = [[*target.tolist(), 0]] * 4
    three = trio(S1=pings(one_too_many), S2=pings(each_a_quarter), S3=pings([target.tolist()] * 4))
    assert measured("ping-S1", three) == {"S1": 1}
    assert measured("ping-S3", three) == {"S3": 0}
    assert measured("identifies", three) == pytest.approx(
        {
            "mean map S1": 16 / 17,
            "mean map S2": 1.0,
            "mean map S3": 1.0,
            "own maps S1": 16 / 17,
            "own maps S2": 0.25,
            "own maps S3": 1.0,
        }
    )
    assert measured("random-helps", three) == pytest.approx({"mean map": 1 / 17, "own maps": 1 / 4 - 16 / 17})


def test_reaching_by_hand() -> None:
    success = np.zeros((4, 4))
    success[:, -1] = [1, 1, 0.9, 0.4]
    assert measured("reaches", trio(S1={"success": success})) == {"S1": 0.75}
    (claim,) = [claim for claim in claims.CLAIMS if claim.id == "reaches"]
    (part,) = claim.parts({"S1": population("S1", 100, success=np.ones((100, 4)))}, "visited")
    # Exact binomial (Clopper and Pearson 1934): with all of n agreeing the lower end is 0.025**(1/n).
    assert part.interval == pytest.approx((0.025 ** (1 / 100), 1.0))


def test_every_claim_of_the_paper_is_judged() -> None:
    frame = claims.judge(trio(), "visited")
    assert frame["claim"].tolist() == [
        "variability-S2",
        "max-near-1",
        "variability-S3",
        "moves-focused",
        "ping-S3",
        "ping-S1",
        "reaches",
        "random-helps",
        "identifies",
    ]
    assert set(frame["verdict"]) <= set(claims.VERDICTS)
    assert (frame[["says", "measure", "because"]] != "").all(axis=None)
