"""The comparison by itself: its tables by hand and by second methods, and all of it in miniature."""

import json
import subprocess
import sys
from dataclasses import replace
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from rliable import metrics
from scipy import stats

from benchmark.drawing.tables import write_csv
from benchmark.execution.driver import pending, run
from benchmark.execution.store import Record, Store
from benchmark.experiments import Experiment, all_specifications, load_experiment, specifications
from benchmark.reports import draw, load_report
from benchmark.reports.comparison import figures
from benchmark.reports.comparison import tables as comparison
from benchmark.reports.comparison.data import Data, load
from benchmark.reports.comparison.protocol import Learner, Protocol
from benchmark.reports.draw import digest_of
from benchmark.reports.item import measured_files
from envs import InputError
from tests.benchmark.reports.made import compared, data_of, with_scores
from tests.support import ROOT, command, mistyped_columns

SMOKE = load_experiment("compare_deep_smoke")


def with_arms(*names: str) -> Experiment:
    """Returns the miniature with fewer arms, of which there are fewer pairs to compare."""
    arms = {name: SMOKE.algorithms[name] for name in names}
    return SMOKE.model_copy(update={"algorithms": arms, "protocol": None})


# In miniature


def test_everything_is_there(miniature: Path) -> None:
    report = load_report("comparison")
    names = {path.name for path in (miniature / SMOKE.name).iterdir() if not path.name.startswith(".")}
    expected = {"README.md", "manifest.json", "index.html", "learning.webp"}
    expected |= {"agent_S1.csv", "agent_S2.csv"}
    for item in report.items:
        has_table = item.compute is not None or item.tell is not None
        expected |= {f"{item.name}.csv"} if has_table else set()
        expected |= {f"{item.name}.{end}" for end in ("md", "tex") if item.display is not None}
        expected |= {f"{item.name}.{end}" for end in ("png", "svg") if item.draw is not None}
    assert names == expected
    scores = pd.read_csv(miniature / SMOKE.name / "scores.csv")
    assert len(scores) == len(all_specifications(SMOKE))
    assert scores["score"].notna().all()
    assert (scores["policy"] == "stochastic").equals(scores["algorithm"].str.startswith("ppo"))
    assert scores["score"].between(0, 1).all()
    readme = (miniature / SMOKE.name / "README.md").read_text(encoding="utf-8")
    numbers = [line.split(".")[0] for line in readme.splitlines() if line[:1].isdecimal()]
    assert numbers == [str(i) for i in range(1, 17)]
    assert "there is no verdict on whether deep RL earns its keep" in readme  # two runs decide nothing
    cost = pd.read_csv(miniature / SMOKE.name / "cost.csv")
    assert cost["peak_memory_mb"].between(50, 700).all()
    manifest = json.loads((miniature / SMOKE.name / "manifest.json").read_text())
    assert {"torch", "stable_baselines3"} <= set(manifest["versions"][0]) | set(manifest["versions"][-1])
    families = {name: arm["family"] for name, arm in manifest["algorithms"].items()}
    assert {name for name, family in families.items() if family == "tabular"} == {
        "q_learning",
        "q_learning_tuned",
        "q_learning_plain",
    }
    checks = {name: arm["check_of"] for name, arm in manifest["algorithms"].items() if arm["check_of"]}
    assert checks == {name: arm.check_of for name, arm in SMOKE.algorithms.items() if arm.check_of}
    assert len(checks) == 6


def test_readers_infer_the_types_of_all_columns(miniature: Path) -> None:
    for path in (miniature / SMOKE.name).glob("*.csv"):
        assert mistyped_columns(path) == [], path.name


def test_checks_have_rows_but_no_maps_and_no_agents(miniature: Path) -> None:
    folder = miniature / SMOKE.name
    learners = {(arm, observation) for _, arm, observation in SMOKE.populations}
    compared = {pair for pair in learners if not SMOKE.algorithms[pair[0]].check_of}
    for name in ("scores", "summary", "aggregate", "curves", "curves_cpu", "threshold", "region", "cost"):
        frame = pd.read_csv(folder / f"{name}.csv")
        assert set(zip(frame["algorithm"], frame["observation"], strict=True)) == learners, name
    for name in ("profile", "maps", "agent", "agent_S1", "agent_S2"):
        frame = pd.read_csv(folder / f"{name}.csv")
        assert set(zip(frame["algorithm"], frame["observation"], strict=True)) == compared, name
    improvement = pd.read_csv(folder / "improvement.csv")
    n_checks, n = len(learners) - len(compared), len(compared)
    assert len(improvement) == n * (n - 1) + 2 * n_checks
    pairs = improvement[improvement["x"].str.contains("_sb3|_plain")]
    assert len(pairs) == n_checks
    assert (pairs["x"].str.replace("_sb3", "").str.replace("_plain", "_tuned") == pairs["y"]).all()
    legend = "hollow: checks, 2 runs, nets by Stable-Baselines3 itself"
    for name in ("curves", "curves_cpu", "disagreements", "aggregate", "threshold", "region"):
        svg = (folder / f"{name}.svg").read_text(encoding="utf-8")
        assert legend in svg
        assert "_sb3" not in svg
    for name in ("profile", "improvement", "maps", "maps_probability"):
        svg = (folder / f"{name}.svg").read_text(encoding="utf-8")
        assert "hollow" not in svg
        assert "_sb3" not in svg
    readme = (folder / "README.md").read_text(encoding="utf-8")
    assert "`dqn_sb3` checks `dqn`, `dqn_linear_sb3` checks `dqn_linear`" in readme


def test_measured_times_change_measured_files_alone(miniature: Path, tmp_path: Path) -> None:
    """Halves the measured times of all records, as if other runs had given the same results."""
    with Store(miniature / "runs.db", read_only=True) as store, Store(tmp_path / "runs.db") as other:
        for record in store.get(sorted(store.statuses())):
            seconds = [second / 2 for second in record.provenance["cpu_time_s"]]
            provenance = {**record.provenance, "cpu_time_s": seconds, "peak_memory_mb": 123.0}
            other.add([Record(record.digest, record.specification, record.status, provenance, record.arrays)])
        small = with_arms("q_learning", "dqn_linear")
        draw.draw(small, store, tmp_path / "measured")
        draw.draw(small, other, tmp_path / "halved")
    patterns = measured_files(load_report("comparison").items)
    for path in (tmp_path / "measured").iterdir():
        same = path.read_bytes() == (tmp_path / "halved" / path.name).read_bytes()
        is_apart = path.name in ("manifest.json", draw.STAMP) or any(map(path.match, patterns))
        assert same or is_apart, path.name
    assert (tmp_path / "measured" / "cost.csv").read_text() != (tmp_path / "halved" / "cost.csv").read_text()


def test_missing_runs_are_refused_or_marked(miniature: Path, tmp_path: Path) -> None:
    small = with_arms("q_learning", "dqn", "ppo")
    with Store(miniature / "runs.db", read_only=True) as store, Store(tmp_path / "runs.db") as other:
        runs = all_specifications(small, range(2))
        failed = specifications(small, "default", "S1", "dqn", "one_hot", [1])[0]
        absent = specifications(small, "default", "S1", "ppo", "coordinates", [0, 1])
        lost = {run.digest for run in (failed, *absent)}
        other.add(store.get([run.digest for run in runs if run.digest not in lost]))
        other.add([Record(failed.digest, failed.content, "failed", {}, {}, "RuntimeError: oh")])
        with pytest.raises(
            InputError, match=f"3 of {len(runs)} runs are missing, 1 of them failed"
        ) as caught:
            draw.draw(small, other, tmp_path / "whole", range(2))
        assert "dqn, one_hot in S1 has 1 of 2; ppo, coordinates in S1 has 0 of 2" in str(caught.value)
        assert "--partial" in str(caught.value)
        assert not (tmp_path / "whole").exists()
        folder = tmp_path / "partial"
        draw.draw(small, other, folder, range(2), partial=True)
    assert "**Partial: 3 of " in (folder / "README.md").read_text()
    assert (folder / "summary.md").read_text().startswith("Partial: 3 of ")
    assert 'style="fill: #b22222"' in (folder / "aggregate.svg").read_text()  # the mark's colour
    assert "#b22222" not in (miniature / SMOKE.name / "aggregate.svg").read_text()
    shown = pd.read_csv(folder / "summary.csv")
    learners = set(zip(shown["algorithm"], shown["observation"], strict=True))
    assert ("ppo", "coordinates") not in learners  # no run in S1
    assert ("dqn", "one_hot") not in learners  # a single run, which has no spread


def test_partial_leaves_out_learners_without_common_seeds(miniature: Path, tmp_path: Path) -> None:
    lost = {("S1", 0), ("S1", 1), ("S2", 2), ("S2", 3)}
    runs = [
        run
        for run in all_specifications(SMOKE)
        if not (run.arm == "q_learning" and (run.scenario.name, run.seed) in lost)
    ]
    with Store(miniature / "runs.db", read_only=True) as store, Store(tmp_path / "runs.db") as other:
        other.add(store.get([run.digest for run in runs]))
        data = load(SMOKE, other, None, True)
    assert Learner("q_learning", "index") not in data.learners
    assert data.missing.endswith("; left out: `q_learning, index`")
    assert len(data.learners) == 16


def test_partial_leaves_out_checks_of_learners_that_are_left_out(miniature: Path, tmp_path: Path) -> None:
    small = with_arms("q_learning", "q_learning_tuned", "dqn_linear", "dqn_linear_sb3")
    runs = [run for run in all_specifications(small) if run.arm != "dqn_linear"]
    with Store(miniature / "runs.db", read_only=True) as store, Store(tmp_path / "runs.db") as other:
        other.add(store.get([run.digest for run in runs]))
        data = load(small, other, None, True)
        assert data.missing.endswith("; left out: `dqn_linear, one_hot`, `dqn_linear_sb3, one_hot`")
        assert data.checks == {}
        one = with_arms("q_learning", "dqn_linear", "dqn_linear_sb3")
        with pytest.raises(InputError, match="at least two learners that are no checks"):
            load(one, other, None, True)


def test_replication_knows_no_partial(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.db"):
        pass
    done = command("report", "reproduce_smoke", "--results", tmp_path, "--partial")
    assert done.returncode == 2
    assert "--partial: reproduce_smoke is a replication" in done.stderr


@pytest.mark.parametrize(
    ("arms", "has_values", "has_probabilities"),
    [(("ppo",), False, True), (("q_learning", "q_learning_tuned"), True, False)],
)
def test_comparison_of_nets_or_of_tables_alone_has_no_sentences(
    miniature: Path, tmp_path: Path, arms: tuple[str, ...], has_values: bool, has_probabilities: bool
) -> None:
    with Store(miniature / "runs.db", read_only=True) as store:
        draw.draw(with_arms(*arms), store, tmp_path / "drawn")
    folder = tmp_path / "drawn"
    assert ("maps.png" in {path.name for path in folder.iterdir()}) == has_values
    assert (folder / "maps_probability.png").exists() == has_probabilities
    readme = (folder / "README.md").read_text(encoding="utf-8")
    assert ("maps_probability.png" in readme) == has_probabilities
    assert "What was found" not in readme
    assert pd.read_csv(folder / "findings.csv").empty


def test_missing_packages_are_named_before_any_run(tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules['rliable'] = None\n"
        "from benchmark.__main__ import main\n"
        f"sys.exit(main(['run', '{SMOKE.name}', '--report', '--results', {str(tmp_path)!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2
    assert "its report needs the package rliable, which is not installed; pip install 'prox" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "runs.db").exists()


def test_comparison_takes_the_default_condition_alone() -> None:
    readings = load_experiment("reproduce_smoke").readings
    with pytest.raises(InputError, match="a comparison takes the default condition alone"):
        load_report("comparison").check(SMOKE.model_copy(update={"readings": readings}))


def test_divergence_is_recorded_shown_and_not_tried_again(tmp_path: Path) -> None:
    path = tmp_path / "diverging.toml"
    changes = '"algorithms.dqn_linear.settings.learning_rate" = 1e38'
    path.write_text(f'extends = "{SMOKE.name}"\ndescription = ""\n[changes]\n{changes}\n')
    experiment = load_experiment(path)
    arms = {name: arm for name, arm in experiment.algorithms.items() if name in ("q_learning", "dqn_linear")}
    experiment = experiment.model_copy(update={"algorithms": arms, "protocol": None})
    runs = all_specifications(experiment)
    with Store(tmp_path / "runs.db") as store:
        assert run(runs, store, 2) == []
        statuses = store.statuses()
        assert {statuses[each.digest] for each in runs if each.arm == "dqn_linear"} == {"diverged"}
        assert {statuses[each.digest] for each in runs if each.arm == "q_learning"} == {"done"}
        assert pending(runs, store) == []
        data = load(experiment, store, None, False)
    summary = comparison.summary(data)
    nets = summary[summary["algorithm"] == "dqn_linear"]
    assert nets["diverged"].tolist() == [2, 2]
    assert summary["diverged"].sum() == 4
    assert nets["unbounded_score"].to_numpy() == pytest.approx(0, abs=1e-9)  # as the random policy
    scores = comparison.scores(data)
    has_diverged = scores["algorithm"].isin(["dqn_linear", "dqn_linear_sb3"])
    assert np.isfinite(scores["diverged_at"]).equals(has_diverged)
    maps = comparison.maps(data)
    assert maps.loc[maps["algorithm"] == "dqn_linear", "value"].isna().all()


# Tables, by hand


def test_threshold_by_hand() -> None:
    scores = np.array(
        [
            [0, 0.96, 0.2, 0.95, 1.0],  # reached at 100, stays from 300 on
            [0, 0, 0, 0, 0.95],  # at the end
            [0, 1, 1, 1, 0.9],  # reached, and lost
            [0, 0.9, 0.949, 0, -3],  # never
        ]
    )
    row = comparison.threshold(data_of(a={"S1": with_scores(scores)})).iloc[0]
    assert row["n"] == 4
    assert row["reached_share"] == 0.75
    assert row["stays_share"] == 0.5
    assert row["reached_step_median"] == (100 + 400) / 2
    assert np.isinf(row["stays_step_median"])
    always = comparison.threshold(data_of(a={"S1": with_scores(np.ones((3, 5)))})).iloc[0]
    assert always["stays_step_median"] == always["reached_step_median"] == 0


def test_disagreements_are_counted_per_1000_steps_since_the_last_evaluation() -> None:
    counts = np.array([[0, 10, 10, 40, 50], [0, 30, 30, 40, 50]])
    frame = comparison.curves(data_of(a={"S1": compared(n=2, disagreements=counts)}))
    assert np.isnan(frame["disagreements"][0])
    assert frame["disagreements"][1:].tolist() == [200, 0, 200, 100]


def test_region_by_hand() -> None:
    target = compared().in_target
    assert target.sum() == 16
    q = np.full((2, 120, 5), -1.0)
    q[0, np.flatnonzero(target)[:8], 4] = 0.5  # half of the region and nothing else
    q[1, np.flatnonzero(target), 4] = 0.5  # all of it, and 8 cells more
    q[1, np.flatnonzero(~target)[:8], 4] = 0.1
    row = comparison.region(data_of(a={"S1": compared(n=2, q=q)})).iloc[0]
    assert row["cells_marked"] == (8 + 24) / 2
    assert row["precision"] == (1 + 16 / 24) / 2
    assert row["n_marking"] == 2
    assert row["recall"] == (0.5 + 1) / 2
    assert row["overlap"] == pytest.approx((8 / 16 + 16 / 24) / 2)
    none = comparison.region(data_of(a={"S1": compared(n=2)})).iloc[0]
    assert np.isnan(none["precision"])
    assert none["overlap"] == 0


def test_stochastic_policies_value_ping_where_it_is_the_likeliest() -> None:
    stochastic = np.full((1, 5, 120, 5), 0.2)
    stochastic[0, -1, 7] = [0.1, 0.1, 0.1, 0.1, 0.6]
    stochastic[0, 0, 9] = [0.1, 0.1, 0.1, 0.1, 0.6]  # not at the end
    marked = compared(n=1, stochastic=stochastic, q=np.ones((1, 0, 5))).values_ping
    assert np.flatnonzero(marked[0]).tolist() == [7]


def random_data(n: int = 10) -> Data:
    rng = np.random.default_rng(0)
    return data_of(
        a={name: with_scores(rng.normal(0.5, 0.3, n), name) for name in ("S1", "S2", "S3")},
        b={name: with_scores(rng.normal(0.6, 0.3, 3 * n), name) for name in ("S1", "S2", "S3")},
    )


def final(data: Data, name: str, *, clipped: bool = True) -> list[NDArray[np.float64]]:
    """Returns a learner's final scores by scenario."""
    field = "clipped" if clipped else "score"
    learner = Learner(name, "index")
    return [data.results(learner, scenario, field)[:, -1] for scenario in data.learners[learner]]


def test_aggregates_by_a_second_method() -> None:
    data = random_data()
    frame = comparison.aggregate(data).set_index("algorithm")
    for name in ("a", "b"):
        clipped, unbounded = final(data, name), np.concatenate(final(data, name, clipped=False))
        row: Any = frame.loc[name]
        assert row["score"] == pytest.approx(np.mean([np.clip(each, 0, 1).mean() for each in clipped]))
        assert row["iqm"] == pytest.approx(stats.trim_mean(unbounded, 0.25))
        assert row["unbounded_score"] == pytest.approx(unbounded.mean())
        # Of numbers in [0, 1] the exact binomial interval is wider than the normal one.
        error = np.sqrt(np.mean([each.var() / len(each) for each in clipped]) / 3)
        assert (
            row["score_low"] < row["score"] - 1.96 * error < row["score"] + 1.96 * error < row["score_high"]
        )
    assert comparison.aggregate(data).equals(comparison.aggregate(data))


def test_a_failure_that_is_far_below_0_counts_as_any_other() -> None:
    near, far = (with_scores(np.array([1.0] * 29 + [low])) for low in (0.0, -40.0))
    frame = comparison.aggregate(data_of(a={"S1": near}, b={"S1": far})).set_index("algorithm")
    assert frame["score"]["a"] == frame["score"]["b"] == pytest.approx(29 / 30)
    assert frame["unbounded_score"]["b"] < -0.3


def test_contrasts_have_verdicts_by_the_protocol() -> None:
    """A learner that always succeeds, one that does half the time, and one that never does."""
    populations = {
        name: {"S1": compared("S1", n, success=np.tile(success[:, None], 5))}
        for name, n, success in (
            ("always", 40, np.ones(40)),
            ("half", 40, np.arange(40) % 2.0),
            ("never", 40, np.zeros(40)),
            ("few", 9, np.ones(9)),
        )
    }
    pairs = [("always", "half"), ("never", "half"), ("always", "few")]
    protocol = Protocol(
        reference=None,
        decisive=[],
        contrasts=[(Learner(x, "index"), Learner(y, "index")) for x, y in pairs],
        success_margin=0.1,
        score_margin=0.05,
        fewest_runs=10,
        is_declared=True,
    )
    data = replace(data_of(**populations), protocol=protocol)
    frame = comparison.contrasts(data)
    assert frame is not None
    assert frame["success_verdict"].tolist() == ["better", "worse", "no verdict"]
    assert frame["success_difference"].tolist() == [0.5, -0.5, 0.0]
    assert frame["n"].tolist() == [40, 40, 9]
    assert frame["score_verdict"].tolist()[:2] != ["better", "worse"]  # all scores are equal
    partial = comparison.contrasts(replace(data, missing="1 of 2 runs are missing"))
    assert partial is not None
    assert set(partial["success_verdict"]) == {"no verdict"}
    assert comparison.contrasts(data_of(**populations)) is None


def test_policy_that_counts_is_the_declared_one() -> None:
    """The stochastic policy succeeds three times in four, the greedy one never."""
    stochastic: dict[str, NDArray[np.float64]] = {}
    for prefix in ("stochastic_", "stochastic_every_cell_"):
        for field in ("grid_return", "steps", "wrong_pings"):
            stochastic[f"{prefix}{field}"] = np.zeros((4, 5))
        stochastic |= {f"{prefix}success": np.full((4, 5), 0.75), f"{prefix}zone_steps": np.zeros((4, 5, 4))}
    population = compared("S1", 4, **stochastic)
    data = data_of(a={"S1": population})
    by_policy = {policy: replace(data, policies={"a": policy}) for policy in ("greedy", "stochastic")}
    found = {policy: comparison.summary(each).iloc[0] for policy, each in by_policy.items()}
    assert (found["greedy"]["success"], found["stochastic"]["success"]) == (0.0, 0.75)
    assert {row["greedy_success"] for row in found.values()} == {0.0}
    assert comparison.curves(by_policy["stochastic"])["success"].tolist() == [0.75] * 5


def test_improvement_is_rliables() -> None:
    data = random_data()
    frame = comparison.improvement(data).set_index(["x", "y"])
    a, b = (np.column_stack(final(data, name)) for name in ("a", "b"))
    expected = metrics.probability_of_improvement(a, b)
    assert frame["probability"]["a, index", "b, index"] == pytest.approx(expected)
    assert frame["probability"]["b, index", "a, index"] == pytest.approx(1 - expected)
    assert frame["low"]["a, index", "b, index"] < expected < frame["high"]["a, index", "b, index"]
    ties = np.array([1.0, 1.0, 0.0])
    tied = data_of(a={"S1": with_scores(ties)}, b={"S1": with_scores(ties[:2])})
    expected = metrics.probability_of_improvement(ties[:, None], ties[:2, None])
    assert comparison.improvement(tied)["probability"][0] == pytest.approx(expected)


def checked_data() -> Data:
    """Returns a comparison of learners a and b, and of a check of a, with three scenarios."""
    data = random_data()
    check, learner = Learner("check", "index"), Learner("a", "index")
    fewer = random_data(5).learners[learner]
    return replace(data, learners={**data.learners, check: fewer}, checks={check: learner})


def test_a_check_is_compared_with_its_learner_alone() -> None:
    data = checked_data()
    frame = comparison.improvement(data).set_index(["x", "y"])["probability"]
    assert set(frame.index) == {
        *permutations(["a, index", "b, index"]),
        *permutations(["a, index", "check, index"]),
    }
    x, y = (np.column_stack(final(data, name)) for name in ("check", "a"))
    expected = metrics.probability_of_improvement(x, y)
    assert frame["check, index", "a, index"] == pytest.approx(expected)
    assert set(comparison.profile(data)["algorithm"]) == {"a", "b"}
    assert set(comparison.aggregate(data)["algorithm"]) == {"a", "b", "check"}


def test_checks_follow_what_they_check_and_take_no_colour(miniature: Path) -> None:
    names = ("q_learning", "dqn", "dqn_linear", "dqn_sb3", "dqn_linear_sb3")
    with Store(miniature / "runs.db", read_only=True) as store:
        data = load(with_arms(*names), store, None, False)
    assert [str(learner) for learner in data.learners] == [
        "q_learning, index", "dqn, one_hot", "dqn_sb3, one_hot", "dqn, coordinates", "dqn_linear, one_hot",
        "dqn_linear_sb3, one_hot",
    ]  # fmt: skip
    assert {str(check): str(learner) for check, learner in data.checks.items()} == {
        "dqn_sb3, one_hot": "dqn, one_hot",
        "dqn_linear_sb3, one_hot": "dqn_linear, one_hot",
    }
    context = data.context
    assert context.arms == ["q_learning", "dqn", "dqn_linear"]
    assert not [learner for panel in context.panels.values() for learner in panel if learner in data.checks]
    assert context.check_note == "hollow: checks, 2 runs, nets by Stable-Baselines3 itself"


def test_checks_are_drawn_hollow_below_and_beside_their_learners() -> None:
    data = checked_data()
    context = data.context
    assert context.check_note == "hollow: checks, 5 runs"
    dots = figures.aggregate(comparison.aggregate(data), context).axes[0]
    hollow = [line for line in dots.lines if line.get_markerfacecolor() == "white"]
    (filled,) = [line for line in dots.lines if line.get_markeredgecolor() == "white"][:1]
    (check,) = hollow
    assert (check.get_color(), check.get_marker()) == (filled.get_color(), filled.get_marker())
    assert -0.5 < filled.get_ydata()[0] < 0 < check.get_ydata()[0] < 0.5  # type: ignore[index, operator]
    assert [label.get_text() for label in dots.get_yticklabels()] == ["a, index", "b, index"]
    learning = figures.curves(comparison.curves(data), context, "step", "environment step").axes[0]
    (points,) = [line for line in learning.lines if line.get_markerfacecolor() == "white"]
    assert points.get_linestyle() == "None"
    assert 1 <= len(np.asarray(points.get_xdata())) < 5


def test_profile_is_the_share_of_runs_that_score_at_least() -> None:
    scores = np.array([0.0, 0.25, 0.5, 1.0])
    frame = comparison.profile(data_of(a={"S1": with_scores(scores)}, b={"S1": with_scores(scores)}))
    share = frame[frame["algorithm"] == "a"].set_index("score")["share"]
    assert share[0.0] == 1
    assert share[0.5] == 0.5  # at it, too
    assert share[0.98] == 0.25
    assert share[1.0] == 0.25  # rounding does not push an optimum below 1


def test_scores_that_differ_by_rounding_alone_are_ties() -> None:
    data = data_of(
        a={"S1": with_scores(np.array([1.0, 1.0]))}, b={"S1": with_scores(np.array([1 + 1e-13, 1 - 1e-13]))}
    )
    assert comparison.improvement(data)["probability"].tolist() == [0.5, 0.5]


# What is published


def test_published_comparison_is_of_the_declared_runs_and_its_tables_are_what_the_code_makes(
    tmp_path: Path,
) -> None:
    folder = ROOT / "results" / "compare_deep"
    full = load_experiment("compare_deep")
    manifest = json.loads((folder / "manifest.json").read_text())
    runs = all_specifications(full)
    assert manifest["runs"] == len(runs)
    assert manifest["digest"] == digest_of([each.digest for each in runs])
    tabular = {name: arm for name, arm in full.algorithms.items() if arm.algorithm == "q_learning"}
    tables = full.model_copy(update={"algorithms": tabular, "protocol": None})
    with Store(tmp_path / "runs.db") as store:
        assert run(all_specifications(tables), store, 2) == []
        made = comparison.scores(load(tables, store, None, False))
    write_csv(made, tmp_path / "scores.csv")
    published = pd.read_csv(folder / "scores.csv")
    published = published[published["algorithm"].isin(list(tabular))].reset_index(drop=True)
    again = pd.read_csv(tmp_path / "scores.csv")
    keys = ["scenario", "algorithm", "seed"]
    pd.testing.assert_frame_equal(
        published.sort_values(keys, ignore_index=True),
        again.sort_values(keys, ignore_index=True),
    )


def test_published_aggregates_follow_from_published_scores() -> None:
    folder = ROOT / "results" / "compare_deep"
    scores = pd.read_csv(folder / "scores.csv")
    aggregate: Any = pd.read_csv(folder / "aggregate.csv").set_index(["algorithm", "observation"])
    for learner, rows in scores.groupby(["algorithm", "observation"]):
        by_scenario: Any = rows.groupby("scenario")
        row: Any = aggregate.loc[learner]
        assert row["runs"] == len(rows)
        for name in ("success", "score", "every_cell_success", "every_cell_score", "unbounded_score"):
            assert row[name] == pytest.approx(by_scenario[name].mean().mean(), abs=1e-5), (learner, name)
        assert row["iqm"] == pytest.approx(stats.trim_mean(rows["unbounded_score"], 0.25), abs=1e-5)


def test_published_contrasts_follow_from_published_scores() -> None:
    folder = ROOT / "results" / "compare_deep"
    scores = pd.read_csv(folder / "scores.csv")
    scores["learner"] = scores["algorithm"] + ", " + scores["observation"]
    means: Any = (
        scores.groupby(["learner", "scenario"])[["success", "score"]].mean().groupby("learner").mean()
    )
    contrasts = pd.read_csv(folder / "contrasts.csv")
    declared = load_experiment("compare_deep").protocol
    assert declared is not None
    assert list(zip(contrasts["x"], contrasts["y"], strict=True)) == list(declared.contrasts)
    for row in contrasts.itertuples():
        for name in ("success", "score"):
            expected = means[name][row.x] - means[name][row.y]
            assert getattr(row, f"{name}_difference") == pytest.approx(expected, abs=1e-5)
