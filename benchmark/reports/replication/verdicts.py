"""The items on the paper's claims: judged with few agents and many, in disjoint sets, under each reading."""

from typing import Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from benchmark.analysis.frames import RecordsOf
from benchmark.drawing.style import COLOURS, INK, figure_of
from benchmark.drawing.tables import link
from benchmark.experiments import DEFAULT_CONDITION, Experiment
from benchmark.reports.folder import Folder
from benchmark.reports.item import entry, item, no_rows
from benchmark.reports.replication.agents import all_agents, few_agents, has_claims, judged, judged_sets
from benchmark.reports.replication.claims import CLAIMS, VERDICTS, agreement, weakest

_SIGNS: Final = dict(zip(VERDICTS, ("✓", "?", "✗"), strict=True))
_COLOURS: Final = dict(zip(VERDICTS, (COLOURS[9], "#f7ecc3", COLOURS[3]), strict=True))  # by brightness, too
_SHOWN: Final = (
    *("claim", "agents", "verdict", "sets", "agreeing", "part", "right_side", "threshold", "value", "state"),
    *("drawn", "effect", "agents_needed"),
)
_MEANINGS: Final = {
    "claim": "claim of the paper",
    "part": "which number of the claim",
    "value": "the number",
    "low": "lower end of its 95 % interval",
    "high": "upper end of its 95 % interval",
    "right_side": "on which side of the threshold the part must lie",
    "threshold": "threshold",
    "state": "whether the part passes, fails or is undecided",
    "verdict": "verdict on the claim",
    "agents": "agents per scenario",
}


@item(
    "claims",
    "every part of every claim, with its 95 % interval, its state and the verdict, by agents",
    meanings=_MEANINGS
    | {
        "effect": "distance to the right side of the threshold, in standard deviations of a single agent",
        "agents_needed": "agents that decide an undecided part with a probability of 80 %, by its effect",
        "note": "more about the part",
        "drawn": "what the paper's figure shows instead of `value`",
        "sets": "disjoint sets of as many agents as the paper has",
        "sets_agreeing": "sets with the same verdict on the claim",
        "share": "`sets_agreeing` / `sets`",
    },
)
def claims(experiment: Experiment, records: RecordsOf) -> pd.DataFrame | None:
    """Tabulates the parts of every claim, with as many agents as the paper has and with all."""
    if not has_claims(experiment):
        return None
    frames, sets = [judged(experiment, few_agents(experiment, records))], judged_sets(experiment, records)
    if sets:
        frames.append(judged(experiment, all_agents(experiment, records, DEFAULT_CONDITION)))
    frame = pd.concat(frames, ignore_index=True)
    frame = frame.join(agreement(frame, sets))
    frame["claim"] = pd.Categorical(frame["claim"], [claim.id for claim in CLAIMS])
    frame = frame.sort_values(["claim", "agents"], kind="stable", ignore_index=True)
    return frame.astype({"claim": str})


@claims.shown
def _(frame: pd.DataFrame) -> pd.DataFrame:
    frame = frame.rename(columns={"low": "value_low", "high": "value_high", "sets_agreeing": "agreeing"})
    keys = [key for key in _SHOWN if key in frame]  # one that no part has is left out of files
    rows = [{key: entry(row, key, "claims") for key in keys} for _, row in frame.iterrows()]
    return pd.DataFrame(rows).rename(columns=lambda key: key.replace("_", " "))


def headline(folder: Folder) -> str | None:
    """Counts the verdicts on the claims, with all agents."""
    if "claims.csv" not in folder:
        return None
    frame = folder.frame("claims")
    most = frame["agents"].max()
    rows = weakest(frame[frame["agents"] == most])
    parts = [(verdict, rows[rows["verdict"] == verdict]) for verdict in VERDICTS]
    counts = [f"{link(str(len(judged)), 'claims', judged)} × {name}" for name, judged in parts if len(judged)]
    scope = f"the paper's {len(rows)} claims, with {most:,} agents per scenario"
    return f"Verdicts on {scope}: {', '.join(counts)}."


@item(
    "claim_sets",
    "every part of every claim in each of the disjoint sets of agents, and the verdicts",
    meanings=_MEANINGS | {"first_seed": "seed of the first agent", "last_seed": "seed of the last agent"},
)
def claim_sets(experiment: Experiment, records: RecordsOf) -> pd.DataFrame | None:
    """Tabulates the parts of every claim in each set."""
    columns = ["first_seed", "last_seed", "claim", "part", "value", "low", "high", "state", "verdict"]
    frames = [frame[columns] for frame in judged_sets(experiment, records)]
    return pd.concat(frames, ignore_index=True) if frames else None


@item(
    "sensitivity",
    "every part of every claim, its state and the verdict, under every reading of the paper",
    where=no_rows,
    meanings=_MEANINGS | {"reading": "reading of the paper"},
)
def sensitivity(experiment: Experiment, records: RecordsOf) -> pd.DataFrame | None:
    """Tabulates the parts of every claim under each reading, with as many agents as the paper has."""
    if not has_claims(experiment):
        return None
    columns = ["claim", "reading", "part", "agents", "value", "low", "high"]
    columns += ["right_side", "threshold", "state", "verdict"]
    frames = [
        judged(experiment, few_agents(experiment, records, name), name).assign(reading=name)[columns]
        for name in experiment.declared.readings
    ]
    return pd.concat(frames, ignore_index=True)


@sensitivity.figure("Whether the paper's claims hold, by how the paper is read.")
def _(table: pd.DataFrame) -> Figure:
    claims, readings = table.drop_duplicates("claim"), list(table["reading"].unique())
    with figure_of(1, 1, (11.0, 0.34 * len(claims) + 0.9)) as (figure, axes):
        axis = axes[0, 0]
        for _, row in weakest(table, "reading").iterrows():
            x, y = readings.index(row["reading"]), list(claims["claim"]).index(row["claim"])
            colour, value = _COLOURS[row["verdict"]], row["value"]
            axis.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, fc=colour, ec="white", lw=2))
            shown = f"{value:.{3 if abs(value) >= 0.01 else 1}g}" if np.isfinite(value) else "-"
            axis.text(x, y, f"{_SIGNS[row['verdict']]}  {shown}", ha="center", va="center", color=INK[0])
        axis.set(xlim=(-0.5, len(readings) - 0.5), ylim=(len(claims) - 0.5, -0.5))
        axis.set_xticks(range(len(readings)), [name.replace("_", " ") for name in readings])
        sides = claims["claim"] + "  (" + claims["right_side"] + claims["threshold"].map(" {:g})".format)
        axis.set_yticks(range(len(claims)), sides)
        axis.xaxis.tick_top()
        axis.tick_params(length=0)
        axis.spines[:].set_visible(False)
        figure.legend(
            handles=[Patch(color=_COLOURS[each], label=f"{sign} {each}") for each, sign in _SIGNS.items()],
            loc="outside lower center", ncols=3, frameon=False,
            title="number: the value of the claim's weakest part; in brackets: where all parts must lie",
        )  # fmt: skip
    return figure
