"""Says in plain sentences what a comparison found; every word that judges follows from a number.

A number is a Markdown link to the rows of the table that it comes from, `[0.63](summary.csv#row=13)`; rows
are counted as by RFC 7111, the header being the first.
Scores are told as means over runs, which show a run that fails, as interquartile means do not. Two learners
differ if the 95 % interval of the probability that a run of one outscores a run of the other leaves out one
half; else they cannot be told apart.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import pandas as pd

from benchmark.analysis.population import GOOD_SCORE
from benchmark.drawing.tables import link
from benchmark.reports.comparison.tables import Grid, Learner

Frames = Mapping[str, pd.DataFrame]  # the tables of `benchmark.reports.comparison.tables`, by name

_TOLD: Final = 3  # nets that are named as the best


def sentences(grid: Grid, frames: Frames) -> list[str]:
    """Returns the headline and ten sentences with their figures; none if there is nothing to compare."""
    tables = [learner for learner in grid.learners if _first(grid, learner)["algorithm"] == "q_learning"]
    nets = [learner for learner in grid.learners if learner not in tables]
    if not tables or not nets:
        return []
    best_table, best_net = (max(group, key=lambda one: _mean(frames, one)) for group in (tables, nets))
    written = (
        _headline(grid, frames, best_table, best_net, nets),
        _tables(grid, frames, tables),
        _best_net(frames, list(dict.fromkeys((tables[0], best_table))), nets, best_net),
        _observations(grid, frames, nets),
        _linear(grid, frames, nets),
        _defaults(frames, nets),
        _threshold(frames, [*tables, best_net]),
        _cost(frames, tables[0], best_net),
        _every_cell(grid, frames, [*tables, best_net]),
        _region(frames, tables, nets),
        _disagreements(frames, [*tables, best_net]),
    )
    return [sentence for sentence in written if sentence]


def _headline(grid: Grid, frames: Frames, table: Learner, best_net: Learner, nets: Sequence[Learner]) -> str:
    """Says in a sentence or two whether deep RL earned its keep."""
    budget = _first(grid, table)["settings"]["budget"]
    better = [net for net in nets if _improvement(frames, net, table)["low"] > 0.5]
    cheap, dear = _row(frames, "cost", table), _row(frames, "cost", best_net)
    told = ", ".join(f"`{net}`" for net in better)
    return (
        f"With {budget:,} environment steps deep RL {'earns' if better else 'does not earn'} its keep over "
        f"a table here: {f'{told} does better' if better else 'no net does better'} than the best table, "
        f"`{table.algorithm}`, which has a mean score of {_score(frames, table)}. The net with the highest "
        f"mean score, `{best_net}`, has {_score(frames, best_net)}, "
        f"{_verdict(frames, best_net, table)}, and takes "
        f"{link(_times(dear['cpu_time_s'] / cheap['cpu_time_s']), 'cost', dear, cheap)} the CPU time of that "
        "table."
    )


def _tables(grid: Grid, frames: Frames, tables: Sequence[Learner]) -> str:
    """Says how the table does, with the first arm's constants and with others."""
    paper = tables[0]
    budget = _first(grid, paper)["settings"]["budget"]
    curves = frames["curves"]
    late = curves[_is(curves, paper) & (curves["step"] > budget / 2)].groupby("scenario", sort=False)
    on_average = ", ".join(link(f"{own['success'].mean():.2f}", "curves", own) for _, own in late)
    text = (
        f"After {budget:,} steps the table `{paper.algorithm}` succeeds with probability "
        f"{_by_scenario(frames, 'summary', paper, 'success', _two_digits)} (on average over the second half "
        f"of training {on_average}), and has a mean score of {_score(frames, paper)} over all scenarios"
    )
    for other in tables[1:]:
        text += (
            f"; with the constants of `{other.algorithm}` it has {_score(frames, other)}, and "
            f"{_verdict(frames, other, paper)}"
        )
    return f"{text}."


def _best_net(frames: Frames, tables: Sequence[Learner], nets: Sequence[Learner], best_net: Learner) -> str:
    """Says how the nets with the highest scores do, and the first of them against the tables."""
    ranked = sorted(nets, key=lambda net: -_mean(frames, net))[:_TOLD]
    scores = []
    for net in ranked:
        own = _aggregate(frames, net, "start", "stochastic")
        by_chance = "" if own is None else f", and {_interval(own)} by its stochastic policy"
        scores.append(f"`{net}` {_score(frames, net)}{by_chance}")
    return (
        f"The nets with the highest mean scores are {'; '.join(scores)}; the first succeeds with probability "
        f"{_by_scenario(frames, 'summary', best_net, 'success', _two_digits)}, and "
        f"{' and '.join(_verdict(frames, best_net, table) for table in tables)}."
    )


def _observations(grid: Grid, frames: Frames, nets: Sequence[Learner]) -> str:
    """Says what the observation's form changes."""
    parts = []
    for arm in dict.fromkeys(learner.algorithm for learner in nets):
        forms = [learner for learner in grid.learners if learner.algorithm == arm]
        if len(forms) == 2:
            scores = " and ".join(f"{_mean_told(frames, form)} with {form.observation}" for form in forms)
            row = _improvement(frames, *forms)
            names = [form.observation for form in forms]
            better = names[0] if row["low"] > 0.5 else names[1] if row["high"] < 0.5 else "neither"
            parts.append(f"`{arm}` {scores} ({better} is better, {_probability(row)})")
    return f"By the form of the observation, mean scores are: {'; '.join(parts)}." if parts else ""


def _linear(grid: Grid, frames: Frames, nets: Sequence[Learner]) -> str:
    """Says what hidden layers add to a linear one."""
    specifications = {net: _first(grid, net) for net in nets}
    linear = [net for net in nets if specifications[net]["settings"]["policy_kwargs"]["net_arch"] == []]
    if not linear:
        return ""
    one = linear[0]
    kin = [
        net
        for net in nets
        if net not in linear
        and net.observation == one.observation
        and specifications[net]["algorithm"] == specifications[one]["algorithm"]
    ]
    text = (
        f"A single linear layer over {one.observation} (`{one.algorithm}`, {_parameters(frames, one)} "
        f"numbers) has {_score(frames, one)}"
    )
    if kin:
        best = max(kin, key=lambda net: _mean(frames, net))
        text += f"; `{best}` with {_parameters(frames, best)} numbers {_verdict(frames, best, one)}"
    return f"{text}."


def _defaults(frames: Frames, nets: Sequence[Learner]) -> str:
    """Says how Stable-Baselines3's own settings do."""
    parts = []
    for net in nets:
        if net.is_default:
            own = frames["threshold"][_is(frames["threshold"], net)]
            share = np.average(own["reached_share"], weights=own["n"])
            parts.append(f"`{net}` {_mean_told(frames, net)} and {link(f'{share:.0%}', 'threshold', own)}")
    if not parts:
        return ""
    return (
        "With Stable-Baselines3's own settings, the mean score and the share of runs that ever score "
        f"{GOOD_SCORE:g} are: {', '.join(parts)}."
    )


def _threshold(frames: Frames, learners: Sequence[Learner]) -> str:
    """Says how many steps a good policy takes."""
    last = frames["curves"]["step"].max()

    def say(step: float) -> str:
        return "never" if np.isinf(step) else "only at the very end" if step == last else f"{step:,.0f}"

    parts = [
        f"`{learner}` {_by_scenario(frames, 'threshold', learner, 'stays_step_median', say)}"
        for learner in learners
    ]
    return f"Half of the runs score {GOOD_SCORE:g} and more for good after so many steps: {'; '.join(parts)}."


def _cost(frames: Frames, table: Learner, net: Learner) -> str:
    """Says what a run costs."""
    one, other = _row(frames, "cost", table), _row(frames, "cost", net)
    times = link(_times(other["cpu_time_s"] / one["cpu_time_s"]), "cost", one, other)

    def say(row: pd.Series, time: str) -> str:
        return (
            f"{link(time, 'cost', row)} of CPU time, {link(f'{row.parameters:,.0f}', 'cost', row)} "
            f"numbers and a process of {link(f'{row.peak_memory_mb:.0f}', 'cost', row)} MB"
        )

    return (
        f"A run takes the table {say(one, f'{one.cpu_time_s * 1000:.2g} ms')}, and `{net}` "
        f"{say(other, f'{other.cpu_time_s:.2g} s')}: {times} the time."
    )


def _every_cell(grid: Grid, frames: Frames, learners: Sequence[Learner]) -> str:
    """Says what was learned off the path."""
    if "every_cell" not in _first(grid, learners[0])["evaluated_from"]:
        return ""
    parts = [
        f"`{one}` {_score(frames, one, 'every_cell')} against {_mean_told(frames, one)}" for one in learners
    ]
    return f"Off the path, mean score from any cell against that from the start: {'; '.join(parts)}."


def _region(frames: Frames, tables: Sequence[Learner], nets: Sequence[Learner]) -> str:
    """Says who knows the personal space."""
    rows = {one: frames["region"][_is(frames["region"], one)] for one in (*tables, *nets)}
    means = {one: own.mean(numeric_only=True, skipna=False) for one, own in rows.items()}
    best = max(nets, key=lambda one: means[one]["overlap"])
    parts = []
    for one in (*tables, best):
        precision, recall, overlap = means[one][["precision", "recall", "overlap"]]
        told = ["none" if np.isnan(value) else f"{value:.2f}" for value in (overlap, precision, recall)]
        own, right, found = (link(text, "region", rows[one]) for text in told)
        parts.append(f"`{one}` {own} (precision {right}, recall {found})")
    return (
        "The cells where an agent values PING overlap with the target region (intersection over union, mean "
        f"of the scenarios) by {', '.join(parts)}, the last being the net that is best at this."
    )


def _disagreements(frames: Frames, learners: Sequence[Learner]) -> str:
    """Says how often the issuer disagreed."""
    parts = []
    for one in learners:
        own = frames["curves"][_is(frames["curves"], one)]
        last = own[own["step"] > 0.9 * own["step"].max()]
        means = (link(f"{part['disagreements'].mean():.0f}", "curves", part) for part in (own, last))
        parts.append(f"`{one}` {' and '.join(means)}")
    return (
        "The issuer disagrees per 1,000 steps, over all of training and in its last tenth: "
        f"{', '.join(parts)}."
    )


def _verdict(frames: Frames, one: Learner, other: Learner) -> str:
    """Says which of two learners does better, and with what probability."""
    row = _improvement(frames, one, other)
    if row["low"] <= 0.5 <= row["high"]:
        return f"cannot be told from `{other}` ({_probability(row)})"
    return f"does {'better' if row['low'] > 0.5 else 'worse'} than `{other}` ({_probability(row)})"


def _improvement(frames: Frames, one: Learner, other: Learner) -> pd.Series:
    """Returns the row with the probability that a run of one outscores a run of the other."""
    frame = frames["improvement"]
    return frame[(frame["x"] == str(one)) & (frame["y"] == str(other))].iloc[0]


def _probability(row: pd.Series) -> str:
    """Returns a row of `improvement` as readers see it."""
    probability = link(f"{row['probability']:.2f}", "improvement", row)
    return f"P = {probability} [{row['low']:.2f}, {row['high']:.2f}]"


def _by_scenario(
    frames: Frames, table: str, learner: Learner, column: str, say: Callable[[float], str]
) -> str:
    """Returns a learner's numbers in every scenario."""
    own = frames[table][_is(frames[table], learner)]
    return ", ".join(
        f"{link(say(row[column]), table, row)} in {row['scenario']}" for _, row in own.iterrows()
    )


def _two_digits(value: float) -> str:
    """Returns a number with two digits after the point."""
    return f"{value:.2f}"


def _score(frames: Frames, learner: Learner, start: str = "start") -> str:
    """Returns a learner's mean score with its interval, by its greedy policy."""
    row = _aggregate(frames, learner, start)
    assert row is not None
    return _interval(row)


def _interval(row: pd.Series) -> str:
    """Returns a value with its interval."""
    return f"{link(f'{row.value:.2f}', 'aggregate', row)} [{row['low']:.2f}, {row['high']:.2f}]"


def _mean(frames: Frames, learner: Learner) -> float:
    """Returns a learner's mean score."""
    row = _aggregate(frames, learner, "start")
    assert row is not None
    return float(row["value"])


def _mean_told(frames: Frames, learner: Learner) -> str:
    """Returns a learner's mean score as readers see it."""
    row = _aggregate(frames, learner, "start")
    assert row is not None
    return link(f"{row['value']:.2f}", "aggregate", row)


def _aggregate(frames: Frames, learner: Learner, start: str, policy: str = "greedy") -> pd.Series | None:
    """Returns the row of a learner's mean score, none where it has no such policy."""
    frame = frames["aggregate"]
    wanted = (frame["policy"] == policy) & (frame["evaluated_from"] == start) & (frame["metric"] == "mean")
    rows = frame[wanted & _is(frame, learner)]
    return None if rows.empty else rows.iloc[0]


def _parameters(frames: Frames, learner: Learner) -> str:
    """Returns how many numbers a learner learns."""
    row = _row(frames, "cost", learner)
    return link(f"{int(row['parameters']):,}", "cost", row)


def _row(frames: Frames, table: str, learner: Learner) -> pd.Series:
    """Returns the one row of a learner."""
    rows = frames[table][_is(frames[table], learner)]
    assert len(rows) == 1
    return rows.iloc[0]


def _is(frame: pd.DataFrame, learner: Learner) -> pd.Series:
    """Returns which rows are a learner's."""
    return (frame["algorithm"] == learner.algorithm) & (frame["observation"] == learner.observation)


def _first(grid: Grid, learner: Learner) -> Mapping[str, Any]:
    """Returns the specification of one of a learner's runs."""
    return next(iter(grid.learners[learner].values())).specification


def _times(ratio: float) -> str:
    """Returns a ratio as readers say it, with two digits."""
    digits = 2 - len(str(int(ratio)))
    return f"{round(ratio, digits):,.0f} times"
