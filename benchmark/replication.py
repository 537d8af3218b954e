"""Which of the paper's claims hold?

A claim has parts, each a number with a 95 % interval and a threshold. A part passes if its interval
lies on the right side of the threshold, fails if it lies on the wrong side, and is undecided
otherwise. A claim holds if all its parts pass, and does not hold if one of them fails.

Numbers that depend on which cells have a mean above zero use simultaneous intervals of all cells'
means: a resampled count of signs is biased, since noise moves means near zero across it more often
in one direction than in the other.

The tables are made of stored records, since action values are not published.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from string import ascii_lowercase
from textwrap import fill
from typing import Final, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from scipy import stats

from agents.policy import contains, greedy_masks
from benchmark.execution.store import Store
from benchmark.experiment import Experiment
from benchmark.records import OPTIMUM_TOLERANCE, Records, anchors, load_records, optimal_values
from benchmark.scenes import colour_bar, dots, heat, region_legend, triangles
from benchmark.statistics import LEVEL, Estimate, interval, proportion, resample, student, with_ends
from benchmark.study import Data, Report
from benchmark.style import COLOURS, WIDTH, draw_cells, figure_of, norm_of
from envs import ACTIONS, InputError, compile_scenario, load_scenario
from envs.model import PING
from envs.people import FEEDBACK
from envs.regions import target_distance
from envs.scene import scene_of
from envs.words import listed

Agents = Mapping[str, Records]  # of one reading of the paper, by scenario
Floats = NDArray[np.float64]

SCENARIOS: Final = ("S1", "S2", "S3")  # the paper's, which its claims are about
VERDICTS: Final = ("holds", "undecided", "does not hold")  # on a claim
STATES: Final = ("passes", "undecided", "fails")  # of a part, in the same order
_OPTIMUM: Final = 1 - OPTIMUM_TOLERANCE  # the score of an optimal policy
_CURVES: Final = {"visited": "max_q", "table": "table_max_q"}  # array of each curve of a reading


def check(experiment: Experiment, _: Report) -> None:
    """Refuses all but one table, which records the maximum Q, in scenes like the paper's."""
    source, accepted = experiment.argument, "accepted in a replication"
    first, *others = experiment.learners.values()
    if others or "record_every" not in first.algorithm.settings.model_fields:
        raise InputError(f"{source}: algorithms: {accepted}: one, a table that records max Q.")
    if not experiment.declared.readings:
        raise InputError(f"{source}: readings: {accepted}: at least one.")
    default = experiment.populations[0].condition
    read = [each.scenario for each in experiment.populations if each.condition is default]
    if sorted(map(str, read)) != sorted(str(load_scenario(name)) for name in SCENARIOS):
        raise InputError(f"{source}: scenarios: {accepted}: the paper's, {listed(SCENARIOS)}.")
    for population in experiment.populations:
        model, name = compile_scenario(population.scenario), population.scenario.name
        is_square = model.scenario.regions.target_radius is not None
        if not (model.has_cell_maps and len(model.starts) == 1 and is_square):
            where = f"{source}: scenarios: {name} ({population.condition.name}): {accepted}"
            what = "one start, one phase, no walls, squares as regions, the cell observed"
            raise InputError(f"{where}: {what}.")


# The agents


@lru_cache(maxsize=16)  # tables share them
def load(data: Data, reading: str, seeds: range) -> Agents:
    """Reads the records of the agents of a reading with these seeds, by scenario."""
    if data.store is None:
        what = "action values are not published"
        raise InputError(f"{data.experiment.argument}: {what}: run the experiment first.")
    own = [each for each in data.experiment.populations if each.condition.name == reading]
    with Store(data.store, read_only=True) as store:
        return {each.scenario.name: load_records(each.runs(seeds), store) for each in own}


def sets_of(data: Data) -> tuple[str, range, list[range]]:
    """Returns the default reading, its seeds, and disjoint sets of as many as the paper has."""
    first = data.experiment.populations[0]
    seeds, size = first.seeds, min(first.learner.declared.seeds, len(first.seeds))
    starts = range(0, len(seeds) - size + 1, size)
    return first.condition.name, seeds, [seeds[i : i + size] for i in starts]


def few(data: Data) -> Agents:
    """Returns the agents that figures show: as many as the paper has, by the first seeds."""
    reading, _, sets = sets_of(data)
    return load(data, reading, sets[0])


def few_and_all(data: Data) -> list[Agents]:
    """Returns these, and all agents if there are at least twice as many."""
    reading, seeds, sets = sets_of(data)
    return [load(data, reading, each) for each in (sets[0], *[seeds] * (len(sets) > 1))]


# The claims


class Part(NamedTuple):
    """One number of a claim, with its 95 % interval; without a number, NaN."""

    part: str  # its name
    value: float
    low: float
    high: float
    note: str = ""
    drawn: float = math.nan  # what the paper's figure shows instead


class Claim(NamedTuple):
    """A claim of the paper, and how it is measured."""

    id: str
    title: str  # in a few words
    right_side: str  # ">" or "<": where a part must lie
    threshold: float
    scenarios: tuple[str, ...]
    measure: Callable[[Sequence[Records], str], list[Part]]  # of these scenarios, and of a curve
    about: str  # for readers


def _resampled(name: str, samples: Floats, drawn: float, note: str = "") -> Part:
    low, high = interval(samples)
    return Part(name, float(samples[0]), float(low), float(high), note, drawn)


@np.errstate(divide="ignore", invalid="ignore")  # infinity or NaN, if nothing has been learned
def _ratios(
    measure: Callable[[Records, str], tuple[Floats, float]], groups: Sequence[Records], curve: str
) -> list[Part]:
    """Returns the ratio of the first scenario's statistic to each other's, and of what is drawn."""
    (first, samples, drawn), *others = ((agents.scenario, *measure(agents, curve)) for agents in groups)
    return [_resampled(f"{first}/{name}", samples / x, float(drawn / y)) for name, x, y in others]


def _spread(agents: Records, curve: str) -> tuple[Floats, float]:
    """Returns the standard deviation over agents and the drawn area's height, means over steps."""
    curves, weights = agents.arrays[curve], resample(len(agents.seeds), agents.scenario)
    mean = weights @ curves / len(curves)
    variance = weights @ curves**2 / len(curves) - mean**2
    deviation = np.sqrt(np.maximum(variance, 0.0)).mean(axis=1)
    return deviation, np.ptp(curves, axis=0).mean()


def _focus(agents: Records, _: str) -> tuple[Floats, float]:
    """Returns cells' mean distance from the target, weighted by positive mean Q of moves."""
    q, weights = agents.arrays["q"][:, :, :PING], resample(len(agents.seeds), agents.scenario)
    mass = np.maximum(weights @ q.reshape(len(q), -1) / len(q), 0.0)
    mass = mass.reshape(len(mass), *q.shape[1:]).sum(axis=-1)  # (RESAMPLES + 1, O)
    scenario = agents.model.scenario
    start = scenario.layout.places[0][0]
    distance = target_distance(scenario.regions, start, scenario.grid.size)
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
        peak = float(curves.mean(axis=0).max())
        parts.append(_resampled(agents.scenario, samples, peak, note))
    return parts


def _signs(agents: Records, level: float = LEVEL) -> NDArray[np.bool_]:
    """Returns where PING's mean Q is above zero: as measured, surely, and possibly, (3, O).

    The latter two hold for all cells at once, with a confidence of `level`.
    """
    q = agents.arrays["q"][:, :, PING]
    return np.stack(student(q, level, q.shape[1])) > 0


def _valued_outside(groups: Sequence[Records], _: str) -> list[Part]:
    (agents,) = groups
    in_target, signs = agents.in_target, _signs(agents)
    inside = signs[0][in_target].sum()  # without any, nothing was learned, and nothing is counted
    counts = signs[:, ~in_target].sum(axis=1)
    value, low, high = (float(n) if inside else math.nan for n in counts)
    note = f"{inside} of {in_target.sum()} target cells have one"
    return [Part(agents.scenario, value, low, high, note)]


def _missing_inside(groups: Sequence[Records], _: str) -> list[Part]:
    (agents,) = groups
    value, high, low = map(float, (~_signs(agents)[:, agents.in_target]).sum(axis=1))
    return [Part(agents.scenario, value, low, high)]


def _reaches(groups: Sequence[Records], _: str) -> list[Part]:
    (agents,) = groups
    return [Part(agents.scenario, *proportion(agents.arrays["success"][:, -1] > 0.5))]


def overlap(cells: NDArray[np.bool_], in_target: NDArray[np.bool_]) -> Floats:
    """Returns the intersection over union of sets of cells, (..., O), and the target region."""
    return np.asarray((cells & in_target).sum(axis=-1) / (cells | in_target).sum(axis=-1))


def _mean_map(agents: Records, level: float = LEVEL) -> Estimate:
    """Returns how the mean map overlaps with the target region: measured, least and greatest."""
    in_target, (measured, surely, possibly) = agents.in_target, _signs(agents, level)
    least = np.where(in_target, surely, possibly)
    greatest = np.where(in_target, possibly, surely)
    return Estimate(*(float(overlap(cells, in_target)) for cells in (measured, least, greatest)))


def _random_helps(groups: Sequence[Records], _: str) -> list[Part]:
    level = (1 + LEVEL) / 2  # of each map, so that both intervals are right at once
    s2, s1 = (_mean_map(agents, level) for agents in groups)
    x, y = (overlap(agents.values_ping, agents.in_target) for agents in groups)
    squares = np.array([own.var(ddof=1) / len(own) for own in (x, y)])  # Welch's interval
    error, difference, reach = math.sqrt(squares.sum()), float(x.mean() - y.mean()), 0.0
    if error > 0:
        freedom = squares.sum() ** 2 / (squares**2 / [len(x) - 1, len(y) - 1]).sum()
        reach = float(stats.t.ppf((1 + LEVEL) / 2, freedom)) * error
    mean_map = Part("mean map", s2.value - s1.value, s2.low - s1.high, s2.high - s1.low)
    return [mean_map, Part("own maps", difference, difference - reach, difference + reach)]


def _identifies(groups: Sequence[Records], _: str) -> list[Part]:
    parts = [Part(f"mean map {agents.scenario}", *_mean_map(agents)) for agents in groups]
    for agents in groups:
        valued, in_target = agents.values_ping, agents.in_target
        hits = (valued & in_target).sum(axis=1)
        precision, recall = hits.sum() / max(valued.sum(), 1), hits.mean() / in_target.sum()
        note = f"precision {precision:.2f}, recall {recall:.2f}"  # which explain the overlap
        own = student(overlap(valued, in_target))
        parts.append(Part(f"own maps {agents.scenario}", *own, note))
    return parts


_OVERLAP: Final = """intersection over union of the target region and the cells in which Q of PING
is above zero, in the mean over agents and in each agent's own Q"""
_VARIABILITY: Final = partial(_ratios, _spread)
CLAIMS: Final = (
    Claim(
        "variability-S2", "max Q varies most in S2", ">", 1.0, ("S2", "S1", "S3"), _VARIABILITY,
        """standard deviation of max Q over agents, averaged over steps, as a ratio. The paper
        shades the area from the least to the largest agent instead (`drawn`), which grows with the
        number of agents.""",
    ),
    Claim(
        "max-near-1", "max Q reaches about 1", ">", 0.95, ("S1", "S3"), _near_one,
        """level that an agent's max Q reaches at 1 % of the steps, mean over agents. No PING in S3
        pays more than 1 - 2/14, so this part can only fail; `note` says how near it comes.""",
    ),
    Claim(
        "variability-S3", "max Q varies least in S3", "<", 1.0, ("S3", "S1", "S2"), _VARIABILITY,
        "as in the first claim.",
    ),
    Claim(
        "moves-focused", "moves are most focused in S3", "<", 1.0, ("S3", "S1", "S2"),
        partial(_ratios, _focus),
        """distance to the target region, averaged over cells with the positive mean Q of moves as
        weights, as a ratio.""",
    ),
    Claim(
        "ping-S3", "S3: no cell outside valued", "<", 1.0, ("S3",), _valued_outside,
        "number of cells outside the target region with a mean Q of PING above zero.",
    ),
    Claim(
        "ping-S3-inside", "S3: all target cells valued", "<", 1.0, ("S3",), _missing_inside,
        "number of target cells without one, if the paper's sentence is read literally.",
    ),
    Claim(
        "ping-S1", "S1: cells outside valued", ">", 0.0, ("S1",), _valued_outside,
        "number of cells outside the target region with a mean Q of PING above zero.",
    ),
    Claim(
        "reaches", "S1: the target is reached", ">", 0.95, ("S1",), _reaches,
        """share of agents whose greedy policy after training PINGs in the target region more likely
        than not.""",
    ),
    Claim(
        "random-helps", "random feedback helps", ">", 0.0, ("S2", "S1"), _random_helps,
        f"{_OVERLAP}; S2 minus S1.",
    ),
    Claim(
        "identifies", "S2, S3: region identified", ">", 0.9, ("S2", "S3"), _identifies,
        f"{_OVERLAP}. One cell of sixteen missed gives 0.94, two added give 0.89.",
    ),
    Claim(
        "identifies-S1", "S1: region identified", ">", 0.9, ("S1",), _identifies,
        "the same, where the person gives no feedback.",
    ),
)  # fmt: skip


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
    sign = np.where(parts["right_side"] == ">", 1, -1)
    ends = sign * (parts[["low", "high"]].to_numpy().T - parts["threshold"].to_numpy())
    states = [ends.min(axis=0) > 0, ends.max(axis=0) <= 0]  # neither of NaN
    parts["state"] = np.select(states, ["passes", "fails"], "undecided")
    worst = parts["state"].map(STATES.index).groupby(parts["claim"]).transform("max")
    about = {"agents": len(seeds), "first_seed": seeds[0], "last_seed": seeds[-1]}
    return parts.assign(verdict=worst.map(VERDICTS.__getitem__), **about)


# Tables

_JUDGED: Final = [
    "part", "agents", "value", "low", "high", "right_side", "threshold", "state", "verdict",
]  # fmt: skip
_IN_SETS: Final = [
    "first_seed", "last_seed", "claim", "part", "value", "low", "high", "state", "verdict",
]  # fmt: skip


def _curve_of(data: Data, reading: str) -> str:
    return _CURVES[data.experiment.declared.readings[reading].curve]


def claim_sets(data: Data) -> pd.DataFrame:
    """Every part of every claim in each of the disjoint sets of agents, and the verdicts."""
    reading, _, sets = sets_of(data)
    curve = _curve_of(data, reading)
    parts = [judge(load(data, reading, seeds), curve) for seeds in sets]
    return pd.concat(parts, ignore_index=True)[_IN_SETS]


def claims(data: Data) -> pd.DataFrame:
    """Every part of every claim with its interval, state and verdict, by the number of agents."""
    curve = _curve_of(data, sets_of(data)[0])
    parts = pd.concat(judge(agents, curve) for agents in few_and_all(data))
    ids = [claim.id for claim in CLAIMS]
    parts = parts.sort_values("claim", key=lambda of: of.map(ids.index), kind="stable")
    verdicts = data.tables["claim_sets"].drop_duplicates(["first_seed", "claim"])
    counts = verdicts.groupby(["claim", "verdict"]).size()
    judged = pd.MultiIndex.from_frame(parts[["claim", "verdict"]])
    parts["sets"] = verdicts["first_seed"].nunique()
    parts["sets_agreeing"] = counts.reindex(judged, fill_value=0).to_numpy()
    return parts[["claim", *_JUDGED, "note", "drawn", "sets", "sets_agreeing"]]


def sensitivity(data: Data) -> pd.DataFrame:
    """Every part of every claim, its state and the verdict, under every reading of the paper."""
    seeds = sets_of(data)[2][0]
    parts = [
        judge(load(data, name, seeds), _curve_of(data, name)).assign(reading=name)
        for name in data.experiment.declared.readings
    ]
    return pd.concat(parts, ignore_index=True)[["claim", "reading", *_JUDGED]]


def max_q(data: Data) -> pd.DataFrame:
    """Maximum Q over agents at every recorded step, of the visited cell and of the table."""
    frames = []
    for name, agents in few(data).items():
        visited, table = (_over_agents(agents.arrays[key]) for key in _CURVES.values())
        every = agents.run.settings.model_dump()["record_every"]
        columns = {"scenario": name, "step": np.arange(len(visited["mean"])) * every} | visited
        columns |= {f"table_{key}": table[key] for key in ("mean", "min", "max")}
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def learning(data: Data) -> pd.DataFrame:
    """Success, score of the greedy policy, and the share of optimal agents, over training."""
    frames = []
    for name, agents in few(data).items():
        scores = agents.unbounded_scores()
        columns = {"scenario": name, "step": agents.evaluation_steps}
        columns |= with_ends("success", proportion(agents.arrays["success"]))
        columns |= with_ends("score", proportion(np.clip(scores, 0.0, 1.0)))
        columns |= with_ends("optimal_share", proportion(scores >= _OPTIMUM))
        frames.append(pd.DataFrame(columns | {"unbounded_score": scores.mean(axis=0)}))
    return pd.concat(frames, ignore_index=True)


def optimal(data: Data) -> pd.DataFrame:
    """The exact optimum, what was learned, success and regret, by the number of agents."""
    groups = few_and_all(data)
    return pd.DataFrame(_reached(agents) for some in groups for agents in some.values())


def _reached(agents: Records) -> dict[str, object]:
    """Returns what the greedy policies reach after training, and the exact anchors."""
    model, q, seeds = agents.model, agents.arrays["q"], agents.seeds
    row: dict[str, object] = {"scenario": agents.scenario, "agents": len(seeds)}
    row |= {"first_seed": seeds[0], "last_seed": seeds[-1]}
    row |= with_ends("success", proportion(agents.arrays["success"][:, -1]))
    row |= with_ends("optimal_share", proportion(agents.unbounded_scores()[:, -1] >= _OPTIMUM))
    for name in ("grid_return", "scenario_return"):
        random, best = anchors(model, agents.run.horizon, name)
        learned = agents.arrays[name][:, -1].mean()
        row |= {f"{name}_random": random, f"{name}_optimal": best, f"{name}_learned": learned}
        row[f"{name}_regret"] = best - learned
    start = model.observation[model.start]
    row["start_value_optimal"] = optimal_values(agents).max(axis=1)[start]
    row["start_value_learned"] = q.max(axis=-1).mean(axis=0)[start]
    row["cells_differing"] = _differing(agents)[~model.is_over[model.fresh_state]].mean()
    return row


def q_values(data: Data) -> pd.DataFrame:
    """Final Q over agents and Q* of every cell and action, and where policies differ."""
    frames = []
    for name, agents in few(data).items():
        best, q = optimal_values(agents), agents.arrays["q"]
        row, column = agents.model.position.repeat(len(ACTIONS), axis=0).T
        columns = {"scenario": name, "row": row, "column": column}
        columns["action"] = np.tile(ACTIONS, len(best))
        values = _over_agents(q) | {"optimal": best, "difference": q.mean(axis=0) - best}
        values["is_optimal"] = contains(greedy_masks(best, OPTIMUM_TOLERANCE))
        columns |= {key: array.ravel() for key, array in values.items()}
        columns["largest_learned"] = q.max(axis=-1).mean(axis=0).repeat(len(ACTIONS))
        columns["differs"] = _differing(agents).repeat(len(ACTIONS))
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def _over_agents(values: Floats) -> dict[str, Floats]:
    """Returns statistics over N agents of their (N, ...) values."""
    spread = {"std": values.std(axis=0, ddof=1), "min": values.min(axis=0)}
    return {"mean": values.mean(axis=0), **spread, "max": values.max(axis=0)}


def _differing(agents: Records) -> Floats:
    """Returns the share of agents whose greedy action is not optimal, (O,); ties count in part."""
    best = contains(greedy_masks(optimal_values(agents), OPTIMUM_TOLERANCE))  # (O, A)
    greedy = contains(agents.arrays["greedy"][:, -1])  # (N, O, A)
    wrong = (greedy & ~best).sum(axis=-1) / greedy.sum(axis=-1)
    return np.asarray(wrong.mean(axis=0))


# Figures

_SIGNS: Final = dict(zip(VERDICTS, ("✓", "?", "✗"), strict=True))
_COLOURS: Final = dict(zip(VERDICTS, (COLOURS[9], "#f7ecc3", COLOURS[3]), strict=True))
_BLOCK: Final = 5  # records of a curve that share a point of the figure
_OF_BLOCK: Final = {"step": "first", "mean": "mean", "min": "min", "max": "max"}


def figure(data: Data) -> Figure:
    """As in the paper's figure: max Q over training, final Q of the moves and of PING."""
    curves, values = data.tables["max_q"], data.tables["q_values"]
    is_ping = values["action"] == "PING"
    norms = norm_of(values["mean"][~is_ping]), norm_of(values["mean"][is_ping])
    models = [compile_scenario(data.experiment.scenarios[name]) for name in SCENARIOS]
    with figure_of(3, len(models), (WIDTH, 7.8)) as (figure, axes):
        for column, model in enumerate(models):
            name, kind = model.scenario.name, model.scenario.issuer.feedback.kind
            top, *maps = axes[:, column]
            own, letters = values["scenario"] == name, ascii_lowercase[column:9:3]  # as the paper's
            _draw_curve(top, curves[curves["scenario"] == name], budget_of(data)[1])
            top.set(title=f"{name}: {FEEDBACK.get(kind, kind)}\n({letters[0]}) max Q over training")
            triangles(maps[0], scene_of(model), values[own & ~is_ping], norms[0])
            pings = values[own & is_ping]
            heat(maps[1], scene_of(model), pings["mean"].to_numpy(), norms[1])
            learned = pings[pings["mean"] > 0]
            dots(maps[1], learned["row"], learned["column"])
            maps[0].set(title=f"({letters[1]}) final Q of moves")
            maps[1].set(title=f"({letters[2]}) final Q of PING")
        _name_curves(axes[0], curves)
        for row, norm in zip(axes[1:], norms, strict=True):
            colour_bar(figure, row, norm, "mean over agents")
        arrow = {"marker": ">", "mfc": "0.7", "mec": "none", "ms": 7}
        dot = {"marker": "o", "color": "black", "ms": 3}
        marks = {"the move that way": arrow, "mean Q of PING > 0": dot}
        handles = [Line2D([], [], ls="", label=label, **mark) for label, mark in marks.items()]
        region_legend(figure, [scene_of(model) for model in models], *handles, columns=3)
    return figure


def _draw_curve(axis: Axes, curve: pd.DataFrame, unit: str) -> None:
    curve = curve.groupby(np.arange(len(curve)) // _BLOCK).agg(_OF_BLOCK)
    axis.fill_between(curve["step"], curve["min"], curve["max"], color="0.8", lw=0)
    axis.plot(curve["step"], curve["mean"], color="black", lw=0.9)
    axis.axhline(1.0, color="0.35", lw=0.8, ls=":")
    axis.set(xlabel=f"{unit} of training", xlim=(0, max(curve["step"].max(), 1)))
    axis.xaxis.set_major_locator(MaxNLocator(3))


def _name_curves(axes: Sequence[Axes], curves: pd.DataFrame) -> None:
    bottom, top = curves["min"].min(), curves["max"].max()
    room = 0.04 * (top - bottom)
    for axis in axes:
        axis.set(ylim=(bottom - room, top + room))
    last = curves[curves["scenario"] == SCENARIOS[0]].iloc[-1]
    axes[0].set(ylabel="max Q of the visited cell")
    middle = (last["mean"] + last["max"]) / 2
    texts = {
        "a correct PING in S1": (1.0 + room, "bottom"),
        "range over agents ": (middle, "baseline"),
        "mean ": (last["mean"] - 2 * room, "top"),
    }
    for text, (height, side) in texts.items():
        axes[0].text(last["step"], height, text, va=side, ha="right", fontsize="small")


def sensitivity_figure(data: Data) -> Figure:
    """Whether the claims hold, by how the paper is read."""
    table, readings = data.tables["sensitivity"], data.experiment.declared.readings
    verdicts = table.groupby(["claim", "reading"])["verdict"].first()  # the same of all parts
    looks = {verdict: (_SIGNS[verdict], to_hex(_COLOURS[verdict])) for verdict in VERDICTS}
    cells = [[looks[verdicts[claim.id, name]] for name in readings] for claim in CLAIMS]
    columns = [fill(reading.title or name, 9) for name, reading in readings.items()]
    with figure_of(1, 1, (WIDTH, 0.3 * len(CLAIMS) + 1.1)) as (figure, axes):
        draw_cells(axes[0, 0], cells, [claim.title for claim in CLAIMS], columns)
        text = ", ".join(f"{sign} {verdict}" for verdict, sign in _SIGNS.items())
        label = f"{text}, with {table['agents'].iloc[0]} agents per scenario"
        figure.supxlabel(label, fontsize="small")
    return figure


# Text

TABLES: Final = {
    "claim_sets": claim_sets,
    "claims": claims,
    "sensitivity": sensitivity,
    "learning": learning,
    "optimal": optimal,
    "max_q": max_q,
    "q_values": q_values,
}
FIGURES: Final = {"figure": figure, "sensitivity": sensitivity_figure}
SHOWN: Final = {
    "optimal": "scenario agents success optimal_share grid_return_learned grid_return_optimal cells_differing"
}
COLUMNS: Final = {
    "agents": "agents per scenario",
    "cells_differing": "share of cells in which a greedy action is not optimal, mean over agents",
    "claim": "claim of the paper",
    "difference": "`mean` minus `optimal`",
    "differs": "share of agents whose greedy action in the cell is not optimal",
    "drawn": "what the paper's figure shows instead of `value`",
    "first_seed": "seed of the first agent",
    "high": "upper end of its 95 % interval",
    "is_optimal": "whether the action is optimal in the cell",
    "largest_learned": "largest Q in the cell, mean over agents",
    "last_seed": "seed of the last agent",
    "low": "lower end of its 95 % interval",
    "max": "largest over agents",
    "mean": "mean over agents",
    "min": "smallest over agents",
    "note": "more about the part",
    "optimal": "optimal action value, see Q* above",
    "optimal_share": "share of agents whose greedy policy is optimal from the start cell",
    "part": "number of the claim",
    "reading": "reading of the paper",
    "right_side": "side of the threshold on which the part must lie",
    "sets": "disjoint sets of agents, each of as many as the paper has",
    "sets_agreeing": "sets with the same verdict on the claim",
    "start_value_learned": "largest Q in the start cell, mean over agents",
    "start_value_optimal": "optimal value of the start cell",
    "state": "whether the part passes, fails or is undecided",
    "std": "sample standard deviation over agents",
    "threshold": "threshold",
    "value": "the number",
    "verdict": "verdict on the claim",
}


def budget_of(data: Data) -> tuple[str, str]:
    """Returns the budget of the default reading, and its unit."""
    settings = data.experiment.populations[0].first.settings.model_dump()
    return f"{settings['budget']:,}", settings["budget_unit"].removesuffix("s")


def headline(data: Data) -> str:
    """Counts the verdicts on the claims, with all agents."""
    table, (budget, unit) = data.tables["claims"], budget_of(data)
    (learner,) = data.experiment.learners.values()
    n_agents = table["agents"].max()
    verdicts = table[table["agents"] == n_agents].drop_duplicates("claim")["verdict"]
    counts = ", ".join(f"*{name}*: {(verdicts == name).sum()}" for name in VERDICTS)
    trained = f"{learner.title}, {n_agents:,} agents per scenario, {budget} {unit}s of training"
    return f"Verdicts on the paper's {len(verdicts)} claims by 95 % intervals ({trained}): {counts}."


def reading(data: Data) -> str:
    """Says what claims mean and how they are measured."""
    agents = data.tables["claims"]["agents"]
    claims_of = "\n".join(f"- {_verdict(data, claim)}: {claim.about}" for claim in CLAIMS)
    readings = "\n".join(
        f"- *{each.title or name}* (`{name}`): {each.question} {each.answer[:1].upper()}{each.answer[1:]}."
        for name, each in data.experiment.declared.readings.items()
    )
    return f"""\
A part of a claim passes if its 95 % interval lies on the right side of the threshold, and fails if
it lies on the wrong side. A claim holds if all its parts pass, does not hold if one fails, and is
undecided otherwise. Of all thresholds, only "around 1" is the paper's. Figures show {agents.min():,}
agents per scenario.

{claims_of}

Readings of the paper, and controls:

{readings}

**Terms.** A score is the undiscounted sum of the grid's rewards, scaled between the exact random
policy (0) and the optimum (1), both within {data.experiment.declared.horizon:,} steps, and clipped
to [0, 1] unless it is called unbounded. Q* are the values of an agent that knows how many PINGs were
wrong, with none so far. That number is hidden from the learner, so Q need not converge to Q*.
Intervals of shares, success and scores are exact binomial ones; those of ratios and levels are
percentile bootstrap intervals over agents; those of agents' own maps are Student's, and Welch's for
differences. Counts and overlaps of cells have simultaneous intervals of all cells' means, by
Student's t with Bonferroni's correction."""


def _verdict(data: Data, claim: Claim) -> str:
    """Returns a claim with its verdict, with all agents."""
    table = data.tables["claims"]
    row = table[table["claim"] == claim.id].iloc[-1]
    verdict = f"*{row['verdict']}* with {row['agents']:,} agents"
    if row["sets"] > 1:
        size = table["agents"].min()
        verdict += f" and in {row['sets_agreeing']} of {row['sets']} sets of {size:,}"
    return f"{claim.title} (`{claim.id}`) {verdict}"
