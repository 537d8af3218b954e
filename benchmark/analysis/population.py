"""Records become populations: all agents of one cell of an experiment, with exact anchors of their scores."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agents import Algorithm, LearnerSettings, load_algorithm
from agents.dynamic_programming import evaluate, every_cell, solve
from agents.policy import uniform_policy
from benchmark.analysis.intervals import resample
from benchmark.execution.store import Record, Store, evaluated
from benchmark.experiments import RunSpecification, evaluation_steps
from envs import ZONES, InputError, Model, Scenario, compile_scenario
from envs.model import PING

OPTIMUM_TOLERANCE: Final = 1e-9  # how far below the optimum still counts as optimal: rounding, nothing more
GOOD_SCORE: Final = 0.95  # the score from which on a policy counts as good


@dataclass(frozen=True, eq=False)
class Population:
    """All agents of one cell of an experiment, in the order of their seeds.

    N agents, T evaluation points, O cells, A actions, R records of max Q.
    """

    specification: Mapping[str, Any]  # of the agent of the first seed, as recorded
    # Name to values, (N, ...): the fields of the algorithm's `Training`, and (N, T, ...) those of
    # `agents.dynamic_programming.Evaluation` for the greedy policy; with `stochastic_` before them for the
    # stochastic one, if there is one, and with `every_cell_` where episodes start anywhere.
    arrays: Mapping[str, NDArray[Any]]
    seeds: Sequence[int]  # (N,)
    provenance: Sequence[Mapping[str, Any]]  # (N,) see `benchmark.execution.store.Record`

    @cached_property
    def model(self) -> Model:
        """The compiled scenario, as recorded."""
        return compile_scenario(Scenario.model_validate_json(json.dumps(self.specification["scenario"])))

    @property
    def scenario(self) -> str:
        """The scenario's name."""
        return str(self.specification["scenario"]["name"])

    @cached_property
    def evaluation_steps(self) -> list[int]:
        """(T,) budget units."""
        return evaluation_steps(
            self.specification["settings"]["budget"], self.specification["evaluation_every"]
        )

    @cached_property
    def algorithm(self) -> Algorithm:
        """How the agents learned."""
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
    def map_places(self) -> NDArray[np.int_]:
        """(V,) which of the evaluation steps have a map."""
        every = self.specification["map_every"] // self.specification["evaluation_every"]
        last = len(self.evaluation_steps) - 1
        return np.array([*range(0, last, every), last])

    @cached_property
    def recorded_steps(self) -> NDArray[np.int_]:
        """(R,) budget units at which max Q was recorded."""
        return np.arange(self.arrays["max_q"].shape[1]) * int(self.specification["settings"]["record_every"])

    @property
    def weights(self) -> NDArray[np.float64]:
        """(RESAMPLES + 1, N) see `resample`."""
        return resample(len(self.seeds), self.scenario)

    @property
    def anchors(self) -> dict[str, tuple[float, float]]:
        """See `anchors`."""
        return anchors(self.model, self.specification["horizon"], "start")

    @cached_property
    def scores(self) -> NDArray[np.float64]:
        """(N, T) grid return of the greedy policy: 0 as the random policy, 1 as the optimal one."""
        return self.scores_of("greedy", "start")

    def scores_of(self, policy: str, start: str) -> NDArray[np.float64]:
        """Returns the scores of a policy from a place, (N, T); (N, 0) of a stochastic policy that is none.

        Args:
          policy: `"greedy"` or `"stochastic"`.
          start: One of what the experiment says under `evaluated_from`.
        """
        random, optimal = anchors(self.model, self.specification["horizon"], start)["grid_return"]
        returns = self.arrays[evaluated("grid_return", policy, start)]
        return np.asarray((returns - random) / (optimal - random))

    @cached_property
    def in_target(self) -> NDArray[np.bool_]:
        """(O,) whether a cell lies in the target region."""
        return np.asarray(self.model.zone_of_cell == ZONES.index("target"))

    @cached_property
    def values_ping(self) -> NDArray[np.bool_]:
        """(N, O) where an agent values PING in the end: Q > 0, or, of a stochastic policy, the likeliest."""
        stochastic = self.arrays["stochastic"]
        if stochastic.shape[1]:
            return np.asarray(stochastic[:, -1].argmax(axis=-1) == PING)
        return np.asarray(self.arrays["q"][:, :, PING] > 0)


@lru_cache(maxsize=64)
def anchors(model: Model, horizon: int, start: str) -> dict[str, tuple[float, float]]:
    """Returns the exact returns of the random and of the optimal policy, by the grid's and all rewards."""
    if start == "every_cell":
        where = every_cell(model)
    else:
        where = np.zeros(len(model.observation))
        where[model.start] = 1.0
    random = evaluate(model, uniform_policy(model), horizon, where)
    return {
        name: (
            float(value),
            float(where @ solve(model, 1.0, horizon, issuer_rewards=issuer).value),
        )
        for name, value, issuer in (
            ("grid_return", random.grid_return, False),
            ("scenario_return", random.scenario_return, True),
        )
    }


def overlap(cells: NDArray[np.bool_], in_target: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Returns the intersection over union of cells, (..., O), with the target region, (...)."""
    return np.asarray((cells & in_target).sum(axis=-1) / (cells | in_target).sum(axis=-1))


def load_population(runs: Sequence[RunSpecification], store: Store, *, fewest: int = 2) -> Population:
    """Reads the records of runs that differ by their seed alone.

    Args:
      runs: Of one cell of an experiment.
      store: Where their records are.
      fewest: Runs that are enough; of one there are no intervals.

    Raises:
      InputError: Some have no record, or failed; nothing is averaged over what happens to be there. Or
        there are fewer than are enough.
    """
    if len(runs) < fewest:
        raise InputError(
            f"{len(runs)} run a scenario: accepted: at least {fewest}, or there are no intervals."
        )
    ended = store.ended()
    missing = [run.seed for run in runs if run.digest not in ended]
    if missing:
        raise InputError(
            f"{len(missing)} of {len(runs)} runs of {runs[0].arm} in {runs[0].scenario.name} are not "
            f"done (the first is seed {missing[0]}); run the experiment first."
        )
    records: list[Record] = store.get([run.digest for run in runs])
    return Population(
        specification=json.loads(records[0].specification),
        arrays={name: np.stack([record.arrays[name] for record in records]) for name in records[0].arrays},
        seeds=[run.seed for run in runs],
        provenance=[record.provenance for record in records],
    )


def optimal_values(population: Population) -> NDArray[np.float64]:
    """Returns Q* of every cell with no wrong PING so far, (O, A); undiscounted, that under the time limit."""
    horizon = None if population.discount < 1 else int(population.specification["horizon"])
    return solve(population.model, population.discount, horizon).q[population.model.fresh_state]
