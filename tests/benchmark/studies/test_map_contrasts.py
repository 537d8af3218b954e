"""Contrasts of a map: error rates by simulation, decisions and intervals by hand."""

import numpy as np
import pytest
from scipy import stats

from benchmark.drawing.tables import read_csv
from benchmark.experiments import load_experiment
from benchmark.studies import report_of
from benchmark.studies.map.contrasts import (
    COARSE,
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
from benchmark.studies.map.declared import compared
from tests.support import ROOT

N_CONTRASTS = 53
TAIL = tail_of(N_CONTRASTS)


def side(times: np.ndarray, **more: float) -> Runs:
    """Returns what runs took, whose evaluations are by default one percent apart."""
    columns = {"steps": times, "before": times * 0.99, "untrained": False, "lasts": True} | more
    return {name: np.broadcast_to(np.asarray(values), len(times)) for name, values in columns.items()}


def decided(*sides: tuple[Runs, Runs]) -> list[Decision]:
    """Returns what is decided of some contrasts."""
    return [*decide_all(dict(enumerate(sides)), "steps").values()]


def verdict_of(x: np.ndarray, y: np.ndarray, tail: float = TAIL) -> str:
    return decide(x, y, (tail, tail), np.zeros(len(x), bool))[0]


def test_a_decision_by_hand() -> None:
    assert pytest.approx(0.05 / 53 / 3) == TAIL  # 53 contrasts have three ends each
    x, y, never = np.arange(20.0), np.arange(20.0) + 1, np.full(20, np.inf)
    assert (verdict_of(x, y), verdict_of(y, x)) == (FASTER, SLOWER)
    assert verdict_of(never, never) == NEITHER  # though all tie
    assert verdict_of(x, never) == FASTER
    assert verdict_of(x[:5], y[:5]) == UNDECIDED
    # 18 of 20 pairs decide, 17 do not
    assert stats.binom.sf(17, 20, 0.5) < TAIL < stats.binom.sf(16, 20, 0.5)
    for n_lost, verdict in ((2, FASTER), (3, UNDECIDED)):
        assert verdict_of(np.where(np.arange(20) < n_lost, 99, x), y) == verdict


def test_steps_down_by_hand() -> None:
    """15 of 19 pairs do not decide one of two contrasts, but the last one; intervals stay those of two."""
    y = np.full(19, 100.0)
    clear, close = (side(np.where(np.arange(19) < n_lost, 200.0, 50.0)) for n_lost in (0, 4))
    assert tail_of(2) < stats.binom.sf(14, 19, 0.5) <= tail_of(1)
    for other, verdict in ((clear, FASTER), (close, UNDECIDED)):
        first, _ = decided((close, side(y)), (other, side(y)))
        assert first.verdict == verdict
    (found, _) = decided((close, side(y)), (clear, side(y)))
    # Clopper and Pearson: the upper tail at the lower end is the tail
    assert stats.binom.sf(14, 19, found.faster.low) == pytest.approx(0.05 / 2 / 3)
    assert found.faster.low < 0.5 < found.faster.value


def test_published_intervals_hold_for_all_contrasts_at_once() -> None:
    contrasts, runs = (read_csv(ROOT / "results" / "when" / f"{name}.csv") for name in ("contrasts", "runs"))
    experiment = load_experiment("when")
    pairs = compared(experiment, report_of(experiment).declared.contrasts)
    n_contrasts = len({(x.first.digest, y.first.digest) for x, y in pairs})  # some points are in two grids
    row = contrasts[contrasts["faster"].between(0.6, 0.9)].iloc[0]
    own = runs[(runs[["grid", "point"]] == row[["grid", "point"]]).all(axis=1)].fillna(np.inf)
    x, y = (own.loc[own["learner"] == row[name], "steps"].to_numpy() for name in "xy")
    wins = np.where(x == y, 0.5, x < y).sum()
    low = stats.beta.ppf(0.05 / n_contrasts / 3, wins, row["n"] - wins + 1)
    assert (row["faster"], row["faster_low"]) == pytest.approx((wins / row["n"], low), abs=1e-5)


STEPS = np.full(160, 5000.0)
LATER = {"steps": 9000.0, "before": 8900.0}


@pytest.mark.parametrize(
    ("x", "y", "why"),
    [
        ({"before": 0.0}, {"steps": 5500.0, "before": 4500.0}, COARSE),  # only x's
        ({}, {"steps": 9000.0, "before": 4500.0}, COARSE),  # only y's
        ({}, {"steps": 5500.0, "before": 4500.0}, ""),  # neither's
        ({"untrained": True}, LATER, TRIVIAL),
        ({"lasts": False}, LATER, LOST),
        ({}, LATER | {"lasts": False}, ""),  # it is slower anyway
        ({"before": 0.0}, {"steps": 9000.0, "before": 5000.0}, ""),  # x had learned before
    ],
)
def test_no_verdict_is_about_something_else(x: dict[str, float], y: dict[str, float], why: str) -> None:
    (found,) = decided((side(STEPS, **x), side(STEPS, **y)))
    assert (found.verdict, found.why) == ((NO_VERDICT if why else FASTER), why)


@pytest.mark.parametrize("spread", [0.0, 0.5])
def test_a_map_has_no_wrong_verdict_in_95_of_100(spread: float) -> None:
    """Of equal learners, none may be called faster anywhere on a map, in at least 95 % of maps.

    What a scenario draws makes runs of a seed alike, in all cells of a map and for both learners. Half of the
    contrasts have a clear winner, so that steps down are taken.
    """
    rng, n_maps, n_wrong = np.random.default_rng(7), 60, 0
    for _ in range(n_maps):
        places, sides = rng.normal(size=16) * spread, []
        for i in range(N_CONTRASTS):
            x, y = (np.exp(5 + places + rng.normal(size=16)).round() for _ in "xy")
            sides.append((side(x * (1e-4 if i % 2 else 1.0)), side(y)))
        found = [decision.verdict for decision in decided(*sides)]
        assert {*found[1::2]} == {FASTER}
        n_wrong += found[::2] != [UNDECIDED] * len(found[::2])
    # With an error rate of 5 %, more than 8 of 60 are rarer than 1 in 500.
    assert n_wrong <= stats.binom.ppf(0.998, n_maps, 0.05)


def test_learners_of_which_half_the_runs_learn_are_not_said_not_to() -> None:
    rng = np.random.default_rng(8)
    for _ in range(400):
        x, y = (np.where(rng.random(160) < 0.5, np.inf, times) for times in rng.random((2, 160)))
        assert verdict_of(x, y) != NEITHER
