"""The data of the page's explorer, as compressed JSON: what agents have learned, and where.

Values over training are those of the first seed's agent, which was chosen before any result was
seen; large tables are left out. For as many other agents as fit, there is the final greedy policy.
From the compiled scenarios, the page looks up the outcomes of a step and computes the optimum.
"""

import gzip
import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from benchmark.experiment import DEFAULT_CONDITION, Experiment, Learner
from benchmark.records import OPTIMUM_TOLERANCE, Records, load_records
from benchmark.scenes import RGB
from benchmark.store import VALUE_DECIMALS, Store
from benchmark.style import colour_map
from envs import ACTIONS, EVENTS, ZONES, Model
from envs import scene as drawn
from envs.model import MOVES, kept_with_model
from envs.observations import compile_seen

MAX_VALUED = 500  # observations of a learner whose values are shown
MAX_STATES = 200_000  # of a scenario that is shown
MAX_MASKS = 480  # per learner: final policies of as many agents as fit, at least one
_PALETTE = ("path", "over", "wall", "no value")  # colours of `envs.scene`


def write(
    experiment: Experiment, store: Store, path: Path, seeds: Sequence[int] | None = None
) -> None:
    """Writes what the explorer shows of an experiment from its stored runs, if that is anything.

    It shows all learners under the first condition. Of the runs of maps and searches, no policies
    are stored. Each agent refers to its scene and sight by index.
    """
    agents, scenes, sights = [], list[object](), list[object]()
    for population in experiment.populations:
        is_shown = population.condition.name == DEFAULT_CONDITION
        if not is_shown or population.first.solved:
            continue
        model = compile_seen(population.first.scenario, population.first.observation)
        if len(model.observation) > MAX_STATES:
            continue
        observed = [component.name for component in model.components]
        sight = {"observed": observed, "of": model.observation.tolist()}
        n_shown = max(MAX_MASKS // model.n_observations, 1)
        runs = population.runs(population.taken(seeds)[:n_shown])
        agents.append(
            _agents(population.learner, load_records(runs, store))
            | {"experiment": experiment.name}
            | {"scene": _index(scenes, _scene(model)), "sight": _index(sights, sight)}
        )
    if agents:
        data = _CONSTANTS | {"scenes": scenes, "sights": sights, "agents": agents}
        text = json.dumps(data, separators=(",", ":"), allow_nan=False)
        path.write_bytes(gzip.compress(text.encode(), mtime=0))


_CONSTANTS = {
    "actions": ACTIONS,
    "events": EVENTS,
    "zones": ZONES,
    "tolerance": OPTIMUM_TOLERANCE,
    "colours": [*map(to_hex, colour_map(drawn.COLOUR_MAP)(np.linspace(0, 1, 33)))],
    "palette": {name: RGB[name] for name in _PALETTE},
    "clipped_share": drawn.CLIPPED_SHARE,
    "triangles": drawn.TRIANGLES.tolist(),
    "moves": MOVES.tolist(),
}


def _index(items: list[object], item: object) -> int:
    """Returns where an item is, after adding it if there is no equal one."""
    if item not in items:
        items.append(item)
    return items.index(item)


def _agents(learner: Learner, records: Records) -> dict[str, object]:
    """Returns a learner's first agent, with every second map of its training, and others' policies.

    Maps hold action values, `q`, or the action probabilities of a stochastic policy.
    """
    last, has_values = len(records.map_indices) - 1, records.model.n_observations <= MAX_VALUED
    chosen = [*(range(0, last, 2) if has_values and last > 1 else []), last]
    points = records.map_indices[chosen]  # among the evaluation steps
    first, scores = records.agents[0], records.unbounded_scores()
    others = [agent["greedy"][-1] for agent in records.agents[1:]]
    return {
        "scenario": records.scenario,
        "learner": learner.title,
        "family": learner.algorithm.family,
        "horizon": records.run.horizon,
        "kind": "probability" if first["stochastic"].shape[0] else "q",
        "discount": records.run.settings.discount_factor,
        "steps": [records.evaluation_steps[point] for point in points],
        "score": _listed(scores[0, points]),
        "success": _listed(first["success"][points]),
        "values": _listed(first["values"][chosen], VALUE_DECIMALS) if has_values else None,
        "greedy": first["greedy"][points].ravel().tolist(),
        "seeds": records.seeds,
        "others": {  # after the first
            "score": _listed(scores[1:, -1]),
            "success": _listed(records.arrays["success"][1:, -1]),
            "greedy": np.ravel(others).astype(int).tolist(),
        },
    }


@kept_with_model
def _scene(model: Model) -> dict[str, object]:
    """Returns the looks of a scenario and the effects of each action, whatever is observed of it.

    `views` has a map for each place and phase. Effects are the same in many states, so each refers
    to one of the `kinds`: flattened lists, (kinds, A, K) of outcomes, (kinds,) of `over`, else
    (kinds, A).
    """
    scenario, n_states = model.scenario, len(model.observation)
    views = [drawn.scene_of(model, context) for context in np.unique(model.context).tolist()]
    effects = {
        "change": model.next_state - np.arange(n_states)[:, None, None],
        "terminated": model.terminated.astype(int),
        "over": model.is_over.astype(int),
        "probability": model.probability,
        "grid_reward": model.grid_reward,
        "issuer_reward": model.issuer_reward,
        "event": model.event,
    }
    columns = np.concatenate([each.reshape(n_states, -1) for each in effects.values()], axis=1)
    _, first, kind = np.unique(columns, axis=0, return_index=True, return_inverse=True)
    starts = np.concatenate([model.starts, model.unseen_starts, model.new_way_starts])
    n_delayed = 1 + scenario.is_delayed
    return {
        "group": scenario.n_people if scenario.group else 1,
        "rows": views[0].rows,
        "columns": views[0].columns,
        "walls": np.flatnonzero(views[0].is_wall).tolist(),
        "outlines": [*drawn.BORDERS.values()],
        "views": [view.as_json() for view in views],
        "shape": [model.n_places, len(scenario.layout.ticks), n_delayed, scenario.ping_limit],
        "ticks": scenario.layout.ticks.tolist(),
        "phases": [stage.name for stage in scenario.layout.stages],
        "starts": starts.tolist(),
        "kind": kind.ravel().tolist(),
        "kinds": {name: values[first].ravel().tolist() for name, values in effects.items()},
    }


def _listed(values: NDArray[np.floating], decimals: int = 6) -> list[float | None]:
    rounded = np.round(values.astype(np.float64).ravel(), decimals).tolist()
    return [None if math.isnan(value) else value for value in rounded]
