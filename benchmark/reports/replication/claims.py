"""The paper's claims as measured rows, each with a threshold and a verdict.

A claim is made of one or more parts, each a number that must lie on one side of a threshold. A part `passes`
if its whole 95 % interval lies on the right side, and `fails` if it lies on the wrong one; otherwise, or if
there is no number, it is `undecided`. If all parts pass, the claim `holds`; if one fails, it `does not hold`;
otherwise it is `undecided`.

Ratios, and means without bounds, have bootstrap intervals over agents; shares exact binomial ones; overlaps
of agents' own maps, which vary much less than shares do, Student's or Welch's. What depends on which cells
have a mean above zero has simultaneous intervals of all cells' means: a resampled count of signs is biased,
since noise turns means near zero more often one way than the other.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from benchmark.analysis.contrasts import POWER
from benchmark.analysis.intervals import LEVEL, interval, proportion, proportion_interval, student
from benchmark.analysis.population import Population, overlap
from envs.model import PING
from envs.regions import target_distance

Samples = NDArray[np.float64]  # (RESAMPLES + 1,) as measured, then resampled

SCENARIOS: Final = ("S1", "S2", "S3")  # the paper's, which its claims are about
VERDICTS: Final = ("holds", "undecided", "does not hold")  # on a claim
STATES: Final = ("passes", "undecided", "fails")  # of a part
_LEAST_DEVIATION: Final = 1e-6  # a smaller standard deviation over agents counts as none
_REACH: Final = float(stats.norm.ppf((1 + LEVEL) / 2) + stats.norm.ppf(POWER))  # 1.96 + 0.84


class Part(NamedTuple):
    """One number of a claim, with its 95 % interval; without a number, NaN."""

    name: str
    value: float
    low: float
    high: float
    standard_error: float = math.nan  # NaN if the interval does not come from one
    note: str = ""
    drawn: float = math.nan  # what the paper's figure shows instead; without interval and verdict


class Claim(NamedTuple):
    """A claim of the paper; the report's document says what it is, and why the threshold is where it is."""

    id: str
    right_side: str  # ">" or "<": where a part must lie
    threshold: float
    scenarios: tuple[str, ...]
    measure: Callable[[Sequence[Population], str], list[Part]]  # of these scenarios, and of a curve


def judge(populations: Mapping[str, Population], curve: str) -> pd.DataFrame:
    """Measures every claim.

    Args:
      populations: The agents of at least the paper's scenarios, all of one reading and equally many.
      curve: The array of maximum Q that the claims on curves are about, `"max_q"` or `"table_max_q"`.

    Returns:
      One row per part of a claim: claim, part, agents (per scenario), value, low, high, right_side,
      threshold, state (of the part), verdict (on the claim), effect, agents_needed, note, drawn.
    """
    return pd.DataFrame([row for claim in CLAIMS for row in judge_claim(claim, populations, curve)])


def judge_claim(claim: Claim, populations: Mapping[str, Population], curve: str) -> list[dict[str, Any]]:
    """Measures a claim; returns its rows of `judge`.

    `effect` is a part's distance from the threshold, in standard deviations of a single agent, positive on
    the right side. It is NaN if there is no standard deviation, or if that is 0 but for rounding. If it is
    the true one, `agents_needed` agents decide an undecided part with a probability of 80 %.
    """
    about = [populations[name] for name in claim.scenarios]
    n_agents = len(about[0].seeds)
    sign = 1 if claim.right_side == ">" else -1
    rows: list[dict[str, Any]] = []
    for part in claim.measure(about, curve):
        margin, *ends = (sign * (x - claim.threshold) for x in (part.value, part.low, part.high))
        state = "passes" if np.min(ends) > 0 else "fails" if np.max(ends) <= 0 else "undecided"  # NaN, too
        deviation = math.sqrt(n_agents) * part.standard_error
        effect = margin / deviation if deviation > _LEAST_DEVIATION else math.nan
        needed = float(np.ceil((_REACH / effect) ** 2)) if effect and state == "undecided" else math.nan
        row = {"claim": claim.id, "part": part.name, "agents": n_agents}
        row |= {"value": part.value, "low": part.low, "high": part.high}
        row |= {"right_side": claim.right_side, "threshold": claim.threshold, "state": state, "verdict": ""}
        row |= {"effect": effect, "agents_needed": needed, "note": part.note, "drawn": part.drawn}
        rows.append(row)
    worst = max((row["state"] for row in rows), key=STATES.index)
    return [row | {"verdict": VERDICTS[STATES.index(worst)]} for row in rows]


def weakest(parts: pd.DataFrame, *keys: str) -> pd.DataFrame:
    """Returns the part that a verdict rests on: of the worst state, the one farthest on the wrong side.

    Args:
      parts: Rows of `judge`, perhaps of several readings or numbers of agents.
      keys: The columns that tell those apart, beside the claim.

    Returns:
      One of the rows per claim and key, in their order.
    """
    sign = np.where(parts["right_side"] == ">", 1, -1)
    ranked = parts.assign(
        _state=parts["state"].map(STATES.index), _margin=sign * (parts["value"] - parts["threshold"])
    ).sort_values(["_state", "_margin"], ascending=[False, True], na_position="first", kind="stable")
    kept = ranked.drop_duplicates(["claim", *keys]).index
    return parts.loc[parts.index.isin(kept)]


def agreement(judged: pd.DataFrame, sets: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Returns in how many of these sets of agents each claim has the same verdict as in `judged`.

    Its columns: sets, sets_agreeing, share, share_low, share_high (95 %, exact; NaN without sets).
    """
    agreeing = np.zeros(len(judged), dtype=int)
    for each in sets:
        agreeing += judged["claim"].map(each.groupby("claim")["verdict"].first()) == judged["verdict"]
    share = agreeing / len(sets) if sets else np.full(len(judged), np.nan)
    low, high = proportion_interval(share, len(sets)) if sets else (share, share)
    frame = pd.DataFrame({"sets": len(sets), "sets_agreeing": agreeing, "share": share}, judged.index)
    return frame.assign(share_low=low, share_high=high)


# The parts of each claim


def _resampled(name: str, samples: Samples, drawn: float = math.nan, note: str = "") -> Part:
    """Makes a part with a bootstrap interval."""
    with np.errstate(invalid="ignore"):  # of infinite ratios
        low, high = interval(samples)
        return Part(name, float(samples[0]), float(low), float(high), float(samples[1:].std()), note, drawn)


def _ratio(numerator: Samples | float, denominator: Samples | float) -> Samples:
    """Divides, giving infinity or NaN where there is nothing to divide by."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.divide(numerator, denominator)


@lru_cache(maxsize=64)
def _spread(population: Population, curve: str) -> tuple[Samples, float]:
    """Returns the standard deviation over agents of their maximum Q, averaged over steps.

    With it goes what the paper draws: the height of the area from the least to the largest agent.
    """
    curves, weights = population.arrays[curve], population.weights
    mean = weights @ curves / len(curves)
    variance = weights @ curves**2 / len(curves) - mean**2
    deviation = np.sqrt(np.maximum(variance, 0.0)).mean(axis=1)
    return deviation, float(np.ptp(curves, axis=0).mean())


def _variability(populations: Sequence[Population], curve: str) -> list[Part]:
    """Compares the first scenario's variability with that of each other."""
    (own, shaded), *others = (_spread(each, curve) for each in populations)
    return [
        _resampled(
            f"{populations[0].scenario}/{each.scenario}", _ratio(own, other), float(_ratio(shaded, area))
        )
        for each, (other, area) in zip(populations[1:], others, strict=True)
    ]


def _near_one(populations: Sequence[Population], curve: str) -> list[Part]:
    """Measures the level that an agent's curve reaches at one step in a hundred, mean over agents.

    What is drawn of it is the peak of the averaged curve.
    """
    parts = []
    for population in populations:
        curves, model = population.arrays[curve], population.model
        level = np.percentile(curves, 99, axis=1)  # (N,)
        reward = (model.grid_reward + model.issuer_reward)[model.fresh_state, PING]
        ceiling = reward[population.in_target].max()
        samples = population.weights @ level / len(level)
        note = f"{samples[0] / ceiling:.1%} of its ceiling {ceiling:.3f}"
        parts.append(_resampled(population.scenario, samples, float(curves.mean(axis=0).max()), note))
    return parts


def _focus(population: Population) -> Samples:
    """Returns how far from the target region the positive mean Q-values of the moves lie, in cells."""
    q = population.arrays["q"][:, :, :PING]
    mass = np.maximum(population.weights @ q.reshape(len(q), -1) / len(q), 0.0)
    mass = mass.reshape(len(mass), *q.shape[1:]).sum(axis=-1)  # (RESAMPLES + 1, O)
    scenario = population.model.scenario
    distance = target_distance(scenario.regions, scenario.places[0], scenario.grid.size)
    return _ratio(mass @ distance, mass.sum(axis=1))


def _moves_focused(populations: Sequence[Population], _: str) -> list[Part]:
    """Compares the first scenario's focus with that of each other."""
    first, *others = populations
    return [
        _resampled(f"{first.scenario}/{each.scenario}", _ratio(_focus(first), _focus(each)))
        for each in others
    ]


@lru_cache(maxsize=64)
def _signs(population: Population, level: float = LEVEL) -> NDArray[np.bool_]:
    """Returns in which cells PING's mean Q-value is above zero: as measured, surely, and possibly, (3, O).

    Surely and possibly are right for all cells at once, with a confidence of `level`. A cell where no agent
    ever chose PING has 0 throughout, and is not above zero.
    """
    q = population.arrays["q"][:, :, PING]
    return np.stack(student(q, level, q.shape[1])) > 0


def _valued_outside(populations: Sequence[Population], _: str) -> list[Part]:
    """Counts the cells outside the target region with a positive mean PING Q-value.

    If no cell of the target region has one either, nothing has been learned, and there is no count.
    """
    (population,) = populations
    in_target, signs = population.in_target, _signs(population)
    inside = signs[0][in_target].sum()
    value, low, high = (float(n) if inside else math.nan for n in signs[:, ~in_target].sum(axis=1))
    note = f"{inside} of {in_target.sum()} target cells have one"
    return [Part(population.scenario, value, low, high, note=note)]


def _missing_inside(populations: Sequence[Population], _: str) -> list[Part]:
    """Counts the target cells without a positive mean PING Q-value."""
    (population,) = populations
    value, high, low = map(float, (~_signs(population)[:, population.in_target]).sum(axis=1))
    return [Part(population.scenario, value, low, high)]


def _reaches(populations: Sequence[Population], _: str) -> list[Part]:
    """Measures the share of agents that succeed more likely than not, with its exact interval."""
    (population,) = populations
    succeeds = population.arrays["success"][:, -1] > 0.5  # (N,)
    error = float(succeeds.std()) / math.sqrt(len(succeeds))
    return [Part(population.scenario, *proportion(succeeds), error)]


def _mean_map(population: Population, level: float = LEVEL) -> tuple[float, float, float]:
    """Returns how the mean map overlaps with the target region: measured, least and greatest.

    With T target cells it is at least (sure inside) / (T + possible outside), and at most (possible inside) /
    (T + sure outside), where possible cells include the sure ones.
    """
    in_target, (measured, surely, possibly) = population.in_target, _signs(population, level)
    least, greatest = np.where(in_target, surely, possibly), np.where(in_target, possibly, surely)
    value, low, high = (float(overlap(cells, in_target)) for cells in (measured, least, greatest))
    return value, low, high


def _random_helps(populations: Sequence[Population], _: str) -> list[Part]:
    """Compares the overlaps in S2 with those in S1; that of agents' own maps has Welch's interval."""
    level = (1 + LEVEL) / 2  # of each map, so that both intervals are right at once
    s2, s1 = (_mean_map(each, level) for each in populations)
    x, y = (each.region_overlap for each in populations)
    squares = np.array([each.var(ddof=1) / len(each) for each in (x, y)])
    error, difference, reach = math.sqrt(squares.sum()), float(x.mean() - y.mean()), 0.0
    if error > 0:
        freedom = squares.sum() ** 2 / (squares**2 / [len(x) - 1, len(y) - 1]).sum()
        reach = float(stats.t.ppf((1 + LEVEL) / 2, freedom)) * error
    return [
        Part("mean map", s2[0] - s1[0], s2[1] - s1[2], s2[2] - s1[1]),
        Part("own maps", difference, difference - reach, difference + reach, error),
    ]


def _identifies(populations: Sequence[Population], _: str) -> list[Part]:
    """Measures how maps overlap with the target region: the mean map, and, by Student, the agents' own."""
    parts = [Part(f"mean map {each.scenario}", *_mean_map(each)) for each in populations]
    for population in populations:
        own, valued, in_target = population.region_overlap, population.values_ping, population.in_target
        found = (valued & in_target).sum(axis=1)
        precision, recall = found.sum() / max(valued.sum(), 1), found.mean() / in_target.sum()
        error = float(own.std(ddof=1)) / math.sqrt(len(own))
        note = f"precision {precision:.2f}, recall {recall:.2f}"  # which explain the overlap
        parts.append(Part(f"own maps {population.scenario}", *student(own), error, note))
    return parts


CLAIMS: Final = (
    Claim("variability-S2", ">", 1.0, ("S2", "S1", "S3"), _variability),
    Claim("max-near-1", ">", 0.95, ("S1", "S3"), _near_one),
    Claim("variability-S3", "<", 1.0, ("S3", "S1", "S2"), _variability),
    Claim("moves-focused", "<", 1.0, ("S3", "S1", "S2"), _moves_focused),
    Claim("ping-S3", "<", 1.0, ("S3",), _valued_outside),
    Claim("ping-S3-inside", "<", 1.0, ("S3",), _missing_inside),
    Claim("ping-S1", ">", 0.0, ("S1",), _valued_outside),
    Claim("reaches", ">", 0.95, ("S1",), _reaches),
    Claim("random-helps", ">", 0.0, ("S2", "S1"), _random_helps),
    Claim("identifies", ">", 0.9, ("S2", "S3"), _identifies),
    Claim("identifies-S1", ">", 0.9, ("S1",), _identifies),
)
