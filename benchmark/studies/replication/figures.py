"""The figures of a replication: the paper's, and verdicts by reading."""

from string import ascii_lowercase
from textwrap import fill
from typing import Final

import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from benchmark.drawing.maps import colour_bar, dots, heat, region_legend, triangles
from benchmark.drawing.style import COLOURS, WIDTH, draw_cells, figure_of, norm_of
from benchmark.studies.item import drawing
from benchmark.studies.replication import tables
from benchmark.studies.replication.analysis import ReplicationAnalysis
from benchmark.studies.replication.claims import CLAIMS, VERDICTS
from envs.people import FEEDBACK
from envs.scene import scene_of

_SIGNS: Final = dict(zip(VERDICTS, ("✓", "?", "✗"), strict=True))
_COLOURS: Final = dict(zip(VERDICTS, (COLOURS[9], "#f7ecc3", COLOURS[3]), strict=True))  # by brightness, too
_BLOCK: Final = 5  # records of a curve that share a point of the figure
_OF_BLOCK: Final = {"step": "first", "mean": "mean", "min": "min", "max": "max"}


@drawing(
    "figure",
    "a figure as in the paper: maximum Q per step, final Q of the moves, final Q of PING",
    "As in the paper's figure: maximum Q over training, final Q of the moves and of PING.",
)
def figure(analysis: ReplicationAnalysis, _: pd.DataFrame) -> Figure:
    """Draws a column per scenario."""
    curves, values, groups = analysis.max_q, analysis.q_values, analysis.few
    moves, pings = values[values["action"] != "PING"], values[values["action"] == "PING"]
    move_norm, ping_norm = norm_of(moves["mean"]), norm_of(pings["mean"])
    bottom, top = curves["min"].min(), curves["max"].max()
    room = 0.04 * (top - bottom)
    scenes = {name: scene_of(agents.model) for name, agents in groups.items()}
    with figure_of(3, len(groups), (WIDTH, 7.8)) as (figure, axes):
        for column, (name, scene) in enumerate(scenes.items()):
            curve, move, ping = (frame[frame["scenario"] == name] for frame in (curves, moves, pings))
            kind = groups[name].model.scenario.issuer.feedback.kind
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
            learned = ping[ping["mean"] > 0]
            dots(ping_axis, learned["row"], learned["column"])
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
        arrow = Line2D([], [], ls="", marker=">", mfc="0.7", mec="none", ms=7, label="the move that way")
        dot = Line2D([], [], ls="", marker="o", color="black", ms=3, label="mean Q of PING > 0")
        region_legend(figure, [*scenes.values()], arrow, dot, columns=3)
    return figure


@tables.sensitivity.figure("Whether the claims hold, by how the paper is read.")
def sensitivity(analysis: ReplicationAnalysis, table: pd.DataFrame) -> Figure:
    """Draws the verdict on each claim under each reading."""
    titles = {name: each.title or name for name, each in analysis.data.experiment.declared.readings.items()}
    verdicts = table.groupby(["claim", "reading"])["verdict"].first()  # all parts have that of the claim
    looks = {verdict: (_SIGNS[verdict], to_hex(_COLOURS[verdict])) for verdict in VERDICTS}
    cells = [[looks[verdicts[claim.id, name]] for name in titles] for claim in CLAIMS]
    with figure_of(1, 1, (WIDTH, 0.3 * len(CLAIMS) + 1.1)) as (figure, axes):
        columns = [fill(title, 9) for title in titles.values()]
        draw_cells(axes[0, 0], cells, [claim.title for claim in CLAIMS], columns)
        text = ", ".join(f"{sign} {verdict}" for verdict, sign in _SIGNS.items())
        figure.supxlabel(f"{text}, with {table['agents'].iloc[0]} agents per scenario", fontsize="small")
    return figure
