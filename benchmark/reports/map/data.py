"""The runs of a map, as its report reads them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agents.dynamic_programming import largest_success
from benchmark.analysis.intervals import BOOTSTRAP_SEED, RESAMPLES, Estimate
from benchmark.analysis.looks import Cell, Decision, Ends, decisions, identities, pairs, read
from benchmark.analysis.stages import stages
from benchmark.execution import driver
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, specifications
from envs import InputError, Scenario, compile_scenario
from envs.scenario import NoisyFeedback

CURRENCIES: Final = ("steps", "disagreements", "cpu_time_s")


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
        """What texts need: the level, the looks, the grids with their axes, and who is a reference."""
        report, solved = self.experiment.report, self.experiment.solved
        assert report is not None
        assert solved is not None
        return {
            "solved": solved.model_dump(mode="json"),
            "looks": report.looks,
            "margin": report.margins.faster,
            "contrasts": len({*identities(self.experiment).values()}),
            "axes": {name: [*grid.axes] for name, grid in self.experiment.grids.items()},
            "references": [name for name, each in self.experiment.algorithms.items() if each.reference_for],
        }

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
            "feedback": feedback.kind,
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

    def steps_compared(self, x: Cell, y: Cell) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns what a contrast uses: the steps, (N,), of its pairs, within the smaller budget."""
        n, budget = self.decided[x, y].n, self._budget(x, y)
        ours, theirs = (self.ends[cell].first(n).took(budget)[0] for cell in (x, y))
        return ours, theirs

    def _budget(self, x: Cell, y: Cell) -> float:
        return min(self.ends[x].budget, self.ends[y].budget)

    def ratio(self, x: Cell, y: Cell, currency: str) -> Estimate:
        """Returns how many times as much y takes as x, by medians over the pairs of a contrast.

        Where most runs never solve, what they spend within the smaller budget counts. It is NaN if that is so
        of both, or if a median is 0. The interval is by resampling pairs, whose runs have the same draw of
        the scenario.
        """
        n, budget, at = self.decided[x, y].n, self._budget(x, y), CURRENCIES.index(currency)
        rng = np.random.default_rng(BOOTSTRAP_SEED)
        drawn = np.vstack([np.arange(n), rng.integers(n, size=(RESAMPLES, n))])
        medians = []
        for cell in (x, y):
            ends = self.ends[cell].first(n)
            found = np.median(ends.took(budget)[at][drawn], axis=1)
            spent = np.median(ends.spent_within(budget)[at])
            medians.append((found, np.where(np.isinf(found), spent, found)))
        (ours, own), (theirs, other) = medians
        if (np.isinf(ours[0]) and np.isinf(theirs[0])) or 0 in (ours[0], theirs[0]):
            return Estimate(np.nan, np.nan, np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):  # some runs may have solved at step 0
            samples = other / own
        return Estimate(float(samples[0]), *map(float, np.nanpercentile(samples[1:], [2.5, 97.5])))

    def is_bound(self, x: Cell, y: Cell) -> bool:
        """Returns whether the ratio of steps is a bound, since most runs of one of them never solve."""
        return any(np.isinf(np.median(steps)) for steps in self.steps_compared(x, y))


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
        found.append(
            "report.contrasts: no compared grid has both learners of a contrast; accepted: one or more."
        )
    if found:
        raise InputError(*(f"{where}: {sentence}" for sentence in found))
    assert experiment.solved is not None
    for cell in {pair[0].place: pair[0] for pair in pairs(experiment)}.values():
        scenario = specifications(experiment, *cell)[0].drawn_scenario
        if (most := _largest_success(scenario, experiment.horizon)) < experiment.solved.success:
            raise InputError(
                f"{where}: solved.success = {experiment.solved.success:g}: in {cell.scenario} at "
                f"{cell.condition.split('/', 1)[1]} no policy succeeds more often than {most:.3g}; "
                "accepted: at most that."
            )


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


@lru_cache(maxsize=1024)
def _largest_success(scenario: Scenario, horizon: int) -> float:
    return largest_success(compile_scenario(scenario), horizon)
