"""The items on what was learned: the paper's figure, the curves, and the distance from the exact optimum."""

from collections.abc import Iterator
from string import ascii_lowercase
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from agents.policy import contains, greedy_masks
from benchmark.analysis.intervals import proportion
from benchmark.analysis.population import OPTIMUM_TOLERANCE, Population, optimal_values
from benchmark.drawing.maps import actions, colour_bar, dots, heat, region_legend, triangles
from benchmark.drawing.style import COLOURS, figure_of, norm_of
from benchmark.drawing.tables import link, show
from benchmark.reports.folder import Folder
from benchmark.reports.item import Frames, drawing, entry, expanded, item
from benchmark.reports.replication.data import Data
from envs import ACTIONS
from envs.scenario import FEEDBACK
from envs.scene import scene_of
from envs.words import listed

_DASHES = ("-", "--", ":")


@drawing(
    "figure",
    "the paper's figure: maximum Q per step, final Q of the moves, final Q of PING",
    "The paper's figure: maximum Q over training, final Q of the moves and of PING.",
)
def figure(frames: Frames, data: Data) -> Figure | None:
    """Draws max Q per step, final Q of the moves and final Q of PING, a column per scenario."""
    if not {"max_q", "q_values"} <= frames.keys():
        return None
    curves, values = frames["max_q"], frames["q_values"]
    moves, pings = values[values["action"] != "PING"], values[values["action"] == "PING"]
    bottom, top = curves["min"].min(), curves["max"].max()
    room = 0.04 * (top - bottom)
    with figure_of(3, len(data.models), (11.0, 9.0)) as (figure, axes):
        for column, (name, model) in enumerate(data.models.items()):
            curve = curves[curves["scenario"] == name]
            letters = ascii_lowercase[column :: len(data.models)]  # as the paper's
            axis = axes[0, column]
            band = {"color": "0.8", "lw": 0, "label": "range over agents"}
            axis.fill_between(curve["step"], curve["min"], curve["max"], **band)
            axis.plot(curve["step"], curve["mean"], color="black", lw=0.9, label="mean of the agents")
            axis.axhline(1.0, color="0.35", lw=0.8, ls=":", label="what a correct PING pays in S1")
            axis.set(title=f"({letters[0]}) max Q, {name}: {FEEDBACK[model.scenario.issuer.feedback.kind]}")
            axis.set(xlabel="environment step", xlim=(0, max(curve["step"].max(), 1)))
            axis.set(ylim=(bottom - room, top + room))
            scene = scene_of(model)
            triangles(axes[1, column], scene, moves[moves["scenario"] == name], norm_of(moves["mean"]))
            axes[1, column].set(title=f"({letters[1]}) moves, {name}")
            ping = pings[pings["scenario"] == name]
            heat(axes[2, column], scene, ping["mean"].to_numpy(), norm_of(pings["mean"]))
            axes[2, column].set(title=f"({letters[2]}) PING, {name}")
            dots(axes[2, column], ping[ping["mean"] > 0])
        axes[0, 0].set(ylabel="max Q of the visited cell")
        axes[0, 0].legend(loc="upper left", frameon=False)
        colour_bar(figure, axes[1], norm_of(moves["mean"]), "mean final Q of the moves")
        colour_bar(figure, axes[2], norm_of(pings["mean"]), "mean final Q of PING")
        region_legend(
            figure,
            Line2D([], [], ls="", marker=">", mfc="0.7", mec="none", ms=7, label="the move that way"),
            Line2D([], [], ls="", marker="o", color="black", ms=3, label="mean Q of PING > 0"),
        )
    return figure


@item("max_q", "maximum Q over agents at every recorded step, of the visited cell and of the table")
def max_q(data: Data) -> pd.DataFrame:
    """Tabulates the maximum Q of the visited cell, and of the table, over agents at each record."""
    frames = []
    for population in data.default:
        curves, every = population.arrays["max_q"], population.specification["settings"]["record_every"]
        columns = {"scenario": population.scenario, "step": np.arange(curves.shape[1]) * every}
        columns |= _spread(curves)
        table = _spread(population.arrays["table_max_q"])
        columns |= {f"table_{name}": values for name, values in table.items() if name != "std"}
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


@max_q.sentence
def _(table: pd.DataFrame, _: Folder) -> str:
    """Says how high the averaged curves get."""
    peaks = table.loc[table.groupby("scenario", sort=False)["mean"].idxmax()]
    texts = [f"{link(show(row['mean']), 'max_q', row)} in {row['scenario']}" for _, row in peaks.iterrows()]
    return f"Where the paper writes 'around 1', the averaged curves of max Q peak at {listed(texts)}."


@item(
    "learning",
    "success, score of the greedy policy, and the share of optimal agents, over training",
    dict.fromkeys(("scenario", "success", "score", "optimal_share", "unbounded_score"), ""),
    where=lambda frame: frame[frame["step"] == frame["step"].max()],
)
def learning(data: Data) -> pd.DataFrame:
    """Tabulates success, the score of the greedy policy, and the share of optimal agents, over training.

    `score` is the mean over agents of scores clipped to [0, 1], and `unbounded_score` that of the scores.
    """
    frames = []
    for population in data.default:
        columns: dict[str, Any] = {"scenario": population.scenario, "step": population.evaluation_steps}
        columns["success"] = proportion(population.arrays["success"])
        columns["score"] = proportion(np.clip(population.unbounded_scores, 0.0, 1.0))
        columns["optimal_share"] = proportion(_is_optimal(population.unbounded_scores))
        columns["unbounded_score"] = population.unbounded_scores.mean(axis=0)
        frames.append(pd.DataFrame(expanded(columns)))
    return pd.concat(frames, ignore_index=True)


@learning.figure("How well agents act while they learn: success, score, and how many are optimal.")
def _(frames: Frames, data: Data) -> Figure:
    frame = frames["learning"]
    panels = {
        "success": "success probability",
        "score": "mean score, clipped to [0, 1]",
        "optimal_share": "share of agents that are optimal",
    }
    with figure_of(1, len(panels), (11.0, 3.6)) as (figure, axes):
        for axis, (key, label) in zip(axes[0], panels.items(), strict=True):
            for i, name in enumerate(data.models):
                rows = frame[frame["scenario"] == name]
                axis.plot(rows["step"], rows[key], label=name, color=COLOURS[i], ls=_DASHES[i % len(_DASHES)])
                ends = rows[f"{key}_low"], rows[f"{key}_high"]
                axis.fill_between(rows["step"], *ends, color=COLOURS[i], alpha=0.25, lw=0)
            axis.set(xlabel="environment step", title=label, xlim=(0, max(frame["step"].max(), 1)))
            axis.set(ylim=(-0.03, 1.03))
            axis.xaxis.set_major_locator(MaxNLocator(4))
        figure.legend(
            *axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False,
            title="line: mean over agents; shade: 95 % interval",
        )  # fmt: skip
    return figure


@item("optimal", "the exact optimum, what was learned, success, and the regret, with all agents as well")
def optimal(data: Data) -> Iterator[dict[str, Any]]:
    """Tabulates what the greedy policies reach after training, and the exact anchors, by population."""
    for population in [*data.default, *(data.everyone.values() if data.sets else ())]:
        first, *_, last = population.seeds
        row: dict[str, Any] = {"scenario": population.scenario, "agents": len(population.seeds)}
        row |= {"first_seed": first, "last_seed": last}
        row["success"] = proportion(population.arrays["success"][:, -1])
        row["optimal_share"] = proportion(_is_optimal(population.unbounded_scores[:, -1]))
        for name, (random, best) in population.anchors.items():
            learned = population.arrays[name][:, -1].mean()
            row |= {f"{name}_random": random, f"{name}_optimal": best, f"{name}_learned": learned}
            row[f"{name}_regret"] = best - learned
        model = population.model
        start = model.observation[model.start]
        row["start_value_optimal"] = optimal_values(population).max(axis=1)[start]
        row["start_value_learned"] = population.arrays["q"].max(axis=-1).mean(axis=0)[start]
        row["cells_differing"] = differing(population)[~model.is_over[model.fresh_state]].mean()
        yield row


@optimal.sentence
def _(table: pd.DataFrame, _: Folder) -> str | None:
    """Says how often agents succeed in S2."""
    rows = table[table["scenario"] == "S2"].sort_values("agents", ascending=False)
    texts = [
        f"{entry(row, 'success', 'optimal')} with {row['agents']:,} agents" for _, row in rows.iterrows()
    ]
    return f"After training the success probability in S2 is {listed(texts)}." if texts else None


@optimal.shown
def _(frame: pd.DataFrame) -> pd.DataFrame:
    hidden = ("scenario", "agents", "first_seed", "last_seed")
    keys = [key for key in map(str, frame) if key not in hidden and not key.endswith(("_low", "_high"))]
    columns = {
        f"{row['scenario']}, {row['agents']:,}": [entry(row, key, "optimal") for key in keys]
        for _, row in frame.iterrows()
    }
    return pd.DataFrame({"": [key.replace("_", " ") for key in keys]} | columns)


@optimal.figure("What is optimal, how far what was learned is from it, and where agents act optimally.")
def _(frames: Frames, data: Data) -> Figure | None:
    if "q_values" not in frames:
        return None
    cells = frames["q_values"]
    by_cell = cells.groupby(["scenario", "row", "column"], sort=False)
    best = by_cell[["optimal", "largest_learned", "differs"]].max()
    best = best.assign(difference=best["largest_learned"] - best["optimal"], agrees=1 - best["differs"])
    labels = {
        "optimal": "optimal value",
        "difference": "learned minus optimal value",
        "agrees": "share of agents acting optimally",
    }
    with figure_of(3, len(data.models), (11.0, 9.6)) as (figure, axes):
        for column, (name, model) in enumerate(data.models.items()):
            scene = scene_of(model)
            for row, (key, label) in enumerate(labels.items()):
                shown = np.where(scene.is_over, np.nan, best.loc[name][key].to_numpy())
                heat(axes[row, column], scene, shown, norm_of(best[key]))
                axes[row, column].set(title=f"{label}, {name}")
            actions(axes[0, column], scene, cells[(cells["scenario"] == name) & cells["is_optimal"]])
        for row, (key, label) in enumerate(labels.items()):
            colour_bar(figure, axes[row], norm_of(best[key]), label)
        region_legend(
            figure,
            Line2D([], [], ls="", marker=">", mfc="white", mec="black", ms=6, label="optimal move"),
            Line2D([], [], ls="", marker="o", color="black", ms=3, label="optimal PING"),
        )
    return figure


@item("q_values", "final Q over agents and Q* of every cell and action, and where policies differ")
def q_values(data: Data) -> pd.DataFrame:
    """Tabulates the final Q-values over agents, and Q*: one row per scenario, cell and action.

    Q* (`optimal`) is that of an agent that knows its state, with no wrong PING so far, discounted and with
    the issuer's mean rewards, as the learner's is. `largest_learned` is the mean over agents of their largest
    Q in the cell (and so no less than the largest of the means); `differs` is the share of agents whose
    greedy action there is not an optimal one.
    """
    frames = []
    for population in data.default:
        best, q = optimal_values(population), population.arrays["q"]
        row, column = population.model.position.repeat(len(ACTIONS), axis=0).T
        columns = {"scenario": population.scenario, "row": row, "column": column}
        columns["action"] = np.tile(ACTIONS, len(best))
        values = _spread(q) | {"optimal": best, "difference": q.mean(axis=0) - best}
        values["is_optimal"] = contains(greedy_masks(best, OPTIMUM_TOLERANCE))
        columns |= {name: array.ravel() for name, array in values.items()}
        columns["largest_learned"] = q.max(axis=-1).mean(axis=0).repeat(len(ACTIONS))
        columns["differs"] = differing(population).repeat(len(ACTIONS))
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def differing(population: Population) -> NDArray[np.float64]:
    """Returns the share of agents whose greedy action is not an optimal one, (O,).

    An agent with several best actions, which it draws from, counts by the share that is not optimal.
    """
    best = contains(greedy_masks(optimal_values(population), OPTIMUM_TOLERANCE))  # (O, A)
    greedy = contains(population.arrays["greedy"][:, -1])  # (N, O, A)
    wrong = (greedy & ~best).sum(axis=-1) / greedy.sum(axis=-1)
    return np.asarray(wrong.mean(axis=0))


def _spread(values: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Returns mean, sample standard deviation and extremes over agents of (N, ...) values."""
    std = values.std(axis=0, ddof=1)
    return {"mean": values.mean(axis=0), "std": std, "min": values.min(axis=0), "max": values.max(axis=0)}


def _is_optimal(scores: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Returns which scores are those of an optimal policy."""
    return scores >= 1 - OPTIMUM_TOLERANCE
