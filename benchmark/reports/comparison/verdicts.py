"""Differences between cells, and what they come to.

A row is the difference of two cells, or of two means of cells over scenarios: x minus y. Contrasts have
verdicts, with p-values adjusted as declared; effects are exploratory.

Deep RL *earns its keep* over tables if some deep learner is better than every baseline in success, and
better than the exact random policy, and not shown to be worse than any of them in score, and if a baseline
with a policy of the same class, greedy or stochastic, is better than the random policy, too. If all that are
have another class, the outcome is *another class*: then it is not shown that the net makes the difference. If
no baseline is better than the random policy, *no table learned*, and *neither learned* if no deep learner is,
either. Deep RL *does not earn* its keep if every deep learner is worse than a baseline or equivalent to it;
so it is of one whose mean is equivalent and that is worse by the margin in some scenario, better by it in
none. Otherwise it is *mixed* if scenarios, or success and score, contradict each other. There is *no verdict*
if runs are missing or too few. If baselines and deep learners have *unequal budgets*, that is the outcome,
unless neither learned. All else is *undecided*. Contrasts that name scenarios or conditions have verdicts of
their own, and no part in the outcome.
"""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Final, Literal

import numpy as np
import pandas as pd

from benchmark.analysis.contrasts import (
    BETTER,
    EQUIVALENT,
    MIXED,
    NO_VERDICT,
    UNDECIDED,
    VERDICTS,
    WORSE,
    Means,
    contrast,
    decide,
    holm,
    mixed,
    runs_to_decide,
)
from benchmark.analysis.intervals import LEVEL, Estimate, p_above
from benchmark.reports.comparison.declared import Declared, Learner, Side
from benchmark.reports.comparison.runs import Cell, Runs, means_of
from envs.words import listed

ENDPOINTS: Final = ("success", "score")  # in the order in which they count
Outcome = Literal[
    "earns",
    "another class",
    "does not earn",
    "no table learned",
    "neither learned",
    "mixed",
    "undecided",
    "unequal budgets",
    "no verdict",
]
Pairs = Sequence[tuple[Cell, Cell]]  # of a row: x and y in every scenario


def contrasts_of(runs: Runs) -> list[dict[str, Any]]:
    """Returns the contrasts with their verdicts: a row each, or one per scenario if nothing is pooled."""
    declared, reporting = runs.declared, runs.declared.reporting
    is_pooled = reporting.pool == "scenarios"
    cases = [case for x, y in declared.contrasts for case in _cases(runs, x, y, is_pooled=is_pooled)]
    if not is_pooled:
        cases.sort(key=lambda case: runs.scenarios.index(case[1][0][0].scenario))
    rows = [names | difference(pairs) for names, pairs in cases]
    fewest = [min(cell.n for pair in pairs for cell in pair) for _, pairs in cases]
    adjust = holm if reporting.adjust == "holm" else list
    for side in "xy" if rows else ():
        values = adjust([row.pop(f"p_random_{side}") for row in rows])
        for row, value in zip(rows, values, strict=True):
            row[f"p_random_{side}"] = value
    for endpoint in ENDPOINTS:
        margin: float = getattr(reporting.margins, endpoint)
        sides = [_sides(pairs, endpoint) for _, pairs in cases]
        found = [contrast(x, y, margin) for x, y in sides]
        allowed = [not runs.is_incomplete and n >= reporting.fewest_runs for n in fewest]
        decided = decide(found, is_allowed=allowed, adjust=adjust)
        for row, n, (x, y), each, outcome in zip(rows, fewest, sides, found, decided, strict=True):
            row |= {"n": n, f"{endpoint}_x": x.mean, f"{endpoint}_y": y.mean}
            for key, value in (asdict(each) | dict(outcome)).items():
                ending = f"difference_{key}" if key.startswith(("low", "high")) else key
                row[f"{endpoint}_{ending}"] = value
            row[f"{endpoint}_margin"] = margin
            verdict, apart = _over_scenarios(row[f"{endpoint}_verdict"], x, y, margin)
            row[f"{endpoint}_verdict"] = verdict
            row[f"{endpoint}_largest"] = max(a - b for a, b in zip(x.means, y.means, strict=True))
            row[f"{endpoint}_except"] = ", ".join(runs.scenarios[i] for i in apart)
    return rows


def effects_of(runs: Runs) -> list[dict[str, Any]]:
    """Returns the effects, a row for each pair of cells that differ by it, with intervals not adjusted."""
    rows = []
    for x, y, name in runs.declared.effects:
        for names, pairs in _cases(runs.own, x, y, is_pooled=False):
            row = {"effect": name} | names | difference(pairs)
            del row["random_success"]  # the sides may differ in it
            for endpoint in ENDPOINTS:
                sides = _sides(pairs, endpoint)
                found = contrast(*sides, margin=0.5)  # of which the interval does not depend
                row |= {f"{endpoint}_x": sides[0].mean, f"{endpoint}_y": sides[1].mean}
                row[f"{endpoint}_difference"] = Estimate(found.difference, found.low, found.high)
            rows.append(row)
    return rows


def difference(pairs: Pairs) -> dict[str, Any]:
    """Returns what a row says besides its endpoints: sizes, policies, wrong PINGs, and the random policy."""
    row: dict[str, Any] = {"n": min(cell.n for pair in pairs for cell in pair)}
    rates, share = [], 1 / len(pairs)
    for side, cells in zip("xy", zip(*pairs, strict=True), strict=True):
        row[f"policy_{side}"] = cells[0].policy
        row["random_success"] = random = share * sum(cell.random_success for cell in cells)
        means = [float(cell.final("success").mean()) for cell in cells]
        row[f"p_random_{side}"] = p_above([share] * len(cells), means, [cell.n for cell in cells], random)
        rates.append([cell.wrong_pings for cell in cells])
        row[f"wrong_pings_{side}"] = float(np.mean([rate.value for rate in rates[-1]]))
    value = row["wrong_pings_x"] - row["wrong_pings_y"]
    reach = share * float(np.linalg.norm([rate.high - rate.value for side in rates for rate in side]))
    return row | {"wrong_pings_difference": Estimate(value, value - reach, value + reach)}


def outcome(declared: Declared, rows: pd.DataFrame, summary: pd.DataFrame | None = None) -> Outcome:
    """Decides by contrasts with baselines, all of one scenario or pooled; see the module's docstring.

    The table `summary` has the budgets, which are taken to be equal without it.
    """
    rows, alpha = decisive_rows(declared, rows), 1 - LEVEL
    verdicts = standings(declared, rows)
    if NO_VERDICT in set(verdicts) or len(verdicts) < len(declared.decisive):
        return "no verdict"
    if ((rows["p_random_x"] > alpha) & (rows["p_random_y"] > alpha)).all():
        return "neither learned"
    if summary is not None and _budgets_differ(rows, summary):
        return "unequal budgets"
    won = winners(rows)
    if _is_alike(won).any():
        return "earns"
    if len(won):
        return "another class" if (won["p_random_y"] <= alpha).any() else "no table learned"
    is_better = (verdicts == BETTER) & (rows.groupby("x")["p_random_x"].max() <= alpha)
    is_lost = verdicts.isin([WORSE, EQUIVALENT]) | is_worse_in_some(rows).groupby(rows["x"]).any()
    if is_better.any() or (MIXED in set(verdicts) and not is_lost.all()):
        return "mixed"
    return "does not earn" if is_lost.all() else "undecided"


def standings(declared: Declared, rows: pd.DataFrame) -> "pd.Series[str]":
    """Returns each learner's verdict on success against all baselines, by its name, from rows of one place.

    It is better only if it is better than all, worse if it is worse than at least one, and equivalent if it
    is equivalent to at least one and worse than none. Learners that are not compared with all are left out.
    """
    baselines = {str(baseline) for baseline in declared.baselines}
    order = (NO_VERDICT, WORSE, EQUIVALENT, MIXED, UNDECIDED, BETTER)  # the first that there is
    found = {}
    for x, against in rows[rows["y"].isin(baselines)].groupby("x", sort=False):
        if set(against["y"]) == baselines:
            found[str(x)] = min(against["success_verdict"], key=order.index)
    return pd.Series(found, dtype=str)


def runs_needed(declared: Declared, rows: pd.DataFrame, n_tests: int) -> int:
    """Returns how few runs would decide on a scenario that is undecided, if all means stayed as they are.

    One learner that is better than all baselines is enough; otherwise each has to be worse than one of them,
    or equivalent to it. It is 0 if no number of runs would do.

    Args:
      declared: What is compared.
      rows: The contrasts of the scenario.
      n_tests: For how many contrasts p-values are adjusted.
    """
    rows, margin = decisive_rows(declared, rows), declared.reporting.margins.success
    undecided = [x for x, found in standings(declared, rows).items() if found == UNDECIDED]
    won, lost = [], [0]
    for _, against in rows[rows["x"].isin(undecided)].groupby("x"):
        is_ahead = against["success_difference"].to_numpy() >= margin
        needed = [
            runs_to_decide([row["success_x"]], [row["success_y"]], margin, n_tests, is_better_enough=ahead)
            for (_, row), ahead in zip(against.iterrows(), is_ahead, strict=True)
        ]
        if is_ahead.all():
            won.append(max(needed))
        else:
            lost.append(min(n for n, ahead in zip(needed, is_ahead, strict=True) if not ahead))
    return min(won, default=max(lost))


def is_worse_in_some(rows: pd.DataFrame) -> pd.Series:
    """Returns which rows are mixed although x is nowhere better by the margin: it is worse in places."""
    is_nowhere_better = (rows["success_largest"] < rows["success_margin"]) & (rows["success_difference"] <= 0)
    return (rows["success_verdict"] == MIXED) & is_nowhere_better


def winners(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns the contrasts of each x that is better in all: in success, than random, not worse in score.

    If some x has the same class of policy as a baseline that has learned, it is those of such x alone.
    """
    is_better = (rows["success_verdict"] == BETTER) & (rows["p_random_x"] <= 1 - LEVEL)
    is_won = is_better & ~rows["score_verdict"].isin([WORSE, MIXED])
    won = rows[is_won.groupby(rows["x"]).transform("all")]
    is_alike = _is_alike(won).groupby(won["x"]).transform("any")
    return won[is_alike] if is_alike.any() else won


def _is_alike(rows: pd.DataFrame) -> "pd.Series[bool]":
    """Returns in which rows y has the same class of policy as x, and is better than the random policy."""
    return (rows["policy_x"] == rows["policy_y"]) & (rows["p_random_y"] <= 1 - LEVEL)


def _budgets_differ(rows: pd.DataFrame, summary: pd.DataFrame) -> bool:
    """Returns whether the learners of contrasts under one condition had different budgets."""
    names = summary["algorithm"] + ", " + summary["observation"]
    is_compared = names.isin([*rows["x"], *rows["y"]])
    if "condition" in rows:
        is_compared &= summary["condition"].isin(rows["condition"])
    return bool(summary.loc[is_compared, "budget"].nunique() > 1)


def decisive_rows(declared: Declared, rows: pd.DataFrame) -> pd.DataFrame:
    """Returns the contrasts of deep learners with the baselines."""
    is_deep = rows["x"].isin([str(learner) for learner in declared.decisive])
    return rows[is_deep & rows["y"].isin([str(baseline) for baseline in declared.baselines])]


def counted(rows: pd.DataFrame) -> str:
    """Counts the verdicts on success in words."""
    counts = []
    for verdict in VERDICTS:
        if n := int((rows["success_verdict"] == verdict).sum()):
            verb = ("has" if n == 1 else "have") if verdict == NO_VERDICT else "is" if n == 1 else "are"
            counts.append(f"{n} {verb} {verdict}")
    return listed(counts or ["none is there"])


def _cases(runs: Runs, x: Side, y: Side, *, is_pooled: bool) -> list[tuple[dict[str, str], Pairs]]:
    """Returns the pairs of cells that two sides name, by what names their row."""
    cases: dict[tuple[tuple[str, str], ...], list[tuple[Cell, Cell]]] = {}
    for cell, other in runs.matched(x, y):
        names: dict[str, str] = {}
        if x.scenario is None and not is_pooled:
            names["scenario"] = cell.scenario
        if x.condition is None and cell.has_conditions:
            names["condition"] = cell.condition
        if x.learner is None:
            names |= cell.learner._asdict()
        names |= {"x": _name(x), "y": _name(y)}
        cases.setdefault(tuple(names.items()), []).append((cell, other))
    return [(dict(names), pairs) for names, pairs in cases.items()]


def _name(side: Side) -> str:
    """Returns how readers call a side."""
    named: list[str | Learner | None] = [side.learner, side.scenario, side.condition]
    return " @ ".join(str(name) for name in named if name is not None)


def _sides(pairs: Pairs, endpoint: str) -> tuple[Means, Means]:
    """Returns the means of x and of y by scenario."""
    x, y = (means_of(cells, endpoint) for cells in zip(*pairs, strict=True))
    return x, y


def _over_scenarios(verdict: str, x: Means, y: Means, margin: float) -> tuple[str, list[int]]:
    """Returns a verdict on a mean over scenarios as these allow, and which of them stand apart.

    Those that contradict it make it mixed. Otherwise, these are the scenarios that are not shown by
    themselves, by a 90 % interval, to be less than the margin on the other side of it.
    """
    if len(x.means) == 1 or verdict not in (BETTER, WORSE, EQUIVALENT):
        return verdict, []
    each = [
        contrast(Means([a], [n]), Means([b], [m]), margin)
        for a, n, b, m in zip(x.means, x.sizes, y.means, y.sizes, strict=True)
    ]
    if contradicting := mixed(verdict, [one.difference for one in each], margin):
        return MIXED, contradicting
    lows, highs = [one.low_90 for one in each], [one.high_90 for one in each]
    apart = set() if verdict == WORSE else {i for i, low in enumerate(lows) if low <= -margin}
    if verdict != BETTER:
        apart |= {i for i, high in enumerate(highs) if high >= margin}
    return verdict, sorted(apart)
