"""What the explorer shows: one agent of every learner, packed small enough for the page."""

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
from envs import ACTIONS, EVENTS, ZONES, Model, Scenario, compile_scenario
from envs.scene import COLOUR_MAP

COLOURS: Final = [to_hex(mpl.colormaps[COLOUR_MAP](i / 32)) for i in range(33)]  # of the colour scale
_NO_NUMBER: Final = -(2**31)  # among a map's values


def collect(folders: Sequence[Folder]) -> dict[str, Any] | None:
    """Returns what the explorer shows of the folders that have snapshots; None if there are none.

    Raises:
      InputError: A folder is damaged, or was made by another version of this project.
    """
    for folder in folders:
        if "agent.csv" in folder:
            return section(folder, _data_of)
    return None


def _data_of(folder: Folder) -> dict[str, Any]:
    """Returns what the explorer shows; a map's values are in thousandths."""
    agents = folder.read("agent.csv", as_text="discount")
    if agents.empty:
        raise ValueError("agent.csv is empty")
    scenarios = {
        name: compile_scenario(Scenario.model_validate_json(json.dumps(declared)))
        for name, declared in folder.manifest["scenarios"].items()
    }
    curves_file = "curves.csv" if "curves.csv" in folder else "learning.csv"
    curves = folder.read(curves_file)
    maps = {name: folder.read(f"agent_{name}.csv", embed=False) for name in scenarios}
    best = folder.read("optimum.csv", embed=False, as_text="discount")
    settings = {arm: one["settings"] for arm, one in folder.manifest["algorithms"].items()}
    blocks = []
    for key, own in agents.groupby(["scenario", "algorithm", "observation"], sort=False):
        scenario, algorithm, observation = map(str, key)
        n_cells = scenarios[scenario].n_observations
        frame = maps[scenario]
        frame = frame[(frame["algorithm"] == algorithm) & (frame["observation"] == observation)]
        if len(frame) != len(own) * n_cells:
            raise ValueError(f"agent_{scenario}.csv has not as many rows as agent.csv says")
        if not ((best["scenario"] == scenario) & (best["discount"] == own["discount"].iloc[0])).any():
            raise ValueError(f"optimum.csv has no {scenario} with discount {own['discount'].iloc[0]}")
        curve = curves[curves["scenario"] == scenario]
        if "algorithm" in curve:
            curve = curve[(curve["algorithm"] == algorithm) & (curve["observation"] == observation)]
        mean = "score_mean" if "score_mean" in curve else "score"
        blocks.append(
            {
                "scenario": scenario,
                "algorithm": algorithm,
                "observation": observation,
                "kind": own["kind"].iloc[0],
                "discount": own["discount"].iloc[0],
                "seed": int(own["seed"].iloc[0]),
                "unit": settings[algorithm].get("budget_unit", "steps"),
                "steps": own["step"].tolist(),
                "score": _listed(own["score"]),
                "success": _listed(own["success"]),
                "agent_row": line_of(own.index[0]),
                "values": _packed(frame[list(ACTIONS)].to_numpy()),
                "greedy": _masks(frame["greedy"]),
                "map_row": line_of(frame.index[0]),
                "curve": {
                    "row": line_of(curve.index[0]),
                    "step": curve["step"].tolist(),
                    **{end: _listed(curve[f"{mean}{end}"]) for end in ("", "_low", "_high")},
                },
            }
        )
    optima = {
        f"{scenario} {discount}": {
            "row": line_of(own.index[0]),
            "values": _packed(own[list(ACTIONS)].to_numpy()),
            "optimal": _masks(own["optimal"]),
        }
        for (scenario, discount), own in best.groupby(["scenario", "discount"], sort=False)
    }
    return {
        "prefix": folder.prefix,
        "curves_file": curves_file,
        "horizon": folder.manifest["horizon"],
        "actions": list(ACTIONS),
        "events": list(EVENTS),
        "zones": list(ZONES),
        "decimals": snapshots.DECIMALS,
        "no_number": _NO_NUMBER,
        "colours": COLOURS,
        "scenarios": {name: _scene(model) for name, model in scenarios.items()},
        "blocks": blocks,
        "optima": optima,
    }


def _listed(values: pd.Series) -> list[float | None]:
    """Returns numbers for JSON, which has none that is not finite."""
    return [None if math.isnan(value) else value for value in values.tolist()]


def _packed(values: NDArray[np.float64]) -> str:
    """Returns values in thousandths as 32-bit integers, little-endian, in base64."""
    scaled = np.rint(values * 10**snapshots.DECIMALS)
    # Beyond two million there are only nets on their way to diverging, whose every digit is noise.
    packed = np.where(np.isnan(scaled), _NO_NUMBER, np.clip(scaled, _NO_NUMBER + 1, -_NO_NUMBER - 1))
    return base64.b64encode(packed.astype("<i4").tobytes()).decode("ascii")


def _masks(names: Iterable[str]) -> str:
    """Returns sets of actions, `UP|PING`, as one byte each, in base64."""
    bit = {action: 1 << i for i, action in enumerate(ACTIONS)}
    masks = bytes(sum(bit[action] for action in one.split("|")) for one in names)
    return base64.b64encode(masks).decode("ascii")


def _scene(model: Model) -> dict[str, Any]:
    """Returns a compiled scenario for the page: all that a walk looks up, (S * A) lists."""
    scenario = model.scenario
    return {
        "rows": scenario.grid.rows,
        "columns": scenario.grid.columns,
        "start": model.start,
        "issuer": list(scenario.issuer.position),
        "radii": [scenario.regions.uncomfortable_radius, scenario.regions.target_radius],
        "zone": model.zone_of_cell.tolist(),
        "next": model.next_state.ravel().tolist(),
        "terminated": model.terminated.ravel().astype(int).tolist(),
        "event": model.event.ravel().tolist(),
        "grid_reward": model.grid_reward.ravel().tolist(),
        "issuer_reward": np.round(model.issuer_reward, 6).ravel().tolist(),
        "issuer_noise": float(model.issuer_noise.max()),
    }
