"""The runs of a map, as its report reads them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agents import load_algorithm
from benchmark.analysis.intervals import BOOTSTRAP_SEED, RESAMPLES, Estimate, quantile
from benchmark.analysis.looks import Cell, Decision, Ends, decisions, identities, pairs, read
from benchmark.analysis.stages import stages
from benchmark.execution import driver
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, specifications
from envs import InputError, Scenario
from envs.scenario import NoisyFeedback

_SIDES: Final = ["deep", "tabular"]
CURRENCIES: Final = ("steps", "disagreements", "cpu_time_s")
_MOST: Final = 10.0  # a logarithm of a ratio that stands for never
_CROSSED: Final = 1e-9  # a difference of logarithms that is none but for rounding


@dataclass(frozen=True, eq=False)
class Maps:
    """What the runs of an experiment with grids took until they had solved."""

    experiment: Experiment
    ends: Mapping[Cell, Ends]
    note: str = ""
    is_incomplete: bool = False

    @cached_property
    def decided(self) -> dict[tuple[Cell, Cell], Decision]:
        """What the last look at each contrast says."""
        return decisions(self.experiment, self.ends)

    @property
    def facts(self) -> Mapping[str, object]:
        """What texts need: the level, the looks, and the grids."""
        report, solved = self.experiment.report, self.experiment.solved
        assert report is not None
        assert solved is not None
        return {
            "solved": solved.model_dump(mode="json"),
            "looks": report.looks,
            "margin": report.margins.faster,
            "contrasts": len({*identities(self.experiment).values()}),
            "grids": {name: self.experiment.grids[name].question for name in self.experiment.grids},
            "contrast": next(
                (
                    [x.learner, y.learner]
                    for x, y in self.decided
                    if [self.family(x), self.family(y)] == _SIDES
                ),
                None,
            ),
            "axes": {name: [*grid.axes] for name, grid in self.experiment.grids.items()},
            "families": {cell.learner: self.family(cell) for cell in self.ends},
            "stochastic": [
                name for name, each in self.experiment.algorithms.items() if each.policy == "stochastic"
            ],
            "references": [name for name, each in self.experiment.algorithms.items() if each.reference_for],
        }

    def family(self, cell: Cell) -> str:
        """Returns what a cell's learner is: tabular or deep."""
        declared = self.experiment.algorithms[cell.variant]
        return declared.family or load_algorithm(declared.algorithm).family

    def is_reference(self, cell: Cell) -> bool:
        """Returns whether a cell is of a reference implementation."""
        return bool(self.experiment.algorithms[cell.variant].reference_for)

    def scenario(self, cell: Cell) -> Scenario:
        """Returns a cell's scenario, of which every run has another draw."""
        if cell.place not in self._scenarios:
            self._scenarios[cell.place] = specifications(self.experiment, *cell)[0].scenario
        return self._scenarios[cell.place]

    @cached_property
    def _scenarios(self) -> dict[tuple[str, str], Scenario]:
        return {}

    def key(self, cell: Cell) -> dict[str, Any]:
        """Returns the columns that name a point: its grid, its name there, and what the scenario is."""
        _, grid, *point = cell.condition.split("/")
        scenario = self.scenario(cell)
        feedback, issuer = scenario.issuer.feedback, scenario.issuer
        return {
            "grid": grid,
            "point": ", ".join(each.replace("=", " ") for each in point),
            "rows": scenario.grid.rows,
            "columns": scenario.grid.columns,
            "places": len(scenario.places) - issuer.unseen,
            "unseen": issuer.unseen,
            "noise": feedback.noise if isinstance(feedback, NoisyFeedback) else 0.0,
            "permuted": issuer.permuted,
        }

    @cached_property
    def lines(self) -> dict[str, dict[str, list[tuple[float, Cell]]]]:
        """Of every grid with one axis the cells of each learner, with the axis' values, rising."""
        found: dict[str, dict[str, list[tuple[float, Cell]]]] = {}
        for cell in self.ends:
            _, grid, *point = cell.condition.split("/")
            if len(point) == 1:
                line = found.setdefault(grid, {}).setdefault(cell.learner, [])
                line.append((number(point[0].split("=")[1]), cell))
        return found

    @cached_property
    def weights(self) -> NDArray[np.float64]:
        """(RESAMPLES + 1, seeds) how much the runs of each seed count: the first time all alike.

        Exponential weights (the Bayesian bootstrap: Rubin 1981, Annals of Statistics 9:130-134) suit cells
        with different numbers of runs. All cells share them, as runs of a seed share their draw of places.
        """
        most = max(each.n for each in self.ends.values())
        drawn = np.random.default_rng(BOOTSTRAP_SEED).exponential(size=(RESAMPLES, most))
        return np.vstack([np.ones(most), drawn])

    def medians(self, cell: Cell, currency: str, budget: float = np.inf) -> NDArray[np.float64]:
        """Returns the median of what runs took, (RESAMPLES + 1,), the first of the runs as they are.

        It is infinite where most never solve.
        """
        ends = self.ends[cell]
        took = ends.took(budget)[CURRENCIES.index(currency)]
        order = np.argsort(took, kind="stable")
        total = self.weights[:, : ends.n][:, order].cumsum(axis=1)
        middle = (total < total[:, -1:] / 2 * (1 - 1e-12)).sum(axis=1)
        return np.asarray(took[order][middle])

    def ratio(self, x: Cell, y: Cell, currency: str) -> Estimate:
        """Returns how many times as much y takes as x, by restricted medians.

        Where most runs never solve, what they spend within the budget counts. NaN if that is so of both.
        """
        budget = min(self.ends[x].budget, self.ends[y].budget)
        medians = [self.medians(each, currency, budget) for each in (x, y)]
        if all(np.isinf(each[0]) for each in medians):
            return Estimate(np.nan, np.nan, np.nan)
        ours, theirs = (
            np.where(np.isinf(each), self._spent(cell, currency, budget), each)
            for each, cell in zip(medians, (x, y), strict=True)
        )
        samples = theirs / ours
        return Estimate(float(samples[0]), *map(float, np.percentile(samples[1:], [2.5, 97.5])))

    def is_bound(self, x: Cell, y: Cell) -> bool:
        """Returns whether the ratio of steps is a bound, since most runs of one of them never solve."""
        budget = min(self.ends[x].budget, self.ends[y].budget)
        return any(np.isinf(self.medians(cell, "steps", budget)[0]) for cell in (x, y))

    def _spent(self, cell: Cell, currency: str, budget: float) -> float:
        """Returns the median of what runs of a cell spend of a budget."""
        return float(np.median(self.ends[cell].spent_within(budget)[CURRENCIES.index(currency)]))

    def crossing(self, x: list[tuple[float, Cell]], y: list[tuple[float, Cell]], currency: str) -> Estimate:
        """Returns from which value of the axis on x takes less than y, by medians, with a 95 % interval.

        Between two values it is where the straight line between the logarithms of the ratios is zero. It is
        the first value if x takes less everywhere, and infinite if it does not at the last one.
        """
        others = dict(y)
        shared = [(value, cell, others[value]) for value, cell in x if value in others]
        budget = min(self.ends[each].budget for _, *both in shared for each in both)
        logs = []
        for _, one, other in shared:
            ours, theirs = (self.medians(each, currency, budget) for each in (one, other))
            # Where the table never solves, what it spends counts, which does not favour the net.
            theirs = np.where(np.isinf(theirs), self._spent(other, currency, budget), theirs)
            with np.errstate(divide="ignore"):  # a table may take no measurable time
                logs.append(np.where(np.isinf(ours), -_MOST, np.log(theirs / ours).clip(-_MOST)))
        values = np.array([value for value, *_ in shared])
        found = _crossings(values, np.array(logs).T)
        low = np.percentile(found[1:], 2.5, method="lower")
        high = np.percentile(found[1:], 97.5, method="higher")
        return Estimate(float(found[0]), float(low), float(high))

    def exponent(self, line: list[tuple[float, Cell]]) -> tuple[int, Estimate]:
        """Returns the exponent of steps against an axis, by least squares of logarithms of medians.

        Only values count at which most runs solve, and there must be three; how many there are comes first.
        """
        medians = {value: self.medians(cell, "steps") for value, cell in line if value > 0}
        finite = {value: steps for value, steps in medians.items() if np.isfinite(steps[0])}
        if len(finite) < 3:
            return len(finite), Estimate(np.nan, np.nan, np.nan)
        logs = np.log([*finite])
        centred = logs - logs.mean()
        steps = np.array([*finite.values()])
        budgets = [[self.ends[cell].budget] for value, cell in line if value in finite]
        samples = centred @ np.log(np.where(np.isinf(steps), budgets, steps)) / (centred @ centred)
        return len(finite), Estimate(float(samples[0]), *map(float, np.percentile(samples[1:], [2.5, 97.5])))


def _crossings(values: NDArray[np.float64], logs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns from which value on each row of logarithms of ratios, (B, values), is above 0.

    >>> logs = np.array([[-1.0, -1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, -1.0]])
    >>> _crossings(np.array([1.0, 10.0, 100.0]), logs)
    array([31.6227766,  1.       ,        inf])
    """
    found = []
    for row in logs:
        below = np.flatnonzero(row <= _CROSSED)
        if not len(below):
            found.append(values[0])
        elif below[-1] == len(values) - 1:
            found.append(np.inf)
        else:
            i = int(below[-1])
            before, after = row[i : i + 2]
            share = -before / (after - before)
            found.append(float(np.exp((1 - share) * np.log(values[i]) + share * np.log(values[i + 1]))))
    return np.array(found)


def number(value: str) -> float:
    """Returns the value of an axis as a number: 5x6 is 30.

    >>> number("0.5"), number("5x6")
    (0.5, 30.0)
    """
    return float(np.prod([float(part) for part in value.split("x")]))


def check(experiment: Experiment) -> None:
    """Refuses, by an InputError, an experiment without grids or looks, or with contrasts of unequal seeds."""
    report, where = experiment.report, experiment.argument
    assert report is not None
    found = []
    if len(experiment.scenarios) > 1:
        found.append(f"scenarios: {len(experiment.scenarios)}: accepted: exactly one.")
    for key, is_there in (
        ("[grids]", bool(experiment.grids)),
        ("[solved]", experiment.solved is not None),
        ("report.looks", bool(report.looks)),
        ("report.contrasts", bool(report.contrasts)),
    ):
        if not is_there:
            found.append(f"{key} is missing; this report needs it.")
    if [*report.looks] != sorted({*report.looks}):
        found.append(f"report.looks = {[*report.looks]}: accepted: increasing numbers.")
    known = {f"{name}, {observation}": name for _, name, observation in experiment.populations}
    for contrast in report.contrasts:
        found += [
            f"report.contrasts: {side}: accepted: {', '.join(known)}."
            for side in contrast
            if side not in known
        ]
        compared = {known[side]: experiment.algorithms[known[side]] for side in contrast if side in known}
        for name, declared in compared.items():
            if report.looks and declared.seeds != min(report.looks):
                accepted = f"report.looks[0] = {report.looks[0]}, as report.contrasts names it"
                found.append(f"algorithms.{name}.seeds = {declared.seeds}: accepted: {accepted}.")
        if len({declared.first_seed for declared in compared.values()}) > 1:
            found.append(f"report.contrasts: {' and '.join(contrast)}: accepted: the same first_seed.")
    if not found and not pairs(experiment):
        found.append("report.contrasts: no compared grid has both learners of any; accepted: one or more.")
    if found:
        raise InputError(*(f"{where}: {sentence}" for sentence in found))


def load(experiment: Experiment, store: Store, seeds: Sequence[int] | None, partial: bool) -> Maps:
    """Reads all runs of a map.

    Raises:
      InputError: Some are missing, or other seeds are asked for.
    """
    if seeds is not None:
        raise InputError(
            f"{experiment.name}: --seeds: a map uses only its declared seeds; remove the option."
        )
    largest: dict[Cell, int] = {}
    missing = sum(len(driver.pending(runs, store)) for runs in stages(experiment, store))
    if missing and not partial:
        raise InputError(f"{experiment.name}: {missing} runs are missing: run the experiment first.")
    ends = read(experiment, store)
    for pair, decision in decisions(experiment, ends).items():
        for cell in pair:
            largest[cell] = max(decision.n, largest.get(cell, 0))
    ends = {cell: each.first(largest.get(cell, each.n)) for cell, each in ends.items()}
    if not largest:
        raise InputError(f"{experiment.name}: no contrast has enough runs yet: run the experiment first.")
    note = f"Partial: at least {missing:,} runs are missing." if missing else ""
    return Maps(experiment, ends, note, bool(missing))


def median(values: NDArray[np.float64]) -> Estimate:
    """Returns the median of what runs took, with an interval that needs no assumption."""
    return quantile(values, 0.5)
