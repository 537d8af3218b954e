"""The two published tables of an experiment: `runs.csv.gz` and `curves.csv.gz`.

`runs` has a row per run of each population, `curves` a row per run and evaluation. `publish` writes
them once, with six significant digits; everything else is computed from what `read` reads back.

Both begin with the columns that name a population: `scenario`; `grid` and `point`, `reading`, or
`trial`; and `learner`. `seed` and, in `runs`, `run`, the beginning of the run's digest, follow.
"""

import gzip
import io
import json
import zlib
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from benchmark import folder as folders
from benchmark.experiment import Experiment, Population, load_experiment
from benchmark.records import Array, Records, load_records, random_success
from benchmark.specification import RunSpecification, solved
from benchmark.store import Store, evaluated
from envs import ZONES, InputError

RUNS = "runs.csv.gz"
CURVES = "curves.csv.gz"
AGENTS = "agents.json.gz"  # what the explorer shows, see `benchmark.page.explorer`
KEYS = ("scenario", "grid", "point", "reading", "trial", "learner")
_COSTS = ("cpu_time_s", "cpu_learned_s", "peak_memory_mb", "wall_time_s")
_MADE = ("started_at", "commit", "machine", "processor", "versions")
# These differ between machines, or whenever a run is repeated.
MEASURED = (*_COSTS, *_MADE)
_NEW = ("unseen_success", "new_way_success")  # where training never was
_TEXTS = ("scenario", "grid", "point", "reading", "learner", "run", "policy", *_MADE)


class Group(NamedTuple):
    """Runs that become rows of the tables: all of a population, or some."""

    population: Population
    runs: Sequence[RunSpecification]


# From records to tables


def tables(groups: Iterable[Group], store: Store) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Returns the tables `runs` and `curves`, in the order of the groups and their runs.

    Raises an InputError if a record is missing or damaged, or if a policy that counts is missing.
    """
    runs, curves = [], []
    for population, own in groups:
        records, policy = load_records(own, store), population.learner.policy
        steps, seeds, arrays = records.evaluation_steps, records.seeds, records.arrays
        found = _over_training(records, policy)
        columns = population.keys | {
            "seed": seeds,
            "run": [run_id(run) for run in own],
            "policy": policy,
            "budget": steps[-1],
            **{name: values[:, -1] for name, values in found.items()},
            "training_wrong_pings": arrays["disagreements"][:, -1],
            "diverged_at": np.where(arrays["diverged_at"] < 0, np.inf, arrays["diverged_at"]),
            "updates": arrays["updates"],
            "parameters": arrays["parameters"],
        }
        if records.run.solved is not None:
            unseen = arrays["unseen_success"][:, :, int(policy == "stochastic")].T  # 0 to 2 rows
            columns |= dict.fromkeys(_NEW, np.nan) | dict(zip(_NEW, unseen, strict=False))
        runs.append(pd.DataFrame(columns).join(_measured(records)))
        progress = {"success": found["success"], "training_wrong_pings": arrays["disagreements"]}
        if "score" in found:
            progress["score"] = found["score"]
        steps_of_all = {"seed": np.repeat(seeds, len(steps)), "step": np.tile(steps, len(seeds))}
        values = {name: curve.ravel() for name, curve in progress.items()}
        curves.append(pd.DataFrame(population.keys | steps_of_all | values))
    return pd.concat(runs, ignore_index=True), pd.concat(curves, ignore_index=True)


def run_id(run: RunSpecification) -> str:
    """Returns the beginning of a run's digest, which stands for it in tables."""
    return run.digest[:16]


def _over_training(records: Records, policy: str) -> dict[str, Array]:
    """Returns what the policies that count reach, (N, T) each."""
    arrays, run = records.arrays, records.run
    if run.solved is not None:
        return {"success": arrays["success"]}
    success = arrays[evaluated("success", policy)]
    if not success.shape[1]:
        where = f"{run.stream}: algorithms.{run.variant}.policy = {policy}"
        raise InputError(f"{where}: its training returns no such policy; accepted: greedy.")
    scores = records.unbounded_scores(policy)
    zone_steps = arrays[evaluated("zone_steps", policy)]
    random = random_success(records.model, run.horizon)
    return {
        "success": success,
        "score": np.clip(scores, 0.0, 1.0),
        "unbounded_score": scores,
        "steps": arrays[evaluated("steps", policy)],
        "wrong_pings": arrays[evaluated("wrong_pings", policy)],
        "uncomfortable_steps": zone_steps[..., ZONES.index("uncomfortable")],
        "greedy_success": arrays["success"],
        "random_success": np.full_like(success, random),
    }


def _measured(records: Records) -> pd.DataFrame:
    """Returns costs, machine and software, a row per run."""
    made = pd.DataFrame([*records.provenance])
    made["versions"] = [json.dumps(each, sort_keys=True) for each in made["versions"]]
    times = made["cpu_time_s"]
    made["cpu_time_s"] = times.str[-1]
    if records.run.solved is not None:
        level, steps = records.run.solved["success"], records.evaluation_steps
        learned = [solved(curve, steps, level)[0] for curve in records.arrays["success"].tolist()]
        made["cpu_learned_s"] = [[*own, np.inf][i] for own, i in zip(times, learned, strict=True)]
    return made[[name for name in MEASURED if name in made]]


# Files


def publish(
    folder: Path,
    runs: pd.DataFrame,
    curves: pd.DataFrame,
    agents: Callable[[Path], object] = lambda _: None,
) -> None:
    """Writes the tables into a folder of results, and their digests into its manifest.

    A file stays as it is published, or as it is there, if only measured columns would change: so
    repeated runs change nothing. `agents` writes the explorer's file, or none.
    """
    with folders.alone(folder.parent), folders.replaced(folder) as made:
        for name, frame in ((RUNS, runs), (CURVES, curves)):
            (made / name).write_bytes(gzip.compress(folders.csv_text(frame).encode(), mtime=0))
        agents(made / AGENTS)
        for path in made.iterdir():
            content, there = path.read_bytes(), folder / path.name
            known = [folders.committed(folder.name, path.name)]
            known += [there.read_bytes()] if there.is_file() else []
            # Other versions of zlib make other bytes of the same content.
            same = (each for each in known if each and unmeasured(each) == unmeasured(content))
            path.write_bytes(next(same, content))
        manifest = dict[str, Any]()
        with suppress(InputError):  # it is missing, or damaged and made anew
            manifest = folders.Folder(folder).manifest
        folders.write_manifest(made, manifest)


def unmeasured(packed: bytes) -> str | bytes:
    """Returns the content of a compressed file, without measured columns if it is a table."""
    try:
        content = folders.unpacked(packed)
    except (OSError, EOFError, ValueError, zlib.error):
        return packed
    if not content.startswith(b"scenario,"):
        return content
    table = pd.read_csv(io.BytesIO(content), dtype=str, keep_default_na=False)
    return table.drop(columns=[*MEASURED], errors="ignore").to_csv()


def read(folder: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Reads the tables; an InputError says if they are missing or damaged."""
    return read_table(folder, RUNS), read_table(folder, CURVES)


def read_table(folder: Path, name: str) -> pd.DataFrame:
    """Reads one of the tables, see `read`."""
    path = folder / name
    if not path.exists():
        raise InputError(f"{path}: there are no runs yet; run the experiment first.")
    packed = folders.Folder(folder).content(name)
    with folders.damaged(path):
        folders.check_size(content := folders.unpacked(packed))
        texts, file = dict.fromkeys(_TEXTS, str), io.BytesIO(content)
        frame = pd.read_csv(file, dtype=texts, keep_default_na=False, na_values=["", "nan"])
        if not frame["success"].between(0, 1).all():
            raise ValueError("success is not a probability")
        return frame.fillna(dict.fromkeys(_TEXTS, ""))


def check_declared(
    experiment: Experiment, table: pd.DataFrame, seeds: Sequence[int] | None = None
) -> None:
    """Checks that the published runs are those that an experiment declares, or with other seeds.

    Of a search, the second stage depends on the first, so none of its runs is demanded.
    """
    declared = {
        (*population.keys.values(), run.seed, run_id(run))
        for population in experiment.populations
        for run in population.runs(population.taken(seeds))
    }
    keys = [*experiment.populations[0].keys, "seed", "run"]
    found = set[tuple[Any, ...]]()
    if {*keys} <= {*table}:
        found = {*table[keys].itertuples(index=False, name=None)}
    search = experiment.declared.search
    others = {row for row in found - declared if search is None or row[-2] not in search.fresh}
    missing = len(declared - found)
    if others or missing:
        there = f"{len(others)} others are there"
        what = f"in its tables, {missing} of {len(declared)} declared runs are missing, {there}"
        run = f"python -m benchmark run {experiment.argument}"
        raise InputError(f"{experiment.name}: {what}; '{run}' publishes those declared.")


# For an analysis of one's own


def runs(experiment: str | Path, results: str | Path | None = None) -> pd.DataFrame:
    """Returns what each run of an experiment reached, as published: a row per run.

    A run that belongs to several conditions has a row in each. The columns `scenario`, `learner`,
    and perhaps `grid` and `point`, `reading` or `trial` say what was run with which `seed`;
    `success` (a probability), `score` (0: random or giving up at once, 1: optimal), `steps` and
    `wrong_pings` per episode are exact results of the `policy` after `budget` steps.
    `training_wrong_pings` counts those of the whole training; `cpu_time_s` is CPU time.

    Args:
      experiment: A name that `python -m benchmark list` shows, or the path of a TOML file.
      results: Folder of results; by default `results` here or, if it lacks them, this project's.

    Raises:
      InputError: There is no such experiment, its runs are not there, or a file is damaged.
    """
    return published(experiment, results)[0]


def curves(experiment: str | Path, results: str | Path | None = None) -> pd.DataFrame:
    """Returns how each run learned, see `runs`: a row per run and evaluation at `step`."""
    return published(experiment, results)[1]


def published(
    experiment: str | Path, results: str | Path | None
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Returns both tables, see `runs`."""
    declared = load_experiment(experiment)
    folder = Path(results or "results") / declared.name
    if results is None and not (folder / RUNS).exists():
        folder = folders.REPOSITORY / "results" / declared.name
    found = read(folder)
    check_declared(declared, found[0])
    return found
