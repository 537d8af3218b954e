"""Contrasts: by hand, and by simulation of how rare wrong verdicts are."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmark.analysis.contrasts import (
    BETTER,
    EQUIVALENT,
    NO_VERDICT,
    UNDECIDED,
    WORSE,
    Means,
    contradicting,
    contrast,
    decide,
    holm,
    verdict,
)


def test_holm_by_hand() -> None:
    """Sorted, p-values are multiplied by 4, 3, 2, 1, never fall, and never exceed 1."""
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert (holm([0.5, 0.9]), holm([0.04]), holm([])) == ([1.0, 1.0], [0.04], [])


@pytest.mark.parametrize(
    ("difference", "p_different", "p_equivalent", "expected"),
    [
        (0.2, 0.01, 0.9, BETTER),
        (-0.2, 0.01, 0.9, WORSE),
        (0.2, 0.06, 0.9, UNDECIDED),
        (0.0, 1.0, 0.05, EQUIVALENT),
        (0.03, 0.001, 0.001, EQUIVALENT),  # shown, but shown to be small
    ],
)
def test_verdicts(difference: float, p_different: float, p_equivalent: float, expected: str) -> None:
    assert verdict(difference, p_different, p_equivalent) == expected


@pytest.mark.parametrize(
    ("verdict", "differences", "expected"),
    [
        (EQUIVALENT, [0.3, -0.15, -0.15], [0, 1, 2]),
        (EQUIVALENT, [0.1, 0.09, -0.09], [0]),  # as large as the margin
        (BETTER, [0.9, 0.0, -0.09], []),
        (BETTER, [0.9, 0.0, -0.1], [2]),
        (WORSE, [-0.9, 0.0, 0.1], [2]),
    ],
)
def test_no_scenario_contradicts_a_mean(verdict: str, differences: list[float], expected: list[int]) -> None:
    assert contradicting(verdict, zip(differences, differences, strict=True), 0.1) == expected


shares = st.tuples(*[st.integers(0, 20).map(lambda count: count / 20)] * 2)


@settings(max_examples=30)
@given(shares, shares, st.sampled_from([5, 20, 200]))
def test_tests_and_intervals_never_contradict_each_other(
    x: Sequence[float], y: Sequence[float], n: int
) -> None:
    found = contrast(Means(x, [n, n]), Means(y, [n, n]), 0.1)
    assert (found.p_different < 0.05 - 1e-6) <= (found.low > 0 or found.high < 0)
    assert (found.p_different > 0.05 + 1e-6) <= (found.low <= 0 <= found.high)
    assert (found.p_equivalent < 0.05 - 1e-6) <= (found.low_90 > -0.1 and found.high_90 < 0.1)
    assert (found.p_equivalent > 0.05 + 1e-6) <= (found.low_90 <= -0.1 or found.high_90 >= 0.1)


def test_few_runs_have_no_verdict_but_count_in_the_adjustment() -> None:
    sure = contrast(Means([1.0], [50]), Means([0.0], [50]), 0.1)
    close = contrast(Means([0.9], [50]), Means([0.7], [50]), 0.1)
    both = decide([sure, close], is_allowed=[False, True])
    assert both[0]["verdict"] == NO_VERDICT
    assert both[1]["p_different"] == close.p_different  # the smaller p-value came first
    twice = decide([close, close], is_allowed=[False, True])
    assert twice[1]["p_different"] == pytest.approx(2 * close.p_different)


@pytest.mark.parametrize("n", [10, 100])
def test_wrong_verdicts_are_rare(n: int) -> None:
    """Four contrasts without a difference, and four with one as large as the margin, many times over."""
    rng = np.random.default_rng(n)
    truth = np.array([0.95, 0.5])

    def verdicts(shift: float) -> set[str]:
        drawn = [[rng.binomial(n, p) / n for p in (truth, truth - shift)] for _ in range(4)]
        found = [contrast(Means([*x], [n, n]), Means([*y], [n, n]), 0.1) for x, y in drawn]
        return {str(each["verdict"]) for each in decide(found, is_allowed=[True] * 4)}

    wrongly_different = sum(bool(verdicts(0.0) & {BETTER, WORSE}) for _ in range(40))
    wrongly_equivalent = sum(EQUIVALENT in verdicts(0.1) for _ in range(40))
    # With a probability of 5 % each, more than 6 of 40 would come up one time in 300.
    assert wrongly_different <= 6
    assert wrongly_equivalent <= 6
