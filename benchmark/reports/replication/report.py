"""What is drawn of a replication: the paper's figure, its claims, and how far learning got."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from benchmark.analysis import intervals
from benchmark.analysis import snapshots as explorer
from benchmark.analysis.population import Population, load_population
from benchmark.drawing import tables
from benchmark.drawing.style import write_figure
from benchmark.execution.store import Store
from benchmark.experiments import DEFAULT_CONDITION, Experiment, specifications
from benchmark.reports.replication import claims, figures
from benchmark.reports.replication import tables as replication_tables
from envs import InputError

_FILES = (
    ("figure.png, .svg", "the paper's figure: maximum Q per step, final Q of the moves, final Q of PING"),
    ("claims", "every claim of the paper, measured, with its 95 % interval over agents and a verdict"),
    ("sensitivity", "value and verdict of every claim under every reading of the paper"),
    ("learning", "exact score of the greedy policy, and the share of optimal agents, over training"),
    ("optimal", "the exact optimum beside what was learned, and the regret"),
    ("optimal_cells.csv", "Q* beside the learned Q of every cell and action, and where policies differ"),
    ("q_values.csv", "final Q over agents of every cell and action"),
    ("max_q.csv", "maximum Q over agents at every recorded step, of the visited cell and of the table"),
    ("agent.csv", "score of the agent of the first seed, at every step of which there is a map"),
    ("agent_*.csv", "what that agent values and does in every cell over training, one file a scenario"),
    ("optimum.csv", "exact optimal values and actions, for the explorer"),
    ("manifest.json", "what made the runs: versions, commit, machine, times, digest"),
)
_OF_CLAIMS = ("claims", "sensitivity")  # only where the paper's three scenarios are run
_SHOWN = {
    "claims": ["claim", "says", "value", "low", "high", "threshold", "verdict"],
    "learning": ["scenario", "step", "score", "score_iqm", "success", "optimal_share"],
}


def write(
    experiment: Experiment, store: Store, directory: Path, seeds: Sequence[int] | None, *, partial: bool
) -> str:
    """Writes every table and figure into a folder.

    Args:
      experiment: As loaded.
      store: Where its records are.
      directory: An empty folder.
      seeds: Other seeds than the declared ones.
      partial: Refused: claims are judged of all runs or not at all.

    Returns:
      What is missing, as a sentence; empty if nothing is.

    Raises:
      InputError: A run is missing.
    """
    if partial:
        raise InputError(f"--partial: {experiment.name} is a replication; accepted: a comparison.")
    arm, declared = next(iter(experiment.algorithms.items()))
    populations: dict[str, dict[str, Population]] = {}
    for reading in experiment.readings:
        cells = [
            load_population(
                specifications(experiment, reading, scenario, arm, declared.observations[0], seeds), store
            )
            for scenario in experiment.scenarios
        ]
        populations[reading] = {population.scenario: population for population in cells}
    agents = len(next(iter(populations[DEFAULT_CONDITION].values())).scores)
    note = "" if agents == declared.seeds else f"Partial: {agents} of the {declared.seeds} agents declared."
    _write(experiment, populations, directory, note)
    return note


def _write(
    experiment: Experiment,
    populations: Mapping[str, Mapping[str, Population]],
    directory: Path,
    note: str,
) -> None:
    """Writes everything but the manifest."""
    default = populations[DEFAULT_CONDITION]
    cells = list(default.values())
    models = {name: population.model for name, population in default.items()}

    values = replication_tables.q_values(cells)
    curves = replication_tables.max_q(cells)
    tables.write_csv(values, directory / "q_values.csv")
    tables.write_csv(curves, directory / "max_q.csv")
    write_figure(figures.replication(curves, values, models), directory / "figure")

    learning = replication_tables.learning(cells)
    shown = tables.with_intervals(learning, ["score", "score_iqm", "success", "optimal_share"])
    tables.write_table(learning, directory / "learning", shown[_SHOWN["learning"]])
    write_figure(figures.learning(learning, models), directory / "learning")

    optimal = replication_tables.optimal(cells)
    by_scenario = optimal.set_index("scenario").T.rename_axis("measure").reset_index()
    tables.write_table(optimal, directory / "optimal", by_scenario)
    optimal_cells = replication_tables.optimal_cells(cells)
    tables.write_csv(optimal_cells, directory / "optimal_cells.csv")
    write_figure(figures.optimal(optimal_cells, models), directory / "optimal")

    arm, declared = next(iter(experiment.algorithms.items()))
    explorer.write([explorer.Shown(arm, declared.observations[0], cell) for cell in cells], directory)

    verdicts = None
    if set(claims.SCENARIOS) <= set(default):
        verdicts = _write_claims(experiment, populations, directory)
    (directory / "README.md").write_text(_readme(experiment, populations, verdicts, note), encoding="utf-8")


def _write_claims(
    experiment: Experiment, populations: Mapping[str, Mapping[str, Population]], directory: Path
) -> pd.DataFrame:
    """Writes claims and sensitivity; returns the claims as readers see them."""
    verdicts = {
        name: claims.judge(populations[name], reading.curve) for name, reading in experiment.readings.items()
    }
    shown = verdicts[DEFAULT_CONDITION][_SHOWN["claims"]]
    tables.write_table(verdicts[DEFAULT_CONDITION], directory / "claims", shown)
    columns = ["claim", "reading", "value", "low", "high", "threshold", "verdict", "parts"]
    sensitivity = pd.concat([frame.assign(reading=name)[columns] for name, frame in verdicts.items()])
    wide = sensitivity.assign(cell=[f"{r.value:.3g}, {r.verdict}" for r in sensitivity.itertuples()])
    wide = wide.pivot(index="claim", columns="reading", values="cell")
    wide = wide.loc[shown["claim"], list(verdicts)].reset_index()
    tables.write_table(sensitivity, directory / "sensitivity", wide)
    write_figure(figures.sensitivity(sensitivity), directory / "sensitivity")
    return shown


def _same_runs(populations: Mapping[str, Population], others: Mapping[str, Population]) -> bool:
    """Returns whether two readings learned the same values in every scenario."""
    return all(
        np.array_equal(populations[name].arrays["q"], others[name].arrays["q"]) for name in populations
    )


def _readme(
    experiment: Experiment,
    populations: Mapping[str, Mapping[str, Population]],
    verdicts: pd.DataFrame | None,
    note: str,
) -> str:
    """Returns the page that says what each file is."""
    default = populations[DEFAULT_CONDITION]
    agents = len(next(iter(default.values())).scores)
    partial = f"\n**{note}**\n" if note else ""
    files_written = [file for file in _FILES if verdicts is not None or file[0] not in _OF_CLAIMS]
    lines = []
    for name, reading in experiment.readings.items():
        line = f"- `{name}`: {reading.question} {reading.answer[0].upper()}{reading.answer[1:]}."
        if name != DEFAULT_CONDITION and _same_runs(populations[name], default):
            line += " (Every agent learns the same values as by default.)"
        lines.append(line)
    readings = "\n".join(lines)
    files = tables.to_markdown(pd.DataFrame(files_written, columns=["file", "what it is"]))
    return f"""# {experiment.name}

{experiment.description}
{partial}
{agents} agents a scenario. Made by `python -m benchmark run {experiment.argument}` and
`python -m benchmark report {experiment.argument}` from the runs in `runs.db`. Files without an ending come
as `.csv` (six digits), `.md` and `.tex` (for reading), and, where they are drawn, as `.png` and `.svg`.

{files}
![The paper's figure, replicated](figure.png)

{_claims_section(verdicts)}## Readings

{readings}

## Words

- *score*: undiscounted return by the grid's own rewards, between the exact random policy (0) and the
  exact optimum (1), both under a limit of {experiment.horizon} steps. It has no lower bound: a greedy
  policy may bump a wall until the limit, and the mean shows it.
- *optimal* (an agent, a policy): it has the score 1, that is, it does as well as can be from the start cell.
  `cells_differing` is the share of all cells in which an agent's greedy action is not an optimal one;
  `optimal.png` shows where these lie.
- *score_iqm*: interquartile mean, over the middle half of the agents. *scenario_return*: with the issuer's
  rewards. *start_value*: discounted value of the start cell, of Q* and of the agents.
- *std*: sample standard deviation over agents. *Intervals*: 95 %, percentile bootstrap over agents,
  {intervals.RESAMPLES} seeded resamples.
- *Q** is that of an agent that knows its state, with no wrong PING so far. Wrong PINGs are hidden from the
  learner, so its values need not tend there; no policy is worth more, but noise can inflate estimates.
"""


def _claims_section(verdicts: pd.DataFrame | None) -> str:
    """Returns what the page says of the paper's claims, nothing where they were not judged."""
    if verdicts is None:
        return ""
    return f"""## Claims of the paper

{tables.to_markdown(verdicts[["claim", "says", "value", "low", "high", "threshold", "verdict"]])}
A claim's value is that of its weakest part; `low` and `high` bound its 95 % interval over agents. A
part passes if its whole interval lies on the right side of the threshold, fails if it lies on the wrong
one, and is undecided otherwise: all pass, `holds`; none passes and one fails, `does not hold`; otherwise,
`holds in part`. How each is measured, all its parts, and why the threshold is where it is: `claims.csv`.

![Verdicts under every reading](sensitivity.png)

"""
