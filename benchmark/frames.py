"""Runs as data frames, for an analysis of your own: `from benchmark import curves, runs`."""

from contextlib import suppress
from pathlib import Path
from typing import Final

from envs import InputError
from envs.packages import needed_by

with needed_by("benchmark.frames"):
    import pandas as pd

    from benchmark.analysis.frames import Group, tables
    from benchmark.execution.store import NoRunsError, Store
    from benchmark.experiments import Experiment, all_specifications, load_experiment
    from benchmark.folder import SCORES, Folder, with_titles
    from benchmark.publish.manifest import digest_of
    from benchmark.studies import report_of

_PUBLISHED: Final = ((SCORES, "runs.csv"), ("curves.csv", "learning.csv"))  # runs, curves
_RESULTS: Final = Path(__file__).parents[1] / "results"
Where = str | Path


def runs(experiment: Where, results: Where | None = None, source: str | None = None) -> pd.DataFrame:
    """Returns what each run of an experiment reached: a row per run, and per condition that shares it.

    Columns are `scenario`, `condition` and its axes, `learner` (`variant` and `observation`), `seed`, and
    exact results of the evaluated `policy` after `budget` steps: `success` (a probability), `score` (0:
    random, 1: optimal), and per episode `steps` and `wrong_pings`; `every_cell_...`: the same, averaged over
    starts in every cell. `training_wrong_pings` counts those of the whole training; `cpu_time_s` is CPU time.

    Args:
      experiment: A name that `python -m benchmark list` shows, or the path of a TOML file.
      results: Folder of results; by default `results` here or, if it lacks them, that of this project.
      source: "stored" (so far), or "published": fewer columns, and of a map `steps` until learned and
        `disagreements`, the wrong PINGs. By default all runs, stored or else published: see `attrs`.

    Raises:
      InputError: There is no such experiment, its runs are not there, or a file is damaged.
    """
    return _read(load_experiment(experiment), results, source, 0)


def curves(experiment: Where, results: Where | None = None, source: str | None = None) -> pd.DataFrame:
    """Returns how each run learned, see `runs`: a row per run and evaluation, after `step` steps.

    Only means over runs are published, with 95 % intervals (`_low`, `_high`): these are returned with
    `source="published"`, and never by default.
    """
    return _read(load_experiment(experiment), results, source, 1)


def _read(experiment: Experiment, results: Where | None, source: str | None, which: int) -> pd.DataFrame:
    readers = {"stored": _stored, "published": _published}
    if source not in (None, *readers):
        raise InputError(f"source = {source!r}: accepted: {', '.join(readers)}.")
    reasons = []
    folders = [Path("results"), _RESULTS] if results is None else [Path(results)]
    for folder in dict.fromkeys(path.resolve() for path in folders):
        for kind in [source] if source else [*readers][: 2 - which]:
            found = readers[kind](experiment, folder, which, source is None)
            if not isinstance(found, str):
                found.attrs["source"] = f"{kind} in {folder}"
                return found
            reasons.append(found)
    advice = ', or take source="published" for means' * (which == 1 and source is None)
    raise InputError(f"{experiment.name}: {'; '.join(reasons)}; run the experiment first{advice}.")


def _stored(experiment: Experiment, results: Path, which: int, is_whole: bool) -> pd.DataFrame | str:
    """Returns a table of stored runs, or a text if all are missing, or some although it must be whole."""
    path, n, n_all = results / "runs.db", 0, 0
    with suppress(NoRunsError), Store(path, read_only=True) as store:
        ended = store.ended()
        declared = [group for groups in report_of(experiment).stages(store) for group in groups]
        runs = ([run for run in group.runs if run.digest in ended] for group in declared)
        there = [Group(group.population, own) for group, own in zip(declared, runs, strict=True)]
        n, n_all = (sum(len(group.runs) for group in groups) for groups in (there, declared))
        if n == n_all or (n and not is_whole):
            return tables([group for group in there if group.runs], store)[which]
    return f"{path} has {n:,} of {n_all:,} runs" if n_all else f"{path} has no runs"


def _published(experiment: Experiment, results: Path, which: int, is_whole: bool) -> pd.DataFrame | str:
    """Returns a published table, or a text if there is none, or one of other runs if it must be whole."""
    folder = Folder(results / experiment.name)
    file = next((name for name in _PUBLISHED[which] if name in folder), None)
    if file is None:
        return f"{folder.path} has no {' or '.join(_PUBLISHED[which])}"
    with folder.reading():
        # The runs of later stages depend on earlier ones.
        is_known = is_whole and not report_of(experiment).study.stages
        if is_known and folder.manifest["digest"] != digest_of(all_specifications(experiment)):
            return f"{folder.path / file} is of other runs than the experiment declares now"
        return with_titles(folder.frame(file), {})
