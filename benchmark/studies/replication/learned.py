"""The items on what was learned: the paper's figure, the curves, and the distance from the exact optimum."""

from collections.abc import Iterator
from functools import partial
from string import ascii_lowercase
from typing import Final

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from agents.policy import contains, greedy_masks
from benchmark.analysis.frames import RecordsOf
from benchmark.analysis.intervals import proportion
from benchmark.analysis.records import OPTIMUM_TOLERANCE, Records, anchors, optimal_values
from benchmark.drawing.maps import actions, colour_bar, dots, heat, region_legend, triangles
from benchmark.drawing.style import COLOURS, WIDTH, figure_of, name_lines, norm_of
from benchmark.experiments import Experiment
from benchmark.studies.item import COLUMNS, Frames, drawing, expanded, item, labelled_columns
from benchmark.studies.replication.agents import agents_of, few_agents
from envs import ACTIONS
from envs.people import FEEDBACK
from envs.scene import scene_of

_item: Final = partial(item, meanings=COLUMNS["replication"])
_DASHES: Final = ("-", "--", ":")
_BLOCK: Final = 5  # records of a curve that share a point of the figure
_OF_BLOCK: Final = {"step": "first", "mean": "mean", "min": "min", "max": "max"}
_OPTIMUM: Final = 1 - OPTIMUM_TOLERANCE  # the score of an optimal policy


@drawing(
    "figure",
    "a figure as in the paper: maximum Q per step, final Q of the moves, final Q of PING",
    "As in the paper's figure: maximum Q over training, final Q of the moves and of PING.",
)
def figure(tables: Frames, experiment: Experiment, records: RecordsOf) -> Figure | None:
    """Draws a column per scenario."""
    if not {"max_q", "q_values"} <= tables.keys():
        return None
    curves, values, groups = tables["max_q"], tables["q_values"], few_agents(experiment, records)
    moves, pings = values[values["action"] != "PING"], values[values["action"] == "PING"]
    move_norm, ping_norm = norm_of(moves["mean"]), norm_of(pings["mean"])
    bottom, top = curves["min"].min(), curves["max"].max()
    room = 0.04 * (top - bottom)
    with figure_of(3, len(groups), (WIDTH, 7.8)) as (figure, axes):
        for column, (name, agents) in enumerate(groups.items()):
            curve, move, ping = (frame[frame["scenario"] == name] for frame in (curves, moves, pings))
            scene, kind = scene_of(agents.model), agents.model.scenario.issuer.feedback.kind
            axis, move_axis, ping_axis = axes[:, column]
            letters = ascii_lowercase[column:9:3]  # as the paper's
            curve = curve.groupby(np.arange(len(curve)) // _BLOCK).agg(_OF_BLOCK)
            axis.fill_between(curve["step"], curve["min"], curve["max"], color="0.8", lw=0)
            sns.lineplot(curve, x="step", y="mean", estimator=None, ax=axis, color="black", lw=0.9)
            axis.axhline(1.0, color="0.35", lw=0.8, ls=":")
            title = f"{name}: {FEEDBACK.get(kind, kind)}\n({letters[0]}) max Q over training"
            axis.set(title=title, xlabel="environment step", ylabel="")
            axis.set(xlim=(0, max(curve["step"].max(), 1)), ylim=(bottom - room, top + room))
            axis.xaxis.set_major_locator(MaxNLocator(3))
            triangles(move_axis, scene, move, move_norm)
            heat(ping_axis, scene, ping["mean"].to_numpy(), ping_norm)
            dots(ping_axis, ping[ping["mean"] > 0])
            move_axis.set(title=f"({letters[1]}) final Q of moves")
            ping_axis.set(title=f"({letters[2]}) final Q of PING")
        last = curves[curves["scenario"] == next(iter(groups))].iloc[-1]
        style = {"ha": "right", "fontsize": "small"}
        axes[0, 0].set(ylabel="max Q of the visited cell")
        axes[0, 0].text(last["step"], 1.0 + room, "a correct PING in S1", va="bottom", **style)
        axes[0, 0].text(last["step"], (last["mean"] + last["max"]) / 2, "range over agents ", **style)
        axes[0, 0].text(last["step"], last["mean"] - 2 * room, "mean ", va="top", **style)
        colour_bar(figure, axes[1], move_norm, "mean over agents")
        colour_bar(figure, axes[2], ping_norm, "mean over agents")
        scenes = [scene_of(agents.model) for agents in groups.values()]
        arrow = Line2D([], [], ls="", marker=">", mfc="0.7", mec="none", ms=7, label="the move that way")
        dot = Line2D([], [], ls="", marker="o", color="black", ms=3, label="mean Q of PING > 0")
        region_legend(figure, scenes, arrow, dot, columns=3)
    return figure


@_item("max_q", "maximum Q over agents at every recorded step, of the visited cell and of the table")
def max_q(experiment: Experiment, records: RecordsOf) -> pd.DataFrame:
    """Tabulates the maximum Q of the visited cell, and of the table, over agents at each record."""
    frames = []
    for name, agents in few_agents(experiment, records).items():
        visited, table = (_spread(agents.arrays[key]) for key in ("max_q", "table_max_q"))
        steps = np.arange(len(visited["mean"])) * agents.run.settings.model_dump()["record_every"]
        columns = {"scenario": name, "step": steps} | visited
        columns |= {f"table_{key}": table[key] for key in ("mean", "min", "max")}
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


@_item(
    "learning",
    "success, score of the greedy policy, and the share of optimal agents, over training",
    labelled_columns({}, "scenario success score optimal_share unbounded_score"),
    where=lambda frame: frame[frame["step"] == frame["step"].max()],
)
def learning(experiment: Experiment, records: RecordsOf) -> pd.DataFrame:
    """Tabulates success, the score of the greedy policy, and the share of optimal agents, over training."""
    frames = []
    for name, agents in few_agents(experiment, records).items():
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


@learning.figure(
    "How often agents succeed while they learn, and how many act optimally; shade: 95 % interval."
)
def _(table: pd.DataFrame) -> Figure:
    panels = {"success": "success", "optimal_share": "share of agents that are optimal"}
    with figure_of(1, len(panels), (WIDTH, 2.8)) as (figure, axes):
        for axis, (key, label) in zip(axes[0], panels.items(), strict=True):
            ends = {}
            for i, (name, rows) in enumerate(table.groupby("scenario", sort=False)):
                style = {"color": COLOURS[i], "ls": _DASHES[i]}
                sns.lineplot(rows, x="step", y=key, estimator=None, ax=axis, **style)
                low, high = rows[f"{key}_low"], rows[f"{key}_high"]
                axis.fill_between(rows["step"], low, high, color=COLOURS[i], alpha=0.25, lw=0)
                ends[str(name)] = float(rows[key].iloc[-1]), style
            axis.set(xlabel="environment step", ylabel="", title=label)
            axis.set(xlim=(0, max(table["step"].max(), 1)), ylim=(-0.03, 1.03))
            axis.xaxis.set_major_locator(MaxNLocator(4))
            name_lines(axis, ends)
    return figure


@_item(
    "optimal",
    "the exact optimum, what was learned, success, and the regret, with all agents as well",
    labelled_columns(
        {},
        "scenario agents success optimal_share grid_return_learned grid_return_optimal "
        "start_value_learned start_value_optimal cells_differing",
    ),
)
def optimal(experiment: Experiment, records: RecordsOf) -> Iterator[dict[str, object]]:
    """Tabulates what the greedy policies reach after training, and the exact anchors."""
    few, *others = agents_of(experiment, records)
    for agents in (agents for groups in (few, *others[-1:]) for agents in groups.values()):
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
        row["cells_differing"] = _differing(agents)[~model.is_over[model.fresh_state]].mean()
        yield row


@optimal.figure("Where agents act optimally after training, and what is optimal there.")
def _(tables: Frames, experiment: Experiment, records: RecordsOf) -> Figure | None:
    if "q_values" not in tables:
        return None
    cells, groups = tables["q_values"], few_agents(experiment, records)
    shares = 1 - cells.groupby(["scenario", "row", "column"], sort=False)["differs"].first()
    norm = Normalize(0, 1)
    with figure_of(1, len(groups), (WIDTH, 3.1)) as (figure, axes):
        for axis, (name, agents) in zip(axes[0], groups.items(), strict=True):
            scene = scene_of(agents.model)
            heat(axis, scene, np.where(scene.is_over, np.nan, shares.loc[name].to_numpy()), norm)
            actions(axis, scene, cells[(cells["scenario"] == name) & cells["is_optimal"]])
            axis.set(title=name)
        colour_bar(figure, axes[0], norm, "share of agents\nacting optimally")
        scenes = [scene_of(agents.model) for agents in groups.values()]
        move = Line2D([], [], ls="", marker=">", mfc="white", mec="black", ms=6, label="optimal move")
        ping = Line2D([], [], ls="", marker="o", color="black", ms=3, label="optimal PING")
        region_legend(figure, scenes, move, ping, columns=3)
    return figure


@_item("q_values", "final Q over agents and Q* of every cell and action, and where policies differ")
def q_values(experiment: Experiment, records: RecordsOf) -> pd.DataFrame:
    """Tabulates final Q-values, and those of an agent that knows its state, with no wrong PING so far."""
    frames = []
    for name, agents in few_agents(experiment, records).items():
        best, q = optimal_values(agents), agents.arrays["q"]
        row, column = agents.model.position.repeat(len(ACTIONS), axis=0).T
        columns = {"scenario": name, "row": row, "column": column, "action": np.tile(ACTIONS, len(best))}
        values = _spread(q) | {"optimal": best, "difference": q.mean(axis=0) - best}
        values["is_optimal"] = contains(greedy_masks(best, OPTIMUM_TOLERANCE))
        columns |= {key: array.ravel() for key, array in values.items()}
        columns["largest_learned"] = q.max(axis=-1).mean(axis=0).repeat(len(ACTIONS))
        columns["differs"] = _differing(agents).repeat(len(ACTIONS))
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def _differing(agents: Records) -> NDArray[np.float64]:
    # The share of agents whose greedy action is not optimal, (O,); if they draw it, in part.
    best = contains(greedy_masks(optimal_values(agents), OPTIMUM_TOLERANCE))  # (O, A)
    greedy = contains(agents.arrays["greedy"][:, -1])  # (N, O, A)
    wrong = (greedy & ~best).sum(axis=-1) / greedy.sum(axis=-1)
    return np.asarray(wrong.mean(axis=0))


def _spread(values: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    std = values.std(axis=0, ddof=1)
    return {"mean": values.mean(axis=0), "std": std, "min": values.min(axis=0), "max": values.max(axis=0)}
