"""What is computed of a replication: the verdicts on the paper's claims, and what its agents have learned."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from agents.policy import contains, greedy_masks
from benchmark.analysis.records import OPTIMUM_TOLERANCE, Records, optimal_values
from benchmark.experiments import DEFAULT_CONDITION
from benchmark.studies.data import Data
from benchmark.studies.replication.claims import SCENARIOS, Agents, judge
from benchmark.studies.study import Declared
from envs import ACTIONS

Floats = NDArray[np.float64]

_CURVES: Final = {"visited": "max_q", "table": "table_max_q"}  # array of each curve that claims can be about


@dataclass(frozen=True, eq=False)
class ReplicationAnalysis:
    """The agents of the default reading, and the parts of all claims."""

    data: Data[Declared]
    few_and_all: Sequence[Agents]
    """As many agents as in the paper, by the first seeds; and all if these are at least twice as many."""
    claims: pd.DataFrame
    """Every part of every claim, see `claims.judge`, with few agents and with all; see `agreement`."""
    claim_sets: pd.DataFrame
    """The same in each disjoint set of as many agents as the paper has."""
    sensitivity: pd.DataFrame
    """The same under each reading of the paper, with few agents."""

    @property
    def few(self) -> Agents:
        """The agents that figures show, by scenario."""
        return self.few_and_all[0]

    @cached_property
    def max_q(self) -> pd.DataFrame:
        """Statistics over agents of the maximum Q of visited cell and table, at each record."""
        frames = []
        for name, agents in self.few.items():
            visited, table = (spread(agents.arrays[key]) for key in _CURVES.values())
            steps = np.arange(len(visited["mean"])) * agents.run.settings.model_dump()["record_every"]
            columns = {"scenario": name, "step": steps} | visited
            columns |= {f"table_{key}": table[key] for key in ("mean", "min", "max")}
            frames.append(pd.DataFrame(columns))
        return pd.concat(frames, ignore_index=True)

    @cached_property
    def q_values(self) -> pd.DataFrame:
        """Final Q-values, and those of an agent that knows its state, with no wrong PING so far."""
        frames = []
        for name, agents in self.few.items():
            best, q = optimal_values(agents), agents.arrays["q"]
            row, column = agents.model.position.repeat(len(ACTIONS), axis=0).T
            columns = {"scenario": name, "row": row, "column": column, "action": np.tile(ACTIONS, len(best))}
            values = spread(q) | {"optimal": best, "difference": q.mean(axis=0) - best}
            values["is_optimal"] = contains(greedy_masks(best, OPTIMUM_TOLERANCE))
            columns |= {key: array.ravel() for key, array in values.items()}
            columns["largest_learned"] = q.max(axis=-1).mean(axis=0).repeat(len(ACTIONS))
            columns["differs"] = differing(agents).repeat(len(ACTIONS))
            frames.append(pd.DataFrame(columns))
        return pd.concat(frames, ignore_index=True)


def analyse(data: Data[Declared]) -> ReplicationAnalysis:
    """Judges the claims: by default with few agents and all, under other readings with few."""
    (learner,) = data.experiment.learners.values()
    populations, size = data.experiment.populations, learner.declared.seeds
    few_and_all, of_sets, of_all = list[Agents](), list[pd.DataFrame](), list[pd.DataFrame]()
    by_reading = []
    for name, reading in data.experiment.declared.readings.items():
        everyone = {
            each.scenario.name: data.records(each) for each in populations if each.condition.name == name
        }
        sets, curve = disjoint(everyone, size), _CURVES[reading.curve]
        first = judge(sets[0], curve)
        by_reading.append(first.assign(reading=name))
        if name == DEFAULT_CONDITION:
            few_and_all = [sets[0], *[everyone] * (len(sets) > 1)]
            of_sets = [first, *(judge(agents, curve) for agents in sets[1:])]
            of_all = [judge(agents, curve) for agents in few_and_all[1:]]
    claim_sets = pd.concat(of_sets, ignore_index=True)
    by_claim = [rows for _, rows in pd.concat([of_sets[0], *of_all]).groupby("claim", sort=False)]
    claims = agreement(pd.concat(by_claim, ignore_index=True), claim_sets)
    return ReplicationAnalysis(
        data, few_and_all, claims, claim_sets, pd.concat(by_reading, ignore_index=True)
    )


def disjoint(everyone: Agents, size: int) -> list[Agents]:
    """Returns disjoint sets of agents by consecutive seeds, `size` in each; all if they are fewer."""
    total = len(everyone[SCENARIOS[0]].seeds)
    return [
        {name: agents.subset(start, start + size) for name, agents in everyone.items()}
        for start in range(0, max(total - size, 0) + 1, size)
    ]


def agreement(parts: pd.DataFrame, sets: pd.DataFrame) -> pd.DataFrame:
    """Returns parts with the number of sets of agents, and of those with the same verdict on the claim."""
    verdicts = sets.drop_duplicates(["first_seed", "claim"])
    counts = verdicts.groupby(["claim", "verdict"]).size()
    judged = pd.MultiIndex.from_frame(parts[["claim", "verdict"]])
    agreeing = counts.reindex(judged, fill_value=0).to_numpy()
    return parts.assign(sets=verdicts["first_seed"].nunique(), sets_agreeing=agreeing)


def differing(agents: Records) -> Floats:
    """Returns the share of agents whose greedy action is not optimal, (O,); ties count in part."""
    best = contains(greedy_masks(optimal_values(agents), OPTIMUM_TOLERANCE))  # (O, A)
    greedy = contains(agents.arrays["greedy"][:, -1])  # (N, O, A)
    wrong = (greedy & ~best).sum(axis=-1) / greedy.sum(axis=-1)
    return np.asarray(wrong.mean(axis=0))


def spread(values: Floats) -> dict[str, Floats]:
    """Returns statistics over N agents of their (N, ...) values."""
    std = values.std(axis=0, ddof=1)
    return {"mean": values.mean(axis=0), "std": std, "min": values.min(axis=0), "max": values.max(axis=0)}
