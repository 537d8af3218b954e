"""Contrasts: by hand, and by simulation of how rare wrong verdicts are."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmark.studies.comparison.contrasts import Means, contrast, holm, verdict


def test_holm_by_hand() -> None:
    """Sorted, p-values are multiplied by 4, 3, 2, 1, never fall, and never exceed 1."""
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert (holm([0.5, 0.9]), holm([0.04]), holm([])) == ([1.0, 1.0], [0.04], [])


@pytest.mark.parametrize(
    ("difference", "p_different", "p_equivalent", "expected"),
    [
        (0.2, 0.01, 0.9, "better"),
        (-0.2, 0.01, 0.9, "worse"),
        (0.2, 0.06, 0.9, "undecided"),
        (0.0, 1.0, 0.05, "equivalent"),
        (0.03, 0.001, 0.001, "equivalent"),  # shown, but shown to be small
    ],
)
def test_verdicts(difference: float, p_different: float, p_equivalent: float, expected: str) -> None:
    assert verdict(difference, p_different, p_equivalent) == expected


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
