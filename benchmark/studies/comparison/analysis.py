"""What is computed of a comparison, once: its cells, their differences, and the verdicts on them.

A *cell* is the runs of a learner in a scenario under a condition. Every contrast is the difference of two
cells, or of two means of cells over scenarios: x minus y. Contrasts that name scenarios or conditions do not
affect the outcome.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmark.analysis.frames import KEYS, by_population
from benchmark.analysis.intervals import Estimate, combined, mean_over_scenarios, p_above, proportion, student
from benchmark.experiments import Experiment, Learner
from benchmark.studies.comparison.contrasts import (
    ALPHA,
    Means,
    contrast,
    holm,
    outcome,
    over_scenarios,
    verdict,
)
from benchmark.studies.comparison.declared import (
    AXES,
    ComparisonDeclared,
    Pair,
    Plan,
    knowledge,
    plan_of,
    side_name,
)
from benchmark.studies.data import Data

Row = dict[str, Any]
ENDPOINTS: Final = ("success", "score")  # in the order in which they count
FEWEST_RUNS: Final = 10  # per scenario and learner; with fewer there is no verdict
# Verdicts that need a side that is shown to succeed more often than the random policy
_OF_LEARNERS: Final = {"success": ("better", "worse", "equivalent"), "score": ("equivalent",)}


class Case(NamedTuple):
    """What a row compares: cells of x and of y, a pair for each scenario."""

    names: dict[str, str]  # the columns that name the row
    cells: tuple[Sequence[Row], Sequence[Row]]

    def means(self, endpoint: str) -> tuple[Means, Means]:
        """Returns the means of x and of y by scenario."""
        x, y = (Means([c[endpoint].value for c in own], [c["n"] for c in own]) for own in self.cells)
        return x, y


@dataclass(frozen=True, eq=False)
class ComparisonAnalysis:
    """A comparison: what is compared, its runs, and the differences."""

    data: Data[ComparisonDeclared]
    plan: Plan
    runs: pd.DataFrame  # learner after learner, references behind their learners
    curves: pd.DataFrame
    cells: Sequence[Row]  # the summary of each, from which contrasts are computed, with all of `KEYS`

    @property
    def experiment(self) -> Experiment:
        """The experiment."""
        return self.data.experiment

    @property
    def is_pooled(self) -> bool:
        """Whether verdicts are on means over scenarios."""
        return self.data.declared.pool == "scenarios"

    @property
    def names(self) -> list[str]:
        """The columns that name a population in tables."""
        has_conditions = len(self.experiment.conditions) > 1
        return [name for name in KEYS if name != "learner" and (has_conditions or name != "condition")]

    def populations(self, frame: pd.DataFrame, *without: str) -> Iterator[tuple[Row, Learner, pd.DataFrame]]:
        """Yields each population of `runs` or `curves`: its columns in tables, its learner, and its rows.

        Without some of the columns, it yields several populations as one.
        """
        names = [name for name in self.names if name not in without]
        for keys, rows in by_population(frame, *without):
            yield {name: keys[name] for name in names}, self.experiment.learners[keys["learner"]], rows

    def pooled(self) -> Iterator[tuple[Row, Learner, list[pd.DataFrame]]]:
        """Yields each learner under each condition, with its runs by scenario, if scenarios are pooled."""
        if self.is_pooled:
            for names, learner, rows in self.populations(self.runs, "scenario"):
                yield names, learner, [own for _, own in rows.groupby("scenario", sort=False)]

    @cached_property
    def aggregate(self) -> list[Row]:
        """Every learner after training, in means over scenarios."""
        found = []
        for names, learner, scenarios in self.pooled():
            first, n_runs = scenarios[0], sum(map(len, scenarios))
            row = {**names, "policy": first["policy"].iloc[0], "runs": n_runs, **effort(learner)}
            for name in (*ENDPOINTS, *(f"every_cell_{endpoint}" for endpoint in ENDPOINTS)):
                if name in first:
                    row[name] = mean_over_scenarios([own[name].to_numpy() for own in scenarios])
            row["unbounded_score"] = np.mean([own["unbounded_score"].to_numpy().mean() for own in scenarios])
            found.append(row)
        return found

    def matrices(self, endpoint: str) -> list[tuple[Row, str, NDArray[np.float64]]]:
        """Returns each learner's numbers, (runs, scenarios), if pooled scenarios have as many runs each."""
        return [
            (names, learner.name, np.stack([own[endpoint].to_numpy() for own in scenarios], axis=1))
            for names, learner, scenarios in self.pooled()
            if len({*map(len, scenarios)}) == 1
        ]

    @cached_property
    def contrasts(self) -> list[Row]:
        """The declared contrasts with their verdicts, the latest first; one per scenario without pooling."""
        later = [row | {"declared": "later"} for row in self._contrasts(self.plan.later)]
        return [*later, *self._contrasts(self.plan.contrasts)]

    @cached_property
    def same_input(self) -> list[Row]:
        """Contrasts of nets with tables and linear learners of the same input, if a baseline has another."""
        others = [name for name, family in self.plan.learners.items() if family in ("tabular", "linear")]
        inputs = {*map(knowledge, self.plan.baseline)}
        pairs = [
            Pair({"learner": x}, {"learner": y})
            for x, y in product(self.plan.nets, others)
            if inputs != {knowledge(x)} == {knowledge(y)} and self.budgets([x]) == self.budgets([y])
        ]
        return self._contrasts([pair for pair in pairs if pair not in self.plan.contrasts])

    @cached_property
    def outcomes(self) -> list[Row]:
        """The outcome, or that of each scenario and condition, if there are baselines."""
        plan, experiment = self.plan, self.experiment
        if not plan.baseline:
            return []
        rows = [row for row in self.contrasts if "declared" not in row]
        rows = [row for row in rows if row["x"] in plan.nets and row["y"] in plan.baseline]
        axes = {} if self.is_pooled else {"scenario": [*experiment.scenarios]}
        axes |= {"condition": [*experiment.conditions]} if "condition" in self.names else {}
        found = []
        for values in product(*axes.values()):
            names = dict(zip(axes, values, strict=True))
            own = pd.DataFrame([row for row in rows if names.items() <= row.items()])
            result = "no verdict"
            if len(own):
                budgets = self.budgets([*own["x"], *own["y"]], names.get("condition"))
                result = outcome(own, plan.baseline, len(plan.nets), len(budgets))
            found.append({**names, "outcome": result})
        return found

    def budgets(self, learners: Iterable[str], condition: str | None = None) -> set[int]:
        """Returns the budgets of learners, under one condition or all."""
        named = [cell for cell in self.cells if condition in (None, cell["condition"])]
        return {cell["budget"] for cell in named if cell["learner"] in {*learners}}

    def _contrasts(self, pairs: Iterable[Pair]) -> list[Row]:
        """Returns these contrasts, whose p-values are adjusted together."""
        pooled = ("scenario",) if self.is_pooled else ()
        cases = [case for pair in pairs for case in self._cases(pair, self.cells, *pooled)]
        if not self.is_pooled:
            order = [*self.experiment.scenarios]
            cases.sort(key=lambda case: order.index(case.cells[0][0]["scenario"]))
        rows = [_difference(case) for case in cases]
        for key in ("p_random_x", "p_random_y"):
            for row, p in zip(rows, holm([row.pop(key) for row in rows]), strict=True):
                row[key] = p
        for endpoint in ENDPOINTS:
            margin: float = getattr(self.data.declared.margins, endpoint)
            tests = [contrast(*case.means(endpoint), margin) for case in cases]
            different = holm([test.p_different for test in tests])
            equivalent = holm([test.p_equivalent for test in tests])
            for case, row, test, p, q in zip(cases, rows, tests, different, equivalent, strict=True):
                decided, (x, y) = verdict(test.difference, p, q), case.means(endpoint)
                if row["n"] < FEWEST_RUNS:
                    decided = "no verdict"
                elif decided in _OF_LEARNERS[endpoint] and min(row["p_random_x"], row["p_random_y"]) > ALPHA:
                    decided = "neither learned"
                decided, scenarios = over_scenarios(decided, x, y, margin)
                values = {"x": x.mean, "y": y.mean, **test._asdict(), "p_different": p, "p_equivalent": q}
                values |= {"verdict": decided, "y_low": combined(y.weights, *y)[0], "margin": margin}
                values["largest"] = max(a - b for a, b in zip(x.means, y.means, strict=True))
                values["except"] = ", ".join(case.cells[0][i]["scenario"] for i in scenarios)
                row |= {f"{endpoint}_{key}": value for key, value in values.items()}
        return rows

    def _cases(self, pair: Pair, cells: Sequence[Row], *without: str) -> list[Case]:
        """Pairs the cells that two sides name, and groups them by the columns of their row, but some."""
        named = {*pair.x, *without, *(("variant", "observation") if "learner" in pair.x else ())}
        keys = [name for name in self.names if name not in named]
        matched = dict[tuple[str, ...], list[tuple[Row, Row]]]()
        xs, ys = ([cell for cell in cells if side.items() <= cell.items()] for side in pair)
        for x, y in product(xs, ys):
            if all(x[axis] == y[axis] for axis in AXES if axis not in pair.x):
                matched.setdefault(tuple(x[key] for key in keys), []).append((x, y))
        sides = {"x": side_name(pair.x), "y": side_name(pair.y)}
        return [
            Case(dict(zip(keys, values, strict=True)) | sides, ([x for x, _ in own], [y for _, y in own]))
            for values, own in matched.items()
        ]


def analyse(data: Data[ComparisonDeclared]) -> ComparisonAnalysis:
    """Computes a comparison from its runs."""
    plan, learners = plan_of(data.experiment, data.declared), data.experiment.learners
    references = {
        name: [other for other in learners if learners[other].reference_for == name] for name in learners
    }
    order = [name for own in plan.learners for name in (own, *references[own])]
    rank = {name: i for i, name in enumerate(order)}
    runs, curves = (
        frame.loc[frame["learner"].map(rank).dropna().sort_values(kind="stable").index]
        for frame in (data.runs, data.curves)
    )
    cells = [_cell(keys, learners[keys["learner"]], rows) for keys, rows in by_population(runs)]
    return ComparisonAnalysis(data, plan, runs, curves, cells)


def effort(learner: Learner) -> Row:
    """Returns what was spent on the search for a learner's settings: trials, steps and CPU seconds."""
    chosen = learner.chosen
    spent = (0, 0, 0.0) if chosen is None else (chosen.trials, chosen.steps, chosen.cpu_time_s)
    return dict(zip(("settings_tried", "search_steps", "search_cpu_s"), spent, strict=True))


def _cell(keys: Mapping[str, str], learner: Learner, runs: pd.DataFrame) -> Row:
    """Summarises runs after training; the interval of wrong PINGs in training is Student's."""
    first = runs.iloc[0]
    row: Row = {**keys, "policy": first["policy"], "n": len(runs), "budget": first["budget"]}
    row |= {name: proportion(runs[name].to_numpy()) for name in ENDPOINTS}
    means = ("unbounded_score", "steps", "wrong_pings", "uncomfortable_steps", "greedy_success")
    row |= {name: runs[name].to_numpy().mean() for name in means}
    row["random_success"] = first["random_success"]
    if "every_cell_success" in runs:
        row["every_cell_success"] = proportion(runs["every_cell_success"].to_numpy())
    row["diverged"] = int(np.isfinite(runs["diverged_at"]).sum())
    rate = student((runs["training_wrong_pings"] / runs["budget"] * 1000).to_numpy())
    row["training_wrong_pings"] = rate._replace(low=max(rate.low, 0.0))
    return row | effort(learner)


def _difference(case: Case) -> Row:
    """Returns a row without its endpoints: number of runs, policies, wrong PINGs, and the random policy."""
    both = [cell for own in case.cells for cell in own]
    row: Row = {**case.names, "n": min(cell["n"] for cell in both)}
    for side, own, means in zip("xy", case.cells, case.means("success"), strict=True):
        row[f"policy_{side}"] = own[0]["policy"]
        row["random_success"] = means.weights[0] * sum(cell["random_success"] for cell in own)
        row[f"p_random_{side}"] = p_above(means.weights, *means, row["random_success"])
        row[f"wrong_pings_{side}"] = float(np.mean([cell["training_wrong_pings"].value for cell in own]))
    value = row["wrong_pings_x"] - row["wrong_pings_y"]
    reaches = [cell["training_wrong_pings"].high - cell["training_wrong_pings"].value for cell in both]
    reach = float(np.linalg.norm(reaches)) / len(case.cells[0])
    return row | {"wrong_pings_difference": Estimate(value, value - reach, value + reach)}
