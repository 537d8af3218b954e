"""The items on the paper's claims: judged with few agents and many, in disjoint sets, under each reading."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator

from benchmark.drawing.style import COLOURS, figure_of
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
_SINGULAR = dict(zip(VERDICTS, ("holds", "is undecided", "does not hold"), strict=True))
_PLURAL = dict(zip(VERDICTS, ("hold", "are undecided", "do not hold"), strict=True))


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
    rows = []
    for claim, parts in frame.groupby("claim", sort=False):
        by_size = {size: parts[parts["agents"] == size] for size in sizes}
        for place, (_, part) in enumerate(by_size[sizes[0]].iterrows()):
            row = {"claim": f"`{claim}`"}
            row |= {f"verdict, {size:,}": _SIGNED[of["verdict"].iloc[0]] for size, of in by_size.items()}
            if len(sizes) > 1:
                interval = f"[{part['share_low']:.0%}, {part['share_high']:.0%}]"
                agreeing = link(str(part["sets_agreeing"]), "claims", part)
                row[f"of {part['sets']} sets"] = f"{agreeing} {interval}"
            if place:
                row = dict.fromkeys(row, "")  # they are those of the claim
            row |= {"part": part["part"], "must be": f"{part['right_side']} {part['threshold']:g}"}
            for size, of in by_size.items():
                here = of.iloc[place]
                value = entry(here.rename({"low": "value_low", "high": "value_high"}), "value", "claims")
                row[f"value, {size:,}"] = f"{value} {_STATE_SIGNS[here['state']]}"
            for key, shown in (("drawn", here), ("effect", part), ("agents_needed", part)):
                if key in frame:  # it is left out of files if no part has one
                    row[key.replace("_", " ")] = entry(shown, key, "claims")
            rows.append(row)
    return pd.DataFrame(rows)


@claims.figure("Every part of every claim, with its 95 % interval and its threshold.")
def _(frames: Frames, _: object) -> Figure | None:
    if "claims" not in frames:
        return None
    frame = frames["claims"]
    names, sizes = frame["claim"].unique(), _sizes(frame)[::-1]
    styles = [{"color": "0.45", "marker": "s", "mfc": "white"}, {"color": COLOURS[0], "marker": "o"}]
    drawn = dict(zip(sizes, styles[-len(sizes) :], strict=True))
    columns = 3
    n_rows = -(-len(names) // columns)
    with figure_of(n_rows, columns, (11.0, 2.5 * n_rows)) as (figure, axes):
        for axis in axes.flat[len(names) :]:
            axis.set_visible(False)
        for axis, name in zip(axes.flat, names, strict=False):
            rows = frame[frame["claim"] == name]
            parts = list(rows["part"].unique())
            side, threshold = rows[["right_side", "threshold"]].iloc[0]
            for i, (size, style) in enumerate(drawn.items()):
                shown = rows[(rows["agents"] == size) & rows["value"].map(np.isfinite)]
                places = shown["part"].map(parts.index) + 0.3 * (i - (len(sizes) - 1) / 2)
                ends = (shown["value"] - shown["low"], shown["high"] - shown["value"])
                style |= {"ls": "", "ms": 4.5, "capsize": 2.5, "label": f"{size:,} agents"}
                axis.errorbar(shown["value"], places, xerr=np.maximum(ends, 0), **style)
            axis.margins(x=0.1)
            axis.axvline(threshold, color="black", lw=0.9, ls="--", label="threshold")
            low, high = axis.get_xlim()
            ends = (threshold, high) if side == ">" else (low, threshold)
            axis.axvspan(*ends, color=COLOURS[9], alpha=0.3, lw=0, zorder=0, label="right side")
            axis.set(xlim=(low, high), ylim=(len(parts) - 0.4, -0.6))
            axis.set_yticks(range(len(parts)), parts)
            axis.xaxis.set_major_locator(MaxNLocator(4))
            verdicts = [rows.loc[rows["agents"] == size, "verdict"].iloc[0] for size in sizes]
            axis.set_title(f"{name}  {' '.join(_SIGNS[verdict] for verdict in verdicts)}")
        order = f", with {' and '.join(f'{size:,}' for size in sizes)} agents" if len(sizes) > 1 else ""
        figure.legend(
            *axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False,
            title=f"bars: 95 % intervals; verdict on the claim{order}: {', '.join(_SIGNED.values())}",
        )  # fmt: skip
    return figure


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
        if changed:
            yield f"The verdict depends on the number of agents for {listed(changed)}."
        else:
            yield f"No verdict with {many:,} agents differs from that with {few:,}."
        n_sets = rows["sets"].iloc[0]
        n_used, n_every = n_sets * few, (rows["sets_agreeing"] == n_sets).sum()
        whole = f"The {many:,} agents are" if n_used == many else f"Of the {many:,} agents, {n_used:,} are"
        some = [
            f"`{row['claim']}` {'has the same verdict ' if i == 0 else ''}in "
            f"{link(str(row['sets_agreeing']), 'claims', row)} of {n_sets} (a share of "
            f"{row['share']:.2g} [{row['share_low']:.2g}, {row['share_high']:.2g}])"
            for i, (_, row) in enumerate(rows[rows["sets_agreeing"] < n_sets].iterrows())
        ]
        yield (
            f"{whole} {n_sets} disjoint sets of {few:,}, by consecutive seeds. {n_every} of the {len(rows)} "
            f"verdicts with all {'is' if n_every == 1 else 'are'} the same in every set"
            f"{'; ' if some else ''}{listed(some)}."
        )


def headline(folder: Folder) -> Finding | None:
    """Counts the verdicts on the claims, with all agents and with as many as the paper has."""
    if "claims.csv" not in folder:
        return None
    rows = weakest(folder.frame("claims"), "agents")
    texts: list[str] = []
    for size in _sizes(rows):
        which = "as many as the paper has," if texts else f"of the paper's {rows['claim'].nunique()} claims"
        counts = []
        for verdict in VERDICTS:
            found = rows[(rows["agents"] == size) & (rows["verdict"] == verdict)]
            if len(found):
                verb = (_SINGULAR if len(found) == 1 else _PLURAL)[verdict]
                counts.append(f"{link(str(len(found)), 'claims', found)} {verb}")
        texts.append(f"With {size:,} agents per scenario, {which} {listed(counts)}.")
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


@item("sensitivity", "every part of every claim, its state and the verdict, under every reading of the paper")
def sensitivity(data: Data) -> pd.DataFrame | None:
    """Tabulates the parts of every claim under each reading, with as many agents as the paper has."""
    columns = ["claim", "reading", "part", "agents", "value", "low", "high"]
    columns += ["right_side", "threshold", "state", "verdict"]
    frames = [frame.assign(reading=name)[columns] for name, frame in data.judged_readings.items()]
    return pd.concat(frames, ignore_index=True) if frames else None


@sensitivity.shown
def _(frame: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for claim, here in _changed(frame).groupby("claim", sort=False):
        others = here[here["verdict"] != here["by_default"]]
        texts = [
            f"`{row['reading']}`: {link(row['verdict'], 'sensitivity', row)}" for _, row in others.iterrows()
        ]
        default = _SIGNED[here["by_default"].iloc[0]]
        rows.append((f"`{claim}`", default, "; ".join(texts) or "no reading changes it"))
    return pd.DataFrame(rows, columns=["claim", "verdict by default", "other verdicts under"])


@sensitivity.sentence
def _(table: pd.DataFrame, _: Folder) -> str | None:
    """Says every verdict that is another one under another reading or control."""
    rows = _changed(table)
    texts: list[str] = []
    for reading, others in rows[rows["verdict"] != rows["by_default"]].groupby("reading", sort=False):
        parts = [
            f"{link(str(len(found)), 'sensitivity', found)} from {old} to {new} "
            f"({listed(f'`{claim}`' for claim in found['claim'])})"
            for (old, new), found in others.groupby(["by_default", "verdict"], sort=False)
        ]
        texts.append(f"under `{reading}`, {listed(parts)}")
    if not texts:
        return None
    n_agents = rows["agents"].iloc[0]
    return f"Verdicts that differ from those by default, with {n_agents:,} agents: {'; '.join(texts)}."


@sensitivity.figure("Verdict on every claim under every reading.")
def _(frames: Frames, _: object) -> Figure | None:
    if "sensitivity" not in frames:
        return None
    frame = frames["sensitivity"]
    names, readings = frame["claim"].unique(), frame["reading"].unique()
    with figure_of(1, 1, (11.0, 0.4 * len(names) + 0.8)) as (figure, axes):
        axis = axes[0, 0]
        for _, row in weakest(frame, "reading").iterrows():
            x, y = list(readings).index(row["reading"]), list(names).index(row["claim"])
            colour, value = _COLOURS[row["verdict"]], row["value"]
            axis.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, fc=colour, ec="white", lw=2))
            shown = f"{value:.{3 if abs(value) >= 0.01 else 1}g}" if np.isfinite(value) else "-"
            axis.text(x, y, f"{_SIGNS[row['verdict']]}  {shown}", ha="center", va="center")
        axis.set(xlim=(-0.5, len(readings) - 0.5), ylim=(len(names) - 0.5, -0.5))
        axis.set_xticks(range(len(readings)), readings)
        sides = frame.drop_duplicates("claim")
        axis.set_yticks(
            range(len(names)),
            [f"{row['claim']}  ({row['right_side']} {row['threshold']:g})" for _, row in sides.iterrows()],
        )
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


def _changed(frame: pd.DataFrame) -> pd.DataFrame:
    """Returns the weakest part of every claim under every reading, with the claim's verdict by default."""
    rows = weakest(frame, "reading")
    default = rows[rows["reading"] == DEFAULT_CONDITION].set_index("claim")["verdict"]
    return rows.assign(by_default=rows["claim"].map(default))
