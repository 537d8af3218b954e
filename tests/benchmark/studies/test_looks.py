"""Contrasts with several looks: error rates by simulation, decisions and intervals by hand."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy import stats

from benchmark.drawing.tables import read_csv
from benchmark.studies.map.looks import (
    COARSE,
    EQUAL,
    FASTER,
    LOST,
    NEITHER,
    NO_VERDICT,
    SLOWER,
    TRIVIAL,
    UNDECIDED,
    Decision,
    Runs,
    decide,
    decide_all,
    tail_of,
)
from tests.support import ROOT

LOOKS, N_CONTRASTS, MARGIN = (20, 40, 80, 160), 53, 0.2
TAIL = tail_of(N_CONTRASTS, 0.05 / len(LOOKS))


def side(times: np.ndarray, **more: float) -> Runs:
    """Returns what runs took, whose evaluations are by default one percent apart."""
    columns = {"steps": times, "before_steps": times * 0.99, "untrained": False, "lasts": True} | more
    runs = np.empty(
        len(times), [(name, bool if name in ("untrained", "lasts") else float) for name in columns]
    )
    for name, values in columns.items():
        runs[name] = values
    return runs


def decided(*sides: tuple[Runs, Runs], looks: Sequence[int] = LOOKS) -> list[Decision]:
    """Returns what is decided of some contrasts."""
    return [*decide_all(dict(enumerate(sides)), looks, MARGIN, "steps").values()]


def verdict_of(x: np.ndarray, y: np.ndarray) -> str:
    return decide(x, y, MARGIN, (TAIL, TAIL), np.zeros(len(x), bool))[0]


def test_a_look_by_hand() -> None:
    # Of the error of a look, 53 contrasts have three ends each
    assert pytest.approx(0.05 / 4 / 53 / 3) == TAIL
    x, y = np.arange(20.0), np.arange(20.0) + 1
    assert (verdict_of(x, y), verdict_of(y, x)) == (FASTER, SLOWER)
    never = np.full(320, np.inf)
    assert verdict_of(never[:20], never[:20]) == NEITHER
    assert verdict_of(never, never) == NEITHER  # though all tie
    assert verdict_of(x, never[:20]) == FASTER
    assert verdict_of(x[:5], y[:5]) == UNDECIDED
    assert verdict_of(np.ones(320), np.ones(320)) == EQUAL  # all tie
    # 19 of 20 pairs decide, 18 do not
    assert stats.binom.sf(18, 20, 0.5) < TAIL < stats.binom.sf(17, 20, 0.5)
    for n_lost, verdict in ((1, FASTER), (2, UNDECIDED)):
        assert verdict_of(np.where(np.arange(20) < n_lost, 99, x), y) == verdict


def test_steps_down_by_hand() -> None:
    """16 of 20 pairs decide if one contrast remains, but not as one of two; intervals stay those of two."""
    error, looks, y = 0.025, (20, 40), np.full(20, 100.0)
    clear, close = (side(np.where(np.arange(20) < n_lost, 200.0, 50.0)) for n_lost in (0, 4))
    assert tail_of(2, error) < stats.binom.sf(15, 20, 0.5) <= tail_of(1, error)
    for other, verdict in ((clear, FASTER), (close, UNDECIDED)):
        first, _ = decided((close, side(y)), (other, side(y)), looks=looks)
        assert first.verdict == verdict
    (found, _) = decided((close, side(y)), (clear, side(y)), looks=looks)
    # Clopper and Pearson: with 16 of 20, the upper tail at the lower end is the tail
    assert stats.binom.sf(15, 20, found.faster.low) == pytest.approx(error / 2 / 3)
    assert found.faster.low < 0.5 < found.faster.value == 0.8


@pytest.mark.parametrize("picks", [(1.0, 1.0, 0.0, 0.0), (0.9, 0.6, 0.4, 0.1), (0.8, 0.8, 0.4, 0.0)])
def test_picks_that_differ_do_not_make_wrong_verdicts_more_probable(picks: Sequence[float]) -> None:
    """Exactly, for four picks with four pairs each, whose probabilities have the mean 1/2."""
    n, tail, wrong = 16, 0.025, []
    for probabilities in (picks, [0.5]):
        of_count = np.ones(1)  # the distribution of the number of pairs that x wins
        for i in range(n):
            p = probabilities[i % len(probabilities)]
            of_count = np.convolve(of_count, [1 - p, p])
        sides = [(np.where(np.arange(n) < count, 1.0, 3.0), np.full(n, 2.0)) for count in range(n + 1)]
        found = [decide(*pair, MARGIN, (tail, tail), np.zeros(n, bool))[0] for pair in sides]
        wrong.append(sum(of_count[[verdict in (FASTER, SLOWER) for verdict in found]]))
    # Of 16 pairs, 13 decide: stats.binom.sf(12, 16, 0.5) is 0.0106
    assert wrong[0] <= wrong[1] == pytest.approx(2 * stats.binom.sf(12, n, 0.5))


def test_published_intervals_hold_for_all_contrasts_and_looks_at_once() -> None:
    folder = ROOT / "results" / "when"
    contrasts, pairs, looks = (read_csv(folder / f"{name}.csv") for name in ("contrasts", "pairs", "looks"))
    n_contrasts = looks[looks["unit"] == "steps"]["contrasts"].sum()
    names, row = ["grid", "point", "x", "y"], contrasts[contrasts["faster"].between(0.6, 0.9)].iloc[0]
    own = pairs[(pairs[names] == row[names]).all(axis=1)][: row["n"]].fillna(np.inf)
    wins = np.where(own["steps_x"] == own["steps_y"], 0.5, own["steps_x"] < own["steps_y"]).sum()
    low = stats.beta.ppf(0.05 / looks["n"].nunique() / n_contrasts / 3, wins, row["n"] - wins + 1)
    assert (row["faster"], row["faster_low"]) == pytest.approx((wins / row["n"], low), abs=1e-5)


STEPS = np.full(160, 5000.0)


@pytest.mark.parametrize(
    ("x", "y", "why"),
    [
        ({"before_steps": 0.0}, {"before_steps": 0.0}, COARSE),  # all at the first evaluation
        ({"before_steps": 0.0}, {"steps": 9000.0, "before_steps": 4500.0}, COARSE),  # of grids that differ
        ({"before_steps": 0.0}, {"steps": 5500.0, "before_steps": 4500.0}, COARSE),  # only x's
        ({}, {"steps": 9000.0, "before_steps": 4500.0}, COARSE),  # only y's
        ({}, {"steps": 5500.0, "before_steps": 4500.0}, ""),  # neither's
        ({"untrained": True}, {"steps": 9000.0, "before_steps": 8900.0}, TRIVIAL),
        ({"lasts": False}, {"steps": 9000.0, "before_steps": 8900.0}, LOST),
        ({}, {"steps": 9000.0, "before_steps": 8900.0, "lasts": False}, ""),  # it is slower anyway
        ({"before_steps": 0.0}, {"steps": 9000.0, "before_steps": 5000.0}, ""),  # x had learned before
    ],
)
def test_no_verdict_is_about_something_else(x: dict[str, float], y: dict[str, float], why: str) -> None:
    (found,) = decided((side(STEPS, **x), side(STEPS, **y)))
    assert (found.verdict, found.why) == ((NO_VERDICT if why else FASTER), why)


@pytest.mark.parametrize("spread", [0.0, 0.5])
def test_a_map_has_no_wrong_verdict_in_95_of_100(spread: float) -> None:
    """Of equal learners, none may be called faster anywhere on a map, in at least 95 % of maps.

    What a scenario draws makes runs of a seed alike, in all cells of a map and for both learners. Half of the
    contrasts have a clear winner, so that steps down are taken; the others are mostly found equally fast.
    """
    rng, n_maps, n_wrong = np.random.default_rng(7), 60, 0
    for _ in range(n_maps):
        places, sides = rng.normal(size=LOOKS[-1]) * spread, []
        for i in range(N_CONTRASTS):
            x, y = (np.exp(places + rng.normal(size=LOOKS[-1])).round(1) for _ in "xy")
            sides.append((side(x * (0.1 if i % 2 else 1.0)), side(y)))
        found = [decision.verdict for decision in decided(*sides)]
        n_wrong += bool({*found[::2]} & {FASTER, SLOWER, NEITHER}) or bool(
            {*found[1::2]} - {FASTER, UNDECIDED}
        )
    # With an error rate of 5 %, more than 8 of 60 are rarer than 1 in 500.
    assert n_wrong <= stats.binom.ppf(0.998, n_maps, 0.05)


@pytest.mark.parametrize("kind", ["larger than the margin", "half of the runs learn"])
def test_wrong_verdicts_are_rare(kind: str) -> None:
    """Neither is a difference above the margin called equal, nor are learners said not to learn by chance."""
    rng, ended = np.random.default_rng(8), list[str]()
    for _ in range(400):
        x, y = rng.random((2, LOOKS[-1]))
        if kind == "larger than the margin":
            is_won = x < 0.5 + MARGIN
            x, y = np.where(is_won, 1.0, 2.0), np.where(is_won, 2.0, 1.0)
        else:  # of each learner, another half
            x, y = (np.where(rng.random(LOOKS[-1]) < 0.5, np.inf, side) for side in (x, y))
        verdicts = [verdict_of(x[:n], y[:n]) for n in LOOKS]
        ended.append(next((verdict for verdict in verdicts if verdict != UNDECIDED), UNDECIDED))
    if kind == "larger than the margin":
        assert {*ended} <= {FASTER, UNDECIDED}
        assert FASTER in ended
    else:
        assert NEITHER not in ended
