"""Draws an experiment's folder of results from the store: which tables and figures there are."""

import hashlib
import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from benchmark import aggregate, claims, figures, tables
from benchmark.experiment import (
    DEFAULT_READING,
    Experiment,
    all_specifications,
    specifications,
)
from benchmark.store import Store
from envs import InputError

_FILES = (
    ("figure.png, .svg", "the paper's figure: maximum Q per step, final Q of the moves, final Q of PING"),
    ("claims", "every claim of the paper, measured, with its 95 % interval over agents and a verdict"),
    ("sensitivity", "value and verdict of every claim under every reading of the paper"),
    ("learning", "exact score of the greedy policy, and the share of optimal agents, over training"),
    ("optimal", "the exact optimum beside what was learned, and the regret"),
    ("optimal_cells.csv", "Q* beside the learned Q of every cell and action, and where policies differ"),
    ("q_values.csv", "final Q over agents of every cell and action"),
    ("max_q.csv", "maximum Q over agents at every tenth step, of the visited cell and of the table"),
    ("manifest.json", "what made the runs: versions, commit, machine, times, digest"),
)
_SHOWN = {
    "claims": ["claim", "says", "value", "low", "high", "threshold", "verdict", "parts"],
    "learning": ["scenario", "step", "score", "score_iqm", "success", "optimal_share"],
}


def draw(experiment: Experiment, store: Store, directory: Path, seeds: Sequence[int] | None = None) -> None:
    """Writes every table and figure of the experiment.

    Files are made aside and moved when all are there, so a failure leaves the folder as it was.

    Args:
      experiment: As loaded.
      store: Where its records are.
      directory: The folder to write.
      seeds: Other seeds than the declared ones.

    Raises:
      InputError: A run is missing, or the folder cannot be written.
    """
    arm = next(iter(experiment.algorithms))
    populations = {
        reading: {
            scenario: aggregate.load_population(
                specifications(experiment, reading, scenario, arm, seeds), store
            )
            for scenario in experiment.scenarios
        }
        for reading in experiment.readings
    }
    try:
        directory.mkdir(parents=True, exist_ok=True)
        aside = Path(tempfile.mkdtemp(prefix=".drawing-", dir=directory))
    except OSError as error:
        raise InputError(
            f"{directory}: cannot be written: {error.strerror}; choose another folder with --results."
        ) from error
    try:
        _write(experiment, populations, aside)
        manifest = _manifest(experiment, store, seeds)
        (aside / "manifest.json").write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
        for path in aside.iterdir():
            path.chmod(0o644)
            path.replace(directory / path.name)
    finally:
        shutil.rmtree(aside)


def _write(
    experiment: Experiment, populations: Mapping[str, Mapping[str, aggregate.Population]], directory: Path
) -> None:
    """Writes everything but the manifest."""
    default = populations[DEFAULT_READING]
    cells = list(default.values())
    models = {name: population.model for name, population in default.items()}

    values = aggregate.q_values(cells)
    curves = aggregate.max_q(cells)
    tables.write_csv(values, directory / "q_values.csv")
    tables.write_csv(curves, directory / "max_q.csv")
    figures.write_figure(figures.replication(curves, values, models), directory / "figure")

    learning = aggregate.learning(cells)
    tables.write_table(learning, directory / "learning", learning[_SHOWN["learning"]])
    figures.write_figure(figures.learning(learning, models), directory / "learning")

    optimal = aggregate.optimal(cells)
    by_scenario = optimal.set_index("scenario").T.rename_axis("measure").reset_index()
    tables.write_table(optimal, directory / "optimal", by_scenario)
    optimal_cells = aggregate.optimal_cells(cells)
    tables.write_csv(optimal_cells, directory / "optimal_cells.csv")
    figures.write_figure(figures.optimal(optimal_cells, models), directory / "optimal")

    verdicts = {
        name: claims.judge(populations[name], reading.curve) for name, reading in experiment.readings.items()
    }
    shown = verdicts[DEFAULT_READING][_SHOWN["claims"]]
    tables.write_table(verdicts[DEFAULT_READING], directory / "claims", shown)
    sensitivity = pd.concat(
        [frame[["claim", "value", "low", "high", "threshold", "verdict", "parts"]].assign(reading=name)
         for name, frame in verdicts.items()]
    )  # fmt: skip
    sensitivity.insert(1, "reading", sensitivity.pop("reading"))
    wide = sensitivity.assign(cell=[f"{r.value:.3g}, {r.verdict}" for r in sensitivity.itertuples()])
    wide = wide.pivot(index="claim", columns="reading", values="cell")
    wide = wide.loc[shown["claim"], list(verdicts)].reset_index()
    tables.write_table(sensitivity, directory / "sensitivity", wide)
    figures.write_figure(figures.sensitivity(sensitivity), directory / "sensitivity")
    (directory / "README.md").write_text(_readme(experiment, shown), encoding="utf-8")


def _readme(experiment: Experiment, verdicts: pd.DataFrame) -> str:
    """Returns the page that says what each file is."""
    readings = "\n".join(
        f"- `{name}`: {reading.question} {reading.answer[0].upper()}{reading.answer[1:]}."
        for name, reading in experiment.readings.items()
    )
    files = tables.to_markdown(pd.DataFrame(_FILES, columns=["file", "what it is"]))
    return f"""# {experiment.name}

{experiment.description}

Made by `python -m benchmark run {experiment.name}` and `python -m benchmark report {experiment.name}`
from the runs in `runs.db`. Files without an ending come as `.csv` (all digits), `.md` and `.tex`
(for reading), and, where they are drawn, as `.png` and `.svg`.

{files}
![The paper's figure, replicated](figure.png)

## Claims of the paper

{tables.to_markdown(verdicts[["claim", "says", "value", "low", "high", "threshold", "verdict"]])}
A claim's value is that of its weakest part; `low` and `high` bound its 95 % interval over agents. A
part passes if its whole interval lies on the right side of the threshold and fails if its value lies
on the wrong one: all pass, `holds`; all fail, `does not hold`; otherwise, `holds in part`. How each is
measured, all its parts, and why the threshold is where it is: `claims.csv`.

![Verdicts under every reading](sensitivity.png)

## Readings

{readings}

## Words

- *score*: undiscounted return by the grid's own rewards, between the exact random policy (0) and the
  exact optimum (1), both under a limit of {experiment.horizon} steps. It has no lower bound: a greedy
  policy may bump a wall until the limit, and the mean shows it.
- *std*: sample standard deviation over agents. *Intervals*: 95 %, percentile bootstrap over agents,
  {aggregate.RESAMPLES} seeded resamples.
- *wrong PINGs* are hidden from the agent, so Q* (of an agent that knows its state, with none so far)
  is an upper mark, not what Q-learning tends to.
"""


def _manifest(experiment: Experiment, store: Store, seeds: Sequence[int] | None) -> dict[str, object]:
    """Returns what made the runs, from their records alone: drawing again gives the same."""
    runs = all_specifications(experiment, seeds)
    records = store.get([run.digest for run in runs], arrays=False)
    provenance = [record.provenance for record in records]

    def every(key: str) -> list[object]:
        return [json.loads(text) for text in sorted({json.dumps(p[key], sort_keys=True) for p in provenance})]

    return {
        "experiment": experiment.name,
        "runs": len(runs),
        "digest": _digest([run.digest for run in runs]),
        "commits": every("commit"),
        "machines": every("machine"),
        "versions": every("versions"),
        "first_started_at": min(p["started_at"] for p in provenance),
        "last_started_at": max(p["started_at"] for p in provenance),
        "training_time_s": round(sum(p["wall_time_s"] for p in provenance), 3),
    }


def _digest(digests: Sequence[str]) -> str:
    """Returns the identity of a set of runs."""
    return hashlib.sha256("".join(sorted(digests)).encode()).hexdigest()
