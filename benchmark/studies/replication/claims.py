"""The paper's claims as measured rows, each with a threshold and a verdict.

The document of the report explains claims, their parts, states, verdicts and intervals. Numbers that depend
on which cells have a mean above zero use simultaneous intervals of all cells' means: a resampled count of
signs is biased, since noise moves means near zero across it more often in one direction than in the other.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from benchmark.analysis.intervals import LEVEL, interval, proportion, resample, student
from benchmark.analysis.records import Records, overlap
from envs.model import PING
from envs.regions import target_distance

Agents = Mapping[str, Records]  # of one reading of the paper, by scenario
Samples = NDArray[np.float64]  # (RESAMPLES + 1,) as measured, then resampled

SCENARIOS: Final = ("S1", "S2", "S3")  # the paper's, which its claims are about
VERDICTS: Final = ("holds", "undecided", "does not hold")  # on a claim
STATES: Final = ("passes", "undecided", "fails")  # of a part


class Part(NamedTuple):
    """One number of a claim, with its 95 % interval; without a number, NaN."""

    part: str  # its name
    value: float
    low: float
    high: float
    note: str = ""
    drawn: float = math.nan  # what the paper's figure shows instead; without interval and verdict


class Claim(NamedTuple):
    """A claim of the paper; the report's document says what it is, and why the threshold is where it is."""

    id: str
    title: str  # in a few words
    right_side: str  # ">" or "<": where a part must lie
    threshold: float
    scenarios: tuple[str, ...]
    measure: Callable[[Sequence[Records], str], list[Part]]  # of these scenarios, and of a curve


def _resampled(name: str, samples: Samples, drawn: float, note: str = "") -> Part:
    low, high = interval(samples)
    return Part(name, float(samples[0]), float(low), float(high), note, drawn)


@np.errstate(divide="ignore", invalid="ignore")  # infinity or NaN, if nothing has been learned
def _ratios(
    measure: Callable[[Records, str], tuple[Samples, float]], groups: Sequence[Records], curve: str
) -> list[Part]:
    """Returns the ratio of the first scenario's statistic to each other's, and that of what is drawn."""
    (first, samples, drawn), *others = ((agents.scenario, *measure(agents, curve)) for agents in groups)
    return [_resampled(f"{first}/{name}", samples / x, float(drawn / y)) for name, x, y in others]


def _spread(agents: Records, curve: str) -> tuple[Samples, float]:
    """Returns the mean over steps of the standard deviation over agents, and of the drawn area's height."""
    curves, weights = agents.arrays[curve], resample(len(agents.seeds), agents.scenario)
    mean = weights @ curves / len(curves)
    variance = weights @ curves**2 / len(curves) - mean**2
    deviation = np.sqrt(np.maximum(variance, 0.0)).mean(axis=1)
    return deviation, np.ptp(curves, axis=0).mean()


def _focus(agents: Records, _: str) -> tuple[Samples, float]:
    """Returns cells' mean distance from the target region, weighted by positive mean Q-values of moves."""
    q, weights = agents.arrays["q"][:, :, :PING], resample(len(agents.seeds), agents.scenario)
    mass = np.maximum(weights @ q.reshape(len(q), -1) / len(q), 0.0)
    mass = mass.reshape(len(mass), *q.shape[1:]).sum(axis=-1)  # (RESAMPLES + 1, O)
    scenario = agents.model.scenario
    distance = target_distance(scenario.regions, scenario.layout.places[0][0], scenario.grid.size)
    return mass @ distance / mass.sum(axis=1), math.nan


def _near_one(groups: Sequence[Records], curve: str) -> list[Part]:
    parts = []
    for agents in groups:
        curves, model = agents.arrays[curve], agents.model
        level = np.percentile(curves, 99, axis=1)  # (N,)
        reward = (model.grid_reward + model.issuer_reward)[model.fresh_state, PING]
        ceiling = reward[agents.in_target].max()
        samples = resample(len(level), agents.scenario) @ level / len(level)
        note = f"{samples[0] / ceiling:.1%} of its ceiling {ceiling:.3f}"
        parts.append(_resampled(agents.scenario, samples, float(curves.mean(axis=0).max()), note))
    return parts


def _signs(agents: Records, level: float = LEVEL) -> NDArray[np.bool_]:
    """Returns in which cells PING's mean Q-value is above zero: as measured, surely, and possibly, (3, O).

    The latter two hold for all cells at once, with a confidence of `level`.
    """
    q = agents.arrays["q"][:, :, PING]
    return np.stack(student(q, level, q.shape[1])) > 0


def _valued_outside(groups: Sequence[Records], _: str) -> list[Part]:
    (agents,) = groups
    in_target, signs = agents.in_target, _signs(agents)
    inside = signs[0][in_target].sum()  # without any, nothing has been learned, and nothing is counted
    value, low, high = (float(n) if inside else math.nan for n in signs[:, ~in_target].sum(axis=1))
    note = f"{inside} of {in_target.sum()} target cells have one"
    return [Part(agents.scenario, value, low, high, note)]


def _missing_inside(groups: Sequence[Records], _: str) -> list[Part]:
    (agents,) = groups
    value, high, low = map(float, (~_signs(agents)[:, agents.in_target]).sum(axis=1))
    return [Part(agents.scenario, value, low, high)]


def _reaches(groups: Sequence[Records], _: str) -> list[Part]:
    (agents,) = groups
    return [Part(agents.scenario, *proportion(agents.arrays["success"][:, -1] > 0.5))]


def _mean_map(agents: Records, level: float = LEVEL) -> tuple[float, float, float]:
    """Returns how the mean map overlaps with the target region: measured, least and greatest."""
    in_target, (measured, surely, possibly) = agents.in_target, _signs(agents, level)
    least, greatest = np.where(in_target, surely, possibly), np.where(in_target, possibly, surely)
    value, low, high = (float(overlap(cells, in_target)) for cells in (measured, least, greatest))
    return value, low, high


def _random_helps(groups: Sequence[Records], _: str) -> list[Part]:
    level = (1 + LEVEL) / 2  # of each map, so that both intervals are right at once
    s2, s1 = (_mean_map(agents, level) for agents in groups)
    x, y = (agents.region_overlap for agents in groups)
    squares = np.array([own.var(ddof=1) / len(own) for own in (x, y)])  # Welch's interval
    error, difference, reach = math.sqrt(squares.sum()), float(x.mean() - y.mean()), 0.0
    if error > 0:
        freedom = squares.sum() ** 2 / (squares**2 / [len(x) - 1, len(y) - 1]).sum()
        reach = float(stats.t.ppf((1 + LEVEL) / 2, freedom)) * error
    mean_map = Part("mean map", s2[0] - s1[0], s2[1] - s1[2], s2[2] - s1[1])
    return [mean_map, Part("own maps", difference, difference - reach, difference + reach)]


def _identifies(groups: Sequence[Records], _: str) -> list[Part]:
    parts = [Part(f"mean map {agents.scenario}", *_mean_map(agents)) for agents in groups]
    for agents in groups:
        n_valued, in_target = agents.values_ping.sum(), agents.in_target
        hits = (agents.values_ping & in_target).sum(axis=1)
        precision, recall = hits.sum() / max(n_valued, 1), hits.mean() / in_target.sum()
        note = f"precision {precision:.2f}, recall {recall:.2f}"  # which explain the overlap
        parts.append(Part(f"own maps {agents.scenario}", *student(agents.region_overlap), note))
    return parts


_VARIABILITY: Final = partial(_ratios, _spread)
_FOCUS: Final = partial(_ratios, _focus)
CLAIMS: Final = (
    Claim("variability-S2", "max Q varies most in S2", ">", 1.0, ("S2", "S1", "S3"), _VARIABILITY),
    Claim("max-near-1", "max Q reaches about 1", ">", 0.95, ("S1", "S3"), _near_one),
    Claim("variability-S3", "max Q varies least in S3", "<", 1.0, ("S3", "S1", "S2"), _VARIABILITY),
    Claim("moves-focused", "moves are most focused in S3", "<", 1.0, ("S3", "S1", "S2"), _FOCUS),
    Claim("ping-S3", "S3: no cell outside valued", "<", 1.0, ("S3",), _valued_outside),
    Claim("ping-S3-inside", "S3: all target cells valued", "<", 1.0, ("S3",), _missing_inside),
    Claim("ping-S1", "S1: cells outside valued", ">", 0.0, ("S1",), _valued_outside),
    Claim("reaches", "S1: the target is reached", ">", 0.95, ("S1",), _reaches),
    Claim("random-helps", "random feedback helps", ">", 0.0, ("S2", "S1"), _random_helps),
    Claim("identifies", "S2, S3: region identified", ">", 0.9, ("S2", "S3"), _identifies),
    Claim("identifies-S1", "S1: region identified", ">", 0.9, ("S1",), _identifies),
)


def judge(agents: Agents, curve: str, claims: Sequence[Claim] = CLAIMS) -> pd.DataFrame:
    """Returns the parts of claims, each with its state and the verdict on its claim.

    Args:
      agents: All of one reading, or some; by scenario.
      curve: Array of the curve of maximum Q that claims are about.
      claims: All claims, or some.
    """
    seeds = next(iter(agents.values())).seeds
    parts = pd.DataFrame(
        {"claim": claim.id, "right_side": claim.right_side, "threshold": claim.threshold} | part._asdict()
        for claim in claims
        for part in claim.measure([agents[name] for name in claim.scenarios], curve)
    )
    ends = np.stack([_margin(parts, "low"), _margin(parts, "high")])
    states = [ends.min(axis=0) > 0, ends.max(axis=0) <= 0]  # neither of NaN
    parts["state"] = np.select(states, ["passes", "fails"], "undecided")
    worst = parts["state"].map(STATES.index).groupby(parts["claim"]).transform("max")
    about = {"agents": len(seeds), "first_seed": seeds[0], "last_seed": seeds[-1]}
    return parts.assign(verdict=worst.map(VERDICTS.__getitem__), **about)


def _margin(parts: pd.DataFrame, column: str) -> "pd.Series[float]":
    """Returns how far a number of each part lies on the right side of the threshold."""
    return (parts[column] - parts["threshold"]) * np.where(parts["right_side"] == ">", 1, -1)
