"""The records of a population: what is stored of its runs, and the anchors of their scores."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.dynamic_programming import evaluate, from_starts, largest_success, solve
from agents.policy import uniform_policy
from benchmark.specification import RunSpecification
from benchmark.store import Provenance, Store, evaluated
from envs import ACTIONS, ZONES, InputError, Model, compile_scenario
from envs.model import PING, kept_with_model
from envs.observations import compile_seen

Array = NDArray[Any]
Floats = NDArray[np.float64]

OPTIMUM_TOLERANCE = 1e-9  # up to this distance a policy counts as optimal
_DIGITS = 9  # of scores, so that rounding does not make one of two optima the better one


@dataclass(frozen=True, eq=False)
class Records:
    """The records of N runs of one population.

    T evaluation steps, V map steps, F fresh states (see `Model.fresh_state`), A actions.
    """

    runs: Sequence[RunSpecification]  # (N,)
    agents: Sequence[Mapping[str, Array]]  # (N,) arrays, see `benchmark.store.Record`
    provenance: Sequence[Provenance]  # (N,)

    @property
    def run(self) -> RunSpecification:
        """The first run; others have the same scenario, observation, budget and schedule."""
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

    def unbounded_scores(self, policy: str = "greedy") -> Floats:
        """Returns the scores of a policy, (N, T); (N, 0) if it is stochastic and there is none."""
        returns = self.arrays[evaluated("grid_return", policy)]
        return unbounded_scores(returns, self.model, self.run.horizon)

    def subset(self, start: int, stop: int) -> "Records":
        """Returns the records of some of the runs, from index `start` to before `stop`."""
        some = slice(start, stop)
        return Records(self.runs[some], self.agents[some], self.provenance[some])

    @cached_property
    def in_target(self) -> NDArray[np.bool_]:
        """(F,) in which fresh states the agent is in the target region."""
        return np.asarray(self.model.zone[self.model.fresh_state] == ZONES.index("target"))

    @cached_property
    def values_ping(self) -> NDArray[np.bool_]:
        """(N, F) in which fresh states an agent values PING after training.

        Its value is above zero and differs from the initial one.
        """
        q = self.arrays["q"][:, :, PING]
        valued = (q > 0) & (q != getattr(self.run.settings, "initial_value", 0))
        return np.asarray(valued[:, self.model.observation[self.model.fresh_state]])


class _Stacked(dict[str, Array]):
    """Arrays that are stacked when they are first asked for: all together are large."""

    def __init__(self, agents: Sequence[Mapping[str, Array]]) -> None:
        self.agents = agents

    def __missing__(self, name: str) -> Array:
        self[name] = np.stack([arrays[name] for arrays in self.agents])
        return self[name]


def load_records(runs: Sequence[RunSpecification], store: Store) -> Records:
    """Reads the records of runs of a population; an InputError says if one is not valid."""
    records = store.get(run.digest for run in runs)
    for run, record in zip(runs, records, strict=True):
        if record.error:
            raise InputError(f"{run.folder}: this run failed: run the experiment again.")
    arrays = [record.arrays for record in records]
    return Records(runs, arrays, [record.provenance for record in records])


@kept_with_model
def anchors(model: Model, horizon: int) -> tuple[float, float]:
    """Returns the grid returns between which scores lie, exactly: what is easily had, and the best.

    The former is that of the random policy or of giving up at once, by PINGs alone, whichever is
    larger. The latter is that of the optimal policy.
    """
    giving_up = np.eye(len(ACTIONS))[np.full(model.n_observations, PING)]
    policies = np.stack([uniform_policy(model), giving_up])
    easy = evaluate(model, policies, horizon).grid_return.max()
    values = solve(model, 1.0, horizon, issuer_rewards=False).value
    return float(easy), float(from_starts(model) @ values)


@kept_with_model
def random_success(model: Model, horizon: int) -> float:
    """Returns how often the random policy succeeds, exactly."""
    return float(evaluate(model, uniform_policy(model), horizon).success)


def unbounded_scores(returns: Floats, model: Model, horizon: int) -> Floats:
    """Returns grid returns of any shape as scores, which are 0 and 1 at the two `anchors`."""
    easy, optimal = anchors(model, horizon)
    return np.round((returns - easy) / (optimal - easy), _DIGITS)


def check_anchors(model: Model, horizon: int) -> None:
    """Raises an InputError if random moves or giving up at once are optimal, see `anchors`."""
    easy, optimal = anchors(model, horizon)
    if optimal - easy <= OPTIMUM_TOLERANCE:
        equal = f"random moves or PINGs alone earn as much as the optimal policy ({easy:.6g})"
        what = f"within {horizon} steps {equal}, so scores are undefined"
        accepted = "other rewards, or another horizon"
        raise InputError(f"{model.scenario.name}: {what}; accepted: {accepted}.")


def check_scores(runs: Iterable[RunSpecification]) -> None:
    """Checks that runs can succeed, and that their scores are defined, see `check_anchors`."""
    for scenario, horizon in {(run.scenario, run.horizon) for run in runs}:
        model = compile_scenario(scenario)
        check_anchors(model, horizon)
        if not largest_success(model, horizon):
            what = f"no policy succeeds within horizon = {horizon}"
            raise InputError(f"{scenario.name}: {what}; accepted: a longer horizon.")
