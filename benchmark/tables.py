"""The two published tables of an experiment: `runs.csv.gz` and `curves.csv.gz`.

`runs` has a row per run of each population, `curves` a row per run and evaluation. `publish` writes
them once, with six significant digits; everything else is computed from what `read` reads back.

Both begin with the columns that name a population: `scenario`; `grid` and `point`, `reading`, or
`trial`; and `learner`. `seed` and, in `runs`, `run`, the beginning of the run's digest, follow.
"""

import csv
import gzip
import io
import json
import sys
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd

from benchmark.experiment import Experiment, Population, load_experiment
from benchmark.folder import (
    MANIFEST,
    REPOSITORY,
    Folder,
    alone,
    committed,
    csv_text,
    digests,
    replaced,
    sealed,
)  # fmt: skip
from benchmark.records import Array, Records, load_records, random_success
from benchmark.specification import RunSpecification, solved
from benchmark.store import Store, evaluated
from envs import ZONES, InputError
from envs.inputs import shortened, whole_number

RUNS: Final = "runs.csv.gz"
CURVES: Final = "curves.csv.gz"
AGENTS: Final = "agents.json.gz"  # what the explorer shows, see `benchmark.explorer`
KEYS: Final = ("scenario", "grid", "point", "reading", "trial", "learner")
# Of one run, these differ between machines or whenever it is repeated.
MEASURED: Final = (
    "cpu_time_s", "cpu_learned_s", "peak_memory_mb", "wall_time_s", "started_at", "commit", "machine",
    "processor", "versions",
)  # fmt: skip
ENDPOINTS: Final = (
    "success", "score", "unbounded_score", "steps", "wrong_pings", "uncomfortable_steps",
)  # fmt: skip
# Success in unseen places: when a run has learned (0) or at the budget (1), by which policy.
_UNSEEN: Final = {
    "unseen_success": (0, ""),
    "unseen_greedy": (0, "greedy"),
    "unseen_stochastic": (0, "stochastic"),
    "unseen_budget": (1, ""),
    "unseen_budget_greedy": (1, "greedy"),
    "unseen_budget_stochastic": (1, "stochastic"),
}
_TRAINING: Final = ("training_wrong_pings", "diverged_at", "updates", "parameters")
_TEXTS: Final = {
    "scenario", "grid", "point", "reading", "learner", "run", "policy", *MEASURED[4:],
}  # fmt: skip
_INTEGERS: Final = {
    "trial",
    "seed",
    "step",
    "budget",
    "training_wrong_pings",
    "updates",
    "parameters",
}
_IDENTITY: Final = ("seed", "run", "policy", "budget")
_MAX_BYTES: Final = 3_000_000  # of a published file
RESULTS: Final = REPOSITORY / "results"
_AGAIN: Final = "run the experiment again, which makes them anew"
_DIGITS: Final = 16  # of a digest
MAX_SEEDS: Final = 1_000_000


class Group(NamedTuple):
    """Runs that become rows of the tables: all of a population, or some."""

    population: Population
    runs: Sequence[RunSpecification]


# From records to tables


def tables(groups: Iterable[Group], store: Store) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Returns the tables `runs` and `curves`, in the order of the groups and their runs.

    Raises an InputError if a record is missing or damaged, or if a learner has no policy that counts.
    """
    runs, curves = [], []
    for group in groups:
        records = load_records(group.runs, store)
        names = group.population.keys
        runs.append(_run_rows(names, records, group.population.learner.declared.policy))
        curves.append(_curve_rows(names, records, group.population.learner.declared.policy))
    return pd.concat(runs, ignore_index=True), pd.concat(curves, ignore_index=True)


def _run_rows(names: Mapping[str, Any], records: Records, policy: str) -> pd.DataFrame:
    columns = {
        **names,
        "seed": records.seeds,
        "run": [run_id(run) for run in records.runs],
        "policy": policy,
        "budget": records.evaluation_steps[-1],
        **(_endpoints(records, policy) if records.run.solved is None else _solved(records, policy)),
        **_trained(records),
        **_measured(records),
    }
    return pd.DataFrame(columns, index=range(len(records.seeds)))


def _curve_rows(names: Mapping[str, Any], records: Records, policy: str) -> pd.DataFrame:
    steps, n = records.evaluation_steps, len(records.seeds)
    at = {"seed": np.repeat(records.seeds, len(steps)), "step": np.tile(steps, n)}
    wrong_pings = records.arrays["disagreements"].ravel()
    success = _over_training("success", records, policy).ravel()
    columns = {**names, **at, "success": success, "training_wrong_pings": wrong_pings}
    if records.run.solved is None:
        columns["score"] = _over_training("score", records, policy).ravel()
    return pd.DataFrame(columns)


def run_id(run: RunSpecification) -> str:
    """Returns the beginning of a run's digest, which stands for it in tables."""
    return run.digest[:_DIGITS]


def _endpoints(records: Records, policy: str) -> dict[str, Any]:
    """Returns what the final policies reach, (N,) each."""
    found: dict[str, Any] = {
        name: _over_training(name, records, policy)[:, -1] for name in ENDPOINTS
    }
    random = random_success(records.model, records.run.horizon)
    return found | {"greedy_success": records.arrays["success"][:, -1], "random_success": random}


def _over_training(name: str, records: Records, policy: str) -> Array:
    """Returns the evaluations of the policy that counts, (N, T)."""
    if records.run.solved is not None:
        return records.arrays[name]
    if not records.arrays[evaluated("success", policy)].shape[1]:
        where = f"{records.run.stream}: algorithms.{records.run.variant}.policy = {policy}"
        raise InputError(f"{where}: its training returns no such policy; accepted: greedy.")
    if name in ("score", "unbounded_score"):
        scores = records.unbounded_scores(policy)
        return scores if name == "unbounded_score" else np.clip(scores, 0.0, 1.0)
    if name == "uncomfortable_steps":
        steps = records.arrays[evaluated("zone_steps", policy)]
        return np.asarray(steps[..., ZONES.index("uncomfortable")])
    return records.arrays[evaluated(name, policy)]


def _solved(records: Records, policy: str) -> dict[str, Any]:
    """Returns success at the end of the curve and in unseen places, NaN without any; (N,) each."""
    found = records.arrays["unseen_success"]  # (N, 2, 2), or without unseen places (N, 0, 2)
    columns: dict[str, Any] = {"success": records.arrays["success"][:, -1]}
    for name, (when, named) in _UNSEEN.items():
        which = int((named or policy) == "stochastic")
        columns[name] = found[:, when, which] if found.size else np.nan
    return columns


def _trained(records: Records) -> dict[str, Any]:
    """Returns what training took, (N,) each."""
    arrays = records.arrays
    diverged_at = np.where(arrays["diverged_at"] < 0, np.inf, arrays["diverged_at"])
    columns = arrays["disagreements"][:, -1], diverged_at, arrays["updates"], arrays["parameters"]
    return dict(zip(_TRAINING, columns, strict=True))


def _measured(records: Records) -> dict[str, Any]:
    """Returns costs, machine and software, (N,) each."""
    made = records.provenance
    columns: dict[str, Any] = {"cpu_time_s": [run["cpu_time_s"][-1] for run in made]}
    if records.run.solved is not None:
        level = float(records.run.solved["success"])
        curves = zip(records.arrays["success"].tolist(), made, strict=True)
        columns["cpu_learned_s"] = [
            [*run["cpu_time_s"], np.inf][solved(curve, records.evaluation_steps, level)[0]]
            for curve, run in curves
        ]
    columns["peak_memory_mb"] = [run["peak_memory_mb"] or np.nan for run in made]
    columns |= {name: [run[name] for run in made] for name in MEASURED[3:-1]}
    return columns | {"versions": [json.dumps(run["versions"], sort_keys=True) for run in made]}


# Files


def publish(
    folder: Path,
    runs: pd.DataFrame,
    curves: pd.DataFrame,
    agents: Callable[[Path], object] = lambda _: None,
) -> bool:
    """Writes the tables into a folder of results, and their digests into its manifest.

    A file stays as it is if only measured columns would change, so repeated runs change nothing.
    `agents` writes the explorer's file, or none. Returns whether all are as in the last commit.
    """
    with alone(folder.parent), replaced(folder) as made:
        for name, frame in ((RUNS, runs), (CURVES, curves)):
            packed = gzip.compress(csv_text(frame).encode(), mtime=0)
            (made / name).write_bytes(packed)
            if len(packed) > _MAX_BYTES:
                text = f"{folder / name} has {len(packed) / 1e6:.1f} MB"
                print(f"{text}; published are files of at most 3 MB.", file=sys.stderr)
        agents(made / AGENTS)
        is_published = all([_keep(path, folder) for path in made.iterdir()])
        manifest = Folder(folder).manifest if (folder / MANIFEST).is_file() else {"files": {}}
        files = manifest["files"] | digests(made)
        (made / MANIFEST).write_text(sealed({**manifest, "files": files}), encoding="utf-8")
    return is_published


def _keep(made: Path, folder: Path) -> bool:
    """Replaces a file by the one in a folder, or the published one, if that has the same content.

    Other versions of zlib make other files. Returns whether the published one has it.
    """
    published, there = committed(folder.name, made.name), folder / made.name
    is_ours = folder.parent.resolve() == RESULTS
    is_same = published is not None and _unmeasured(published) == _unmeasured(made.read_bytes())
    if is_ours and is_same and published is not None:
        made.write_bytes(published)
    elif there.is_file() and _unmeasured(there.read_bytes()) == _unmeasured(made.read_bytes()):
        made.write_bytes(there.read_bytes())
    return is_same


def _unmeasured(packed: bytes) -> list[list[str]] | bytes:
    """Returns the cells of a compressed table but measured ones, or its content if it has none."""
    try:
        content = gzip.decompress(packed)
    except (OSError, EOFError, zlib.error):
        return packed
    names, _, _ = content.partition(b"\n")
    if not {*names.decode(errors="replace").split(",")} & {*MEASURED}:
        return content
    rows = [*csv.reader(io.StringIO(content.decode()))]
    kept = [i for i, name in enumerate(rows[0]) if name not in MEASURED]
    return [[row[i] for i in kept] for row in rows]


def read(folder: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Reads the tables; an InputError says if they are missing, damaged or something else."""
    runs, curves = read_table(folder, RUNS), read_table(folder, CURVES)
    names = [name for name in (*KEYS, "seed") if name in curves]
    if not curves[names].drop_duplicates().reset_index(drop=True).equals(runs[names]):
        raise InputError(f"{folder}: {RUNS} and {CURVES} are about other runs; {_AGAIN}.")
    return runs, curves


def read_table(folder: Path, name: str) -> pd.DataFrame:
    """Reads one of the tables, see `read`."""
    path = folder / name
    if not path.exists():
        raise InputError(f"{path}: there are no runs yet; run the experiment first.")
    packed = Folder(folder).content(name)
    try:
        text = gzip.decompress(packed).decode()
        return _typed(pd.read_csv(io.StringIO(text), dtype=str, keep_default_na=False), name)
    except (OSError, EOFError, zlib.error, ValueError) as error:
        raise InputError(f"{path}: not a table of runs ({error}); {_AGAIN}.") from error


def _typed(texts: pd.DataFrame, name: str) -> pd.DataFrame:
    """Returns a table with the types of its columns; a ValueError if it has others."""
    if [*texts] not in _accepted([key for key in KEYS if key in texts])[name]:
        raise ValueError(f"columns {', '.join(map(str, texts))}")
    frame = texts.copy()
    for column in frame:
        if column in _INTEGERS:
            frame[column] = frame[column].astype("int64")
        elif column not in _TEXTS:
            frame[column] = frame[column].replace("", "nan").astype("float64")
    if frame.empty or not frame["success"].between(0, 1).all():
        raise ValueError("success is not a share")
    return frame


def _accepted(keys: list[str]) -> dict[str, list[list[str]]]:
    """Returns the columns that a table can have: those of usual runs, and of runs until solved."""
    usual = [*ENDPOINTS, "greedy_success", "random_success", *_TRAINING]
    until_solved = ["success", *_UNSEEN, *_TRAINING]
    measured = [name for name in MEASURED if name != "cpu_learned_s"]
    progress = [*keys, "seed", "step", "success", "training_wrong_pings"]
    return {
        RUNS: [
            [*keys, *_IDENTITY, *usual, *measured],
            [*keys, *_IDENTITY, *until_solved, *MEASURED],
        ],
        CURVES: [[*progress, "score"], progress],
    }


def check_declared(
    experiment: Experiment, table: pd.DataFrame, seeds: Sequence[int] | None = None
) -> None:
    """Checks that the published runs are those that an experiment declares, or with other seeds.

    Of a search, the second stage depends on the first, so its runs are checked but not demanded.
    """
    search, declared = experiment.declared.search, set[tuple[object, ...]]()
    possible = set[tuple[object, ...]]()
    for population in experiment.populations:
        names = (*population.keys.values(),)
        declared |= {(*names, run_id(run)) for run in population.runs(population.taken(seeds))}
        if search is not None:
            possible |= {(*names, run_id(run)) for run in population.runs(search.fresh)}
    keys = [*experiment.populations[0].keys, "run"]
    found = {*table[keys].itertuples(index=False, name=None)} if {*keys} <= {*table} else set()
    missing, foreign = len(declared - found), len(found - declared - possible)
    if missing or foreign:
        what = f"{missing} of {len(declared)} declared runs are missing, and {foreign} are others"
        run = f"python -m benchmark run {experiment.argument}"
        raise InputError(
            f"{experiment.name}: of the published runs, {what}; {run} makes them anew."
        )


# Other seeds


def parse_seeds(text: str | None) -> range | None:
    """Returns the seeds that `--seeds` names; None if the option is not given.

    >>> list(parse_seeds("7-9"))
    [7, 8, 9]
    """
    if text is None:
        return None
    first, dash, last = text.partition("-")
    try:
        low = whole_number(first, "--seeds", 0, MAX_SEEDS - 1)
        high = whole_number(last, "--seeds", low, MAX_SEEDS - 1) if dash else low
    except InputError:
        accepted = "A-B with A at most B, as in 0-29, or one seed, as in 7; seeds below"
        found = f"--seeds {shortened(text)}"
        raise InputError(f"{found}: accepted: {accepted} {MAX_SEEDS:,}.") from None
    return range(low, high + 1)


def folder_name(experiment: Experiment, seeds: range | None) -> str:
    """Returns the name of a folder of results; other seeds than the declared ones have their own."""
    if all(each.taken(seeds) == each.seeds for each in experiment.populations) or seeds is None:
        return experiment.name
    ends = dict.fromkeys((seeds[0], seeds[-1]))
    return f"{experiment.name}_seeds_{'-'.join(map(str, ends))}"


# For an analysis of one's own


def runs(experiment: str | Path, results: str | Path | None = None) -> pd.DataFrame:
    """Returns what each run of an experiment reached, as published: a row per run.

    A run that belongs to several conditions has a row in each. The columns `scenario`, `learner`, and
    perhaps `grid` and `point`, `reading` or `trial` say what was run with which `seed`; `success` (a
    probability), `score` (0: random, 1: optimal), `steps` and `wrong_pings` per episode are exact
    results of the `policy` after `budget` steps. `training_wrong_pings` counts those of the whole
    training; `cpu_time_s` is CPU time.

    Args:
      experiment: A name that `python -m benchmark list` shows, or the path of a TOML file.
      results: Folder of results; by default `results` here or, if it lacks them, this project's.

    Raises:
      InputError: There is no such experiment, its runs are not there, or a file is damaged.
    """
    return _published(experiment, results)[0]


def curves(experiment: str | Path, results: str | Path | None = None) -> pd.DataFrame:
    """Returns how each run learned, see `runs`: a row per run and evaluation, after `step` steps."""
    return _published(experiment, results)[1]


def _published(
    experiment: str | Path, results: str | Path | None
) -> tuple[pd.DataFrame, pd.DataFrame]:
    declared = load_experiment(experiment)
    folders = [Path("results"), RESULTS] if results is None else [Path(results)]
    there = [path / declared.name for path in folders if (path / declared.name / RUNS).exists()]
    found = read((there or [folders[0] / declared.name])[0])
    check_declared(declared, found[0])
    return found
