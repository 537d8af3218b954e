"""The data of the page's explorer, one file of compressed JSON: what agents have learned, and where.

Values over training are those of the first seed's agent, which was chosen before any result was seen; large
tables are left out. For as many other agents as fit, there is the final greedy policy. From the compiled
scenarios, the page looks up the outcomes of a step and computes the optimum. Very large ones are left out.
"""

import gzip
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from benchmark.analysis.records import OPTIMUM_TOLERANCE, Records
from benchmark.drawing.style import colour_map
from benchmark.execution.store import VALUE_DECIMALS
from benchmark.studies.item import writing
from envs import ACTIONS, EVENTS, ZONES, Model, Scenario
from envs import scene as drawn
from envs.model import MOVES
from envs.scene import scene_of

FILE: Final = "agents.json.gz"
MAX_VALUED: Final = 500  # observations of a learner whose values are shown
MAX_STATES: Final = 200_000  # of a scenario that is shown
MAX_MASKS: Final = 480  # per learner: final policies of as many agents as fit, at least one
_PALETTE: Final = ("path", "over", "wall", "no value")  # colours of `envs.scene` that the page's script uses
_NO_NUMBER: Final = -(2**31)  # stands for NaN among packed values
_FIRST_MASK: Final = ord("0")  # a mask is written as a character, from this one on


# Decorates the function of the item with the explorer's file, which calls `write`.
explorer_item: Final = writing(
    "agents", "what the explorer on the page shows: values, policies and scenarios, as compressed JSON", FILE
)


def write(shown: Sequence[Records], path: Path) -> None:
    """Writes the explorer's file, if it has agents; each refers to its scene and its sight by index."""
    shown = [records for records in shown if len(records.model.observation) <= MAX_STATES]
    if not shown:
        return
    models = {records.model.scenario: records.model for records in shown}
    scenes: list[dict[str, object]] = []  # shared by scenarios that differ in what is observed
    sights: list[dict[str, object]] = []
    index_of: dict[Scenario, dict[str, int]] = {}
    for scenario, model in models.items():
        if (scene := _scene(model)) not in scenes:
            scenes.append(scene)
        index_of[scenario] = {"scene": scenes.index(scene), "sight": len(sights)}
        observed = [component.name for component in model.components]
        sights.append({"observed": observed, "changes": np.diff(model.observation, prepend=0).tolist()})
    agents = [_learner(records) | index_of[records.model.scenario] for records in shown]
    data = {
        "actions": ACTIONS,
        "events": EVENTS,
        "zones": ZONES,
        "decimals": VALUE_DECIMALS,
        "no_number": _NO_NUMBER,
        "first_mask": _FIRST_MASK,
        "tolerance": OPTIMUM_TOLERANCE,
        "colours": [to_hex(colour) for colour in colour_map(drawn.COLOUR_MAP)(np.linspace(0, 1, 33))],
        "palette": {name: "#{:02x}{:02x}{:02x}".format(*drawn.COLOURS[name]) for name in _PALETTE},
        "clipped_share": drawn.CLIPPED_SHARE,
        "triangles": drawn.TRIANGLES.tolist(),
        "moves": MOVES.tolist(),
        "scenes": scenes,
        "sights": sights,
        "agents": agents,
    }
    path.write_bytes(compressed(data))


def compressed(data: object) -> bytes:
    """Returns data as compressed JSON."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return gzip.compress(text.encode(), mtime=0)


def _learner(records: Records) -> dict[str, object]:
    """Returns a learner's first agent, with every second map of its training, and others' final policies.

    Maps hold action values, `q`, or the action probabilities of a stochastic policy.
    """
    n_observations, last = records.model.n_observations, len(records.map_indices) - 1
    has_values = n_observations <= MAX_VALUED
    chosen = [*(range(0, last, 2) if has_values and last > 1 else []), last]
    points = records.map_indices[chosen]  # among the evaluation steps
    first = records.agents[0]
    n_shown = min(len(records.seeds), max(MAX_MASKS // n_observations, 1))
    others = [agent["greedy"][-1] for agent in records.agents[1:n_shown]]
    return {
        "scenario": records.scenario,
        "variant": records.run.variant,
        "observation": records.run.observation,
        "horizon": records.run.horizon,
        "kind": "probability" if first["stochastic"].shape[0] else "q",
        "discount": records.run.settings.discount_factor,
        "steps": [records.evaluation_steps[point] for point in points],
        "score": _listed(records.unbounded_scores()[0, points]),
        "success": _listed(first["success"][points]),
        "values": _integers(first["values"][chosen]) if has_values else None,
        "greedy": _characters(first["greedy"][points]),
        "seeds": list(records.seeds[:n_shown]),
        "others": {  # after the first
            "score": _listed(records.unbounded_scores()[1:n_shown, -1]),
            "success": _listed(records.arrays["success"][1:n_shown, -1]),
            "greedy": _characters(np.array(others, dtype=np.uint8)),
        },
    }


def _scene(model: Model) -> dict[str, object]:
    """Returns the looks of a scenario and the effects of each action, whatever is observed of it.

    `views` has a map for each place and phase. Effects are the same in many states, so each refers to
    one of the `kinds`: flattened lists, (kinds, A, K) of outcomes, (kinds,) of `over`, else (kinds, A).
    """
    scenario, n_states = model.scenario, len(model.observation)
    views = [scene_of(model, context) for context in np.unique(model.context).tolist()]
    effects = {
        "change": model.next_state - np.arange(n_states)[:, None, None],
        "probability": model.probability,
        "grid_reward": model.grid_reward,
        "issuer_reward": model.issuer_reward,
        "terminated": model.terminated.astype(int),
        "event": model.event,
    }
    columns = np.concatenate([values.reshape(n_states, -1) for values in effects.values()], axis=1)
    _, first, kind = np.unique(columns, axis=0, return_index=True, return_inverse=True)
    effects["over"] = model.is_over.astype(int)
    starts = np.concatenate([model.starts, model.unseen_starts])
    more = {"group": scenario.n_people} if scenario.group else {}
    return more | {
        "rows": views[0].rows,
        "columns": views[0].columns,
        "walls": np.flatnonzero(views[0].is_wall).tolist(),
        "outlines": [*drawn.BORDERS.values()],
        "views": [view.as_json() for view in views],
        "shape": [model.n_places, len(scenario.layout.ticks), 1 + scenario.is_delayed, scenario.ping_limit],
        "ticks": scenario.layout.ticks.tolist(),
        "phases": [stage.name for stage in scenario.layout.stages],
        "starts": starts.tolist(),
        "kind": kind.ravel().tolist(),
        "kinds": {name: values[first].ravel().tolist() for name, values in effects.items()},
        "issuer_noise": float(model.issuer_noise.max()),
    }


def _listed(values: NDArray[np.float64]) -> list[float | None]:
    return [None if math.isnan(value) else round(value, 6) for value in values.tolist()]


def _integers(maps: NDArray[np.floating]) -> list[int]:
    """Returns maps, (V, O, A), as integer differences from the map before: mostly zeros, which zip well."""
    scaled = np.rint(maps.astype(np.float64) * 10**VALUE_DECIMALS)
    # Only the values of nets about to diverge exceed two million; their digits are noise.
    whole = np.where(np.isnan(scaled), _NO_NUMBER, np.clip(scaled, _NO_NUMBER + 1, -_NO_NUMBER - 1))
    return [int(change) for change in np.diff(whole.astype(np.int64), axis=0, prepend=0).ravel()]


def _characters(masks: NDArray[np.uint8]) -> str:
    return (masks.ravel() + np.uint8(_FIRST_MASK)).tobytes().decode("ascii")
