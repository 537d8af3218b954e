"""The items on the paper's claims: judged with few agents and many, in disjoint sets, under each reading."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from benchmark.drawing.style import COLOURS, INK, figure_of
from benchmark.drawing.tables import link
from benchmark.experiments import DEFAULT_CONDITION
from benchmark.reports.folder import Folder
from benchmark.reports.item import Finding, Frames, entry, item
from benchmark.reports.replication.claims import CLAIMS, STATES, VERDICTS, agreement, judge, weakest
from benchmark.reports.replication.data import Data
from envs.words import listed

_SIGNS = dict(zip(VERDICTS, ("✓", "?", "✗"), strict=True))
_SIGNED = {verdict: f"{sign} {verdict}" for verdict, sign in _SIGNS.items()}
_STATE_SIGNS = dict(zip(STATES, _SIGNS.values(), strict=True))
_COLOURS = dict(zip(VERDICTS, (COLOURS[9], "#f7ecc3", COLOURS[3]), strict=True))  # differ in brightness, too
_OF_THE_PAPER = 100  # agents per scenario
_WORDS = (("holds", "hold"), ("is undecided", "are undecided"), ("does not hold", "do not hold"))
_VERBS = dict(zip(VERDICTS, _WORDS, strict=True))  # of one claim, and of several


@item("claims", "every part of every claim, with its 95 % interval, its state and the verdict, by agents")
def claims(data: Data) -> pd.DataFrame | None:
    """Tabulates the parts of every claim, with as many agents as the paper has and with all."""
    if not data.judged_readings:
        return None
    judged = [data.judged_readings[DEFAULT_CONDITION]]
    if data.sets:
        judged.append(judge(data.everyone, data.curves[DEFAULT_CONDITION]))
    frame = pd.concat(judged, ignore_index=True)
    frame = frame.join(agreement(frame, data.judged_sets))
    frame["claim"] = pd.Categorical(frame["claim"], [claim.id for claim in CLAIMS])
    frame = frame.sort_values(["claim", "agents"], kind="stable", ignore_index=True)
    return frame.astype({"claim": str})


@claims.shown
def _(frame: pd.DataFrame) -> pd.DataFrame:
    sizes = _sizes(frame)
    frame = frame.rename(columns={"low": "value_low", "high": "value_high"})
    rows: list[dict[str, str]] = []
    for (claim, name), part in frame.groupby(["claim", "part"], sort=False):
        by_size = {size: part[part["agents"] == size].iloc[0] for size in sizes}
        every, few = by_size[sizes[0]], by_size[sizes[-1]]
        row = {"claim": f"`{claim}`"}
        row |= {f"verdict, {size:,}": _SIGNED[each["verdict"]] for size, each in by_size.items()}
        if len(sizes) > 1:
            interval = f"[{every['share_low']:.0%}, {every['share_high']:.0%}]"
            row[f"of {every['sets']} sets"] = f"{entry(every, 'sets_agreeing', 'claims')} {interval}"
        if rows and any(each["claim"] == row["claim"] for each in rows):
            row = dict.fromkeys(row, "")  # they are those of the claim
        row |= {"part": str(name), "must be": f"{every['right_side']} {every['threshold']:g}"}
        for size, each in by_size.items():
            row[f"value, {size:,}"] = f"{entry(each, 'value', 'claims')} {_STATE_SIGNS[each['state']]}"
        for key, shown in (("drawn", few), ("effect", every), ("agents_needed", every)):
            if key in frame:  # it is left out of files if no part has one
                row[key.replace("_", " ")] = entry(shown, key, "claims")
        rows.append(row)
    return pd.DataFrame(rows)


@claims.sentence
def _(table: pd.DataFrame, _: Folder) -> Iterator[str]:
    """Says which verdicts differ between the numbers of agents, and which are not those of all sets."""
    many, *others = _sizes(table)
    for few in others:
        rows, before = (weakest(table[table["agents"] == size]) for size in (many, few))
        changed = [
            f"`{row['claim']}` ({old} with {few:,}, {link(row['verdict'], 'claims', row)} with {many:,})"
            for (_, row), old in zip(rows.iterrows(), before["verdict"], strict=True)
            if row["verdict"] != old
        ]
        yield f"The verdict depends on the number of agents for {listed(changed) if changed else 'no claim'}."
        n_sets = rows["sets"].iloc[0]
        counts = [
            f"{entry(row, 'sets_agreeing', 'claims')} for `{row['claim']}`"
            for _, row in rows[rows["sets_agreeing"] < n_sets].iterrows()
        ]
        counts.append(f"{n_sets} for every {'other ' if counts else ''}claim")
        yield (
            f"Of {n_sets} disjoint sets of {few:,} agents, by consecutive seeds, this many have the "
            f"verdict of all {many:,} agents: {listed(counts)}."
        )


def headline(folder: Folder) -> Finding | None:
    """Counts the verdicts on the claims, with all agents and with as many as the paper has."""
    if "claims.csv" not in folder:
        return None
    rows = weakest(folder.frame("claims"), "agents")
    texts: list[str] = []
    for size, judged in sorted(rows.groupby("agents"), reverse=True):
        start = f"With {size:,} agents per scenario,"
        if not texts:
            start += f" of the paper's {len(judged)} claims"
        elif size == _OF_THE_PAPER:
            start += " as many as the paper has,"
        counts = [
            f"{link(str(len(found)), 'claims', found)} {verbs[len(found) > 1]}"
            for verdict, verbs in _VERBS.items()
            if len(found := judged[judged["verdict"] == verdict])
        ]
        texts.append(f"{start} {listed(counts)}.")
    return Finding("\n\n".join(texts))


@item("claim_sets", "every part of every claim in each of the disjoint sets of agents, and the verdicts")
def claim_sets(data: Data) -> pd.DataFrame | None:
    """Tabulates the parts of every claim in each set."""
    columns = ["first_seed", "last_seed", "claim", "part", "value", "low", "high", "state", "verdict"]
    frames = []
    for populations, judged in zip(data.sets, data.judged_sets, strict=False):
        first, *_, last = next(iter(populations.values())).seeds
        frames.append(judged.assign(first_seed=first, last_seed=last)[columns])
    return pd.concat(frames, ignore_index=True) if frames else None


def _changed(frame: pd.DataFrame) -> pd.DataFrame:
    """Returns the weakest parts of the claims whose verdict under a reading is not the one by default."""
    rows = weakest(frame, "reading")
    default = rows[rows["reading"] == DEFAULT_CONDITION].set_index("claim")["verdict"]
    rows = rows.assign(by_default=rows["claim"].map(default))
    return rows[rows["verdict"] != rows["by_default"]]


@item(
    "sensitivity",
    "every part of every claim, its state and the verdict, under every reading of the paper",
    {"reading": "", "claim": "", "by_default": "verdict by default", "verdict": "", "part": "", "value": ""},
    where=_changed,
)
def sensitivity(data: Data) -> pd.DataFrame | None:
    """Tabulates the parts of every claim under each reading, with as many agents as the paper has."""
    columns = ["claim", "reading", "part", "agents", "value", "low", "high"]
    columns += ["right_side", "threshold", "state", "verdict"]
    frames = [frame.assign(reading=name)[columns] for name, frame in data.judged_readings.items()]
    return pd.concat(frames, ignore_index=True) if frames else None


@sensitivity.figure("Whether the paper's claims hold, by how the paper is read.")
def _(frames: Frames, _: object) -> Figure | None:
    if "sensitivity" not in frames:
        return None
    frame = frames["sensitivity"]
    claims, readings = frame.drop_duplicates("claim"), list(frame["reading"].unique())
    with figure_of(1, 1, (11.0, 0.34 * len(claims) + 0.9)) as (figure, axes):
        axis = axes[0, 0]
        for _, row in weakest(frame, "reading").iterrows():
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
            handles=[Patch(color=_COLOURS[verdict], label=text) for verdict, text in _SIGNED.items()],
            loc="outside lower center", ncols=3, frameon=False,
            title="number: the value of the claim's weakest part; in brackets: where all parts must lie",
        )  # fmt: skip
    return figure


def _sizes(frame: pd.DataFrame) -> list[int]:
    """Returns the numbers of agents, the largest first."""
    return sorted(map(int, frame["agents"].unique()), reverse=True)
