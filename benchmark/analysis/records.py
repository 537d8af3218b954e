"""The records of a population: what is stored of its runs."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agents.dynamic_programming import evaluate, from_starts, largest_success, solve
from agents.policy import uniform_policy
from benchmark.execution.store import Provenance, Store, evaluated
from benchmark.experiments import RunSpecification
from envs import ZONES, InputError, Model, compile_scenario
from envs.model import PING, kept_with_model
from envs.observations import compile_seen

Array = NDArray[Any]
OPTIMUM_TOLERANCE: Final = 1e-9  # a policy counts as optimal up to this distance, which allows for rounding
_DIGITS: Final = 9  # of scores, so that the last digit of two optima does not decide which of them is better


@dataclass(frozen=True, eq=False)
class Records:
    """The records of N runs of one population.

    T evaluation steps, V map steps, F fresh states (see `Model.fresh_state`), A actions.
    """

    runs: Sequence[RunSpecification]  # (N,)
    agents: Sequence[Mapping[str, Array]]  # (N,) arrays, see `benchmark.execution.store.Record`
    provenance: Sequence[Provenance]  # (N,)

    @property
    def run(self) -> RunSpecification:
        """The first run; others have the same scenario, form of observation, budget and schedule."""
        return self.runs[0]

    @cached_property
    def seeds(self) -> list[int]:
        """The runs' seeds, (N,)."""
        return [run.seed for run in self.runs]

    @cached_property
    def arrays(self) -> Mapping[str, Array]:
        """The arrays of all agents, (N, ...) each, by name."""
        return _Stacked(self.agents)

    @cached_property
    def model(self) -> Model:
        """The scenario, compiled for the learner's form of observation."""
        return compile_seen(self.run.scenario, self.run.observation)

    @property
    def scenario(self) -> str:
        """The scenario's name."""
        return self.run.scenario.name

    @cached_property
    def evaluation_steps(self) -> tuple[int, ...]:
        """(T,) in units of the learner's budget."""
        return self.run.schedule.evaluation_steps

    @cached_property
    def map_indices(self) -> NDArray[np.int_]:
        """(V,) indices of the map steps among the evaluation steps."""
        return np.flatnonzero(self.run.schedule.is_mapped)

    def unbounded_scores(self, policy: str = "greedy", start: str = "start") -> NDArray[np.float64]:
        """Returns the scores of grid returns, (N, T); (N, 0) for a stochastic policy if there is none."""
        returns = self.arrays[evaluated("grid_return", policy, start)]
        return unbounded_scores(returns, self.model, self.run.horizon, start)

    def subset(self, start: int, stop: int) -> "Records":
        """Returns the records of some of the runs, from index `start` to before `stop`."""
        some = slice(start, stop)
        return Records(self.runs[some], self.agents[some], self.provenance[some])

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

        Its value is above zero and differs from the initial one.
        """
        q = self.arrays["q"][:, :, PING]
        initial = np.array([getattr(run.settings, "initial_value", 0) for run in self.runs])
        valued = (q > 0) & (q != initial[:, None])
        return np.asarray(valued[:, self.model.observation[self.model.fresh_state]])


class _Stacked(dict[str, Array]):
    """Arrays that are stacked when they are first asked for: all together are large."""

    def __init__(self, agents: Sequence[Mapping[str, Array]]) -> None:
        self.agents = agents

    def __missing__(self, name: str) -> Array:
        self[name] = np.stack([arrays[name] for arrays in self.agents])
        return self[name]


def load_records(runs: Sequence[RunSpecification], store: Store) -> Records:
    """Reads the records of runs of a population; an InputError says if any is missing."""
    ended = store.ended(run.digest for run in runs)
    if missing := [run.seed for run in runs if run.digest not in ended]:
        found = f"{len(missing)} of {len(runs)} runs of {runs[0].variant} in {runs[0].scenario.name}"
        which = f"are missing or failed (the first is seed {missing[0]})"
        raise InputError(f"{found} {which}: run the experiment first.")
    records = store.get([run.digest for run in runs])
    return Records(runs, [record.arrays for record in records], [record.provenance for record in records])


@kept_with_model
def anchors(model: Model, horizon: int, start: str, returns: str = "grid_return") -> tuple[float, float]:
    """Computes the exact returns of the random and of the optimal policy, from `"start"` or `"every_cell"`.

    `"grid_return"` is the sum of the grid's rewards alone, and `"scenario_return"` that with the issuer's.
    """
    random = getattr(evaluate(model, uniform_policy(model), horizon, start), returns)
    values = solve(model, 1.0, horizon, issuer_rewards=returns == "scenario_return").value
    return float(random), float(from_starts(model, start) @ values)


def unbounded_scores(
    returns: NDArray[np.float64], model: Model, horizon: int, start: str
) -> NDArray[np.float64]:
    """Returns grid returns of any shape as scores: 0 for the random policy and 1 for the optimal one."""
    random, optimal = anchors(model, horizon, start)
    return np.round((returns - random) / (optimal - random), _DIGITS)


def check_anchors(model: Model, horizon: int, start: str) -> None:
    """Raises an InputError if the optimal policy earns no more than the random one: scores are undefined."""
    random, optimal = anchors(model, horizon, start)
    if optimal - random <= OPTIMUM_TOLERANCE:
        equal = f"the random policy earns as much as the optimal one ({random:.6g}), so scores are undefined"
        accepted = "other rewards, or another horizon"
        raise InputError(f"{model.scenario.name}: within {horizon} steps {equal}; accepted: {accepted}.")


def check_scores(runs: Iterable[RunSpecification]) -> None:
    """Checks that runs can succeed, and that their scores are defined, see `check_anchors`."""
    for scenario, horizon, starts in {(run.scenario, run.horizon, run.evaluated_from) for run in runs}:
        for start in starts:
            check_anchors(compile_scenario(scenario), horizon, start)
        if not largest_success(compile_scenario(scenario), horizon):
            accepted = "accepted: a longer horizon, or another scenario"
            raise InputError(f"{scenario.name}: no policy succeeds within horizon = {horizon}; {accepted}.")


def overlap(cells: NDArray[np.bool_], in_target: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Returns the intersection over union of sets of cells, (..., O), and the target region, (...)."""
    return np.asarray((cells & in_target).sum(axis=-1) / (cells | in_target).sum(axis=-1))


def optimal_values(records: Records) -> NDArray[np.float64]:
    """Returns the learner's Q* of fresh states, (F, A); with discount 1, up to the horizon."""
    discount = records.run.settings.discount_factor
    horizon = None if discount < 1 else records.run.horizon
    return solve(records.model, discount, horizon).q[records.model.fresh_state]
