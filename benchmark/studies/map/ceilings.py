"""An item for groups: what tables lose because a row covers several states, computed exactly."""

from collections.abc import Iterator, Mapping

import numpy as np

from agents.dynamic_programming import evaluate, solve
from agents.policy import mask_policy
from benchmark.analysis.records import OPTIMUM_TOLERANCE
from benchmark.experiments import title_of
from benchmark.studies.item import item
from benchmark.studies.map.analysis import MapAnalysis
from envs import compile_scenario
from envs.observations import INDICES, compile_seen


@item(
    "ceilings",
    "exact: the largest share of states before any PING in which one action per row can be optimal, and "
    "success with these actions, which others may exceed",
    "grid table rows optimal success",
    labels={"optimal": "optimal in what share of states"},
)
def ceilings(analysis: MapAnalysis) -> Iterator[Mapping[str, object]]:
    """Tabulates each form of index in the scene of each panel, with all possible places."""
    experiment = analysis.data.experiment
    horizon, populations = experiment.declared.horizon, experiment.populations
    scenes = {population.condition.axes["grid"]: population.scenario for population in populations}
    for grid in dict.fromkeys(panel.grid for panel in analysis.data.declared.panels):
        everywhere = scenes[grid].issuer.model_copy(update={"places": None, "unseen": 0})
        scenario = scenes[grid].model_copy(update={"issuer": everywhere})
        model = compile_scenario(scenario)
        q, value = solve(model, 1.0, horizon, issuer_rewards=False)
        states = model.fresh_state[~model.is_over[model.fresh_state]]
        is_optimal = q[states] >= value[states, None] - OPTIMUM_TOLERANCE
        n_states = len(q)
        del q, value, model  # a large scene takes a gigabyte
        for form in INDICES:
            seen = compile_seen(scenario, form)
            counts = np.zeros((seen.n_observations, is_optimal.shape[1]))
            np.add.at(counts, seen.observation[states], is_optimal)
            policy = mask_policy((1 << counts.argmax(axis=1)).astype(np.uint8))
            yield {
                "grid": grid,
                "observation": form,
                "table": title_of("table", form, "tabular"),
                "states": n_states,
                "rows": len(np.unique(seen.observation[states])),
                "optimal": float(counts.max(axis=1).sum() / len(states)),
                "success": float(evaluate(seen, policy, horizon).success),
            }
