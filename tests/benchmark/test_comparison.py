"""The comparison: grids, tables and findings by themselves, and all of it in miniature."""

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
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
from benchmark.execution.driver import pending, run
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
from envs.inputs import override, parse, read_toml

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


def cell(
    name: str, observation: str, seeds: list[int], experiment: Experiment = SMOKE
) -> list[RunSpecification]:
    return specifications(experiment, "default", "S1", name, observation, seeds)


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


def test_missing_package_of_the_report_is_told(results: Path) -> None:
    code = (
        "import sys; sys.modules['rliable'] = None\n"
        "from benchmark.__main__ import main\n"
        f"sys.exit(main(['report', '{SMOKE.name}', '--results', {str(results)!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2
    assert "its report needs the package rliable, which is not installed; make compare-deep" in done.stderr
    assert done.stderr.count("\n") == 1


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


def test_stochastic_policies_value_ping_where_it_is_the_likeliest() -> None:
    stochastic = np.full((1, 5, 120, 5), 0.2)
    stochastic[0, -1, 7] = [0.1, 0.1, 0.1, 0.1, 0.6]
    stochastic[0, 0, 9] = [0.1, 0.1, 0.1, 0.1, 0.6]  # not at the end
    marked = population(n=1, stochastic=stochastic, q=np.ones((1, 0, 5))).values_ping
    assert np.flatnonzero(marked[0]).tolist() == [7]


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
