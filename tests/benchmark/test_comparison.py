"""Comparisons of made-up runs: verdicts, tables and texts by hand, and attempts to falsify them."""

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from rliable import metrics
from scipy import stats

from benchmark import comparison
from benchmark.comparison import Declared, verdict
from benchmark.experiment import load_experiment
from benchmark.experiments import compare_deep
from benchmark.statistics import Contrast, Means, contrast, holm
from benchmark.study import Data
from envs import InputError
from envs.inputs import parse

EXPERIMENT = """
description = "Made up."
scenarios = [{scenarios}]
horizon = 200
evaluation_every = 200
map_every = 200
settings = {{ budget = 400, time_limit = 200 }}
[report]
kind = "comparison"
{report}
"""
LEARNER = '[algorithms.{name}]\nalgorithm = "q_learning"\nobservations = ["index"]\nseeds = 2\n'
NET = """
[algorithms.net]
title = "searched DQN"
algorithm = "compiled_dqn"
observations = ["one_hot"]
seeds = 2
first_seed = 400
tuned_by = "tuning:room_dqn"
settings = { budget = 400, time_limit = 100 }
"""
RANDOM = 0.02  # success of the random policy
Runs = Sequence[float] | np.ndarray[Any, Any]


def share(p: float, n: int = 100) -> Runs:
    """Returns the success of n runs, of which a share succeeds."""
    return (np.arange(n) < round(p * n)).astype(float)


def made(
    folder: Path,
    learners: Mapping[str, Runs | Sequence[Runs]],
    report: str = "",
    scores: Mapping[str, Runs] | None = None,
    extra: str = "",
) -> Data:
    """Returns a comparison of runs by learner, the same in S1 to S3, or by scenario.

    Learners are tables on cells but `net`. Runs begin at 0, and score as they succeed.
    """
    names = {name: f"{name}, {'one_hot' if name == 'net' else 'index'}" for name in learners}
    n_scenarios = max(len(runs) if np.ndim(runs[0]) else 1 for runs in learners.values())
    scenarios = ["S1", "S2", "S3"][:n_scenarios]
    tables = "".join(NET if name == "net" else LEARNER.format(name=name) for name in learners)
    listed = ", ".join(f'"{name}"' for name in scenarios)
    text = EXPERIMENT.format(scenarios=listed, report=report) + extra + tables
    (folder / "made.toml").write_text(text, encoding="utf-8")
    experiment = load_experiment(folder / "made.toml")
    runs, curves = [], []
    for name, own in learners.items():
        for i, scenario in enumerate(scenarios):
            success = np.asarray(own[i] if np.ndim(own[0]) else own, dtype=float)
            score = success if scores is None else np.asarray(scores[name], dtype=float)
            keys: dict[str, Any] = {
                "scenario": scenario,
                "learner": names[name],
                "seed": range(len(success)),
            }
            final: dict[str, Any] = {"success": success, "score": score, "unbounded_score": score}
            others = ("steps", "wrong_pings", "uncomfortable_steps", "greedy_success", "updates")
            final |= dict.fromkeys((*others, "parameters", "peak_memory_mb"), 1.0)
            final |= {"policy": "greedy", "budget": 400, "random_success": RANDOM}
            final |= {"diverged_at": np.inf}
            final |= {"cpu_time_s": len(name), "training_wrong_pings": range(len(success))}
            runs.append(pd.DataFrame(keys | final))
            for step in (0, 400):
                values = {"step": step, "success": success * (step > 0), "score": score}
                curves.append(pd.DataFrame(keys | values))
    declared = parse(Declared, experiment.declared.report or {}, "made.toml")
    comparison.check(experiment, declared)
    runs_table, curves_table = (pd.concat(each, ignore_index=True) for each in (runs, curves))
    return Data(experiment, declared, runs_table, curves_table)


def pair(x: str = "x, index", y: str = "y, index") -> str:
    """Returns the declaration of a contrast."""
    return f'contrasts = [["{x}", "{y}"]]\n'


def contrasts(data: Data) -> pd.DataFrame:
    """Computes the table of contrasts; texts read it as it is in a file, without empty columns."""
    table = comparison.contrasts(data)
    assert table is not None
    empty = [name for name in table if (table[name] == "").all()]
    data.tables["contrasts"] = table.drop(columns=empty)
    return table


def only(data: Data) -> dict[str, Any]:
    """Returns the only contrast."""
    (row,) = contrasts(data).to_dict("records")
    return {str(key): value for key, value in row.items()}


def at(table: Any, *key: object) -> Any:
    """Returns the row with a key."""
    return table.loc[key]


# Verdicts


def decide(difference: float, different: float, equivalent: float, **row: float) -> str:
    """Returns the verdict on a difference with p-values, with a margin of 0.1."""
    test = Contrast(difference, 0, 0, 0, 0, different, equivalent)
    return verdict(test, 0.1, {"n": 10, "learned_x": True, "learned_y": True} | row)


NOT_X, NOT_Y = {"learned_x": False}, {"learned_y": False}


@pytest.mark.parametrize(
    ("found", "row", "expected"),
    [
        ((0.3, 0.01, 1), {}, "better"),
        ((-0.3, 0.05, 1), {}, "worse"),
        ((0.3, 0.06, 1), {}, "undecided"),
        ((0.3, 0.01, 1), {"n": 9}, "no verdict"),
        ((0.1, 0.01, 1), {}, "better"),
        ((0.0999, 0.01, 1), {}, "slightly better"),
        ((-0.06, 0.01, 1), {}, "slightly worse"),
        ((0.01, 1, 0.05), {}, "within margin"),
        ((-0.05, 4e-5, 0.01), {}, "within margin, but worse"),
        # Who has not learned is not better, neither slightly nor within the margin.
        ((0.3, 0.01, 1), NOT_X | NOT_Y, comparison.NEITHER),
        ((0.01, 1, 0.01), NOT_X | NOT_Y, comparison.NEITHER),
        ((0.3, 0.5, 1), NOT_X | NOT_Y, "undecided"),
        ((0.3, 0.01, 1), NOT_X, comparison.UNEARNED),
        ((0.05, 0.01, 1), NOT_X, comparison.UNEARNED),
        ((0.05, 0.01, 0.01), NOT_X, "within margin"),
        ((0.3, 0.01, 1), NOT_Y, "better"),
        ((-0.3, 0.01, 1), NOT_X, "worse"),
        ((-0.3, 0.01, 1), NOT_Y, comparison.UNEARNED),
    ],
)
def test_verdicts_follow_the_declared_rule(
    found: tuple[float, float, float], row: dict[str, float], expected: str
) -> None:
    assert decide(*found, **row) == expected


def test_a_learner_that_never_trained_wins_nothing_by_score(tmp_path: Path) -> None:
    """It gives up at once, which scores more than y, which fails at a cost."""
    scores = {"x": np.full(100, 0.43), "y": np.full(100, 0.1)}
    row = only(made(tmp_path, {"x": share(0), "y": share(0)}, pair(), scores))
    assert row["score_p_different"] < 0.001
    assert (row["success_verdict"], row["score_verdict"]) == (comparison.NEITHER,) * 2
    row = only(made(tmp_path, {"x": share(0), "y": share(0.5)}, pair(), scores))
    assert (row["success_verdict"], row["score_verdict"]) == ("worse", comparison.UNEARNED)


def test_a_learner_that_is_good_untrained_wins_nothing(tmp_path: Path) -> None:
    """One succeeds before training as often as after, the other only after."""
    data = made(tmp_path, {"x": share(0.9), "y": share(0.5)}, pair())
    is_x = data.curves["learner"] == "x, index"
    data.curves.loc[is_x, "success"] = 0.9 - 0.099 * (data.curves["step"] == 0)
    row = only(data)
    assert (row["p_random_x"] < 1e-9, row["learned_x"], row["learned_y"]) == (True, False, True)
    assert row["success_verdict"] == comparison.UNEARNED
    data.curves.loc[is_x & (data.curves["step"] == 0), "success"] = 0.8  # lower by the margin
    assert only(data)["success_verdict"] == "better"
    report = "margins.success = 0.2\n" + pair()  # larger than what was learned
    row = only(made(tmp_path, {"x": share(0.15), "y": share(0)}, report))
    assert (row["learned_x"], row["success_verdict"]) == (True, "slightly better")


def test_runs_that_diverged_are_counted_in_the_sentence(tmp_path: Path) -> None:
    data = made(tmp_path, {"x": share(0.1), "y": share(0.5)}, pair())
    data.runs.loc[(data.runs["learner"] == "x, index") & (data.runs["seed"] < 3), "diverged_at"] = (
        200
    )
    contrasts(data)
    sentence = "x against y: *worse* (0.1 against 0.5; diverged runs 3 against 0)"
    assert sentence in comparison.headline(data)


def test_the_random_policy_is_beaten_by_an_exact_binomial_test(tmp_path: Path) -> None:
    row = only(made(tmp_path, {"x": share(0.4, 20), "y": share(0.05, 20)}, pair()))
    for side, count in (("x", 8), ("y", 1)):
        expected = stats.binomtest(count, 20, RANDOM, alternative="greater").pvalue
        assert row[f"p_random_{side}"] == pytest.approx(min(expected, 1.0), rel=1e-6)


@pytest.mark.parametrize(
    ("x", "y", "expected", "apart"),
    [
        ((1.0, 0.85, 0.85), (0.7, 1.0, 1.0), "mixed", "S1, S2, S3"),  # the same on average
        ((1.0, 1.0, 0.85), (0.2, 0.2, 0.9), "better", "S3"),
        ((1.0, 1.0, 0.95), (1.0, 1.0, 1.0), "within margin", "S3"),
        ((1.0, 1.0, 0.75), (1.0, 1.0, 1.0), "slightly worse", ""),
    ],
)
def test_exchanging_x_and_y_only_exchanges_better_and_worse(
    tmp_path: Path, x: Sequence[float], y: Sequence[float], expected: str, apart: str
) -> None:
    learners = {"x": [*map(share, x)], "y": [*map(share, y)]}
    one = only(made(tmp_path, learners, pair()))
    other = only(made(tmp_path, learners, pair("y, index", "x, index")))
    assert (one["success_verdict"], one["success_except"]) == (expected, apart)
    swapped = {"better": "worse", "slightly worse": "slightly better"}
    assert other["success_verdict"] == swapped.get(expected, expected)
    assert other["success_except"] == apart
    for key, opposite in (("", ""), ("_low", "_high"), ("_low_90", "_high_90")):
        difference = other[f"success_difference{opposite}"]
        assert one[f"success_difference{key}"] == pytest.approx(-difference)


def test_p_values_of_all_contrasts_are_adjusted_together(tmp_path: Path) -> None:
    learners = {"x": share(1, 20), "z": share(0.25, 20), "y": share(1, 20)}
    report = 'contrasts = [["x, index", "y, index"], ["z, index", "y, index"]]'
    table = contrasts(made(tmp_path, learners, report))
    assert [*table["success_verdict"]] == ["undecided", "worse"]
    raw = [contrast(Means([p], [20]), Means([1.0], [20]), 0.1) for p in (1.0, 0.25)]
    for key in ("p_different", "p_equivalent"):
        expected = holm([getattr(test, key) for test in raw])
        assert [*table[f"success_{key}"]] == pytest.approx(expected)


# Other tables


def test_summary_and_aggregate_by_hand(tmp_path: Path) -> None:
    data = made(tmp_path, {"x": [share(0.5, 4), share(1, 4)], "y": share(1, 4)})
    table = comparison.summary(data).set_index(["learner", "scenario"])
    row = at(table, "x, index", "S1")
    ends = stats.binomtest(2, 4).proportion_ci(method="exact")
    assert [*row[["success", "success_low", "success_high"]]] == pytest.approx([0.5, *ends])
    # Wrong PINGs are 0, 1, 2, 3 in 400 steps: 3.75 per 1,000; t with 3 degrees of freedom is 3.182.
    reach = 3.182 * np.sqrt(5 / 3) / 2 * 2.5
    rate = [*row[["training_wrong_pings", "training_wrong_pings_high"]]]
    assert rate == pytest.approx([3.75, 3.75 + reach], abs=1e-3)
    assert row["training_wrong_pings_low"] == 0
    means = comparison.aggregate(data)
    assert [*means["learner"]] == ["y, index", "x, index"]
    assert [*means["success"]] == [1, 0.75]
    assert [*means["runs"]] == [8, 8]


def test_curves_and_cost_by_hand(tmp_path: Path) -> None:
    data = made(tmp_path, {"slow": share(0.75, 8), "y": share(1, 8)})
    table = comparison.progress(data).set_index(["learner", "step"])
    assert [*at(table, "slow, index")["success"]] == [0, 0.75]
    ends = stats.binomtest(6, 8).proportion_ci(method="exact")
    assert [*at(table, "slow, index", 400)[["success_low", "success_high"]]] == pytest.approx(
        [*ends]
    )
    assert [*comparison.cost(data)["learner"]] == ["y, index", "slow, index"]


def test_usual_measures_are_rliables_and_the_same_every_time(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    drawn = {name: [rng.random(12) for _ in range(2)] for name in ("x", "y")}
    data = made(tmp_path, drawn, pair())
    table = comparison.rliable(data)
    state = str(np.random.get_state())  # noqa: NPY002
    pd.testing.assert_frame_equal(table, comparison.rliable(data))
    assert state == str(np.random.get_state())  # noqa: NPY002
    rows = table.set_index(["endpoint", "learner"])
    x, y = (np.array(drawn[name]).T for name in ("x", "y"))
    row = at(rows, "success", "x, index")
    for name in comparison.AGGREGATES:
        expected = getattr(metrics, f"aggregate_{name}")(x)
        assert row[name] == pytest.approx(expected)
        assert row[f"{name}_low"] < expected < row[f"{name}_high"]
    expected = pytest.approx(metrics.probability_of_improvement(x, y))
    assert only(data)["success_p_improvement"] == expected


# Texts and figures


def test_a_sentence_names_learners_margin_and_what_else_differs(tmp_path: Path) -> None:
    """A searched net with another time limit against a table as declared."""
    report = pair("net, one_hot", "y, index") + "margins.success = 0.2\n"
    data = made(tmp_path, {"net": share(0.9), "y": share(0.5)}, report)
    contrasts(data)
    first, sentence = comparison.headline(data).split("\n\n")
    first = " ".join(first.split())
    assert "After 400 steps" in first
    assert "margin is 0.2, the level 5 %" in first
    assert "100 runs" in first
    what = "settings searched (tuning) against declared; time limit 100 against 200"
    assert sentence.startswith("- searched DQN on one-hot cells against y: *better*")
    assert sentence.endswith(f"(0.9 against 0.5; {what})")


def test_a_measurable_difference_within_the_margin_is_not_called_equivalent(tmp_path: Path) -> None:
    data = made(tmp_path, {"x": share(0.97, 4000), "y": share(1, 4000)}, pair())
    assert only(data)["success_p_different"] < 4e-5
    text = comparison.headline(data)
    assert "x against y: *within margin, but worse* (0.97 against 1)" in text
    assert "equivalent" not in text + comparison.reading(data)


def test_both_of_two_contradicting_verdicts_name_their_learners(tmp_path: Path) -> None:
    report = 'contrasts = [["x, index", "y, index"], ["z, index", "y, index"]]'
    data = made(tmp_path, {"x": share(0.9), "y": share(0.5), "z": share(0.1)}, report)
    contrasts(data)
    text = comparison.headline(data)
    assert "*better* (1), *worse* (1)" in text
    assert "- x against y: *better* (0.9 against 0.5)" in text
    assert "- z against y: *worse* (0.1 against 0.5)" in text


def test_many_undecided_contrasts_are_counted(tmp_path: Path) -> None:
    names = "abcdef"
    pairs = ", ".join(f'["{name}, index", "y, index"]' for name in names)
    learners = {name: share(0.5) for name in (*names, "y")}
    data = made(tmp_path, learners, f"contrasts = [{pairs}]")
    contrasts(data)
    assert "- *undecided*: 6 contrasts, see contrasts.csv" in comparison.headline(data)


def test_without_contrasts_there_is_no_verdict(tmp_path: Path) -> None:
    data = made(tmp_path, {"x": share(1), "y": share(0)})
    assert comparison.contrasts(data) is None
    assert "no verdicts" in comparison.headline(data)
    assert comparison.draw_contrasts(data) is None


def test_reading_has_the_numbers_of_the_declaration(tmp_path: Path) -> None:
    data = made(tmp_path, {"x": share(1), "y": share(0)}, "margins = { success = 0.15 }\n")
    text = " ".join(comparison.reading(data).split())
    assert "0.15 of success and 0.08 of the score" in text


def test_figures_show_what_tables_have(tmp_path: Path) -> None:
    report = 'contrasts = [["x, index", "y, index"], ["y, index", "x, index"]]'
    data = made(tmp_path, {"x": share(0.75, 12), "y": share(0.25, 12), "z": share(1, 12)}, report)
    for name, function in comparison.TABLES.items():
        table = function(data)
        assert table is not None
        data.tables[name] = table
    figures: dict[str, Any] = {name: draw(data) for name, draw in comparison.FIGURES.items()}
    (axis,) = figures["contrasts"].axes
    names = [label.get_text() for label in axis.get_yticklabels()]
    assert names == ["against y", "x", "against x", "y"]
    shown = data.tables["contrasts"]
    assert [text.get_text() for text in axis.texts] == [*shown["success_verdict"]]
    points = [line for line in axis.lines if line.get_marker() not in ("", "None", None)]
    differences = [float(point.get_xdata()[0]) for point in points]
    assert differences == [*shown["success_difference"]]
    (panel,) = figures["curves"].axes
    ends = {line.get_ydata()[-1] for line in panel.lines if len(line.get_xdata()) == 2}
    assert {0.75, 0.25} <= ends  # z is not compared
    assert 1.0 not in ends


# What experiments declare


@pytest.mark.parametrize(
    ("report", "message"),
    [
        (pair("x, index", "w, index"), "report.contrasts: unknown learner w, index"),
        (pair("x, index", "x, index"), "x, index is named twice"),
        ("margins = { success = 0.3 }", "0.2"),
        ('curves = ["y"]', "report.curves"),
    ],
)
def test_what_cannot_be_compared_is_refused(tmp_path: Path, report: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        made(tmp_path, {"x": share(1, 4), "y": share(1, 4)}, report)
    assert message in str(error.value)


def test_different_budgets_are_refused(tmp_path: Path) -> None:
    longer = LEARNER.format(name="z") + "settings = { budget = 800 }\n"
    learners = {"x": share(1, 4), "y": share(1, 4)}
    with pytest.raises(InputError, match=r"settings\.budget: accepted in a comparison"):
        made(tmp_path, learners, extra=longer)


# Findings


def test_a_finding_asserts_what_it_says() -> None:
    nets, tables = [*compare_deep.NETS], [*compare_deep.TABLES]
    pairs = [*product(nets, tables), *zip(nets[2:], nets[:2], strict=True)]
    others = [compare_deep.SMALL, *compare_deep.DEFAULTS, "dqn, coordinates", "ppo, coordinates"]
    learners = [*nets, *tables, *others]
    sizes = dict(zip(learners, [50, 50] + [100] * 6 + [10, 10, 100, 100], strict=True))
    rows = [
        {"learner": learner, "scenario": scenario, "n": sizes[learner], "budget": 10_000}
        | {"success": 1 if learner in others else 0.6 if learner in nets else at_tables}
        for learner in learners
        for scenario, at_tables in (("S1", 0.7), ("S2", 0.5), ("S3", 0.7))
    ]
    contrasts = pd.DataFrame(pairs, columns=["x", "y"]).assign(
        success_margin=0.1,
        success_verdict=["better", "mixed", "undecided"] * 4 + ["within margin"] * 2,
        score_verdict="undecided",
    )
    aggregate = pd.DataFrame({"learner": learners, "success": np.arange(12) / 10, "score": 0.5})
    found = {"summary": pd.DataFrame(rows), "contrasts": contrasts, "aggregate": aggregate}
    text = compare_deep.finding(found)
    assert "| compiled PPO, 0.30 | better | mixed | undecided |" in text
    assert "DQN has 0.20 against 0.00\n(*within margin*)" in text
    contrasts.loc[2, "success_verdict"] = "slightly better"
    with pytest.raises(AssertionError, match="no net is better than tile coding"):
        compare_deep.finding(found)
