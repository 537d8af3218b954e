"""Records become populations, and populations become tables of numbers with intervals.

A population is all agents of one cell of an experiment: one scenario, reading, arm and observation. The
tables here are those of a replication; `benchmark.comparison` makes those of a comparison. Intervals are
95 % percentile bootstrap intervals over its agents; their resampling is seeded, so the same records give
the same digits.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from agents.dynamic_programming import evaluate, every_cell, solve
from agents.policy import contains, greedy_masks, uniform_policy
from benchmark.experiment import RunSpecification, evaluation_steps
from benchmark.store import Record, Store, evaluated
from envs import ACTIONS, ZONES, InputError, Model, Scenario, compile_scenario
from envs.model import PING

RESAMPLES: Final = 1000
BOOTSTRAP_SEED: Final = 20210803
OPTIMAL: Final = 1e-9  # how far below the optimum still counts as optimal: rounding, nothing more
REACHED: Final = 0.95  # the score from which on a policy counts as good


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
    provenance: Sequence[Mapping[str, Any]]  # (N,) see `benchmark.store.Record`

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

    @property
    def discount(self) -> float:
        """The discount that the learner was told, by whichever name."""
        settings = self.specification["settings"]
        return float(settings.get("discount", settings.get("gamma")))

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
        return resample(len(self.arrays["q"]), self.scenario)

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


@lru_cache(maxsize=8)
def resample(n_agents: int, scenario: str) -> NDArray[np.float64]:
    """Draws how often each agent is counted, (RESAMPLES + 1, N); the first row is the sample itself.

    A statistic that is a function of means is thus resampled by one product of matrices. Scenarios
    are resampled apart from each other; the readings of one share their draws, as they do their seeds.
    """
    rng = np.random.default_rng([BOOTSTRAP_SEED, *scenario.encode()])
    counts = rng.multinomial(n_agents, np.full(n_agents, 1 / n_agents), size=RESAMPLES)
    return np.vstack([np.ones(n_agents), counts]).astype(np.float64)


def interval(samples: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the ends of the 95 % interval of resampled values.

    Args:
      samples: (RESAMPLES + 1, ...), the first of which is the sample's own.
    """
    with np.errstate(invalid="ignore"):  # infinite ratios have no interval
        low, high = np.percentile(samples[1:], [2.5, 97.5], axis=0)
    return low, high


def q_values(populations: Sequence[Population]) -> pd.DataFrame:
    """Tabulates the final Q-values over agents: one row a scenario, cell and action."""
    frames = []
    for population in populations:
        q = population.arrays["q"]
        grid = population.model.scenario.grid
        row, column, action = np.indices((grid.rows, grid.columns, len(ACTIONS))).reshape(3, -1)
        frames.append(
            pd.DataFrame(
                {
                    "scenario": population.scenario,
                    "row": row,
                    "column": column,
                    "action": np.array(ACTIONS)[action],
                }
                | _spread(q.reshape(len(q), -1))
            )
        )
    return pd.concat(frames, ignore_index=True)


def max_q(populations: Sequence[Population]) -> pd.DataFrame:
    """Tabulates the maximum Q of the visited cell, and of the table, over agents at each record."""
    frames = []
    for population in populations:
        table = _spread(population.arrays["table_max_q"])
        frames.append(
            pd.DataFrame(
                {"scenario": population.scenario, "step": population.recorded_steps}
                | _spread(population.arrays["max_q"])
                | {f"table_{name}": table[name] for name in ("mean", "min", "max")}
            )
        )
    return pd.concat(frames, ignore_index=True)


def learning(populations: Sequence[Population]) -> pd.DataFrame:
    """Tabulates the exact score of the greedy policy, and the share of optimal agents, over training.

    `score_iqm` is the interquartile mean (Agarwal et al. 2021): scores have no lower bound, since a
    greedy policy may bump a wall until the horizon, and the mean shows it.
    """
    frames = []
    for population in populations:
        weights = population.weights
        columns: dict[str, Any] = {"scenario": population.scenario, "step": population.evaluation_steps}
        for name, values in (
            ("score", population.scores),
            ("success", population.arrays["success"]),
            ("optimal_share", (population.scores >= 1 - OPTIMAL).astype(np.float64)),
            ("return", population.arrays["grid_return"]),
            ("scenario_return", population.arrays["scenario_return"]),
        ):
            columns |= mean_with_interval(name, weights @ values / len(values))
            if name == "score":
                columns |= interquartile_mean("score_iqm", population.scores)
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def optimal(populations: Sequence[Population]) -> pd.DataFrame:
    """Tabulates the exact anchors beside what the greedy policies reached at the end of training."""
    rows = []
    for population in populations:
        scores = population.scores[:, -1]
        weights = population.weights
        row: dict[str, Any] = {"scenario": population.scenario, "agents": len(scores)}
        for name, (random, best) in population.anchors.items():
            learned = population.arrays[name][:, -1]
            samples = weights @ (best - learned) / len(learned)
            regret = mean_with_interval("regret", samples[:, None])
            row |= {f"{name}_random": random, f"{name}_optimal": best, f"{name}_learned": learned.mean()}
            row |= {f"{name}_{key}": value[0] for key, value in regret.items()}
        row["optimal_share"] = (scores >= 1 - OPTIMAL).mean()
        row["start_value_optimal"] = optimal_values(population).max(axis=1)[population.model.start]
        row["start_value_learned"] = largest_values(population)[population.model.start]
        walkable = np.flatnonzero(~population.model.terminated[: population.model.n_observations].all(axis=1))
        row["cells_differing"] = differing(population)[walkable].mean()
        rows.append(row)
    return pd.DataFrame(rows)


def optimal_cells(populations: Sequence[Population]) -> pd.DataFrame:
    """Tabulates Q* beside the learned Q: one row a scenario, cell and action.

    Q* is that of an agent that knows its state, with no wrong PING so far, discounted and with the
    issuer's mean rewards, as the learner's is. `largest_learned` is the mean over agents of their largest
    Q in the cell (and so no less than the largest of the means); `differs` the share of agents whose
    greedy action there is not an optimal one.
    """
    frame = q_values(populations)[["scenario", "row", "column", "action", "mean"]]
    frame = frame.rename(columns={"mean": "q_learned"})
    frame["q_optimal"] = np.concatenate([optimal_values(p).ravel() for p in populations])
    frame["difference"] = frame["q_learned"] - frame["q_optimal"]
    frame["is_optimal"] = np.concatenate(
        [contains(greedy_masks(optimal_values(p), OPTIMAL)).ravel() for p in populations]
    )
    frame["largest_learned"] = np.concatenate([largest_values(p).repeat(len(ACTIONS)) for p in populations])
    frame["differs"] = np.concatenate([differing(p).repeat(len(ACTIONS)) for p in populations])
    return frame


def optimal_values(population: Population) -> NDArray[np.float64]:
    """Returns Q* of every cell with no wrong PING so far, (O, A); undiscounted, that under the time limit."""
    horizon = None if population.discount < 1 else int(population.specification["horizon"])
    return solve(population.model, population.discount, horizon).q[: population.model.n_observations]


def largest_values(population: Population) -> NDArray[np.float64]:
    """Returns the mean over agents of their largest Q in every cell, (O,)."""
    return np.asarray(population.arrays["q"].max(axis=-1).mean(axis=0))


def differing(population: Population) -> NDArray[np.float64]:
    """Returns the share of agents whose greedy action is not an optimal one, (O,).

    An agent with several best actions, which it draws from, counts by the share that is not optimal.
    """
    best = contains(greedy_masks(optimal_values(population), OPTIMAL))  # (O, A)
    greedy = contains(population.arrays["greedy"][:, -1])  # (N, O, A)
    wrong = (greedy & ~best).sum(axis=-1) / greedy.sum(axis=-1)
    return np.asarray(wrong.mean(axis=0))


def _spread(values: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Returns mean, sample standard deviation and extremes over agents of (N, ...) values."""
    std = values.std(axis=0, ddof=1)
    return {"mean": values.mean(axis=0), "std": std, "min": values.min(axis=0), "max": values.max(axis=0)}


def mean_with_interval(name: str, samples: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Names a resampled statistic, (RESAMPLES + 1, T), and its interval."""
    low, high = interval(samples)
    return {name: samples[0], f"{name}_low": low, f"{name}_high": high}


def interquartile_mean(name: str, scores: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Names the interquartile mean of (N, T) scores and its bootstrap interval."""

    def iqm(values: NDArray[np.float64], axis: int = 0) -> NDArray[np.float64]:
        return np.asarray(stats.trim_mean(values, 0.25, axis=axis))

    bootstrap = stats.bootstrap(
        (scores,),
        iqm,
        axis=0,
        n_resamples=RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(BOOTSTRAP_SEED),
    )
    low, high = bootstrap.confidence_interval
    return {name: iqm(scores), f"{name}_low": np.asarray(low), f"{name}_high": np.asarray(high)}
