"""Examines the installation, the machine and the store, and estimates what an experiment costs here."""

import argparse
import os
import platform
import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from itertools import chain
from pathlib import Path
from typing import Final, NamedTuple

from rich.console import Console
from rich.filesize import decimal
from rich.text import Text

from benchmark.commands import parse_jobs
from benchmark.execution.calibration import estimate
from benchmark.execution.driver import pending
from benchmark.execution.machine import free_memory, usable_cores
from benchmark.execution.provenance import versions
from benchmark.execution.store import REPAIR_ADVICE, NoRunsError, Store
from benchmark.experiments import RunSpecification, all_specifications, load_experiment
from benchmark.studies import report_of
from envs import InputError
from envs.packages import extras

_CONSTRAINTS: Final = Path(__file__).parents[2] / "constraints.txt"
_COLOURS: Final = {"ok": "green", "note": "yellow", "problem": "bold red"}
_JOB_MEMORY: Final = 500_000_000  # bytes of a job of nets, about
_OTHER_FOLDER: Final = "choose another folder with --results"
_LITTLE_DISK: Final = 1_000_000_000  # bytes


class Finding(NamedTuple):
    """A finding about one subject; if it is not "ok", the text says what to do."""

    state: str  # a key of `_COLOURS`
    subject: str
    text: str


def _finding(subject: str, text: str, advice: str = "", state: str = "note") -> Finding:
    """Returns a finding that is "ok" without advice, else in the given state."""
    return Finding(state, subject, f"{text}; {advice}") if advice else Finding("ok", subject, text)


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code: 0 if there is no problem, else 1."""
    options.jobs = parse_jobs(options.jobs)
    runs: Sequence[RunSpecification] = []
    if options.experiment is not None:
        runs = all_specifications(load_experiment(options.experiment))
    of_runs = _experiment(runs, options) if runs else ()
    store = options.results / "runs.db"
    findings = chain(_installation(), _machine(options.results), _store(store), of_runs)
    console = Console()
    states = set()
    for finding in findings:
        line = Text(f"{finding.state:8}", style=_COLOURS[finding.state])
        console.print(line.append(f"{finding.subject:10} {finding.text}", style="default"), soft_wrap=True)
        states.add(finding.state)
    return 1 if "problem" in states else 0


def _installation() -> Iterator[Finding]:
    if others := _outside():
        advice = "pip install -c constraints.txt -e '.[EXTRA]' installs those of the published results"
        yield _finding("versions", f"other than in constraints.txt: {', '.join(others)}", advice)
    else:
        yield _finding("versions", f"Python {platform.python_version()}, and packages as declared")
    complete = [extra for extra, packages in extras().items() if all(map(_is_installed, packages))]
    others = [extra for extra in extras() if extra not in complete]
    more = f"; others: {', '.join(others)} (in a checkout, make .venv/.NAME installs one)" if others else ""
    yield _finding("packages", f"installed extras: {', '.join(complete) or 'none'}{more}")


def _is_installed(package: str) -> bool:
    with suppress(PackageNotFoundError):
        return bool(version(package))
    return False


def _outside() -> list[str]:
    lines = _CONSTRAINTS.read_text(encoding="utf-8").splitlines() if _CONSTRAINTS.is_file() else []
    outside = []
    for line in lines:
        name, _, accepted = line.partition("==")
        with suppress(PackageNotFoundError, ValueError):  # a comment is no name
            installed = version(name).partition("+")[0]  # a build may add +cpu
            # A fresh environment has its own setuptools, which only a test needs.
            if name != "setuptools" and installed != accepted:
                outside.append(f"{name} {installed} (=={accepted})")
    return outside


def _machine(results: Path) -> Iterator[Finding]:
    cores, load, memory = usable_cores(), os.getloadavg()[0], free_memory()
    text = f"{cores} of {os.cpu_count()} may be used here, with a load average of {load:.1f}"
    yield _finding("cores", text, "other programs slow down runs" * (load > cores))
    if memory is not None:
        jobs = max(1, memory // _JOB_MEMORY)
        advice = f"nets take about {decimal(_JOB_MEMORY)} per job: give --jobs {jobs}"
        yield _finding("memory", f"{decimal(memory)} free", advice * (memory < cores * _JOB_MEMORY))
    folder, free = _disk(results)
    if folder.is_dir() and os.access(folder, os.W_OK):
        text = f"{decimal(free)} free in {folder}"
        yield _finding("disk", text, "free some space" * (free < _LITTLE_DISK))
    else:
        yield _finding("disk", f"{folder} is not a folder that can be written", _OTHER_FOLDER, "problem")


def _disk(results: Path) -> tuple[Path, int]:
    """Returns the deepest folder of a path that exists, and its free bytes."""
    paths = (results.absolute(), *results.absolute().parents)
    folder = next(path for path in paths if path.exists())
    return folder, shutil.disk_usage(folder).free


def _store(path: Path) -> Iterator[Finding]:
    try:
        with Store(path, read_only=True) as store:
            if structure := store.problem():
                yield Finding("problem", "store", f"{path} is damaged: {structure}; {REPAIR_ADVICE}")
                return
            counts = Counter(store.statuses().values())
            runs = ", ".join(f"{n:,} {status}" for status, n in sorted(counts.items())) or "none"
            again = "'run EXPERIMENT' tries failed runs again" if counts["failed"] else ""
            yield _finding("store", f"{path}: {decimal(path.stat().st_size)}, runs: {runs}", again)
    except NoRunsError:
        yield _finding("store", f"{path}: there are no runs yet")
    except InputError as error:
        yield Finding("problem", "store", str(error).removesuffix("."))


def _experiment(runs: Sequence[RunSpecification], options: argparse.Namespace) -> Iterator[Finding]:
    """Yields what it costs to execute the missing runs of an experiment."""
    for algorithm in sorted({run.algorithm for run in runs}):
        versions(algorithm)  # refuses a missing package
    missing = runs
    # There may be no store yet, and what is wrong with it has been said.
    with suppress(InputError), Store(options.results / "runs.db", read_only=True) as store:
        missing = pending(runs, store)
    if not missing:
        yield _finding("runs", f"all {len(runs):,} are done")
        return
    folder = options.results / Path(options.experiment).stem
    yield _finding("runs", f"{len(missing):,} of {len(runs):,} are missing")
    has_stages = report_of(load_experiment(options.experiment)).study.stages is not None
    stage = " for the first stage" if has_stages else ""
    yield _finding("time", f"{estimate(missing, folder, min(options.jobs, usable_cores())).text}{stage}")
    free, size = _disk(options.results)[1], sum(run.record_size for run in missing)  # before compression
    text = f"at most about {decimal(size)} for records; {decimal(free)} are free"
    yield _finding("disk", text, _OTHER_FOLDER * (size >= free), "problem")
