"""The tables of a replication: claims with few agents and many and under each reading, and learning."""

from collections.abc import Iterator
from typing import Final

import numpy as np
import pandas as pd

from benchmark.analysis.intervals import proportion
from benchmark.analysis.records import OPTIMUM_TOLERANCE, anchors, optimal_values
from benchmark.studies.item import Item, expanded, item, no_rows
from benchmark.studies.replication.analysis import ReplicationAnalysis, differing

_Table = Item
_OPTIMUM: Final = 1 - OPTIMUM_TOLERANCE  # the score of an optimal policy
_JUDGED: Final = ("part", "agents", "value", "low", "high", "right_side", "threshold", "state", "verdict")
_SHOWN: Final = {"low": "value_low", "high": "value_high", "sets_agreeing": "agreeing"}
_IN_SETS: Final = ["first_seed", "last_seed", "claim", "part", "value", "low", "high", "state", "verdict"]


claims = _Table(
    "claims",
    "every part of every claim, with its 95 % interval, its state and the verdict, by agents",
    "claim agents verdict sets agreeing part right_side threshold value state drawn",
    compute=lambda analysis: analysis.claims[["claim", *_JUDGED, "note", "drawn", "sets", "sets_agreeing"]],
    where=lambda frame: frame.rename(columns=_SHOWN),
)
claim_sets = _Table(
    "claim_sets",
    "every part of every claim in each of the disjoint sets of agents, and the verdicts",
    compute=lambda analysis: analysis.claim_sets[_IN_SETS],
)
sensitivity = _Table(
    "sensitivity",
    "every part of every claim, its state and the verdict, under every reading of the paper",
    where=no_rows,
    compute=lambda analysis: analysis.sensitivity[["claim", "reading", *_JUDGED]],
)
max_q = _Table(
    "max_q",
    "maximum Q over agents at every recorded step, of the visited cell and of the table",
    compute=lambda analysis: analysis.max_q,
)
q_values = _Table(
    "q_values",
    "final Q over agents and Q* of every cell and action, and where policies differ",
    compute=lambda analysis: analysis.q_values,
)


@item(
    "learning",
    "success, score of the greedy policy, and the share of optimal agents, over training",
    "scenario success score optimal_share unbounded_score",
    where=lambda frame: frame[frame["step"] == frame["step"].max()],
)
def learning(analysis: ReplicationAnalysis) -> pd.DataFrame:
    """Tabulates success, the score of the greedy policy, and the share of optimal agents, over training."""
    frames = []
    for name, agents in analysis.few.items():
        scores = agents.unbounded_scores()
        columns = {
            "scenario": name,
            "step": agents.evaluation_steps,
            "success": proportion(agents.arrays["success"]),
            "score": proportion(np.clip(scores, 0.0, 1.0)),
            "optimal_share": proportion(scores >= _OPTIMUM),
            "unbounded_score": scores.mean(axis=0),
        }
        frames.append(pd.DataFrame(expanded(columns)))
    return pd.concat(frames, ignore_index=True)


@item(
    "optimal",
    "the exact optimum, what was learned, success, and the regret, with all agents as well",
    "scenario agents success optimal_share grid_return_learned grid_return_optimal start_value_learned "
    "start_value_optimal cells_differing",
)
def optimal(analysis: ReplicationAnalysis) -> Iterator[dict[str, object]]:
    """Tabulates what the greedy policies reach after training, and the exact anchors."""
    for agents in (agents for groups in analysis.few_and_all for agents in groups.values()):
        model, q, seeds = agents.model, agents.arrays["q"], agents.seeds
        row: dict[str, object] = {"scenario": agents.scenario, "agents": len(seeds)}
        row |= {"first_seed": seeds[0], "last_seed": seeds[-1]}
        row["success"] = proportion(agents.arrays["success"][:, -1])
        row["optimal_share"] = proportion(agents.unbounded_scores()[:, -1] >= _OPTIMUM)
        for name in ("grid_return", "scenario_return"):
            random, best = anchors(model, agents.run.horizon, "start", name)
            learned = agents.arrays[name][:, -1].mean()
            row |= {f"{name}_random": random, f"{name}_optimal": best, f"{name}_learned": learned}
            row[f"{name}_regret"] = best - learned
        start = model.observation[model.start]
        row["start_value_optimal"] = optimal_values(agents).max(axis=1)[start]
        row["start_value_learned"] = q.max(axis=-1).mean(axis=0)[start]
        row["cells_differing"] = differing(agents)[~model.is_over[model.fresh_state]].mean()
        yield row
