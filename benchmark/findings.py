"""Says in ten plain sentences what a comparison found; every word that judges follows from a number.

Two learners are said to differ if the 95 % interval of the probability that a run of one outscores a run of
the other leaves out one half, and otherwise not to be told apart.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from benchmark.comparison import REACHED, Grid, Learner

Frames = Mapping[str, pd.DataFrame]  # the tables of `benchmark.comparison`, by name


def sentences(grid: Grid, frames: Frames) -> list[str]:
    """Returns ten sentences, each with its figures; fewer where there is nothing to compare."""
    tables = [learner for learner in grid.learners if _first(grid, learner)["algorithm"] == "q_learning"]
    nets = [learner for learner in grid.learners if learner not in tables]
    if not tables or not nets:
        return []
    best_table, best_net = (max(group, key=lambda one: _iqm(frames, one)) for group in (tables, nets))
    written = (
        _tables(grid, frames, tables),
        _best_net(frames, tables, best_table, best_net),
        _observations(grid, frames, nets),
        _linear(grid, frames, nets),
        _defaults(grid, frames, nets),
        _threshold(frames, [*tables, best_net]),
        _cost(frames, tables[0], best_net),
        _every_cell(grid, frames, [*tables, best_net]),
        _region(frames, tables[0], best_table, nets),
        _disagreements(frames, [*tables, best_net]),
    )
    return [sentence for sentence in written if sentence]


def _tables(grid: Grid, frames: Frames, tables: Sequence[Learner]) -> str:
    """Says how the table does, with the paper's constants and with others."""
    paper = tables[0]
    success = frames["summary"][_is(frames["summary"], paper)]
    by_scenario = ", ".join(f"{r.success:.0%} in {r.scenario}" for r in success.itertuples())
    budget = _first(grid, paper)["settings"]["budget"]
    text = (
        f"After {budget:,} steps the table with the paper's constants scores {_score(frames, paper)} over "
        "all scenarios (interquartile mean and 95 % interval; 0 is random, 1 optimal), its greedy policy "
        f"succeeding with probability {by_scenario}"
    )
    for other in tables[1:]:
        verdict = _verdict(frames, other, paper)
        text += f"; `{other.algorithm}`, a table, too, scores {_score(frames, other)} and {verdict}"
    return f"{text}."


def _best_net(frames: Frames, tables: Sequence[Learner], best_table: Learner, best_net: Learner) -> str:
    """Says how the best net does against the tables, over all and by scenario."""
    compared = [f"{_verdict(frames, best_net, table)}" for table in dict.fromkeys((tables[0], best_table))]
    ahead = {}
    for table in dict.fromkeys((tables[0], best_table)):
        mine, theirs = (
            frames["summary"][_is(frames["summary"], one)].set_index("scenario") for one in (best_net, table)
        )
        where = [s for s in mine.index if mine["score_iqm_low"][s] > theirs["score_iqm_high"][s]]
        ahead[table] = ", ".join(where) or "no scenario"
    by_scenario = " and of ".join(f"`{table}` in {where}" for table, where in ahead.items())
    return (
        f"Of the nets `{best_net}` does best with {_score(frames, best_net)}; it {' and '.join(compared)}; "
        f"its interval lies above that of {by_scenario}."
    )


def _observations(grid: Grid, frames: Frames, nets: Sequence[Learner]) -> str:
    """Says what the observation's form changes."""
    parts = []
    for arm in dict.fromkeys(learner.algorithm for learner in nets):
        forms = [learner for learner in grid.learners if learner.algorithm == arm]
        if len(forms) == 2:
            one, other = forms
            scores = " and ".join(f"{_score(frames, form)} with {form.observation}" for form in forms)
            parts.append(f"`{arm}` scores {scores} ({_verdict(frames, one, other, short=True)})")
    return f"The observation's form: {'; '.join(parts)}." if parts else ""


def _linear(grid: Grid, frames: Frames, nets: Sequence[Learner]) -> str:
    """Says what hidden layers add to a linear one."""
    linear = [one for one in nets if _first(grid, one)["settings"]["policy_kwargs"]["net_arch"] == []]
    if not linear:
        return ""
    one = linear[0]
    kin = [
        net
        for net in nets
        if net.observation == one.observation
        and net != one
        and _first(grid, net)["algorithm"] == _first(grid, one)["algorithm"]
    ]
    parameters = {net: int(_row(frames["cost"], net)["parameters"]) for net in (one, *kin)}
    text = (
        f"A single linear layer over {one.observation}, the rung between table and net (`{one.algorithm}`, "
        f"{parameters[one]:,} parameters), scores {_score(frames, one)}"
    )
    if kin:
        best = max(kin, key=lambda net: _iqm(frames, net))
        text += f"; `{best}` with {parameters[best]:,} parameters {_verdict(frames, best, one)}"
    return f"{text}."


def _defaults(grid: Grid, frames: Frames, nets: Sequence[Learner]) -> str:
    """Says how Stable-Baselines3's own settings do."""
    own = [net for net in nets if net.algorithm.endswith("_default")]
    if not own:
        return ""
    threshold = frames["threshold"]
    shares = {
        net: np.average(
            threshold[_is(threshold, net)]["reached_share"], weights=threshold[_is(threshold, net)]["n"]
        )
        for net in own
    }
    parts = ", ".join(f"`{net}` {_score(frames, net)} and {shares[net]:.0%}" for net in own)
    n = sum(len(grid.scores(net)) for net in own) * len(next(iter(grid.learners.values())))
    return (
        "With Stable-Baselines3's own settings, scores and the share of runs whose greedy policy ever gets "
        f"to {REACHED:g} are: {parts} ({n} runs)."
    )


def _threshold(frames: Frames, learners: Sequence[Learner]) -> str:
    """Says how many steps a good policy takes."""
    parts = []
    for learner in learners:
        own = frames["threshold"][_is(frames["threshold"], learner)]
        columns = own[["scenario", "stays_step_median", "stays_share"]].to_numpy()
        when = ", ".join(f"{_steps(step)} in {scenario} ({share:.0%})" for scenario, step, share in columns)
        parts.append(f"`{learner}` {when}")
    return (
        f"Steps after which half of the runs score {REACHED:g} for good, and the share of runs that get "
        f"there: {'; '.join(parts)}."
    )


def _cost(frames: Frames, table: Learner, net: Learner) -> str:
    """Says what a run costs."""
    one, other = _row(frames["cost"], table), _row(frames["cost"], net)
    seconds = one["cpu_time_s"], other["cpu_time_s"]
    return (
        f"A run costs the table {seconds[0] * 1000:.2g} ms of CPU time, {one['parameters']:,.0f} numbers "
        f"and {one['peak_memory_mb']:.0f} MB, and `{net}` {seconds[1]:.2g} s, {other['parameters']:,.0f} "
        f"numbers and {other['peak_memory_mb']:.0f} MB (medians on the machine of the manifest): "
        f"{_times(seconds[1] / seconds[0])} the time."
    )


def _every_cell(grid: Grid, frames: Frames, learners: Sequence[Learner]) -> str:
    """Says what was learned off the path."""
    if "every_cell" not in _first(grid, learners[0])["evaluated_from"]:
        return ""
    parts = [
        f"`{one}` {_score(frames, one, start='every_cell')} against {_iqm(frames, one):.2f} from the start"
        for one in learners
    ]
    return f"Off the path, from any starting cell: {'; '.join(parts)}."


def _region(frames: Frames, paper: Learner, best_table: Learner, nets: Sequence[Learner]) -> str:
    """Says who knows the personal space."""
    means = {one: frames["region"][_is(frames["region"], one)].mean(numeric_only=True) for one in nets}
    best = max(nets, key=lambda one: means[one]["overlap"])
    parts = []
    for one in dict.fromkeys((paper, best_table, best)):
        own = frames["region"][_is(frames["region"], one)].mean(numeric_only=True)
        precision = "none" if np.isnan(own["precision"]) else f"{own['precision']:.2f}"
        parts.append(f"`{one}` {own['overlap']:.2f} (precision {precision}, recall {own['recall']:.2f})")
    return (
        "Where an agent values PING overlaps with the target region (intersection over union, mean of the "
        f"scenarios): {', '.join(parts)}, the last being the best of the nets."
    )


def _disagreements(frames: Frames, learners: Sequence[Learner]) -> str:
    """Says how often the issuer disagreed."""
    parts = []
    for one in learners:
        own = frames["curves"][_is(frames["curves"], one)]
        whole = own["disagreements"].mean()
        last = own[own["step"] > 0.9 * own["step"].max()]["disagreements"].mean()
        parts.append(f"`{one}` {whole:.0f} and {last:.0f}")
    return (
        "Disagreements received per 1,000 steps, over all of training and in its last tenth: "
        f"{', '.join(parts)}."
    )


def _verdict(frames: Frames, one: Learner, other: Learner, *, short: bool = False) -> str:
    """Says which of two learners does better, and with what probability."""
    frame = frames["improvement"].set_index(["x", "y"])
    row: Any = frame.loc[(str(one), str(other))]
    p, low, high = float(row["probability"]), float(row["low"]), float(row["high"])
    number = f"{p:.2f} [{low:.2f}, {high:.2f}]"
    if short:
        better = one.observation if low > 0.5 else other.observation if high < 0.5 else None
        return f"{better} is better, {number}" if better else f"not to be told apart, {number}"
    meaning = f"a run of it outscores one of the other with probability {number}"
    if low <= 0.5 <= high:
        return f"cannot be told from `{other}` ({meaning})"
    return f"does {'better' if low > 0.5 else 'worse'} than `{other}` ({meaning})"


def _score(frames: Frames, learner: Learner, start: str = "start") -> str:
    """Returns a learner's interquartile mean with its interval, by its greedy policy."""
    row = _aggregate(frames, learner, start)
    return f"{row['value']:.2f} [{row['low']:.2f}, {row['high']:.2f}]"


def _iqm(frames: Frames, learner: Learner) -> float:
    """Returns a learner's interquartile mean."""
    return float(_aggregate(frames, learner, "start")["value"])


def _aggregate(frames: Frames, learner: Learner, start: str) -> pd.Series:
    """Returns the row of a learner's interquartile mean."""
    frame = frames["aggregate"]
    rows = (frame["policy"] == "greedy") & (frame["evaluated_from"] == start) & (frame["metric"] == "iqm")
    return _row(frame[rows], learner)


def _row(frame: pd.DataFrame, learner: Learner) -> pd.Series:
    """Returns the one row of a learner."""
    rows = frame[_is(frame, learner)]
    assert len(rows) == 1
    return rows.iloc[0]


def _is(frame: pd.DataFrame, learner: Learner) -> pd.Series:
    """Returns which rows are a learner's."""
    return (frame["algorithm"] == learner.algorithm) & (frame["observation"] == learner.observation)


def _first(grid: Grid, learner: Learner) -> Mapping[str, Any]:
    """Returns the specification of one of a learner's runs."""
    return next(iter(grid.learners[learner].values())).specification


def _steps(median: float) -> str:
    """Returns a number of steps."""
    return "never" if np.isinf(median) else f"{median:,.0f}"


def _times(ratio: float) -> str:
    """Returns a ratio as readers say it, with two digits."""
    digits = 2 - len(str(int(ratio)))
    return f"{round(ratio, digits):,.0f} times"
