"""Items of a comparison: how learners learn, after how many steps, at whose expense, and at what cost."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmark.analysis.intervals import BOOTSTRAP_SEED, RESAMPLES, Estimate, combined, proportion, student
from benchmark.drawing import film
from benchmark.drawing.tables import link
from benchmark.reports.comparison import figures, words
from benchmark.reports.comparison.declared import Declared, Learner
from benchmark.reports.comparison.runs import CELL, EFFORT, PAIR, Cell, Runs
from benchmark.reports.explorer import Shown, explorer_item, typical_agent
from benchmark.reports.folder import Folder
from benchmark.reports.item import Frames, drawing, expanded, item, no_rows, writing
from benchmark.reports.learners import Names
from envs.words import listed

ENOUGH: Final = 0.9  # a success by which a scenario counts as learned
_MOST_RATIOS: Final = 2  # that a sentence has


@item("curves", "success, score and wrong PINGs over training, against environment steps", where=no_rows)
def curves(runs: Runs) -> pd.DataFrame:
    """`wrong_pings` are those per 1,000 steps since the evaluation before, with Student's interval."""
    frames = []
    for cell in runs:
        steps = np.array(cell.steps)
        columns: dict[str, Any] = {**cell.names, "step": steps}
        columns |= {name: proportion(cell.results(name)) for name in ("success", "score")}
        rate = np.diff(cell.population.arrays["disagreements"], axis=1) / np.diff(steps) * 1000
        rate = np.column_stack([np.full(len(rate), np.nan), rate])  # nothing before the first step
        wrong = student(rate)
        columns["wrong_pings"] = wrong._replace(low=np.maximum(wrong.low, 0.0))
        frames.append(pd.DataFrame(expanded(columns)))
    return pd.concat(frames, ignore_index=True)


@curves.figure("How often each learner succeeds while it learns.")
def _(tables: Frames, runs: Runs) -> Figure:
    frame = tables["curves"]
    few = words.by_place(frame)["scenario"].nunique() <= figures.FEW
    panels = runs.panels if few else {"": runs.declared.compared or figures.learners_in(frame, runs)}
    signs = f"; dotted: {ENOUGH:g}"
    with figures.curve_panels(frame, runs, panels, "success", "success", signs) as (figure, axes):
        for axis in axes:
            axis.axhline(ENOUGH, color="0.35", lw=0.8, ls=":")
            axis.set(ylim=(-0.03, 1.03), yticks=(0, 0.5, 1))
    return figure


@drawing(
    "wrong_pings",
    "wrong PINGs per 1,000 steps while agents learn",
    "How often a person is disturbed while agents learn: wrong PINGs per 1,000 steps.",
)
def wrong_pings(tables: Frames, runs: Runs) -> Figure | None:
    """Draws how often the issuer disagreed while agents learned."""
    if "curves" not in tables:
        return None
    frame = tables["curves"]
    drawn = runs.declared.compared or figures.learners_in(frame, runs)
    label = "wrong PINGs\nper 1,000 steps"
    with figures.curve_panels(frame, runs.own, {"": drawn}, "wrong_pings", label) as (figure, axes):
        shown = frame[figures.is_of_any(frame, drawn, runs.own)]
        for axis in axes:
            axis.set(ylim=(0, float(shown["wrong_pings"].max()) * 1.05))
    return figure


def _first_step(is_good: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Returns the place of the evaluation from which each row, (..., T), stays good to the end; T if none."""
    n_steps = is_good.shape[-1]
    bad_before = n_steps - (~is_good)[..., ::-1].argmax(axis=-1)
    return np.asarray(np.where(is_good.all(axis=-1), 0, bad_before))


@item(
    "steps",
    f"after how many steps success stays at or above {ENOUGH:g} to the last evaluation",
    {
        **CELL,
        "n": "runs",
        "budget": "steps of training",
        "share": "share of runs",
        "median_step": "median step of runs",
        "step": "step of the mean over runs",
        "final_success": "final mean",
    },
    best="-step",
)
def steps(runs: Runs) -> Iterator[dict[str, Any]]:
    """`step` is that of the mean success over runs, and `below_at` the last evaluation before it."""
    for cell in runs:
        success = cell.results("success")
        when, places = np.array([*cell.steps, np.inf]), _first_step(success >= ENOUGH)
        first = int(_first_step(success.mean(axis=0) >= ENOUGH))
        yield cell.row(
            n=cell.n,
            budget=cell.steps[-1],
            share=proportion(places < success.shape[1]),
            median_step=float(np.median(when[places])),
            step=float(when[first]),
            below_at=float(when[first - 1]) if first > 0 else np.nan,
            final_success=float(success.mean(axis=0)[-1]),
        )


@steps.sentence
def _(table: pd.DataFrame, folder: Folder) -> Iterator[str]:
    """Says which learner was the first to learn each scenario, tables and nets alike."""
    families = {name: each["family"] for name, each in folder.manifest["algorithms"].items()}
    references = [name for name, each in folder.manifest["algorithms"].items() if each["reference_for"]]
    winners: dict[str, dict[str, pd.DataFrame]] = {}  # by kind and scenario, the rows that say so
    own = table[~table["algorithm"].isin(references)]
    for scenario, here in own.groupby(words.scenario_labels(own), sort=False):
        best = here[(here["step"] == here["step"].min()) & np.isfinite(here["step"])]
        here_first = {families[name] for name in best["algorithm"]}
        kind = "both" if len(here_first) > 1 else "".join(here_first) or "none"
        winners.setdefault(kind, {})[str(scenario)] = best if len(best) else here
    told = {
        kind: link(str(len(found)), "steps", *found.values())
        + f" ({listed([*found])})" * (len(found) <= figures.FEW)
        for kind, found in winners.items()
    }
    kinds = {"tabular": "a table", "deep": "a net", "both": "a table and a net at the same evaluation"}
    if len(table["scenario"].unique()) > 1:
        if first := "; ".join(f"{text} in {told[kind]}" for kind, text in kinds.items() if kind in told):
            start = f"Of {len({*words.scenario_labels(own)})} scenarios"
            yield f"{start}, the first learner whose mean success stays at or above {ENOUGH:g} is {first}."
        if "none" in told:
            yield f"No learner's mean success stays at or above {ENOUGH:g} in {told['none']}."


def _medians(cell: Cell, rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns medians over runs of the steps between which a run learns, (RESAMPLES + 1,) each.

    The first is of the runs as they are, the others are resampled. A run that never learns has the budget and
    infinity.
    """
    when, first = np.array([0.0, *cell.steps, np.inf]), _first_step(cell.results("success") >= ENOUGH)
    drawn = np.vstack([np.arange(cell.n), rng.integers(cell.n, size=(RESAMPLES, cell.n))])
    with np.errstate(invalid="ignore"):
        return np.median(when[first][drawn], axis=1), np.median(when[first + 1][drawn], axis=1)


def _ratio(x: Cell, y: Cell) -> dict[str, Any]:
    """Returns how many times as many steps y needs as x, with an interval over runs and evaluations.

    Where half of the runs never learn, the budget stands in place of the median, and the ratio is a bound.
    It is empty if neither learns, or if one of them succeeds before the first step.
    """
    rng = np.random.default_rng([BOOTSTRAP_SEED, *x.scenario.encode()])
    (x_low, x_high), (y_low, y_high) = _medians(x, rng), _medians(y, rng)
    steps = float(x_high[0]), float(y_high[0])
    if min(steps) in (0, math.inf):
        return {}
    with np.errstate(divide="ignore", invalid="ignore"):
        lows, highs = y_low / x_high, y_high / x_low
    low = np.percentile(np.where(np.isnan(lows), 0.0, lows)[1:], 2.5, method="lower")
    high = np.percentile(np.where(np.isnan(highs), np.inf, highs)[1:], 97.5, method="higher")
    ratio = min(steps[1], y.steps[-1]) / min(steps[0], x.steps[-1])
    return {"x_step": steps[0], "y_step": steps[1], "ratio": Estimate(ratio, float(low), float(high))}


@item(
    "speedups",
    f"exploratory: how many times as many steps y needs as x until half of the runs stay at {ENOUGH:g}",
    {**PAIR, "x_step": "steps of x", "y_step": "steps of y", "ratio": "ratio, y to x"},
    where=lambda frame: frame[frame["ratio"] >= 1],
    best="ratio",
)
def speedups(runs: Runs) -> Iterator[dict[str, Any]]:
    """Of every deep learner against every table, and of every table against every deep learner."""
    families = runs.declared.families
    for x in runs.own:
        for y in runs.own:
            if x.place == y.place and families[x.learner] != families[y.learner] and (ratio := _ratio(x, y)):
                yield {**x.place, "x": str(x.learner), "y": str(y.learner), **ratio}


@speedups.sentence
def _(table: pd.DataFrame, folder: Folder) -> Iterator[str]:
    """Compares in each scenario the fastest net with the fastest table, in whichever direction."""
    families, names = Declared.from_manifest(folder.manifest).families, folder.names
    found: dict[str, dict[str, pd.Series]] = {"deep": {}, "tabular": {}}
    for scenario, here in table.groupby(words.scenario_labels(table), sort=False):
        fastest = here.sort_values(["y_step", "x_step"], kind="stable").iloc[0][["x", "y"]]
        for _, row in here[here["x"].isin(fastest) & here["y"].isin(fastest)].iterrows():
            if row["ratio_low"] > 1:
                found[families[Learner.of(row["x"])]][str(scenario)] = row
    for family, (side, other) in {"deep": ("net", "table"), "tabular": ("table", "net")}.items():
        if rows := found[family]:
            where = f"{link(str(len(rows)), 'speedups', *rows.values())} scenarios"
            if len(rows) <= _MOST_RATIOS:
                where = listed(f"{scenario} ({_times(row, names)})" for scenario, row in rows.items())
            yield (
                f"Exploratory: until half of the runs stay at a success of {ENOUGH:g}, the fastest {other} "
                f"needs more steps than the fastest {side} in {where}, by 95 % intervals over runs and "
                "evaluations, not adjusted."
            )


def _times(row: pd.Series, names: Names) -> str:
    """Returns how many times as many steps y needs as x, and who they are."""
    bound = "at least " * math.isinf(row["y_step"])
    times = link(f"{bound}{words.times(row['ratio'])}", "speedups", row)
    ends = f"[{words.times(row['ratio_low'])}, {words.times(row['ratio_high'])}]"
    return f"{times} times {ends}: {names.told(row['y'])} against {names.told(row['x'])}"


@item("ahead", "exploratory: at which steps one learner of a contrast succeeds more often than the other")
def ahead(runs: Runs) -> Iterator[dict[str, Any]]:
    """A step counts if the 95 % interval of the difference of the means, not adjusted, lies above 0.

    Only steps at which both are evaluated count. `first_step` and `last_step` are infinite if none does.
    """
    for x, y in runs.declared.contrasts:
        for pair in runs.matched(x, y):
            if x.learner != y.learner:
                yield from (_ahead(*pair), _ahead(*pair[::-1]))


def _ahead(x: Cell, y: Cell) -> dict[str, Any]:
    """Returns when x is ahead of y in a scenario."""
    sizes = [x.n, y.n]
    means = [dict(zip(cell.steps, cell.results("success").mean(axis=0), strict=True)) for cell in (x, y)]
    common = {step: (means[0][step], means[1][step]) for step in x.steps if step in means[1]}
    ahead = [step for step, pair in common.items() if combined([1, -1], pair, sizes)[0] > 0]
    most = max(common, key=lambda step: common[step][0] - common[step][1])
    return {
        **x.place,
        "x": str(x.learner),
        "y": str(y.learner),
        "n": min(sizes),
        "steps_ahead": len(ahead),
        "first_step": float(ahead[0]) if ahead else np.inf,
        "last_step": float(ahead[-1]) if ahead else np.inf,
        "largest_difference": common[most][0] - common[most][1],
        "largest_at": most,
        "largest_x": common[most][0],
        "largest_y": common[most][1],
    }


@item(
    "cost",
    "cost of a run, measured: medians over all runs of CPU seconds, updates, parameters and peak memory",
    {
        **CELL,
        "cpu_time_s": "CPU time (s)",
        "steps_per_cpu_s": "steps per CPU second",
        "updates": "",
        "parameters": "",
        "peak_memory_mb": "peak memory (MB)",
        **EFFORT,
    },
    is_measured=True,
    best="-cpu_time_s",
)
def cost(runs: Runs) -> Iterator[dict[str, Any]]:
    """Medians over all scenarios, and the range of CPU time."""
    for learner, cells in runs.learners.items():
        provenance = [run for cell in cells for run in cell.population.provenance]
        seconds = np.array([run["cpu_time_s"][-1] for run in provenance])
        memory = [run["peak_memory_mb"] for run in provenance if run["peak_memory_mb"] is not None]
        yield {
            **learner._asdict(),
            "runs": len(seconds),
            "cpu_time_s": np.median(seconds),
            "cpu_time_s_min": seconds.min(),
            "cpu_time_s_max": seconds.max(),
            "steps_per_cpu_s": cells[0].population.settings.budget / np.median(seconds),
            "updates": np.median(np.concatenate([cell.population.arrays["updates"] for cell in cells])),
            "parameters": int(cells[0].population.arrays["parameters"][0]),
            "peak_memory_mb": np.median(memory) if memory else np.nan,
            **runs.effort(learner),
        }


@writing(
    "learning", "animation of learning: a table and a net, each the agent of the median seed", "learning.webp"
)
def learning(runs: Runs, directory: Path) -> None:
    """Writes an animation: typical agents of a table and of a net, in every scenario.

    They are the first baseline and the first net that is compared with it, or else the first of each.
    """
    learners = [*runs.declared.baselines, *runs.declared.decisive, *(cell.learner for cell in runs.own)]
    rows: list[list[film.Film]] = []
    for family in ("tabular", "deep"):
        chosen = next((each for each in learners if runs.declared.families[each] == family), None)
        rows.append([_film(runs, cell) for cell in runs if cell.learner == chosen])
    film.write(film.learning([row for row in rows if row]), directory / "learning.webp")


def _film(runs: Runs, cell: Cell) -> film.Film:
    """Returns the film of a cell's typical agent."""
    agent = typical_agent(cell.population)
    learner, seed = runs.names(*cell.learner), cell.population.seeds[agent]
    title = f"{cell.scenario}: {learner}, seed {seed} (median)"
    return film.film_of(title, cell.population, agent)


def _shown(runs: Runs) -> list[Shown]:
    return [Shown(*cell.learner, cell.population) for cell in runs.own]


agents = explorer_item(_shown)
