"""What is drawn of a comparison: scores, what they cost, and the maps of tables and nets side by side."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from benchmark.analysis import snapshots as explorer
from benchmark.analysis.intervals import RESAMPLES
from benchmark.analysis.population import GOOD_SCORE
from benchmark.drawing import film as animation
from benchmark.drawing import tables
from benchmark.drawing.style import write_figure
from benchmark.execution.store import Store
from benchmark.experiments import Experiment
from benchmark.reports.comparison import figures as figures_comparison
from benchmark.reports.comparison import findings
from benchmark.reports.comparison import tables as comparison
from benchmark.reports.comparison.tables import Grid, Learner

_FILES = (
    ("scores", "every run at the end of training, by its greedy and its stochastic policy"),
    ("summary", "each scenario and learner: runs, score, success, steps, wrong PINGs"),
    ("aggregate", "over all scenarios: interquartile mean, median, mean and optimality gap, by rliable"),
    ("improvement", "probability that a run of one learner outscores one of another, each pair"),
    ("profile", "performance profiles: the share of runs whose score is above a number"),
    ("curves", "score, success and disagreements over training, against environment steps"),
    ("curves_cpu", "score over training against seconds of one CPU"),
    ("disagreements.png, .svg", "the issuer's disagreements per 1,000 steps while agents learn"),
    ("threshold", f"when, and in how many runs, the greedy policy scores {GOOD_SCORE:g}"),
    ("region", "how well the cells where an agent values PING match the target region"),
    ("cost", "what a run costs: CPU seconds, updates, parameters, peak memory of the process it runs in"),
    ("maps", "final values of every cell and action; the figure: Q of PING, without SB3's own settings"),
    ("maps_moves.png, .svg", "the same of the moves"),
    ("maps_probability.png, .svg", "probability of PING where the policy is stochastic"),
    ("learning.webp", "learning as a moving picture: the agents of the first seed, table and net"),
    ("findings.csv", "the sentences above; every number in them is a link to the rows it comes from"),
    ("agent.csv", "score of the agent of the first seed, at every step of which there is a map"),
    ("agent_*.csv", "what that agent values and does in every cell over training, one file a scenario"),
    ("optimum.csv", "exact optimal values and actions, by discount"),
    ("manifest.json", "what made the runs: versions, commit, machine, times, digest"),
)
_MEASURED_TIMES = ("curves_cpu", "cost")
_KEYS = ["scenario", "algorithm", "observation"]


def write(
    experiment: Experiment, store: Store, directory: Path, seeds: Sequence[int] | None, *, partial: bool
) -> str:
    """Writes every table and figure into a folder.

    Args:
      experiment: As loaded.
      store: Where its records are.
      directory: An empty folder.
      seeds: Other seeds than the declared ones.
      partial: Whether to draw what is there where runs are missing, marked as partial.

    Returns:
      What is missing, as a sentence; empty if nothing is.

    Raises:
      InputError: A run is missing.
    """
    grid = comparison.load_grid(experiment, store, seeds, partial=partial)
    frames = {
        "scores": comparison.scores(grid),
        "summary": comparison.summary(grid),
        "aggregate": comparison.aggregate(grid),
        "improvement": comparison.improvement(grid),
        "profile": comparison.profile(grid),
        "curves": comparison.curves(grid),
        "threshold": comparison.threshold(grid),
        "region": comparison.region(grid),
        "cost": comparison.cost(grid),
        "maps": comparison.maps(grid),
    }
    frames["curves_cpu"] = comparison.curves_cpu(grid, frames["curves"])
    for name, frame in frames.items():
        tables.write_table(frame, directory / name, _shown(name, frame), note=_note(grid))
    explorer.write([explorer.Shown(*learner, population) for learner, _, population in grid.cells], directory)
    _film(grid, directory)
    sentences = findings.sentences(grid, frames)
    tables.write_csv(
        pd.DataFrame({"finding": range(len(sentences)), "text": sentences}), directory / "findings.csv"
    )
    drawn = _draw(experiment, grid, frames, directory)
    page = _readme(experiment, grid, frames, drawn, [tables.plain(one) for one in sentences])
    (directory / "README.md").write_text(page, encoding="utf-8")
    return _note(grid)


def _note(grid: Grid) -> str:
    """Returns what marks tables and figures as partial; empty if they are not."""
    return f"Partial: {grid.missing}." if grid.missing else ""


def _shown(name: str, frame: pd.DataFrame) -> pd.DataFrame:
    """Returns what readers see of a table."""
    match name:
        case "scores":
            return (
                frame[[*_KEYS, "seed", "score", "success", "steps", "wrong_pings", "every_cell_score"]]
                if ("every_cell_score" in frame)
                else frame[[*_KEYS, "seed", "score", "success", "steps", "wrong_pings"]]
            )
        case "summary":
            columns = ["score_iqm", "score_mean", "success", "steps"]
            columns += [c for c in ("every_cell_score_iqm", "stochastic_score_iqm") if c in frame]
            return tables.with_intervals(frame, columns)[[*_KEYS, "n", "diverged", *columns]]
        case "aggregate":
            shown = tables.with_intervals(
                frame.rename(columns={"low": "value_low", "high": "value_high"}), ["value"]
            )
            keys = ["algorithm", "observation", "policy", "evaluated_from"]
            wide = shown.pivot(index=keys, columns="metric", values="value")[list(comparison.METRICS)]
            return wide.loc[list(dict.fromkeys(map(tuple, shown[keys].to_numpy())))].reset_index()
        case "improvement":
            names = {"probability": "p", "low": "p_low", "high": "p_high"}
            shown = tables.with_intervals(frame.rename(columns=names), ["p"])
            return shown[["x", "y", "p"]]
        case "curves" | "curves_cpu":
            last = frame["step"].max()
            tenth = frame[frame["step"] % (last / 10) == 0]
            columns = ["score_iqm"] + (["success", "disagreements"] if name == "curves" else [])
            seconds = ["cpu_time_s"] if name == "curves_cpu" else []
            return tables.with_intervals(tenth, columns)[[*_KEYS, "step", *seconds, *columns]]
        case "threshold":
            columns = ["reached_share", "stays_share"]
            steps = ["reached_step_median", "stays_step_median"]
            return tables.with_intervals(frame, columns)[[*_KEYS, "n", *columns, *steps]]
        case "region":
            columns = ["precision", "recall", "overlap"]
            return tables.with_intervals(frame, columns)[[*_KEYS, "n", "cells_marked", *columns]]
        case "profile":
            return frame[(frame["score"] * 10 % 1).abs() < 1e-9]
        case "maps":
            return (
                frame[frame["action"] == "PING"]
                .groupby(_KEYS, sort=False, as_index=False)[["value", "marked"]]
                .max()
            )
    return frame


def _draw(
    experiment: Experiment, grid: Grid, frames: Mapping[str, pd.DataFrame], directory: Path
) -> set[str]:
    """Writes every figure there is something for; returns their names."""
    panels = _panels(experiment, grid)
    models = {
        scenario: population.model for scenario, population in next(iter(grid.learners.values())).items()
    }
    kinds = (
        frames["maps"].drop_duplicates(["algorithm", "observation"]).set_index(["algorithm", "observation"])
    )
    # SB3's own DQN learns nothing to be looked at: its numbers are in the table.
    valued = [one for one in grid.learners if kinds["kind"][one] == "q" and not one.is_default]
    likely = [one for one in grid.learners if kinds["kind"][one] == "probability"]
    f = figures_comparison
    drawn = {
        "curves": f.curves(frames["curves"], panels, "step", "environment step"),
        "curves_cpu": f.curves(frames["curves_cpu"], panels, "cpu_time_s", "CPU time (s)"),
        "disagreements": f.disagreements(frames["curves"], panels),
        "aggregate": f.aggregate(frames["aggregate"]),
        "profile": f.profile(frames["profile"], panels),
        "improvement": f.improvement(frames["improvement"]),
        "threshold": f.threshold(frames["threshold"]),
        "region": f.region(frames["region"]),
    }
    if valued:
        label = "mean final Q of PING"
        drawn["maps"] = f.maps(frames["maps"], models, valued, "PING", label)
        label = "mean final Q of the moves"
        drawn["maps_moves"] = f.maps(frames["maps"], models, valued, "moves", label)
    if likely:
        label = "mean final probability of PING"
        drawn["maps_probability"] = f.maps(frames["maps"], models, likely, "PING", label, (0.0, 1.0))
    for name, figure in drawn.items():
        if grid.missing:
            figure.suptitle("PARTIAL: runs are missing", color="firebrick")
        write_figure(figure, directory / name)
    return set(drawn)


def _film(grid: Grid, directory: Path) -> None:
    """Writes the moving picture of learning: the first table and the first net, in every scenario."""
    kinds = {learner: next(iter(own.values())).specification for learner, own in grid.learners.items()}
    tables = [learner for learner, own in kinds.items() if own["algorithm"] == "q_learning"]
    nets = [learner for learner in kinds if learner not in tables]
    films = [
        [animation.film_of(f"{scenario}: {learner}", own) for scenario, own in grid.learners[learner].items()]
        for learner in [*tables[:1], *nets[:1]]
    ]
    animation.write(animation.learning(films), directory / "learning.webp")


def _panels(experiment: Experiment, grid: Grid) -> dict[str, list[Learner]]:
    """Returns who is drawn together: each group of arms, with the arms of none."""
    everywhere = [learner for learner in grid.learners if not experiment.algorithms[learner.algorithm].group]
    panels: dict[str, list[Learner]] = {}
    for learner in grid.learners:
        group = experiment.algorithms[learner.algorithm].group
        if group:
            panels.setdefault(group, [*everywhere]).append(learner)
    return panels or {"all": everywhere}


def _readme(
    experiment: Experiment,
    grid: Grid,
    frames: Mapping[str, pd.DataFrame],
    drawn: set[str],
    found: Sequence[str],
) -> str:
    """Returns the page that says what was found and what each file is."""
    figures_alone = ".png, .svg"
    written = [
        row
        for row in _FILES
        if not row[0].endswith(figures_alone) or row[0].removesuffix(figures_alone) in drawn
    ]
    files = tables.to_markdown(pd.DataFrame(written, columns=["file", "what it is"]))
    nothing = "Nothing: it takes a table and a net, each with two runs of every scenario."
    sentences = "\n".join(f"{i}. {text}" for i, text in enumerate(found[1:], 1))
    headline = f"**{found[0]}**\n\n" if found else ""
    partial = f"\n**{_note(grid)}**\n" if grid.missing else ""
    aggregate = _shown("aggregate", frames["aggregate"])
    greedy = aggregate[(aggregate["policy"] == "greedy") & (aggregate["evaluated_from"] == "start")]
    diverged = int(frames["summary"]["diverged"].sum())
    told = f"{diverged} runs diverged" if diverged else "No run diverged"
    call = experiment.argument
    note = f"\n{experiment.note.strip()}\n" if experiment.note else ""
    timed = " and ".join(f"`{one}`" for one in _MEASURED_TIMES)
    return f"""# {experiment.name}

{experiment.description}
{partial}{note}
## What was found

{headline}Scores are 0 for the random policy and 1 for the optimal one; brackets hold 95 % intervals. P is the
probability that a run of the first scores higher than one of the second, in the same scenario, by however
little. All is about greedy policies after training, if nothing else is said.

{sentences or nothing}

![Learning curves](curves.png)

## Over all scenarios

{tables.to_markdown(greedy.drop(columns=["policy", "evaluated_from"]))}
![Aggregates](aggregate.png)

## Files

Made by `python -m benchmark run {call}` and `python -m benchmark report {call}` from the runs in
`runs.db`. Files without an ending come as `.csv` (six digits; all columns), `.md` and `.tex` (for reading),
and, where they are drawn, as `.png` and `.svg`. {timed}, `manifest.json` and a sentence above hold
measured times and memory. All else is the same, to the last digit, however often it is made with the same
versions on the same kind of processor; on another kind sums are rounded otherwise, and nets learn otherwise.

{files}
## Words

- *learner*: an algorithm with its settings and the form of observation that it learns from. Settings are in
  the experiment's TOML file; `_default` means Stable-Baselines3's own.
- *score*: undiscounted return by the grid's own rewards, between the exact random policy (0) and the exact
  optimum (1), both under a limit of {experiment.horizon} steps. It has no lower bound: a greedy policy that
  bumps a wall until the limit is far below the random one, and means show it. Policies are evaluated exactly,
  without an episode.
- *greedy, stochastic*: DQN and the table act by their best action; PPO is judged by its likeliest action
  first, and by its own probabilities beside (`stochastic_`).
- *every_cell*: episodes start in any cell but the issuer's, all alike, in place of the start cell.
- *values PING*: Q > 0; where the policy is stochastic, PING is the likeliest action.
- *iqm*: interquartile mean, over the middle half of the runs. *median*: of the scenarios' mean
  scores. *optimality gap*: by how much runs fall short
  of a score of 1, on average. *Intervals*: 95 %, percentile bootstrap over runs, stratified by scenario where
  these are taken together, {RESAMPLES} seeded resamples (of profiles, {RESAMPLES // 2}).
  Of the shares in `threshold` they are exact binomial ones. They are not corrected for the number of
  comparisons, and of ten runs bootstrap intervals are rather too narrow: where all agree they have no width.
- *inf*: half of the runs or more never got there.
- *diverged*: a net whose values are no longer finite counts as the random policy from then on. {told}.
"""
