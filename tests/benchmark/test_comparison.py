"""Comparisons of made-up runs: verdicts, tables and texts by hand, and attempts to falsify them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from rliable import metrics
from scipy import stats

from benchmark import comparison
from benchmark.comparison import Declared, verdict
from benchmark.statistics import Contrast, Means, contrast, holm
from benchmark.study import Data
from envs import InputError
from envs.inputs import parse
from tests.benchmark.populations import with_tables
from tests.support import made as experiment_of
from tests.support import small_experiment, variant

NET = variant(
    "compiled_dqn",
    "one_hot",
    title="searched DQN",
    first_seed=400,
    tuned_by="tuning:room_dqn",
    settings={"budget": 400, "time_limit": 100},
)
LEARNERS: dict[str, object] = {"net": NET, "longer": variant(settings={"budget": 800})}
RANDOM = 0.02  # success of the random policy
XY, ZY = ["x, index", "y, index"], ["z, index", "y, index"]
Runs = Sequence[float] | np.ndarray[Any, Any]


def share(p: float, n: int = 100) -> Runs:
    """Returns the success of n runs, of which a share succeeds."""
    return (np.arange(n) < round(p * n)).astype(float)


def made(
    folder: Path,
    learners: Mapping[str, Runs | Sequence[Runs]],
    contrasts: Sequence[Sequence[str]] = (),
    scores: Mapping[str, Runs] | None = None,
    **report: object,
) -> Data:
    """Returns a comparison of runs by learner, the same in S1 to S3, or by scenario.

    Learners are tables on cells but those of `LEARNERS`. Runs begin at 0, and score as they
    succeed.
    """
    of_learners = {name: np.atleast_2d(np.array(runs)) for name, runs in learners.items()}
    scenarios = ["S1", "S2", "S3"][: max(map(len, of_learners.values()))]
    text = small_experiment(
        scenarios=scenarios,
        horizon=200,
        report={"kind": "comparison", "contrasts": contrasts, **report},
        settings={"budget": 400, "time_limit": 200},
        algorithms={name: LEARNERS.get(name, variant()) for name in learners},
    )
    experiment = experiment_of(folder / "made.toml", text)
    runs, curves = [], []
    for each in experiment.populations:
        name, success = each.learner.variant, of_learners[each.learner.variant]
        success = success[scenarios.index(each.scenario.name) % len(success)]
        score = success if scores is None else scores[name]
        keys = {**each.keys, "seed": range(len(success))}
        final: dict[str, Any] = {"success": success, "score": score, "unbounded_score": score}
        others = ("steps", "wrong_pings", "uncomfortable_steps", "greedy_success", "updates")
        final |= dict.fromkeys((*others, "parameters", "peak_memory_mb"), 1.0)
        final |= {"policy": "greedy", "budget": 400, "random_success": RANDOM}
        final |= {"diverged_at": np.inf, "cpu_time_s": len(name)}
        runs.append(pd.DataFrame(keys | final | {"training_wrong_pings": range(len(success))}))
        for step in (0, 400):
            values = {"step": step, "success": success * (step > 0), "score": score}
            curves.append(pd.DataFrame(keys | values))
    declared = parse(Declared, experiment.declared.report or {}, "made.toml")
    comparison.check(experiment, declared)
    runs_table, curves_table = (pd.concat(each, ignore_index=True) for each in (runs, curves))
    return Data(experiment, declared, runs_table, curves_table)


def contrasts(data: Data) -> pd.DataFrame:
    """Computes the table of contrasts."""
    return with_tables(data, {"contrasts": comparison.contrasts}).tables["contrasts"]


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
    row = only(made(tmp_path, {"x": share(0), "y": share(0.5)}, [XY], scores))
    assert row["score_p_different"] < 0.001
    assert (row["success_verdict"], row["score_verdict"]) == ("worse", comparison.UNEARNED)


def test_a_learner_that_is_good_untrained_wins_nothing(tmp_path: Path) -> None:
    """One succeeds before training as often as after, the other only after."""
    data = made(tmp_path, {"x": share(0.9), "y": share(0.5)}, [XY])
    is_x = data.curves["learner"] == "x, index"
    data.curves.loc[is_x, "success"] = 0.9 - 0.099 * (data.curves["step"] == 0)
    row = only(data)
    assert (row["p_random_x"] < 1e-9, row["learned_x"], row["learned_y"]) == (True, False, True)
    assert row["success_verdict"] == comparison.UNEARNED
    data.curves.loc[is_x & (data.curves["step"] == 0), "success"] = 0.8  # lower by the margin
    assert only(data)["success_verdict"] == "better"
    learners, margins = {"x": share(0.15), "y": share(0)}, {"success": 0.2}  # more than learned
    row = only(made(tmp_path, learners, [XY], margins=margins))
    assert (row["learned_x"], row["success_verdict"]) == (True, "slightly better")


@pytest.mark.parametrize(
    ("x", "y", "expected", "apart"),
    [
        ((1.0, 0.85, 0.85), (0.7, 1.0, 1.0), "mixed", "S1, S2, S3"),  # the same on average
        ((1.0, 1.0, 0.85), (0.2, 0.2, 0.9), "better", "S3"),  # it may be worse there
        ((1.0, 1.0, 0.95), (1.0, 1.0, 1.0), "within margin", "S3"),
        ((1.0, 1.0, 0.75), (1.0, 1.0, 1.0), "slightly worse", ""),
        ((0.1, 1.0, 1.0), (0.0, 1.0, 1.0), "mixed", "S1"),  # as large as the margin
        ((1.0, 1.0, 0.7), (0.2, 0.2, 0.9), "mixed", "S3"),
        ((1.0, 1.0, 1.0), (0.2, 0.2, 0.9), "better", ""),
    ],
)
def test_exchanging_x_and_y_only_exchanges_better_and_worse(
    tmp_path: Path, x: Sequence[float], y: Sequence[float], expected: str, apart: str
) -> None:
    learners = {"x": [*map(share, x)], "y": [*map(share, y)]}
    one = only(made(tmp_path, learners, [XY]))
    other = only(made(tmp_path, learners, [XY[::-1]]))
    assert (one["success_verdict"], one["success_except"]) == (expected, apart)
    swapped = {"better": "worse", "slightly worse": "slightly better"}
    assert other["success_verdict"] == swapped.get(expected, expected)
    assert other["success_except"] == apart
    for key, opposite in (("", ""), ("_low", "_high"), ("_low_90", "_high_90")):
        difference = other[f"success_difference{opposite}"]
        assert one[f"success_difference{key}"] == pytest.approx(-difference)


def test_p_values_of_all_contrasts_are_adjusted_together(tmp_path: Path) -> None:
    learners = {"x": share(1, 20), "z": share(0.25, 20), "y": share(1, 20)}
    table = contrasts(made(tmp_path, learners, [XY, ZY]))
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
    assert [*comparison.cost(data)["learner"]] == ["y, index", "slow, index"]


def test_usual_measures_are_rliables_and_the_same_every_time(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    drawn = {name: [rng.random(12) for _ in range(2)] for name in ("x", "y")}
    data = made(tmp_path, drawn, [XY])
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
    learners, margins = {"net": share(0.9), "y": share(0.5)}, {"success": 0.2}
    data = made(tmp_path, learners, [["net, one_hot", "y, index"]], margins=margins)
    contrasts(data)
    first, sentence = comparison.headline(data).split("\n\n")
    first = " ".join(first.split())
    assert "After 400 steps" in first
    assert "margin is 0.2, the level 5 %" in first
    assert "100 runs" in first
    what = "settings searched (tuning) against declared; time limit 100 against 200"
    assert sentence.startswith("- searched DQN on one-hot cells against y: *better*")
    assert sentence.endswith(f"(0.9 against 0.5; {what})")


def test_decided_contrasts_are_named_and_many_others_counted(tmp_path: Path) -> None:
    """Even if they contradict each other; runs that diverged are counted, too."""
    learners = {"x": share(0.9), "z": share(0.1)} | dict.fromkeys("abcdef", share(0.5))
    pairs = [(f"{name}, index", "y, index") for name in learners]
    data = made(tmp_path, learners | {"y": share(0.5)}, pairs)
    is_z = data.runs["learner"] == "z, index"
    data.runs.loc[is_z & (data.runs["seed"] < 3), "diverged_at"] = 200
    contrasts(data)
    text = comparison.headline(data)
    assert "*better* (1), *worse* (1)" in text
    assert "- x against y: *better* (0.9 against 0.5)" in text
    assert "- z against y: *worse* (0.1 against 0.5; diverged runs 3 against 0)" in text
    assert "- *undecided*: 6 contrasts, see contrasts.csv" in text


def test_without_contrasts_there_is_no_verdict(tmp_path: Path) -> None:
    data = made(tmp_path, {"x": share(1), "y": share(0)})
    assert comparison.contrasts(data) is None
    assert "no verdicts" in comparison.headline(data)
    assert comparison.draw_contrasts(data) is None


def test_figures_show_what_tables_have(tmp_path: Path) -> None:
    learners = {"x": share(0.75, 12), "y": share(0.25, 12), "z": share(1, 12)}
    data = with_tables(made(tmp_path, learners, [XY, XY[::-1]]), comparison.TABLES)
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
        ({"contrasts": [["x, index", "w, index"]]}, "report.contrasts: unknown learner w, index"),
        ({"contrasts": [["x, index", "x, index"]]}, "x, index is named twice"),
        ({"margins": {"success": 0.3}}, "0.2"),
        ({"curves": ["y"]}, "report.curves"),
    ],
)
def test_what_cannot_be_compared_is_refused(tmp_path: Path, report: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        made(tmp_path, {"x": share(1, 4), "y": share(1, 4)}, **report)


def test_different_budgets_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"settings\.budget: accepted in a comparison"):
        made(tmp_path, {"x": share(1, 4), "longer": share(1, 4)})
