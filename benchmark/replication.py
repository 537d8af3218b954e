"""Which of the paper's claims hold?

A claim has parts, each a number with a 95 % interval and a threshold. A part passes if its interval
lies on the right side of the threshold, fails if it lies on the wrong side, and is undecided
otherwise. A claim holds if all its parts pass, and does not hold if one of them fails.

Numbers that depend on which cells have a mean above zero use simultaneous intervals of all cells'
means: a resampled count of signs is biased, since noise moves means near zero across it more often
in one direction than in the other.

The tables are made of stored records, since action values are not published.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from textwrap import fill
from typing import Any, NamedTuple
from warnings import catch_warnings

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from scipy import stats

from benchmark.experiment import DEFAULT_CONDITION as DEFAULT
from benchmark.experiment import Experiment
from benchmark.records import OPTIMUM_TOLERANCE, Records, load_records
from benchmark.scenes import colour_bar, dots, heat, region_legend, triangles
from benchmark.statistics import (
    LEVEL,
    Floats,
    Numbers,
    interval,
    proportion,
    resample,
    student,
    with_ends,
)
from benchmark.store import Store
from benchmark.study import Data, Report, described
from benchmark.style import WIDTH, draw_cells, figure_of, norm_of
from envs import ACTIONS, InputError, compile_scenario, load_scenario
from envs.model import PING
from envs.people import FEEDBACK
from envs.regions import target_distance
from envs.scene import scene_of
from envs.words import listed

Agents = Mapping[str, Records]  # of one reading of the paper, by scenario

READS_STORE = True  # action values are not published
SCENARIOS = ("S1", "S2", "S3")  # the paper's, which its claims are about
VERDICTS = {
    "holds": ("✓", "#56b4e9"),
    "undecided": ("?", "#f7ecc3"),
    "does not hold": ("✗", "#d55e00"),
}
"""The verdicts on a claim, each with its sign and colour."""
_OPTIMUM = 1 - OPTIMUM_TOLERANCE  # the score of an optimal policy
_CURVES = {"visited": "max_q", "table": "table_max_q"}  # array of each curve of a reading


def check(experiment: Experiment, _: Report) -> None:
    """Refuses all but one table, which records the maximum Q, in the paper's scenarios."""
    first, *others = experiment.learners.values()
    default = {each.scenario for each in experiment.populations if each.condition.name == DEFAULT}
    is_table = not others and "record_every" in first.algorithm.settings.model_fields
    if not is_table or default != {*map(load_scenario, SCENARIOS)}:
        accepted = f"one table that records max Q, in {listed(SCENARIOS)}, with a default reading"
        raise InputError(f"{experiment.argument}: accepted in a replication: {accepted}.")


# The agents


@lru_cache(maxsize=1)  # tables share them
def load(data: Data) -> Mapping[str, Agents]:
    """Reads the records of all agents, by reading; the default one comes first."""
    if data.store is None:
        what = "action values are not published"
        raise InputError(f"{data.experiment.argument}: {what}: run the experiment first.")
    found: dict[str, dict[str, Records]] = {}
    seeds = data.runs.groupby(["reading", "scenario"])["seed"]
    with Store(data.store) as store:
        for each in data.experiment.populations:
            reading, scenario = each.condition.name, each.scenario.name
            runs = each.runs(seeds.get_group((reading, scenario)))
            found.setdefault(reading, {})[scenario] = load_records(runs, store)
    return found


def sets_of(data: Data, reading: str = DEFAULT) -> list[Agents]:
    """Returns disjoint sets of the agents of a reading, as large as the paper's, and all agents.

    Figures show the first set. If there are not enough agents for two sets, all are the only one.
    """
    everyone, (learner,) = load(data)[reading], data.experiment.learners.values()
    size, total = learner.declared.seeds, len(everyone[SCENARIOS[0]].seeds)
    starts = range(0, total - size + 1, size)
    if len(starts) < 2:
        return [everyone]
    sets = [{name: agents.subset(i, i + size) for name, agents in everyone.items()} for i in starts]
    return [*sets, everyone]


# The claims


class Part(NamedTuple):
    """One number of a claim, with its 95 % interval; without a number, NaN."""

    part: str  # its name
    value: Numbers
    low: Numbers
    high: Numbers


class Claim(NamedTuple):
    """A claim of the paper. Each of its measures takes each group of scenarios."""

    id: str
    title: str  # in a few words
    right_side: str  # ">" or "<": where a part must lie
    threshold: float
    groups: str  # of scenarios, as in "S2/S1 S2/S3"
    measures: Sequence[Callable[..., Part]]  # of a curve and of a group
    about: str  # for readers: how it is measured


def _means(agents: Records, values: Floats) -> Floats:
    """Returns means over agents of (N, ...) values, resampled: (RESAMPLES + 1, the rest)."""
    n = len(values)
    return resample(n, agents.scenario) @ values.reshape(n, -1) / n


def _spread(curve: str, agents: Records) -> Floats:
    """Returns the standard deviation over agents, mean over steps."""
    curves = agents.arrays[curve]
    variance = _means(agents, curves**2) - _means(agents, curves) ** 2
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)).mean(axis=1))


def _focus(_: str, agents: Records) -> Floats:
    """Returns cells' mean distance from the target, weighted by positive mean Q of moves."""
    mass = np.maximum(_means(agents, agents.arrays["q"][:, :, :PING]), 0.0)
    mass = mass.reshape(len(mass), -1, PING).sum(axis=-1)  # (RESAMPLES + 1, O)
    scenario = agents.model.scenario
    start = scenario.layout.places[0][0]
    distance = target_distance(scenario.regions, start, scenario.grid.size)
    return np.asarray(mass @ distance / mass.sum(axis=1))


@np.errstate(divide="ignore", invalid="ignore")  # infinity or NaN, if nothing has been learned
def _ratio(measure: Callable[[str, Records], Floats], curve: str, x: Records, y: Records) -> Part:
    ratio = measure(curve, x) / measure(curve, y)
    return Part(f"{x.scenario}/{y.scenario}", ratio[0], *interval(ratio))


def _near_one(curve: str, agents: Records) -> Part:
    samples = _means(agents, np.percentile(agents.arrays[curve], 99, axis=1))[:, 0]
    return Part(agents.scenario, samples[0], *interval(samples))


def _signs(agents: Records, level: float = LEVEL) -> NDArray[np.bool_]:
    """Returns where PING's mean Q is above zero: as measured, surely, and possibly, (3, O).

    The latter two hold for all cells at once, with a confidence of `level`.
    """
    q = agents.arrays["q"][:, :, PING]
    return np.stack(student(q, level, q.shape[1])) > 0


def _valued_outside(_: str, agents: Records) -> Part:
    in_target, signs = agents.in_target, _signs(agents)
    has_learned = signs[0, in_target].any()
    counts = np.where(has_learned, signs[:, ~in_target].sum(axis=1), np.nan)
    return Part(agents.scenario, *counts)


def _missing_inside(_: str, agents: Records) -> Part:
    counts = (~_signs(agents)[:, agents.in_target]).sum(axis=1)
    return Part(agents.scenario, *counts[[0, 2, 1]])


def _reaches(_: str, agents: Records) -> Part:
    return Part(agents.scenario, *proportion(agents.arrays["success"][:, -1] > 0.5))


def overlap(cells: NDArray[np.bool_], in_target: NDArray[np.bool_]) -> Floats:
    """Returns the intersection over union of sets of cells, (..., O), and the target region."""
    return np.asarray((cells & in_target).sum(axis=-1) / (cells | in_target).sum(axis=-1))


def _overlap_of_mean(agents: Records, level: float = LEVEL) -> Floats:
    """Returns the overlap of the mean map: as measured, the least and the greatest."""
    in_target, (measured, surely, possibly) = agents.in_target, _signs(agents, level)
    least = np.where(in_target, surely, possibly)
    greatest = np.where(in_target, possibly, surely)
    return overlap(np.stack([measured, least, greatest]), in_target)


def _mean_map(_: str, agents: Records) -> Part:
    return Part(f"mean map {agents.scenario}", *_overlap_of_mean(agents))


def _own_maps(_: str, agents: Records) -> Part:
    overlaps = overlap(agents.values_ping, agents.in_target)
    return Part(f"own maps {agents.scenario}", *student(overlaps))


def _mean_maps_differ(_: str, *both: Records) -> Part:
    level = (1 + LEVEL) / 2  # of each map, so that both intervals are right at once
    x, y = (_overlap_of_mean(agents, level) for agents in both)
    return Part("mean map", *(x - y[[0, 2, 1]]))


def _own_maps_differ(_: str, *both: Records) -> Part:
    x, y = (overlap(agents.values_ping, agents.in_target) for agents in both)
    difference = x.mean() - y.mean()
    with catch_warnings(action="ignore"):  # of equal values
        ends = stats.ttest_ind(x, y, equal_var=False).confidence_interval(LEVEL)  # Welch's
    return Part("own maps", difference, *np.nan_to_num(ends, nan=difference))


_VARIABILITY = (partial(_ratio, _spread),)
CLAIMS = (
    Claim(
        "variability-S2", "max Q varies most in S2", ">", 1.0, "S2/S1 S2/S3",
        _VARIABILITY,
        "standard deviation of max Q over agents, mean over steps, as a ratio",
    ),
    Claim(
        "max-near-1", "max Q reaches about 1", ">", 0.95, "S1 S3", (_near_one,),
        "level that an agent's max Q reaches in 1 % of steps; in S3 no PING pays more than 0.857",
    ),
    Claim(
        "variability-S3", "max Q varies least in S3", "<", 1.0, "S3/S1 S3/S2",
        _VARIABILITY, "the same ratios of standard deviations",
    ),
    Claim(
        "moves-focused", "moves are most focused in S3", "<", 1.0, "S3/S1 S3/S2",
        (partial(_ratio, _focus),),
        "mean distance to the target region, weighted by positive mean Q of moves, as a ratio",
    ),
    Claim(
        "ping-S3", "S3: no cell outside valued", "<", 1.0, "S3", (_valued_outside,),
        "cells outside the target region with a mean Q of PING above zero",
    ),
    Claim(
        "ping-S3-inside", "S3: all target cells valued", "<", 1.0, "S3", (_missing_inside,),
        "target cells where it is not",
    ),
    Claim(
        "ping-S1", "S1: cells outside valued", ">", 0.0, "S1", (_valued_outside,),
        "cells outside the target region where it is",
    ),
    Claim(
        "reaches", "S1: the target is reached", ">", 0.95, "S1", (_reaches,),
        "agents whose greedy policy PINGs in the target region more likely than not",
    ),
    Claim(
        "random-helps", "random feedback helps", ">", 0.0, "S2/S1",
        (_mean_maps_differ, _own_maps_differ),
        "overlap of the cells with Q of PING above zero and the target region (intersection over "
        "union), S2 minus S1",
    ),
    Claim(
        "identifies", "S2, S3: region identified", ">", 0.9, "S2 S3",
        (_mean_map, _own_maps),
        "the same overlap, by mean Q and by each agent's own",
    ),
    Claim(
        "identifies-S1", "S1: region identified", ">", 0.9, "S1", (_mean_map, _own_maps),
        "the same",
    ),
)  # fmt: skip


def judge(agents: Agents, curve: str, claims: Sequence[Claim] = CLAIMS) -> pd.DataFrame:
    """Returns the parts of claims, each with its state and the verdict on its claim.

    Args:
      agents: All of one reading, or some; by scenario.
      curve: Array of the curve of maximum Q that claims are about.
      claims: All claims, or some.
    """
    seeds = agents[SCENARIOS[0]].seeds
    parts = pd.DataFrame(
        {"claim": claim.id, "agents": len(seeds), "first_seed": seeds[0]}
        | measure(curve, *(agents[name] for name in group.split("/")))._asdict()
        | {"right_side": claim.right_side, "threshold": claim.threshold}
        for claim in claims
        for measure in claim.measures
        for group in claim.groups.split()
    )
    sign = np.where(parts["right_side"] == ">", 1, -1)
    ends = sign * (parts[["low", "high"]].to_numpy().T - parts["threshold"].to_numpy())
    state = np.select([ends.min(axis=0) > 0, ends.max(axis=0) <= 0], [0, 2], 1)  # 1 of NaN
    parts["state"] = np.take(["passes", "undecided", "fails"], state)
    worst = pd.Series(state).groupby(parts["claim"]).transform("max")
    return parts.assign(verdict=np.take([*VERDICTS], worst))


# Tables


def claims(data: Data) -> pd.DataFrame:
    """The parts of all claims, by reading, in sets of agents as large as the paper's and in all."""
    parts = [
        judge(agents, _CURVES[reading.curve]).assign(reading=name)
        for name, reading in data.experiment.declared.readings.items()
        for agents in sets_of(data, name)
    ]
    return pd.concat(parts, ignore_index=True)


def verdicts_of(table: pd.DataFrame) -> pd.DataFrame:
    """Returns the verdicts on claims, a column for each, by reading, agents and first seed."""
    keys = ["reading", "agents", "first_seed"]
    return table.pivot_table("verdict", keys, "claim", aggfunc="first", sort=False)


def optimal(data: Data) -> pd.DataFrame:
    """Greedy policies after training, with as many agents as in the paper and with all."""
    sets = sets_of(data)
    return pd.DataFrame(
        {
            "scenario": name,
            "agents": len(agents.seeds),
            "step": agents.evaluation_steps[-1],
            **with_ends("success", proportion(agents.arrays["success"][:, -1])),
            **with_ends("optimal_share", proportion(agents.unbounded_scores()[:, -1] >= _OPTIMUM)),
        }
        for some in dict.fromkeys([0, len(sets) - 1])
        for name, agents in sets[some].items()
    )


def max_q(data: Data) -> pd.DataFrame:
    """Maximum Q of the visited cell over training."""
    frames = []
    for name, agents in sets_of(data)[0].items():
        every = agents.run.settings.model_dump()["record_every"]
        curves = agents.arrays["max_q"]
        steps = np.arange(curves.shape[1]) * every
        frames.append(_over_agents({"scenario": name, "step": steps}, curves))
    return pd.concat(frames, ignore_index=True)


def q_values(data: Data) -> pd.DataFrame:
    """Final Q of every cell and action."""
    frames = []
    for name, agents in sets_of(data)[0].items():
        row, column = agents.model.position.repeat(len(ACTIONS), axis=0).T
        where = {"row": row, "column": column, "action": np.resize(ACTIONS, len(row))}
        frames.append(_over_agents({"scenario": name, **where}, agents.arrays["q"]))
    return pd.concat(frames, ignore_index=True)


def _over_agents(keys: Mapping[str, Any], values: Floats) -> pd.DataFrame:
    """Returns columns of keys, and of statistics over N agents of their (N, ...) values."""
    statistics = {
        "mean": values.mean(axis=0),
        "std": values.std(axis=0, ddof=1),
        "min": values.min(axis=0),
        "max": values.max(axis=0),
    }
    return pd.DataFrame({**keys, **{name: each.ravel() for name, each in statistics.items()}})


# Figures

_THINNED = 5  # every so many records of a curve are drawn


def figure(data: Data) -> Figure:
    """As in the paper's figure: max Q over training, final Q of the moves and of PING."""
    values = data.tables["q_values"]
    models = [compile_scenario(load_scenario(name)) for name in SCENARIOS]
    is_ping = values["action"] == "PING"
    shown = values[~is_ping], values[is_ping]
    norms = [norm_of(each["mean"]) for each in shown]
    with figure_of(3, len(models), (WIDTH, 7.8)) as (figure, axes):
        for (top, moves, pings), model in zip(axes.T, models, strict=True):
            name, kind = model.scenario.name, model.scenario.issuer.feedback.kind
            moved, pinged = (each[each["scenario"] == name] for each in shown)
            scene = scene_of(model)
            top.sharey(axes[0, 0])
            _draw_curve(top, data, name)
            top.set_title(f"{name}: {FEEDBACK[kind]}")
            triangles(moves, scene, moved, norms[0])
            heat(pings, scene, pinged["mean"].to_numpy(), norms[1])
            learned = pinged[pinged["mean"] > 0]
            dots(pings, learned["row"], learned["column"])
        axes[0, 0].set(ylabel="max Q of the visited cell")
        for row, norm, of in zip(axes[1:], norms, ("moves", "PING"), strict=True):
            colour_bar(figure, row, norm, f"final mean Q of {of}")
        arrow = Line2D([], [], ls="", marker=">", color="0.7", label="the move that way")
        dot = Line2D([], [], ls="", marker="o", color="black", ms=3, label="mean Q of PING > 0")
        lines, _ = axes[0, 0].get_legend_handles_labels()
        region_legend(figure, [scene_of(models[0])], arrow, dot, *lines, columns=3)
    return figure


def _draw_curve(axis: Axes, data: Data, scenario: str) -> None:
    table = data.tables["max_q"]
    curve = table[table["scenario"] == scenario][::_THINNED]
    steps = curve["step"]
    axis.plot(steps, curve["mean"], color="black", lw=0.9, label="mean over agents")
    axis.fill_between(
        steps, curve["min"], curve["max"], color="0.8", lw=0, label="range over agents"
    )
    axis.axhline(1.0, color="0.35", lw=0.8, ls=":", label="a correct PING in S1")
    axis.set_xlabel(f"training ({budget_of(data)})")
    axis.margins(x=0)
    axis.locator_params(axis="x", nbins=3)


def sensitivity_figure(data: Data) -> Figure:
    """Whether the claims hold, by how the paper is read."""
    readings = data.experiment.declared.readings
    verdicts = verdicts_of(data.tables["claims"]).groupby("reading").first()  # of the first sets
    cells = [[VERDICTS[verdicts[claim.id][name]] for name in readings] for claim in CLAIMS]
    columns = [fill(reading.title or name, 9) for name, reading in readings.items()]
    with figure_of(1, 1, (WIDTH, 0.3 * len(CLAIMS) + 1.1)) as (figure, axes):
        draw_cells(axes[0, 0], cells, [claim.title for claim in CLAIMS], columns)
        signs = ", ".join(f"{sign} {verdict}" for verdict, (sign, _) in VERDICTS.items())
        label = f"{signs}, with {data.tables['claims']['agents'].iloc[0]} agents per scenario"
        figure.supxlabel(label, fontsize="small")
    return figure


# Text

TABLES = {"claims": claims, "optimal": optimal, "max_q": max_q, "q_values": q_values}
FIGURES = {"figure": figure, "sensitivity": sensitivity_figure}
SHOWN = {"optimal": "scenario agents success optimal_share"}
COLUMNS = described("""\
action: action
agents: agents per scenario
column: column of the cell
claim: claim of the paper
first_seed: seed of the first agent
high: upper end of its 95 % interval, see `low`
max: largest over agents
mean: mean over agents
min: smallest over agents
optimal_share: share of agents whose greedy policy is optimal from the start cell
part: number of the claim
row: row of the cell
right_side: side of the threshold on which the part must lie
state: whether the part passes, fails or is undecided
std: sample standard deviation over agents
threshold: threshold
value: what is measured
verdict: verdict on the claim
""") | {
    "low": """\
lower end of its 95 % interval: bootstrap percentiles for ratios and levels, Student's t for own
maps, Welch's for differences, simultaneous intervals of all cells' means for counts of cells"""
}


def budget_of(data: Data) -> str:
    """Returns the budget of the default reading, such as "10,000 steps"."""
    settings = data.experiment.populations[0].first.settings.model_dump()
    return f"{settings['budget']:,} {settings['budget_unit']}"


def headline(data: Data) -> str:
    """Counts the verdicts on the claims, with all agents."""
    n_agents, (learner,) = data.tables["claims"]["agents"].max(), data.experiment.learners.values()
    verdicts = verdicts_of(data.tables["claims"]).loc[DEFAULT].iloc[-1]  # with all agents
    counts = ", ".join(f"*{name}*: {(verdicts == name).sum()}" for name in VERDICTS)
    trained = f"{learner.title}, {n_agents:,} agents per scenario, {budget_of(data)} of training"
    return f"Verdicts on the paper's claims by 95 % intervals ({trained}): {counts}."


def reading(data: Data) -> str:
    """Says what claims mean and how they are measured."""
    few, all_agents = data.tables["claims"]["agents"].agg(["min", "max"])
    verdicts = verdicts_of(data.tables["claims"]).loc[DEFAULT]
    last, sets = verdicts.iloc[-1], verdicts.loc[few]
    claims_of = "\n".join(
        f"- {title} (`{name}`, *{last[name]}*, "
        f"{(sets[name] == last[name]).sum()}/{len(sets)}): {about}."
        for name, title, *_, about in CLAIMS
    )
    readings = "\n".join(
        f"- {each.title or name}: {each.answer}."
        for name, each in data.experiment.declared.readings.items()
        if name != DEFAULT
    )
    return f"""\
A part of a claim passes if its 95 % interval lies on the right side of the threshold, and fails if
it lies on the wrong side. A claim holds if all parts pass, does not hold if one fails, and is
undecided otherwise. Of all thresholds, only "around 1" is the paper's. Figures show {few:,} agents
per scenario. Verdicts below are with {all_agents:,}; the fractions say in how many of the disjoint
sets of {few:,} they are the same.

{claims_of}

Other readings of the paper, and controls:

{readings}"""
