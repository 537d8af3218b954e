"""The runs of a comparison: the cells of a table of scenarios, conditions and learners."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agents.dynamic_programming import evaluate
from agents.policy import uniform_policy
from benchmark.analysis.contrasts import Means
from benchmark.analysis.intervals import Estimate, student
from benchmark.analysis.population import Population, load_population
from benchmark.execution.store import Store, evaluated
from benchmark.experiments import Experiment, RunSpecification, specifications
from benchmark.experiments.search import Chosen
from benchmark.experiments.specification import tuning_of
from benchmark.reports.comparison.declared import Declared, Learner, Side
from benchmark.reports.learners import Names
from envs import InputError, Model

Values = NDArray[np.float64]
Place = tuple[str, str, Learner]  # scenario, condition and learner
Listed = Mapping[Place, Sequence[RunSpecification]]  # the runs of cells

SB3: Final = "Stable-Baselines3 itself"  # what trains references, as readers see it
CELL: Final = dict.fromkeys(("scenario", "condition", "learner"), "")  # columns, unlabelled
EFFORT: Final = {  # columns
    "settings_tried": "settings tried",
    "search_steps": "steps of the search",
    "search_cpu_s": "CPU seconds of the search",
}
PAIR: Final = dict.fromkeys(("scenario", "condition", "x", "y"), "")
_LISTED: Final = 4  # cells that a sentence on missing runs names
_ROUNDING: Final = 9  # digits, so that the last digit of two optima does not decide which of them is better


@dataclass(frozen=True, eq=False)
class Cell:
    """The runs of a learner in a scenario under a condition, evaluated by the policy that counts."""

    scenario: str
    condition: str
    learner: Learner
    population: Population
    policy: str = "greedy"  # or "stochastic"
    has_conditions: bool = False  # whether there are others, so that rows have to name this one

    @property
    def place(self) -> dict[str, str]:
        """What names its scenario and condition in a table."""
        return {"scenario": self.scenario} | ({"condition": self.condition} if self.has_conditions else {})

    @property
    def names(self) -> dict[str, str]:
        """What names the cell in a table."""
        return self.place | self.learner._asdict()

    @property
    def n(self) -> int:
        """How many runs there are."""
        return len(self.population.seeds)

    @property
    def steps(self) -> list[int]:
        """(T,) when policies were evaluated."""
        return self.population.evaluation_steps

    def row(self, **values: Any) -> dict[str, Any]:
        """Returns a row of a table about this cell."""
        return self.names | values

    def results(self, name: str, start: str = "start") -> Values:
        """Returns what the policy that counts is evaluated as, (N, T).

        Args:
          name: `"score"`, clipped to [0, 1]; `"unbounded_score"`; or a field of
            `agents.dynamic_programming.Evaluation`.
          start: Where episodes start.
        """
        if name in ("score", "unbounded_score"):
            scores = np.round(self.population.unbounded_scores_of(self.policy, start), _ROUNDING)
            return scores if name == "unbounded_score" else np.clip(scores, 0.0, 1.0)
        return np.asarray(self.population.arrays[evaluated(name, self.policy, start)])

    def final(self, name: str, start: str = "start") -> Values:
        """Returns what the policy is evaluated as after training, (N,)."""
        return self.results(name, start)[:, -1]

    @cached_property
    def wrong_pings(self) -> Estimate:
        """Wrong PINGs per 1,000 steps of the whole training, with Student's interval."""
        rate = student(self.population.arrays["disagreements"][:, -1] / self.steps[-1] * 1000)
        return rate._replace(low=max(rate.low, 0.0))

    @property
    def random_success(self) -> float:
        """How often the random policy succeeds, exactly."""
        return _random_success(self.population.model, self.population.horizon)


@lru_cache(maxsize=128)
def _random_success(model: Model, horizon: int) -> float:
    return float(evaluate(model, uniform_policy(model), horizon).success)


def means_of(cells: Sequence[Cell], name: str, start: str = "start") -> Means:
    """Returns the means over the runs of each cell after training, for contrasts; see `Cell.results`."""
    return Means([float(cell.final(name, start).mean()) for cell in cells], [cell.n for cell in cells])


@dataclass(frozen=True, eq=False)
class Runs:
    """All cells of a comparison. Planners, which know the model, are apart: they say what is possible."""

    cells: Sequence[Cell]  # by learner, in the order declared; a reference follows its learner
    planners: Sequence[Cell]
    declared: Declared
    groups: Mapping[str, str]  # algorithm to its group; those of none are drawn with all
    references: Mapping[Learner, Learner]  # reference implementations to their learners
    missing: str = ""  # which runs are missing; empty if none is
    seeds_note: str = ""  # which seeds there are instead of those declared
    names: Names = field(default_factory=lambda: Names({}, {}))  # what readers call learners
    # What a search has chosen, of learners that have their settings from one.
    searches: Mapping[Learner, Chosen] = field(default_factory=dict)

    def __iter__(self) -> Iterator[Cell]:
        return iter(self.cells)

    @property
    def learners(self) -> dict[Learner, list[Cell]]:
        """The cells of every learner."""
        found: dict[Learner, list[Cell]] = {}
        for cell in self.cells:
            found.setdefault(cell.learner, []).append(cell)
        return found

    def effort(self, learner: Learner) -> dict[str, float]:
        """Returns what was spent on the search for a learner's settings: trials, steps and CPU seconds."""
        found = self.searches.get(learner)
        spent = (0, 0, 0.0) if found is None else (found.trials, found.steps, found.cpu_time_s)
        return dict(zip(EFFORT, spent, strict=True))

    @property
    def over_scenarios(self) -> list[tuple[dict[str, str], list[Cell]]]:
        """The cells of every learner under every condition, and what names them."""
        found: dict[tuple[tuple[str, str], ...], list[Cell]] = {}
        for cell in self.cells:
            names = tuple((axis, name) for axis, name in cell.names.items() if axis != "scenario")
            found.setdefault(names, []).append(cell)
        return [(dict(names), cells) for names, cells in found.items()]

    @property
    def own(self) -> "Runs":
        """The same without references."""
        cells = [cell for cell in self if cell.learner not in self.references]
        return replace(self, cells=cells, references={})

    @property
    def scenarios(self) -> list[str]:
        """The scenarios, in the order declared."""
        return list(dict.fromkeys(cell.scenario for cell in self.cells))

    def matched(self, x: Side, y: Side) -> list[tuple[Cell, Cell]]:
        """Returns the cells that two sides name, each with the other that differs by what the sides name."""
        places = {(cell.scenario, cell.condition, cell.learner): cell for cell in self.cells}
        pairs = []
        for place, cell in places.items():
            if all(name in (None, own) for name, own in zip(x, place, strict=True)):
                other = tuple(own if name is None else name for name, own in zip(y, place, strict=True))
                if other in places:
                    pairs.append((cell, places[other]))
        return pairs

    @property
    def note(self) -> str:
        """What is missing or other than declared, in sentences; empty if nothing is."""
        missing = f"Partial: {self.missing}." if self.missing else ""
        return " ".join(filter(None, [missing, self.seeds_note]))

    @property
    def is_incomplete(self) -> bool:
        """Whether runs are missing."""
        return bool(self.missing)

    @property
    def facts(self) -> dict[str, object]:
        """What was to be decided, see `Declared.from_manifest`."""
        everyone = [*self.cells, *self.planners]
        return {
            "declared": self.declared.reporting.model_dump_json(),
            "learners": {str(learner): family for learner, family in self.declared.families.items()},
            "axes": {
                "scenarios": list(dict.fromkeys(cell.scenario for cell in everyone)),
                "conditions": list(dict.fromkeys(cell.condition for cell in everyone)),
            },
        }

    @property
    def panels(self) -> Mapping[str, Sequence[Learner]]:
        """The learners that are drawn together, without references, by the title of their panel."""
        learners = [learner for learner in self.learners if learner not in self.references]
        everywhere = [learner for learner in learners if not self.groups.get(learner.algorithm)]
        panels: dict[str, list[Learner]] = {}
        for learner in learners:
            if group := self.groups.get(learner.algorithm):
                panels.setdefault(group, [*everywhere]).append(learner)
        return panels or {"": everywhere}

    @property
    def algorithms(self) -> Sequence[str]:
        """All that are declared, in the order of their colours, without references."""
        names = [learner.algorithm for learner in self.declared.families if learner not in self.references]
        return list(dict.fromkeys(names))

    @property
    def reference_note(self) -> str:
        """What figures say of references; empty if there are none."""
        references = [cell for cell in self if cell.learner in self.references]
        if not references:
            return ""
        sizes = [cell.n for cell in references]
        n = f"{max(sizes)}" if min(sizes) == max(sizes) else f"{min(sizes)} to {max(sizes)}"
        algorithms = [cell.population.algorithm for cell in references]
        nets = [each for each in algorithms if each.family == "deep"]
        is_sb3 = bool(nets) and all("stable_baselines3" in each.packages for each in nets)
        return f"hollow: reference implementations, {n} runs{f', nets by {SB3}' if is_sb3 else ''}"


def load(experiment: Experiment, store: Store, seeds: Sequence[int] | None, partial: bool) -> Runs:
    """Reads all runs of a comparison; in part, without learners with fewer than two seeds in all scenarios.

    Raises:
      InputError: Runs are missing, and which; or there are too few to draw anything.
    """
    statuses, ended = store.statuses(), store.ended()
    wanted = {
        (Path(scenario).stem, condition, Learner(name, observation)): specifications(
            experiment, condition, scenario, name, observation, seeds
        )
        for condition in experiment.conditions
        for scenario, name, observation in experiment.populations
    }
    there = {place: [run for run in runs if run.digest in ended] for place, runs in wanted.items()}
    missing = _missing(wanted, there, statuses)
    if missing and not partial:
        raise InputError(
            f"{experiment.name}: {missing}: run the experiment first, or draw the existing runs with "
            "--partial."
        )
    algorithms = experiment.algorithms
    order = {learner: i for i, learner in enumerate(dict.fromkeys(learner for _, _, learner in wanted))}
    references = {
        learner: Learner(algorithms[learner.algorithm].reference_for, learner.observation)
        for learner in order
        if algorithms[learner.algorithm].reference_for
    }
    few = {learner for learner in order if len(_common_seeds(learner, there)) < 2}
    few |= {reference for reference, learner in references.items() if learner in few}
    cells: list[Cell] = []
    planners: list[Cell] = []

    def rank(place: Place) -> tuple[int, bool, int]:
        learner = place[2]
        return order[references.get(learner, learner)], learner in references, order[learner]

    for place in sorted(there, key=rank):
        *_, learner = place
        if learner in few:
            continue
        population = load_population(there[place], store)
        policy = algorithms[learner.algorithm].policy
        if not population.unbounded_scores_of(policy, "start").shape[1]:
            raise InputError(
                f"{experiment.argument}: algorithms.{learner.algorithm}.policy = {policy}: its training "
                "returns no such policy; accepted: greedy."
            )
        cell = Cell(*place, population, policy, len(experiment.conditions) > 1)
        (planners if population.algorithm.family == "planner" else cells).append(cell)
    if len({cell.learner for cell in cells} - references.keys()) < 2:
        raise InputError(
            f"{experiment.name}: {missing or 'too few runs'}: accepted: at least two learners that are "
            "neither reference implementations nor planners, each with two runs of every scenario."
        )
    left_out = "left out: " + ", ".join(f"`{learner}`" for learner in sorted(few)) if few else ""
    seeds_note = ""
    if seeds is not None:
        seeds_note = f"Every learner has the seeds {min(seeds)} to {max(seeds)} instead of those declared."
    return Runs(
        cells,
        planners,
        Declared.of(experiment),
        groups={name: declared.group for name, declared in algorithms.items()},
        references={each: learner for each, learner in references.items() if each not in few},
        missing="; ".join(filter(None, [missing, left_out])),
        seeds_note=seeds_note,
        names=Names.of(experiment),
        searches={each: chosen for each in order if (chosen := tuning_of(experiment, *each))},
    )


def _common_seeds(learner: Learner, there: Listed) -> set[int]:
    """Returns the seeds of which a learner has a run everywhere."""
    own = [{run.seed for run in runs} for place, runs in there.items() if place[2] == learner]
    return set.intersection(*own)


def _missing(wanted: Listed, there: Listed, statuses: Mapping[str, str]) -> str:
    """Says which runs are missing; empty if none is."""
    lacking = [
        f"{place[2]} in {place[0]} has {len(there[place])} of {len(runs)}"
        for place, runs in wanted.items()
        if len(there[place]) < len(runs)
    ]
    if not lacking:
        return ""
    n_runs = sum(map(len, wanted.values()))
    n_failed = sum(statuses.get(run.digest) == "failed" for runs in wanted.values() for run in runs)
    more = f"; and {len(lacking) - _LISTED} more populations" if len(lacking) > _LISTED else ""
    failed = f", {n_failed} of them failed" if n_failed else ""
    n_missing = n_runs - sum(map(len, there.values()))
    return f"{n_missing} of {n_runs} runs are missing{failed} ({'; '.join(lacking[:_LISTED])}{more})"
