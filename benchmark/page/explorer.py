"""What the explorer shows: the agents of every learner and scenario, packed small enough for the page."""

import base64
import json
import math
from collections.abc import Iterable, Sequence
from typing import Any, Final

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from benchmark.analysis import snapshots
from benchmark.page.sources import Folder, line_of, section
from envs import ACTIONS, EVENTS, Model, Scenario, compile_scenario
from envs import scene as scenes

COLOURS: Final = [to_hex(mpl.colormaps[scenes.COLOUR_MAP](i / 32)) for i in range(33)]  # of the scale
_PALETTE: Final = ("path", "over", "no value")  # colours of `envs.scene` that the script uses
_NO_NUMBER: Final = -(2**31)  # stands for NaN among packed values
_CURVES: Final = ("curves.csv", "learning.csv")  # files with the mean score over training


def collect(folders: Sequence[Folder]) -> dict[str, Any] | None:
    """Returns what the explorer shows of the folders that have snapshots; None if there are none.

    `agents`, `optima` and `scenes` are lists; an agent refers to its optimum and its scene by position.

    Raises:
      InputError: A folder is damaged, or was made by another version of this project.
    """
    parts = [section(folder, _read) for folder in folders if "agent.csv" in folder]
    if not parts:
        return None
    data: dict[str, Any] = {"agents": [], "optima": [], "scenes": []}
    for agents, optima, drawn in parts:
        for name, scene in drawn.items():
            if scene not in data["scenes"]:
                data["scenes"].append(scene)
            drawn[name] = data["scenes"].index(scene)
        for agent in agents:
            agent["scene"] = drawn[agent["scenario"]]
            agent["optimum"] += len(data["optima"])
        data["agents"] += agents
        data["optima"] += optima
    return {
        "actions": list(ACTIONS),
        "events": list(EVENTS),
        "decimals": snapshots.DECIMALS,
        "letters": snapshots.LETTERS,
        "no_number": _NO_NUMBER,
        "colours": COLOURS,
        "palette": {name: "#{:02x}{:02x}{:02x}".format(*scenes.COLOURS[name]) for name in _PALETTE},
        "clipped_share": scenes.CLIPPED_SHARE,
        **data,
    }


def _read(folder: Folder) -> tuple[list[dict[str, Any]], list[dict[str, Any]], dict[str, Any]]:
    """Returns a folder's agents, the optima that they refer to, and its scenes by scenario."""
    frame = folder.read("agent.csv", as_text="discount")
    if frame.empty:
        raise ValueError("agent.csv is empty")
    models = {
        name: compile_scenario(Scenario.model_validate_json(json.dumps(scenario)))
        for name, scenario in folder.manifest["scenarios"].items()
        if name in set(frame["scenario"])  # others have no maps of cells
    }
    curves_file = next((name for name in _CURVES if name in folder), None)
    curves = folder.read(curves_file) if curves_file else None
    maps = {name: folder.read(f"agent_{name}.csv", embed=False) for name in models}
    best = folder.read("optimum.csv", embed=False, as_text="discount")
    optima = {
        (str(scenario), str(discount)): {
            "scenario": scenario,
            "discount": discount,
            **_place(folder, "optimum.csv", rows),
            "columns": list(best.columns),
            "values": _packed(rows[list(ACTIONS)].to_numpy(), 1),
            "optimal": _masks(rows["optimal"]),
        }
        for (scenario, discount), rows in best.groupby(["scenario", "discount"], sort=False)
    }
    policies = folder.read("agents.csv", as_text="greedy") if "agents.csv" in folder else None
    agents = []
    for key, rows in frame.groupby(["scenario", "algorithm", "observation"], sort=False):
        scenario, arm, observation = map(str, key)
        optimum = scenario, str(rows["discount"].iloc[0])
        if optimum not in optima:
            raise ValueError(f"optimum.csv has no {scenario} with discount {optimum[1]}")
        snapshot = _of_learner(maps[scenario], arm, observation)
        if len(snapshot) != len(rows) * models[scenario].n_observations:
            raise ValueError(f"agent_{scenario}.csv has not as many rows as agent.csv says")
        seed = int(rows["seed"].iloc[0])
        others = None if policies is None else _others(folder, policies, key, models[scenario])
        declared = folder.manifest["algorithms"][arm]
        agents.append(
            {
                "experiment": folder.manifest["experiment"],
                "scenario": scenario,
                "algorithm": arm,
                "observation": observation,
                "method": declared["algorithm"],
                "horizon": folder.manifest["horizon"],
                "kind": rows["kind"].iloc[0],
                "discount": optimum[1],
                "seed": seed,
                "seeds": [seed] if others is None else others["seeds"],
                "others": others,
                "unit": declared["settings"].get("budget_unit", "steps"),
                "steps": rows["step"].tolist(),
                "score": _listed(rows["score"]),
                "success": _listed(rows["success"]),
                "evaluation": _place(folder, "agent.csv", rows),
                "maps": {
                    **_place(folder, f"agent_{scenario}.csv", snapshot),
                    "columns": list(snapshot.columns),
                },
                "values": _packed(snapshot[list(ACTIONS)].to_numpy(), len(rows)),
                "greedy": _masks(snapshot["greedy"]),
                "optimum": list(optima).index(optimum),
                "curve": None if curves is None else _curve(folder, str(curves_file), curves, key),
            }
        )
    return agents, list(optima.values()), {name: _scene(model) for name, model in models.items()}


def _of_learner(frame: pd.DataFrame, arm: str, observation: str) -> pd.DataFrame:
    """Returns a learner's rows; all rows of a file that does not tell learners apart."""
    if "algorithm" not in frame:
        return frame
    return frame[(frame["algorithm"] == arm) & (frame["observation"] == observation)]


def _others(folder: Folder, policies: pd.DataFrame, key: tuple[Any, ...], model: Model) -> dict[str, Any]:
    """Returns the seeds of a learner's agents, and where their final policies stand, one after the other."""
    scenario, arm, observation = map(str, key)
    rows = _of_learner(policies[policies["scenario"] == scenario], arm, observation)
    if not (rows["greedy"].str.len() == model.n_observations).all():
        raise ValueError(f"agents.csv has policies of {scenario} that have not a letter for every cell")
    return {**_place(folder, "agents.csv", rows), "seeds": rows["seed"].tolist()}


def _curve(folder: Folder, file: str, curves: pd.DataFrame, key: tuple[Any, ...]) -> dict[str, Any]:
    """Returns the mean score of a learner's runs over training, with its interval."""
    scenario, arm, observation = map(str, key)
    rows = _of_learner(curves[curves["scenario"] == scenario], arm, observation)
    return {
        **_place(folder, file, rows),
        "step": rows["step"].tolist(),
        "mean": _listed(rows["score"]),
        "low": _listed(rows["score_low"]),
        "high": _listed(rows["score_high"]),
    }


def _place(folder: Folder, file: str, rows: pd.DataFrame) -> dict[str, Any]:
    """Returns where consecutive rows stand: the link to their file, and the line of the first of them."""
    return {"file": folder.link(file), "line": line_of(rows.index[0])}


def _listed(values: pd.Series) -> list[float | None]:
    """Returns numbers for JSON, which has no NaN."""
    return [None if math.isnan(value) else value for value in values.tolist()]


def _packed(values: NDArray[np.float64], n_maps: int) -> list[int]:
    """Returns rounded values as integers, each less that of the map before: most are zero, and zip well."""
    scaled = np.rint(values * 10**snapshots.DECIMALS)
    # Only the values of nets about to diverge exceed two million; their digits are noise.
    packed = np.where(np.isnan(scaled), _NO_NUMBER, np.clip(scaled, _NO_NUMBER + 1, -_NO_NUMBER - 1))
    changes: list[int] = (
        np.diff(packed.astype(np.int64).reshape(n_maps, -1), axis=0, prepend=0).ravel().tolist()
    )
    return changes


def _masks(names: Iterable[str]) -> str:
    """Returns sets of actions, such as `UP|PING`, as one byte each, in base64."""
    bit = {action: 1 << i for i, action in enumerate(ACTIONS)}
    masks = bytes(sum(bit[action] for action in actions.split("|")) for actions in names)
    return base64.b64encode(masks).decode("ascii")


def _scene(model: Model) -> dict[str, Any]:
    """Returns a scene and everything that a walk looks up: (O,), (S,) and flattened (S, A) lists."""
    return scenes.scene_of(model).as_json() | {
        "start": int(model.observation[model.start]),
        "fresh": model.fresh_state.tolist(),
        "observation": model.observation.tolist(),
        "next": model.next_state.ravel().tolist(),
        "terminated": model.terminated.ravel().astype(int).tolist(),
        "event": model.event.ravel().tolist(),
        "grid_reward": model.grid_reward.ravel().tolist(),
        "issuer_reward": np.round(model.issuer_reward, 6).ravel().tolist(),
        "issuer_noise": float(model.issuer_noise.max()),
    }
