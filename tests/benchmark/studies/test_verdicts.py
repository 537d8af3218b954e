"""What a comparison concludes: contrasts by hand, and by simulation of how rare wrong ones are."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from benchmark.studies.comparison.contrasts import Means, contrast, holm, verdict
from tests.benchmark.studies.made import Made, compared, random_success

RANDOM = random_success("S1")


def test_holm_by_hand() -> None:
    """Sorted, p-values are multiplied by 4, 3, 2, 1, never fall, and never exceed 1."""
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert (holm([0.5, 0.9]), holm([0.04]), holm([])) == ([1.0, 1.0], [0.04], [])


shares = st.tuples(*[st.integers(0, 20).map(lambda count: count / 20)] * 2)


@settings(max_examples=30)
@given(shares, shares, st.sampled_from([5, 20, 200]))
def test_tests_and_intervals_never_contradict_each_other(
    x: Sequence[float], y: Sequence[float], n: int
) -> None:
    found = contrast(Means(x, [n, n]), Means(y, [n, n]), 0.1)
    low, high, low_90, high_90 = found[1:5]
    assert (found.p_different < 0.05 - 1e-6) <= (low > 0 or high < 0)
    assert (found.p_different > 0.05 + 1e-6) <= (low <= 0 <= high)
    assert (found.p_equivalent < 0.05 - 1e-6) <= (low_90 > -0.1 and high_90 < 0.1)
    assert (found.p_equivalent > 0.05 + 1e-6) <= (low_90 <= -0.1 or high_90 >= 0.1)


@pytest.mark.parametrize("n", [10, 100])
def test_wrong_verdicts_are_rare(n: int) -> None:
    """Four contrasts without a difference, and four with one as large as the margin, many times over."""
    rng = np.random.default_rng(n)
    truth = np.array([0.95, 0.5])

    def verdicts(shift: float) -> set[str]:
        drawn = [[rng.binomial(n, p) / n for p in (truth, truth - shift)] for _ in range(4)]
        found = [contrast(Means([*x], [n, n]), Means([*y], [n, n]), 0.1) for x, y in drawn]
        adjusted = (holm([one.p_different for one in found]), holm([one.p_equivalent for one in found]))
        return {verdict(one.difference, p, q) for one, p, q in zip(found, *adjusted, strict=True)}

    wrongly_different = sum(bool(verdicts(0.0) & {"better", "worse"}) for _ in range(40))
    wrongly_equivalent = sum("equivalent" in verdicts(0.1) for _ in range(40))
    # With a probability of 5 % each, more than 6 of 40 would come up one time in 300.
    assert wrongly_different <= 6
    assert wrongly_equivalent <= 6


def test_a_net_at_the_random_policy_has_not_learned_though_it_is_better_than_a_greedy_table_at_0() -> None:
    """As PPO with a learning rate of 1e-12 in TurningHidden: better than the table, and never trained."""
    random = random_success("TurningHidden")
    assert 0.05 < random < 0.5
    net = Made("deep", random, 100, policy="stochastic", every_run=True)
    learners = {"table": Made("tabular", 0.0), "net": net}
    (row,) = compared(learners, baseline=["table"], scenarios=["TurningHidden"]).contrasts
    assert row["success_verdict"] == "neither learned"


def test_the_random_policy_is_beaten_by_an_exact_binomial_test() -> None:
    learners = {"x": Made("deep", 0.4, 20), "y": Made("tabular", 0.05, 20)}
    (row,) = compared(learners, [("x", "y")], scenarios=["S1"]).contrasts
    for side, count in (("x", 8), ("y", 1)):
        expected = stats.binomtest(count, 20, RANDOM, alternative="greater").pvalue
        assert row[f"p_random_{side}"] == pytest.approx(min(expected, 1.0), rel=1e-6)


# Scenarios


@pytest.mark.parametrize(
    ("x", "y", "verdict", "apart"),
    [
        ((1.0, 0.85, 0.85), (0.7, 1.0, 1.0), "mixed", "S1, S2, S3"),  # the same on average
        ((0.1, 1.0, 1.0), (0.0, 1.0, 1.0), "mixed", "S1"),  # as large as the margin
        ((1.0, 1.0, 0.7), (0.2, 0.2, 0.9), "mixed", "S3"),  # better on average, and worse in one by 0.2
        ((1.0, 1.0, 0.85), (0.2, 0.2, 0.9), "better", "S3"),  # in S3 it may be worse by more than 0.1
        ((1.0, 1.0, 1.0), (0.2, 0.2, 0.9), "better", ""),
        ((1.0, 1.0, 0.95), (1.0, 1.0, 1.0), "equivalent", "S3"),
    ],
)
def test_scenarios_that_stand_apart_are_named_and_exchanging_x_and_y_only_exchanges_better_and_worse(
    x: Sequence[float], y: Sequence[float], verdict: str, apart: str
) -> None:
    made = {"x": Made("deep", x), "y": Made("tabular", y)}
    (one,), (other,) = (compared(made, [pair]).contrasts for pair in (("x", "y"), ("y", "x")))
    assert (one["success_verdict"], one["success_except"]) == (verdict, apart)
    assert other["success_verdict"] == {"better": "worse"}.get(verdict, verdict)
    assert other["success_except"] == apart
    for key, opposite in (("", ""), ("_low", "_high"), ("_low_90", "_high_90")):
        value = one[f"score_difference{key}"]
        assert value == pytest.approx(-other[f"score_difference{opposite}"])
    for key in ("p_different", "p_equivalent"):
        assert one[f"success_{key}"] == pytest.approx(other[f"success_{key}"])


def test_every_scenario_has_its_own_verdict_and_all_are_adjusted_together() -> None:
    learners = {"x": Made("deep", (1.0, 0.25), 20), "y": Made("tabular", 1.0, 20)}
    rows = compared(learners, baseline=["y"], scenarios=["S1", "S2"], pool="none").contrasts
    assert [row["scenario"] for row in rows] == ["S1", "S2"]
    assert [row["success_verdict"] for row in rows] == ["undecided", "worse"]
    raw = [contrast(Means([share], [20]), Means([1.0], [20]), 0.1) for share in (1.0, 0.25)]
    for key in ("p_different", "p_equivalent"):
        expected = holm([getattr(each, key) for each in raw])
        assert [row[f"success_{key}"] for row in rows] == pytest.approx(expected)


def test_few_runs_have_no_verdict_but_count_in_the_adjustment() -> None:
    learners = {"few": Made("deep", 0.5, 8), "net": Made("deep", 0.5, 50), "y": Made("tabular", 1.0, 50)}
    few, net = compared(learners, baseline=["y"], scenarios=["S1"]).contrasts
    assert (few["success_verdict"], net["success_verdict"]) == ("no verdict", "worse")
    raw = contrast(Means([0.5], [50]), Means([1.0], [50]), 0.1).p_different  # the smaller one
    assert net["success_p_different"] == pytest.approx(2 * raw)


def test_later_contrasts_are_adjusted_among_themselves_over_all_scenarios_and_in_each() -> None:
    learners = {"table": Made("tabular", 0.3), "net": Made("deep", 1.0), "other": Made("deep", 0.4)}
    later = (("other, index", "table, index"),)
    alone = compared(learners, [("net", "table")], ["table"])
    *added, declared = compared(learners, [("net", "table")], ["table"], later=later).contrasts
    assert declared == alone.contrasts[0]
    assert [row["scenario"] for row in added] == ["", "S1", "S2", "S3"]
    assert {(row["x"], row["declared"]) for row in added} == {("other, index", "later")}
    means = [Means([0.4] * n, [100] * n) for n in (3, 1, 1, 1)]
    raw = [contrast(x, Means([0.3] * len(x.means), x.sizes), 0.1).p_different for x in means]
    assert [row["success_p_different"] for row in added] == pytest.approx(holm(raw))


@pytest.mark.parametrize(
    ("x", "y", "verdicts"),
    [
        ((0.3, 400, 0.9), (0.3, 400, 0.5), ("equivalent", "better")),
        ((0.9, 400, 0.5), (0.3, 400, 0.9), ("better", "worse")),
        ((0.0, 400), (0.0, 400), ("neither learned", "neither learned")),
        # The random policy succeeds as often as x, and more often than y.
        ((RANDOM, 400, 0.2), (0.0, 400), ("neither learned", "better")),
    ],
)
def test_score_and_success_have_verdicts_of_their_own(
    x: tuple[Any, ...], y: tuple[Any, ...], verdicts: tuple[str, str]
) -> None:
    made = {name: Made("tabular", *own)._replace(every_run=True) for name, own in (("x", x), ("y", y))}
    (row,) = compared(made, [("x", "y")], scenarios=["S1"]).contrasts
    assert (row["success_verdict"], row["score_verdict"]) == verdicts
