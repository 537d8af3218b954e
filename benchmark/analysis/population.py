"""A population: the records of runs that differ by their seed alone, with exact anchors of their scores."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agents import Algorithm, LearnerSettings, load_algorithm
from agents.dynamic_programming import evaluate, every_cell, from_starts, solve
from agents.policy import uniform_policy
from benchmark.analysis.intervals import resample
from benchmark.execution.store import Store, evaluated
from benchmark.experiments import RunSpecification, evaluation_steps
from envs import ZONES, InputError, Model, Scenario, compile_scenario
from envs.model import PING
from envs.observations import compile_seen

OPTIMUM_TOLERANCE: Final = 1e-9  # a policy counts as optimal up to this distance, which allows for rounding


@dataclass(frozen=True, eq=False)
class Population:
    """All runs of one scenario, condition and learner, in the order of their seeds.

    N agents, T evaluation steps, V map steps, O observations, F fresh states (see `Model.fresh_state`; in S1
    to S3 both are the cells), A actions, R records of max Q.
    """

    specification: Mapping[str, Any]  # of the first run, as recorded
    agents: Sequence[Mapping[str, NDArray[Any]]]  # (N,) arrays, see `benchmark.execution.store.Record`
    seeds: Sequence[int]  # (N,)
    provenance: Sequence[Mapping[str, Any]]  # (N,) see `benchmark.execution.store.Record`

    @cached_property
    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """The arrays of all agents, (N, ...) each, by name."""
        return _Stacked(self.agents)

    @cached_property
    def model(self) -> Model:
        """The scenario as recorded, compiled for the learner's form of observation."""
        scenario = Scenario.model_validate_json(json.dumps(self.specification["scenario"]))
        return compile_seen(scenario, self.specification["observation"])

    @property
    def scenario(self) -> str:
        """The scenario's name."""
        return str(self.specification["scenario"]["name"])

    @property
    def horizon(self) -> int:
        """Steps after which an evaluated episode is truncated."""
        return int(self.specification["horizon"])

    @cached_property
    def evaluation_steps(self) -> list[int]:
        """(T,) in units of the learner's budget."""
        return evaluation_steps(
            self.specification["settings"]["budget"], self.specification["evaluation_every"]
        )

    @cached_property
    def algorithm(self) -> Algorithm:
        """The algorithm that trained the agents."""
        return load_algorithm(self.specification["algorithm"])

    @cached_property
    def settings(self) -> LearnerSettings:
        """The learner's settings, as recorded."""
        return self.algorithm.settings.model_validate_json(json.dumps(self.specification["settings"]))

    @property
    def discount(self) -> float:
        """The discount of the learner's values."""
        return self.settings.discount_factor

    @cached_property
    def map_indices(self) -> NDArray[np.int_]:
        """(V,) indices of the map steps among the evaluation steps."""
        every = self.specification["map_every"] // self.specification["evaluation_every"]
        last = len(self.evaluation_steps) - 1
        return np.array([*range(0, last, every), last])

    @property
    def weights(self) -> NDArray[np.float64]:
        """(RESAMPLES + 1, N) how often each agent counts, see `resample`."""
        return resample(len(self.seeds), self.scenario)

    @property
    def anchors(self) -> Mapping[str, tuple[float, float]]:
        """Exact returns from the start, see `anchors`."""
        return anchors(self.model, self.horizon, "start")

    @cached_property
    def unbounded_scores(self) -> NDArray[np.float64]:
        """(N, T) scores of the greedy policy from the start, see `unbounded_scores_of`."""
        return self.unbounded_scores_of("greedy", "start")

    def unbounded_scores_of(self, policy: str, start: str) -> NDArray[np.float64]:
        """Returns scores, (N, T): grid returns scaled so that 0 is the random policy and 1 the optimal one.

        Args:
          policy: `"greedy"` or `"stochastic"`; the scores of a stochastic policy are (N, 0) if the learner
            has none.
          start: Where episodes start, one of the experiment's `evaluated_from`.
        """
        random, optimal = anchors(self.model, self.horizon, start)["grid_return"]
        returns = self.arrays[evaluated("grid_return", policy, start)]
        return np.asarray((returns - random) / (optimal - random))

    def subset(self, start: int, stop: int) -> "Population":
        """Returns the population of some of the agents, from place `start` to before `stop`."""
        some = slice(start, stop)
        return Population(self.specification, self.agents[some], self.seeds[some], self.provenance[some])

    @cached_property
    def in_target(self) -> NDArray[np.bool_]:
        """(F,) in which fresh states the agent is in the target region."""
        return np.asarray(self.model.zone_of_cell == ZONES.index("target"))

    @property
    def region_overlap(self) -> NDArray[np.float64]:
        """(N,) how the fresh states in which an agent values PING overlap with the target region."""
        return overlap(self.values_ping, self.in_target)

    @cached_property
    def values_ping(self) -> NDArray[np.bool_]:
        """(N, F) in which fresh states an agent values PING after training.

        With action values, where PING's is above zero, and is not what the table began with; with
        probabilities, also of a learner that has both, where PING is the likeliest action.
        """
        stochastic, q = self.arrays["stochastic"], self.arrays["q"]
        if stochastic.shape[1]:
            valued = stochastic[:, -1].argmax(axis=-1) == PING
        else:
            initial = self.specification["settings"].get("initial_value", 0)
            valued = (q[:, :, PING] > 0) & (q[:, :, PING] != initial)
        return np.asarray(valued[:, self.model.observation[self.model.fresh_state]])


class _Stacked(Mapping[str, NDArray[Any]]):
    """The arrays of N agents, (N, ...), each stacked when it is first asked for: all together are large."""

    def __init__(self, agents: Sequence[Mapping[str, NDArray[Any]]]) -> None:
        self.agents = agents  # (N,)
        self._stacked: dict[str, NDArray[Any]] = {}

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self._stacked:
            self._stacked[name] = np.stack([arrays[name] for arrays in self.agents])
        return self._stacked[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.agents[0])

    def __len__(self) -> int:
        return len(self.agents[0])


@lru_cache(maxsize=128)
def anchors(model: Model, horizon: int, start: str) -> Mapping[str, tuple[float, float]]:
    """Computes the exact returns of the random and of the optimal policy.

    Args:
      model: Compiled scenario.
      horizon: Steps after which an episode is truncated.
      start: `"start"`, or `"every_cell"`: see `agents.dynamic_programming.every_cell`.

    Returns:
      (random, optimal) for `"grid_return"`, the grid's rewards alone, and `"scenario_return"`, with the
      issuer's.
    """
    starts = every_cell(model) if start == "every_cell" else from_starts(model)
    random = evaluate(model, uniform_policy(model), horizon, starts)
    grid, both = (starts @ solve(model, 1.0, horizon, issuer_rewards=each).value for each in (False, True))
    return {
        "grid_return": (float(random.grid_return), float(grid)),
        "scenario_return": (float(random.scenario_return), float(both)),
    }


def check_anchors(model: Model, horizon: int, start: str) -> None:
    """Checks that scores are defined: that the optimal policy earns more than the random one; see `anchors`.

    Raises:
      InputError: It does not.
    """
    random, optimal = anchors(model, horizon, start)["grid_return"]
    if optimal - random <= OPTIMUM_TOLERANCE:
        raise InputError(
            f"{model.scenario.name}: within {horizon} steps the random policy earns as much as the optimal "
            f"one ({random:.6g}), so scores are undefined; accepted: other rewards, or another horizon."
        )


def check_scores(runs: Iterable[RunSpecification]) -> None:
    """Checks that the scores of all these runs are defined, see `check_anchors`."""
    for scenario, horizon, starts in {(run.scenario, run.horizon, run.evaluated_from) for run in runs}:
        for start in starts:
            check_anchors(compile_scenario(scenario), horizon, start)


def overlap(cells: NDArray[np.bool_], in_target: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Returns the intersection over union of sets of cells, (..., O), and the target region, (...)."""
    return np.asarray((cells & in_target).sum(axis=-1) / (cells | in_target).sum(axis=-1))


def load_population(runs: Sequence[RunSpecification], store: Store, *, fewest: int = 2) -> Population:
    """Reads the records of a population.

    Args:
      runs: All its runs; they differ by their seed alone.
      store: Where their records are.
      fewest: The least number of runs accepted; a single run has no intervals.

    Raises:
      InputError: There are fewer runs, or some are missing or failed.
    """
    if len(runs) < fewest:
        raise InputError(
            f"runs per scenario and learner = {len(runs)}: accepted: at least {fewest}, "
            "since a single run has no interval."
        )
    ended = store.ended()
    missing = [run.seed for run in runs if run.digest not in ended]
    if missing:
        raise InputError(
            f"{len(missing)} of {len(runs)} runs of {runs[0].variant} in {runs[0].scenario.name} are "
            f"missing or failed (the first is seed {missing[0]}): run the experiment first."
        )
    records = store.get([run.digest for run in runs])
    return Population(
        specification=json.loads(records[0].specification),
        agents=[record.arrays for record in records],
        seeds=[run.seed for run in runs],
        provenance=[record.provenance for record in records],
    )


def optimal_values(population: Population) -> NDArray[np.float64]:
    """Returns Q* of every fresh state, (F, A); undiscounted, up to the horizon."""
    model = population.model
    horizon = None if population.discount < 1 else population.horizon
    return solve(model, population.discount, horizon).q[model.fresh_state]
