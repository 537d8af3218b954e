"""What is computed of a comparison, once: its cells, their differences, and the verdicts on them.

A *cell* is the runs of a learner in a scenario. Every contrast is the difference of two learners, x minus y,
in one scenario or in the mean over all.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, product
from typing import Any, Final, NamedTuple

import pandas as pd

from benchmark.analysis.intervals import mean_over_scenarios, p_above, proportion, student
from benchmark.experiments import Experiment
from benchmark.studies.comparison.contrasts import ALPHA, Means, contrast, holm, over_scenarios, verdict
from benchmark.studies.comparison.declared import ComparisonDeclared, Pair
from benchmark.studies.data import Data

Row = dict[str, Any]
NAMES: Final = ("scenario", "variant", "observation")  # columns that name a learner in a scenario
ENDPOINTS: Final = ("success", "score")  # in the order in which they count
FEWEST_RUNS: Final = 10  # per scenario and learner; with fewer there is no verdict
# Verdicts that need a side that is shown to succeed more often than the random policy
_OF_LEARNERS: Final = {"success": ("better", "worse", "equivalent"), "score": ("equivalent",)}


class Case(NamedTuple):
    """What a row compares: two learners, in one scenario or in all."""

    pair: Pair
    scenarios: Sequence[str]


@dataclass(frozen=True, eq=False)
class ComparisonAnalysis:
    """A comparison: what is compared, its runs, and the differences."""

    data: Data[ComparisonDeclared]
    learners: Sequence[str]  # without references
    runs: pd.DataFrame  # learner after learner, references behind their learners
    curves: pd.DataFrame
    cells: Mapping[tuple[str, str], Row]  # the summary of each learner in each scenario, by these two

    @property
    def experiment(self) -> Experiment:
        """The experiment."""
        return self.data.experiment

    @property
    def is_pooled(self) -> bool:
        """Whether verdicts are on means over scenarios."""
        return self.data.declared.pool == "scenarios"

    @cached_property
    def drawn(self) -> set[str]:
        """The baselines and the nets compared with them, or else all that are compared, or else all."""
        asked, learners = self.data.declared, self.experiment.learners
        pairs = [(x, y) for x, y in asked.contrasts if y in asked.baseline]
        nets = {x for x, _ in pairs if learners[x].family == "deep"}
        return {*asked.baseline, *nets} if nets else {*chain(*asked.contrasts)} or {*self.learners}

    @property
    def over_training(self) -> set[str]:
        """The learners in the figure of success over training."""
        return {*self.data.declared.curves} or self.drawn

    @cached_property
    def pooled(self) -> list[tuple[Row, str, list[pd.DataFrame]]]:
        """Each learner, with its columns in tables and its runs by scenario, if scenarios are pooled."""
        learners = by_learner(self.runs, NAMES[1:]) if self.is_pooled else ()
        return [
            (names, name, [own for _, own in runs.groupby("scenario", sort=False)])
            for names, name, runs in learners
        ]

    @cached_property
    def aggregate(self) -> list[Row]:
        """Every learner after training, in means over scenarios."""
        found = []
        for names, _, scenarios in self.pooled:
            first, n_runs = scenarios[0], sum(map(len, scenarios))
            row = {**names, "policy": first["policy"].iloc[0], "runs": n_runs}
            for key in (*ENDPOINTS, *(f"every_cell_{endpoint}" for endpoint in ENDPOINTS)):
                if key in first:
                    row[key] = mean_over_scenarios([own[key].to_numpy() for own in scenarios])
            found.append(row)
        return found

    @cached_property
    def contrasts(self) -> list[Row]:
        """The declared contrasts with their verdicts, the latest first; one per scenario without pooling."""
        every = (*self.experiment.scenarios,)
        each = [(name,) for name in every]
        groups, asked = [every] if self.is_pooled else each, self.data.declared
        later = [Case(*case) for case in product(asked.later, dict.fromkeys([*groups, *each]))]
        declared = [Case(pair, names) for names, pair in product(groups, asked.contrasts)]
        return [*(row | {"declared": "later"} for row in self._compared(later)), *self._compared(declared)]

    def _means(self, case: Case, endpoint: str) -> tuple[Means, Means]:
        """Returns the means of x and of y by scenario."""
        sides = ([self.cells[name, scenario] for scenario in case.scenarios] for name in case.pair)
        x, y = (Means([cell[endpoint].value for cell in own], [cell["n"] for cell in own]) for own in sides)
        return x, y

    def _difference(self, case: Case) -> Row:
        """Returns a row without its endpoints; p-values are not adjusted."""
        sides = self._means(case, "success")
        row: Row = {"scenario": case.scenarios[0] if len(case.scenarios) == 1 else ""}
        row |= dict(zip("xy", case.pair, strict=True)) | {"n": min(min(means.sizes) for means in sides)}
        for side, name, means in zip("xy", case.pair, sides, strict=True):
            random = sum(self.cells[name, scenario]["random_success"] for scenario in case.scenarios)
            row[f"p_random_{side}"] = p_above(means.weights, *means, means.weights[0] * random)
        return row

    def _compared(self, cases: Sequence[Case]) -> list[Row]:
        """Returns these contrasts, whose p-values are adjusted together."""
        rows = [self._difference(case) for case in cases]
        for key in ("p_random_x", "p_random_y"):
            for row, p in zip(rows, holm([row[key] for row in rows]), strict=True):
                row[key] = p
        for endpoint in ENDPOINTS:
            margin: float = getattr(self.data.declared.margins, endpoint)
            tests = [contrast(*self._means(case, endpoint), margin) for case in cases]
            different = holm([test.p_different for test in tests])
            equivalent = holm([test.p_equivalent for test in tests])
            for case, row, test, p, q in zip(cases, rows, tests, different, equivalent, strict=True):
                decided, (x, y) = verdict(test.difference, p, q), self._means(case, endpoint)
                if row["n"] < FEWEST_RUNS:
                    decided = "no verdict"
                elif decided in _OF_LEARNERS[endpoint] and min(row["p_random_x"], row["p_random_y"]) > ALPHA:
                    decided = "neither learned"
                decided, apart = over_scenarios(decided, x, y, margin)
                values = {"x": x.mean, "y": y.mean, **test._asdict(), "p_different": p, "p_equivalent": q}
                named = ", ".join(case.scenarios[i] for i in apart)
                values |= {"verdict": decided, "margin": margin, "except": named}
                row |= {f"{endpoint}_{key}": value for key, value in values.items()}
        return rows


def analyse(data: Data[ComparisonDeclared]) -> ComparisonAnalysis:
    """Computes a comparison from its runs."""
    learners = data.experiment.learners
    own_learners = [name for name, learner in learners.items() if not learner.reference_for]
    order = [
        name
        for own in own_learners
        for name, learner in learners.items()
        if own in (name, learner.reference_for)
    ]
    runs, curves = (
        frame.sort_values("learner", key=lambda names: names.map(order.index), kind="stable")
        for frame in (data.runs, data.curves)
    )
    cells = {(name, names["scenario"]): _cell(names, rows) for names, name, rows in by_learner(runs)}
    return ComparisonAnalysis(data, own_learners, runs, curves, cells)


def by_learner(frame: pd.DataFrame, names: Iterable[str] = NAMES) -> Iterator[tuple[Row, str, pd.DataFrame]]:
    """Yields each learner's columns in tables, its name and its rows, in each scenario or over all."""
    for (name, *values), rows in frame.groupby(["learner", *names], sort=False):
        yield dict(zip(names, values, strict=True)), str(name), rows


def _cell(names: Row, runs: pd.DataFrame) -> Row:
    """Summarises runs after training; the interval of wrong PINGs in training is Student's."""
    first = runs.iloc[0]
    row: Row = {**names, "policy": first["policy"], "n": len(runs), "budget": first["budget"]}
    row |= {name: proportion(runs[name].to_numpy()) for name in ENDPOINTS}
    means = ("unbounded_score", "steps", "wrong_pings", "greedy_success")
    row |= {name: runs[name].to_numpy().mean() for name in means}
    row["random_success"] = first["random_success"]
    if "every_cell_success" in runs:
        row["every_cell_success"] = proportion(runs["every_cell_success"].to_numpy())
    rate = student((runs["training_wrong_pings"] / runs["budget"] * 1000).to_numpy())
    row["training_wrong_pings"] = rate._replace(low=max(rate.low, 0.0))
    return row
