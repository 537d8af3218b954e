"""Differences between cells, and what they come to.

A row is the difference of two cells, or of two means of cells over scenarios: x minus y. Contrasts have
verdicts, with p-values adjusted as declared; effects are exploratory. The rules of verdicts and outcomes are
in `document.md.jinja`. Contrasts that name scenarios or conditions have verdicts of their own, and no part in
the outcome.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from itertools import product
from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from benchmark.analysis.contrasts import (
    BETTER,
    EQUIVALENT,
    MIXED,
    NO_VERDICT,
    UNDECIDED,
    WORSE,
    Means,
    contrast,
    decide,
    holm,
    mixed,
)
from benchmark.analysis.intervals import LEVEL, Estimate, p_above
from benchmark.experiments import Experiment
from benchmark.reports.comparison.cells import Row, cells_of
from benchmark.reports.comparison.declared import (
    AXES,
    Pair,
    contrasts_of,
    decisive_learners,
    effects_of,
    reporting_of,
    side_name,
)

ENDPOINTS: Final = ("success", "score")  # in the order in which they count
ALPHA: Final = 1 - LEVEL
FEWEST_RUNS: Final = 10  # per scenario and learner; with fewer there is no verdict


class Case(NamedTuple):
    """What a row compares: cells of x and of y, one of each in every scenario."""

    names: dict[str, str]  # the columns that name the row
    x: pd.DataFrame
    y: pd.DataFrame

    @property
    def fewest_runs(self) -> int:
        """How many runs the smallest cell has."""
        return int(min(self.x["n"].min(), self.y["n"].min()))

    def sides(self, endpoint: str) -> tuple[Means, Means]:
        """Returns the means of x and of y by scenario."""
        x, y = (Means([*cells[endpoint]], [*cells["n"]]) for cells in (self.x, self.y))
        return x, y


def contrast_rows(runs: pd.DataFrame, experiment: Experiment, is_partial: bool) -> list[Row]:
    """Returns the contrasts with their verdicts: a row each, or one per scenario if nothing is pooled."""
    reporting, cells = reporting_of(experiment), cells_of(runs, experiment)
    is_pooled = reporting.pool == "scenarios"
    cases: list[Case] = []
    for pair in contrasts_of(experiment):
        cases += _cases(cells, pair, experiment, is_pooled=is_pooled)
    if not is_pooled:
        order = [*experiment.scenarios]
        cases.sort(key=lambda case: order.index(case.x["scenario"].iloc[0]))
    rows: list[Row] = [{**case.names, **_difference(case)} for case in cases]
    allowed = [not is_partial and case.fewest_runs >= FEWEST_RUNS for case in cases]
    adjust = holm if reporting.adjust == "holm" else list
    for key in ("p_random_x", "p_random_y"):
        for row, p in zip(rows, adjust([row.pop(key) for row in rows]), strict=True):
            row[key] = p
    for endpoint in ENDPOINTS:
        margin: float = getattr(reporting.margins, endpoint)
        sides = [case.sides(endpoint) for case in cases]
        tests = [contrast(x, y, margin) for x, y in sides]
        decisions = decide(tests, is_allowed=allowed, adjust=adjust)
        for case, row, (x, y), test, decision in zip(cases, rows, sides, tests, decisions, strict=True):
            verdict, apart = _over_scenarios(str(decision["verdict"]), x, y, margin)
            values = {"x": x.mean, "y": y.mean, **asdict(test), **decision, "verdict": verdict}
            values |= {"margin": margin, "largest": max(a - b for a, b in zip(x.means, y.means, strict=True))}
            values["except"] = ", ".join(case.x["scenario"].iloc[apart])
            for key, value in values.items():
                ending = f"difference_{key}" if key.startswith(("low", "high")) else key
                row[f"{endpoint}_{ending}"] = value
    return rows


def effect_rows(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Yields the effects, a row for each pair of cells that differ by it, with intervals not adjusted."""
    cells = cells_of(runs, experiment)
    references = [name for name, learner in experiment.learners.items() if learner.reference_for]
    own = cells[~cells["learner"].isin(references)]
    for name, pair in effects_of(experiment).items():
        for case in _cases(own, pair, experiment, is_pooled=False):
            row: Row = {"effect": name, **case.names, **_difference(case)}
            del row["random_success"]  # the sides may differ in it
            for endpoint in ENDPOINTS:
                x, y = case.sides(endpoint)
                test = contrast(x, y, margin=0.5)  # on which the interval does not depend
                row |= {f"{endpoint}_x": x.mean, f"{endpoint}_y": y.mean}
                row[f"{endpoint}_difference"] = Estimate(test.difference, test.low, test.high)
            yield row


def outcome_rows(runs: pd.DataFrame, experiment: Experiment, is_partial: bool) -> Iterator[Row]:
    """Yields the outcome, or that of each scenario and condition, if there are baselines."""
    reporting = reporting_of(experiment)
    if not reporting.baseline:
        return
    baselines, decisive = reporting.baseline, decisive_learners(experiment)
    every = contrast_rows(runs, experiment, is_partial)
    rows = [row for row in every if row["x"] in decisive and row["y"] in baselines]
    axes = {"scenario": [*experiment.scenarios]} if reporting.pool == "none" else {}
    axes |= {"condition": [*experiment.conditions]} if len(experiment.conditions) > 1 else {}
    for values in product(*axes.values()):
        names = dict(zip(axes, values, strict=True))
        here = pd.DataFrame([row for row in rows if names.items() <= row.items()])
        yield {**names, "outcome": _outcome(here, baselines, decisive, runs) if len(here) else "no verdict"}


def _outcome(
    rows: pd.DataFrame, baselines: Sequence[str], decisive: Sequence[str], runs: pd.DataFrame
) -> str:
    """Decides by the contrasts of decisive learners with baselines, of one scenario or pooled."""
    verdicts, of_x = standings(rows, baselines), rows["x"]
    if NO_VERDICT in set(verdicts) or len(verdicts) < len(decisive):
        return "no verdict"
    x_has_learned, y_has_learned = rows["p_random_x"] <= ALPHA, rows["p_random_y"] <= ALPHA
    if not (x_has_learned | y_has_learned).any():
        return "neither learned"
    is_compared = runs["learner"].isin([*of_x, *rows["y"]])
    if "condition" in rows:
        is_compared &= runs["condition"].isin(rows["condition"])
    if runs.loc[is_compared, "budget"].nunique() > 1:
        return "unequal budgets"
    # Those are winners that are better in all of their contrasts: in success, than random, not worse in score
    is_better = (rows["success_verdict"] == BETTER) & x_has_learned
    is_won = (is_better & ~rows["score_verdict"].isin([WORSE, MIXED])).groupby(of_x).transform("all")
    if (is_won & y_has_learned & (rows["policy_x"] == rows["policy_y"])).any():
        return "earns"
    if is_won.any():
        return "another class" if (is_won & y_has_learned).any() else "no table learned"
    # Mixed although x is nowhere better by the margin: it is worse in some scenario
    is_nowhere_better = (rows["success_largest"] < rows["success_margin"]) & (rows["success_difference"] <= 0)
    is_worse = (rows["success_verdict"] == MIXED) & is_nowhere_better
    is_lost = verdicts.isin([WORSE, EQUIVALENT]) | is_worse.groupby(of_x).any()
    has_better = ((verdicts == BETTER) & x_has_learned.groupby(of_x).all()).any()
    if has_better or (MIXED in set(verdicts) and not is_lost.all()):
        return "mixed"
    return "does not earn" if is_lost.all() else "undecided"


def standings(rows: pd.DataFrame, baselines: Iterable[str]) -> "pd.Series[str]":
    """Returns each learner's verdict on success against all baselines, by its name, from rows of one place.

    It is better only if it is better than all, worse if it is worse than at least one, and equivalent if it
    is equivalent to at least one and worse than none. Learners that are not compared with all are left out.
    """
    tables = {*baselines}
    order = (NO_VERDICT, WORSE, EQUIVALENT, MIXED, UNDECIDED, BETTER)  # the first that there is
    verdicts = {}
    for x, against in rows[rows["y"].isin(tables)].groupby("x", sort=False):
        if set(against["y"]) == tables:
            verdicts[str(x)] = min(against["success_verdict"], key=order.index)
    return pd.Series(verdicts, dtype=str)


def _cases(cells: pd.DataFrame, pair: Pair, experiment: Experiment, *, is_pooled: bool) -> Iterator[Case]:
    """Yields the pairs of cells that two sides name, by what names their row."""
    x = cells[np.logical_and.reduce([cells[axis] == name for axis, name in pair.x.items()])]
    # The cell that differs from each of these by what the sides name, if it is there
    known, wanted = (pd.MultiIndex.from_frame(frame[[*AXES]]) for frame in (cells, x.assign(**pair.y)))
    others = known.get_indexer(wanted)
    is_there = others >= 0
    x, y = x[is_there].reset_index(drop=True), cells.iloc[others[is_there]].reset_index(drop=True)
    keys = ["scenario"] if "scenario" not in pair.x and not is_pooled else []
    keys += ["condition"] if "condition" not in pair.x and len(experiment.conditions) > 1 else []
    keys += ["algorithm", "observation"] if "learner" not in pair.x else []
    sides = {"x": side_name(pair.x), "y": side_name(pair.y)}
    for _, rows in x.groupby([x[key] for key in keys] or np.zeros(len(x)), sort=False):
        yield Case({key: rows[key].iloc[0] for key in keys} | sides, rows, y.loc[rows.index])


def _difference(case: Case) -> Row:
    """Returns what a row says besides its endpoints: sizes, policies, wrong PINGs, and the random policy."""
    row: Row = {"n": case.fewest_runs}
    share = 1 / len(case.x)
    rates = []
    for side, cells in (("x", case.x), ("y", case.y)):
        row[f"policy_{side}"] = cells["policy"].iloc[0]
        row["random_success"] = random = share * sum(cells["random_success"])
        means, sizes = [*cells["success"]], [*cells["n"]]
        row[f"p_random_{side}"] = p_above([share] * len(cells), means, sizes, random)
        rates.append(float(np.mean(cells["wrong_pings"].to_numpy())))
        row[f"wrong_pings_{side}"] = rates[-1]
    value = rates[0] - rates[1]
    reaches = [*case.x["wrong_pings_reach"], *case.y["wrong_pings_reach"]]
    reach = share * float(np.linalg.norm(reaches))
    return row | {"wrong_pings_difference": Estimate(value, value - reach, value + reach)}


def _over_scenarios(verdict: str, x: Means, y: Means, margin: float) -> tuple[str, list[int]]:
    """Returns a verdict on a mean over scenarios as these allow, and which of them stand apart.

    Those that contradict it make it mixed. Otherwise, these are the scenarios that are not shown by
    themselves, by a 90 % interval, to be less than the margin on the other side of it.
    """
    if len(x.means) == 1 or verdict not in (BETTER, WORSE, EQUIVALENT):
        return verdict, []
    alone = [
        contrast(Means([a], [n]), Means([b], [m]), margin)
        for a, n, b, m in zip(x.means, x.sizes, y.means, y.sizes, strict=True)
    ]
    if contradicting := mixed(verdict, [one.difference for one in alone], margin):
        return MIXED, contradicting
    lows, highs = [one.low_90 for one in alone], [one.high_90 for one in alone]
    apart = set() if verdict == WORSE else {i for i, low in enumerate(lows) if low <= -margin}
    if verdict != BETTER:
        apart |= {i for i, high in enumerate(highs) if high >= margin}
    return verdict, sorted(apart)
