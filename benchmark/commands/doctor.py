"""Says which packages are missing, what machine and store have, and what an experiment costs here."""

import argparse
import os
import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from itertools import chain
from pathlib import Path
from typing import Final

from rich.filesize import decimal

from benchmark.commands import parse_jobs
from benchmark.execution.driver import pending
from benchmark.execution.machine import free_memory, usable_cores
from benchmark.execution.progress import estimate
from benchmark.execution.provenance import versions
from benchmark.execution.store import REPAIR_ADVICE, NoRunsError, Store
from benchmark.experiments import Experiment, all_specifications, load_experiment
from benchmark.studies import report_of
from envs import InputError
from envs.packages import extras

_USES: Final = {  # by extra
    "reproduce": "all commands",
    "deep": "nets, speed and run --log",
    "cluster": "run --cluster",
    "render": "windows of environments",
}
_JOB_MEMORY: Final = 500_000_000  # bytes that a job with nets takes, about
_MIN_DISK: Final = 1_000_000_000  # bytes


Finding = tuple[str, str, str]  # ok, note or problem; its subject; and a text, which says what to do about it


def _finding(subject: str, text: str, advice: str = "", state: str = "note") -> Finding:
    """Returns a finding that is "ok" without advice, else in the given state."""
    return (state, subject, f"{text}; {advice}") if advice else ("ok", subject, text)


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code: 0 if there is no problem, else 1."""
    options.jobs = parse_jobs(options.jobs)
    experiment = load_experiment(options.experiment) if options.experiment is not None else None
    findings = chain(_packages(), _machine(options.results), _store(options.results / "runs.db"))
    code = 0
    for state, subject, text in chain(findings, _experiment(experiment, options) if experiment else ()):
        print(f"{state:8}{subject:10} {text}")
        code |= state == "problem"
    return code


def _packages() -> Iterator[Finding]:
    for extra, use in _USES.items():
        missing = [package for package in extras()[extra] if not _is_installed(package)]
        found = f"missing: {', '.join(missing)}" if missing else "installed"
        text = f"{extra}, for {use}: {found}"
        yield _finding("packages", text, f"in a checkout, make .venv/.{extra} installs them" * bool(missing))


def _is_installed(package: str) -> bool:
    with suppress(PackageNotFoundError):
        return bool(version(package))
    return False


def _machine(results: Path) -> Iterator[Finding]:
    cores, load, memory = usable_cores(), os.getloadavg()[0], free_memory()
    text = f"{cores} of {os.cpu_count()} may be used here, with a load average of {load:.1f}"
    yield _finding("cores", text, "other programs slow down runs" * (load > cores))
    if memory is not None:
        jobs = max(1, memory // _JOB_MEMORY)
        advice = f"nets take about {decimal(_JOB_MEMORY)} per job: give --jobs {jobs}"
        yield _finding("memory", f"{decimal(memory)} free", advice * (memory < cores * _JOB_MEMORY))
    folder = _existing(results)
    if folder.is_dir() and os.access(folder, os.W_OK):
        free = shutil.disk_usage(folder).free
        yield _finding("disk", f"{decimal(free)} free in {folder}", "free some space" * (free < _MIN_DISK))
    else:
        text = f"{folder} is not a folder that can be written"
        yield _finding("disk", text, "choose another folder with --results", "problem")


def _existing(path: Path) -> Path:
    """Returns the deepest part of a path that exists."""
    return next(each for each in (path.absolute(), *path.absolute().parents) if each.exists())


def _store(path: Path) -> Iterator[Finding]:
    try:
        with Store(path, read_only=True) as store:
            if structure := store.problem():
                yield _finding("store", f"{path} is damaged: {structure}", REPAIR_ADVICE, "problem")
                return
            counts = Counter(store.statuses().values())
            runs = ", ".join(f"{n:,} {status}" for status, n in sorted(counts.items())) or "none"
            again = "'run EXPERIMENT' tries failed runs again" if counts["failed"] else ""
            yield _finding("store", f"{path}: {decimal(path.stat().st_size)}, runs: {runs}", again)
    except NoRunsError:
        yield _finding("store", f"{path}: there are no runs yet")
    except InputError as error:
        yield "problem", "store", str(error).removesuffix(".")


def _experiment(experiment: Experiment, options: argparse.Namespace) -> Iterator[Finding]:
    """Yields what it costs to execute the missing runs of an experiment."""
    runs = missing = all_specifications(experiment)
    for algorithm in sorted({run.algorithm for run in runs}):
        versions(algorithm)  # refuses a missing package
    # There may be no store yet, and what is wrong with it has been said.
    with suppress(InputError), Store(options.results / "runs.db", read_only=True) as store:
        missing = pending(runs, store)
    if not missing:
        yield _finding("runs", f"all {len(runs):,} are done")
        return
    yield _finding("runs", f"{len(missing):,} of {len(runs):,} are missing")
    folder = options.results / Path(options.experiment).stem
    stage = " for the first stage" if report_of(experiment).study.stages is not None else ""
    how_long, *_ = estimate(missing, folder, min(options.jobs, usable_cores()))
    yield _finding("time", f"{how_long}{stage}")
    free = shutil.disk_usage(_existing(options.results)).free
    size = sum(run.record_size for run in missing)  # before compression
    text = f"at most about {decimal(size)} for records; {decimal(free)} are free"
    yield _finding("disk", text, "choose another folder with --results" * (size >= free), "problem")
