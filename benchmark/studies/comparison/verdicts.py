"""Differences between cells, and the verdicts on them.

A row is the difference of two cells, or of two means of cells over scenarios: x minus y. The rules of
verdicts and outcomes are in `document.md.jinja`. Contrasts that name scenarios or conditions have no part in
the outcome.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from typing import Final, Literal, NamedTuple

import numpy as np
import pandas as pd

from benchmark.analysis import contrasts
from benchmark.analysis.contrasts import BETTER, EQUIVALENT, MIXED, NEITHER, NO_VERDICT, UNDECIDED, WORSE
from benchmark.analysis.intervals import LEVEL, Estimate, combined, p_above
from benchmark.experiments import Experiment
from benchmark.studies.comparison import declared
from benchmark.studies.comparison.cells import Row, cells_of
from benchmark.studies.comparison.columns import ENDPOINTS
from benchmark.studies.comparison.declared import Pair, knowledge

Means = contrasts.Means
ALPHA: Final = 1 - LEVEL
FEWEST_RUNS: Final = 10  # per scenario and learner; with fewer there is no verdict
# Verdicts that need a side that is shown to succeed more often than the random policy
_OF_LEARNERS: Final = {"success": (BETTER, WORSE, EQUIVALENT), "score": (EQUIVALENT,)}


class Case(NamedTuple):
    """What a row compares."""

    names: dict[str, str]  # the columns that name the row
    cells: pd.DataFrame  # a row per scenario: the cell of x, and that of y in columns that end in _y

    def sides(self, endpoint: str) -> list[Means]:
        """Returns the means of x and of y by scenario."""
        return [Means([*self.cells[endpoint + end]], [*self.cells["n" + end]]) for end in ("", "_y")]


def contrast_rows(runs: pd.DataFrame, experiment: Experiment, is_partial: bool) -> list[Row]:
    """Returns the contrasts with their verdicts: a row each, or one per scenario if nothing is pooled."""
    return _rows(declared.contrasts_of(experiment), runs, experiment, is_partial)


def same_input_rows(runs: pd.DataFrame, experiment: Experiment, is_partial: bool) -> list[Row]:
    """Returns contrasts with tables and linear learners of a net's input, if some baseline has another."""
    reporting = declared.reporting_of(experiment)
    others = declared.own_learners(experiment, "tabular", "linear")
    budgets = {name: {*budget} for name, budget in runs.groupby("learner")["budget"]}
    pairs = [
        Pair({"learner": x}, {"learner": y})
        for x, y in product(declared.decisive_learners(experiment), others)
        if {*map(knowledge, reporting.baseline)} != {knowledge(x)} == {knowledge(y)}
        if (x, y) not in reporting.contrasts and budgets.get(x) == budgets.get(y)
    ]
    return _rows(pairs, runs, experiment, is_partial)


def _rows(pairs: Iterable[Pair], runs: pd.DataFrame, experiment: Experiment, is_partial: bool) -> list[Row]:
    """Returns these contrasts, whose p-values are adjusted together."""
    reporting, cells = declared.reporting_of(experiment), cells_of(runs, experiment)
    is_pooled = reporting.pool == "scenarios"
    cases = [case for pair in pairs for case in _cases(cells, pair, experiment, is_pooled=is_pooled)]
    if not is_pooled:
        order = [*experiment.scenarios]
        cases.sort(key=lambda case: order.index(case.cells["scenario"].iloc[0]))
    rows: list[Row] = [case.names | _difference(case.cells) for case in cases]
    allowed = [not is_partial and row["n"] >= FEWEST_RUNS for row in rows]
    for key in ("p_random_x", "p_random_y"):
        for row, p in zip(rows, contrasts.holm([row.pop(key) for row in rows]), strict=True):
            row[key] = p
    for endpoint in ENDPOINTS:
        margin: float = getattr(reporting.margins, endpoint)
        sides = [case.sides(endpoint) for case in cases]
        tests = [contrasts.contrast(x, y, margin) for x, y in sides]
        decisions = contrasts.decide(tests, is_allowed=allowed)
        for case, row, (x, y), test, decision in zip(cases, rows, sides, tests, decisions, strict=True):
            decided = str(decision["verdict"])
            if decided in _OF_LEARNERS[endpoint] and min(row["p_random_x"], row["p_random_y"]) > ALPHA:
                decided = NEITHER
            verdict, apart = _over_scenarios(decided, x, y, margin)
            values = {"x": x.mean, "y": y.mean, **test._asdict(), **decision, "verdict": verdict}
            values["y_low"] = combined([1 / len(y.means)] * len(y.means), *y)[0]
            values |= {"margin": margin, "largest": max(a - b for a, b in zip(x.means, y.means, strict=True))}
            values["except"] = ", ".join(case.cells["scenario"].iloc[apart])
            for key, value in values.items():
                ending = f"difference_{key}" if key.startswith(("low", "high")) else key
                row[f"{endpoint}_{ending}"] = value
    return rows


def effect_rows(runs: pd.DataFrame, experiment: Experiment) -> Iterator[Row]:
    """Yields the effects, a row for each pair of cells that differ by it, with intervals not adjusted."""
    own = cells_of(runs[runs["learner"].isin(declared.own_learners(experiment))], experiment)
    for name, pair in declared.effects_of(experiment):
        for case in _cases(own, pair, experiment, is_pooled=False):
            row: Row = {"effect": name, **case.names, **_difference(case.cells)}
            del row["random_success"]  # the sides may differ in it
            for endpoint in ENDPOINTS:
                x, y = case.sides(endpoint)
                test = contrasts.contrast(x, y, margin=0.5)  # on which the interval does not depend
                row |= {f"{endpoint}_x": x.mean, f"{endpoint}_y": y.mean}
                row[f"{endpoint}_difference"] = Estimate(test.difference, test.low, test.high)
            yield row


def outcome_rows(runs: pd.DataFrame, experiment: Experiment, is_partial: bool) -> Iterator[Row]:
    """Yields the outcome, or that of each scenario and condition, if there are baselines."""
    reporting, decisive = declared.reporting_of(experiment), declared.decisive_learners(experiment)
    if not (baselines := reporting.baseline):
        return
    every = contrast_rows(runs, experiment, is_partial)
    rows = [row for row in every if row["x"] in decisive and row["y"] in baselines]
    axes = {"scenario": [*experiment.scenarios]} if reporting.pool == "none" else {}
    axes |= {"condition": [*experiment.conditions]} if len(experiment.conditions) > 1 else {}
    for values in product(*axes.values()):
        names = dict(zip(axes, values, strict=True))
        here = pd.DataFrame([row for row in rows if names.items() <= row.items()])
        outcome = _outcome(here, baselines, len(decisive), runs) if len(here) else "no verdict"
        yield {**names, "outcome": outcome}


def _outcome(rows: pd.DataFrame, baselines: Sequence[str], n_decisive: int, runs: pd.DataFrame) -> str:
    """Decides by the contrasts of decisive learners with baselines, of one scenario or pooled."""
    verdicts, of_x, success = standings(rows, baselines), rows["x"], rows["success_verdict"]
    if NO_VERDICT in set(verdicts) or len(verdicts) < n_decisive:
        return "no verdict"
    x_has_learned, y_has_learned = rows["p_random_x"] <= ALPHA, rows["p_random_y"] <= ALPHA
    has_same_input = of_x.map(knowledge) == rows["y"].map(knowledge)
    is_compared = runs["learner"].isin([*of_x, *rows["y"]])
    if "condition" in rows:
        is_compared &= runs["condition"].isin(rows["condition"])
    # Those are winners that are better in all of their contrasts: in success, than random, not worse in score
    is_better = (success == BETTER) & x_has_learned
    is_won = (is_better & ~rows["score_verdict"].isin([WORSE, MIXED])).groupby(of_x).transform("all")
    is_shown = is_won & y_has_learned
    has_same_policy = rows["policy_x"] == rows["policy_y"]
    # A net that is better in some scenario has room there
    is_larger = rows["success_largest"] >= rows["success_margin"]
    is_beaten = (is_larger | (success == BETTER)).groupby(rows["y"]).transform("any")
    has_room = 1 - rows["success_y_low"] >= rows["success_margin"]
    # Mixed although x is nowhere better by the margin: it is worse in some scenario
    is_worse = (success == MIXED) & ~is_larger & (rows["success_difference"] <= 0)
    is_lost = verdicts.isin([WORSE, EQUIVALENT]) | is_worse.groupby(of_x).any()
    has_better = ((verdicts == BETTER) & x_has_learned.groupby(of_x).all()).any()
    rules = [
        ("nothing to learn", (rows["random_success"] >= 1 - rows["success_margin"]).all()),
        ("neither learned", not (x_has_learned | y_has_learned).any()),
        ("unequal budgets", runs.loc[is_compared, "budget"].nunique() > 1),
        ("earns", (is_shown & has_same_policy & has_same_input).any()),
        ("another input", (is_shown & has_same_policy).any()),
        ("another policy", is_shown.any()),
        ("no baseline learned", (is_won & has_same_input).any()),
        ("another input", is_won.any()),
        ("cannot be beaten", (y_has_learned & ~has_room & ~is_beaten).any()),
        ("mixed", has_better or (MIXED in set(verdicts) and not is_lost.all())),
        ("does not earn", is_lost.all()),
    ]
    return next((outcome for outcome, holds in rules if holds), "undecided")


def standings(rows: pd.DataFrame, baselines: Iterable[str]) -> "pd.Series[str]":
    """Returns each learner's verdict on success against all baselines, by its name, from rows of one place.

    It is better only if it is better than all, worse if it is worse than at least one, and equivalent if it
    is equivalent to at least one and worse than none. Learners that are not compared with all are left out.
    """
    every = {*baselines}
    order = (NO_VERDICT, WORSE, EQUIVALENT, MIXED, NEITHER, UNDECIDED, BETTER)  # the first that there is
    against = rows[rows["y"].isin(every)].groupby("x", sort=False)
    found = {x: min(of_x["success_verdict"], key=order.index) for x, of_x in against if {*of_x["y"]} == every}
    return pd.Series(found, dtype=str)


def _cases(cells: pd.DataFrame, pair: Pair, experiment: Experiment, *, is_pooled: bool) -> Iterator[Case]:
    """Yields the pairs of cells that two sides name, by what names their row."""
    x, y = (cells[(cells[[*side]] == side).all(axis=1)] for side in pair)
    open_axes = [axis for axis in declared.AXES if axis not in pair.x]
    how: Literal["inner", "cross"] = "inner" if open_axes else "cross"
    pairs = x.merge(y, how, open_axes or None, suffixes=("", "_y"))
    keys = ["scenario"] if "scenario" in open_axes and not is_pooled else []
    keys += ["condition"] if "condition" in open_axes and len(experiment.conditions) > 1 else []
    keys += ["variant", "observation"] if "learner" in open_axes else []
    sides = {"x": declared.side_name(pair.x), "y": declared.side_name(pair.y)}
    for _, rows in pairs.groupby(keys or np.zeros(len(pairs)), sort=False):
        yield Case({key: rows[key].iloc[0] for key in keys} | sides, rows)


def _difference(cells: pd.DataFrame) -> Row:
    """Returns what a row says besides its endpoints: sizes, policies, wrong PINGs, and the random policy."""
    row: Row = {"n": int(min(*cells["n"], *cells["n_y"]))}
    share = 1 / len(cells)
    for side, end in (("x", ""), ("y", "_y")):
        row[f"policy_{side}"] = cells[f"policy{end}"].iloc[0]
        row["random_success"] = random = share * sum(cells[f"random_success{end}"])
        means, sizes = [*cells[f"success{end}"]], [*cells[f"n{end}"]]
        row[f"p_random_{side}"] = p_above([share] * len(cells), means, sizes, random)
        row[f"wrong_pings_{side}"] = float(np.mean(cells[f"wrong_pings{end}"].to_numpy()))
    value = row["wrong_pings_x"] - row["wrong_pings_y"]
    reach = share * float(np.linalg.norm([*cells["wrong_pings_reach"], *cells["wrong_pings_reach_y"]]))
    return row | {"wrong_pings_difference": Estimate(value, value - reach, value + reach)}


def _over_scenarios(verdict: str, x: Means, y: Means, margin: float) -> tuple[str, list[int]]:
    """Returns a verdict on a mean over scenarios as these allow, and which of them stand apart.

    Those that contradict it make it mixed. Otherwise, these are the scenarios that are not shown by
    themselves, by a 90 % interval, to be less than the margin on the other side of it.
    """
    if len(x.means) == 1 or verdict not in (BETTER, WORSE, EQUIVALENT):
        return verdict, []
    alone = [
        contrasts.contrast(Means([a], [n]), Means([b], [m]), margin)
        for a, n, b, m in zip(x.means, x.sizes, y.means, y.sizes, strict=True)
    ]
    if apart := contrasts.contradicting(verdict, [(one.difference, one.difference) for one in alone], margin):
        return MIXED, apart
    return verdict, contrasts.contradicting(verdict, [(one.low_90, one.high_90) for one in alone], margin)
