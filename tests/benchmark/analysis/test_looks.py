"""Contrasts with several looks: error rates by simulation, decisions by hand."""

import numpy as np
import pytest
from scipy import stats

from benchmark.analysis.looks import EQUAL, FASTER, NEITHER, SLOWER, UNDECIDED, decide, tail_of

LOOKS, N_CONTRASTS, MARGIN = (20, 40, 80, 160), 53, 0.2
TAIL = tail_of(N_CONTRASTS, len(LOOKS))


def ended(x: np.ndarray, y: np.ndarray) -> str:
    """Returns the first verdict of the declared looks that decides, or that of the last."""
    for n in LOOKS:
        verdict = decide(x[:n], y[:n], MARGIN, TAIL).verdict
        if verdict != UNDECIDED:
            break
    return verdict


def test_a_look_by_hand() -> None:
    x, y = np.arange(20.0), np.arange(20.0) + 1
    found = decide(x, y, MARGIN, TAIL)
    # The lower end of a share of 20 of 20: tail ** (1 / 20)
    assert found.faster == pytest.approx((1.0, TAIL ** (1 / 20), 1.0))
    assert (found.n, found.verdict) == (20, FASTER)
    assert decide(y, x, MARGIN, TAIL).verdict == SLOWER
    never = np.full(20, np.inf)
    assert decide(never, never, MARGIN, TAIL).verdict == NEITHER
    assert decide(x, never, MARGIN, TAIL).verdict == FASTER
    assert decide(x[:5], y[:5], MARGIN, TAIL).verdict == UNDECIDED
    assert decide(np.ones(320), np.ones(320), MARGIN, TAIL).verdict == EQUAL  # all tie
    # 19 of 20 pairs decide, 18 do not, as `when` declares
    assert stats.binom.sf(18, 20, 0.5) < TAIL < stats.binom.sf(17, 20, 0.5)
    for n_lost, verdict in ((1, FASTER), (2, UNDECIDED)):
        assert decide(np.where(np.arange(20) < n_lost, 99, x), y, MARGIN, TAIL).verdict == verdict


@pytest.mark.parametrize("spread", [0.0, 0.5])
def test_a_map_without_differences_has_no_winner_in_95_of_100(spread: float) -> None:
    """Of equal learners, none may be called faster anywhere on a map, in at least 95 % of maps.

    What a scenario draws makes runs of a seed alike, in all cells of a map and for both learners.
    """
    rng, n_maps, n_wrong = np.random.default_rng(7), 60, 0
    for _ in range(n_maps):
        places = rng.normal(size=LOOKS[-1]) * spread
        verdicts = []
        for _ in range(N_CONTRASTS):
            x, y = (np.exp(places + rng.normal(size=LOOKS[-1])).round(1) for _ in "xy")
            verdicts.append(ended(x, y))
        n_wrong += bool({*verdicts} & {FASTER, SLOWER, NEITHER})
    # With an error rate of 5 %, more than 8 of 60 are rarer than 1 in 500.
    assert n_wrong <= stats.binom.ppf(0.998, n_maps, 0.05)


def test_what_is_larger_than_the_margin_is_not_called_equal() -> None:
    rng, n_maps, n_wrong, n_decided = np.random.default_rng(8), 400, 0, 0
    for _ in range(n_maps):
        wins = rng.random(LOOKS[-1]) < 0.5 + MARGIN
        verdict = ended(np.where(wins, 1.0, 2.0), np.where(wins, 2.0, 1.0))
        n_wrong += verdict in (EQUAL, SLOWER, NEITHER)
        n_decided += verdict == FASTER
    assert n_wrong == 0
    assert n_decided > 0


def test_most_runs_that_never_learn_are_not_called_so_by_chance() -> None:
    rng, n_wrong = np.random.default_rng(9), 0
    for _ in range(400):  # exactly half of both learn
        x, y = (np.where(rng.random(LOOKS[-1]) < 0.5, np.inf, rng.random(LOOKS[-1])) for _ in "xy")
        n_wrong += ended(x, y) == NEITHER
    assert n_wrong == 0
