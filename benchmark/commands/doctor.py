"""Examines the installation, the machine and the store, and estimates what an experiment costs here."""

import argparse
import os
import platform
import random
import shutil
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from packaging.requirements import Requirement
from rich.console import Console
from rich.text import Text

from benchmark import packages
from benchmark.commands import parse_jobs, parse_seeds
from benchmark.execution import provenance
from benchmark.execution.machine import free_memory, usable_cores
from benchmark.execution.store import REPAIR_ADVICE, NoRunsError, Store
from envs import InputError
from envs.inputs import EXTRAS, missing_package, needed_by, shortened

if TYPE_CHECKING:
    from benchmark.experiments import RunSpecification

BROWSERS: Final = ("chromium", "chromium-browser", "google-chrome")  # the tests of the page need one of them
_CONSTRAINTS: Final = Path(__file__).parents[2] / "constraints.txt"
_COLOURS: Final = {"ok": "green", "note": "yellow", "problem": "bold red"}
_LONGEST: Final = 200  # characters of an error
_CHECK_S: Final = 3.0  # how long to verify checksums
_AT_ONCE: Final = 100  # records
_JOB_MEMORY: Final = 500_000_000  # bytes of a job of nets, about
_OTHER_FOLDER: Final = "choose another folder with --results"
_LITTLE_DISK: Final = 1_000_000_000  # bytes


class Finding(NamedTuple):
    """What was found about something; if it is not "ok", the text says what to do."""

    state: str  # a key of `_COLOURS`
    subject: str
    text: str


def _finding(subject: str, text: str, advice: str = "", state: str = "note") -> Finding:
    """Returns that all is well, or with advice that something is not."""
    return Finding(state, subject, f"{text}; {advice}") if advice else Finding("ok", subject, text)


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code: 0 if there is no problem, else 1."""
    options.jobs = parse_jobs(options.jobs)
    seeds = parse_seeds(options.seeds)
    if seeds is not None and options.experiment is None:
        raise InputError("--seeds: accepted only together with an experiment.")
    cache = _cache()
    runs, limits = [], ""
    if options.experiment is not None and cache.state == "ok":  # else nothing compiled can be imported
        from benchmark.commands.run import forecast
        from benchmark.experiments import all_specifications, load_experiment

        experiment = load_experiment(options.experiment)
        runs, limits = all_specifications(experiment, seeds), forecast(experiment)
    found = [
        _installation(),
        [cache],
        _machine(options.results),
        _store(options.results / "runs.db"),
    ]
    if options.cluster is not None:
        found.append([_cluster(options.cluster, runs)])
    if limits:
        found.append([Finding("note", "verdicts", limits)])
    if runs:
        found.append(_experiment(runs, options))
    console = Console()
    states = set()
    for finding in chain.from_iterable(found):
        line = Text(f"{finding.state:8}", style=_COLOURS[finding.state])
        console.print(line.append(f"{finding.subject:10} {finding.text}", style="default"), soft_wrap=True)
        states.add(finding.state)
    return 1 if "problem" in states else 0


def _installation() -> Iterator[Finding]:
    """Yields whether packages are there, in which versions, and what records will say of the code."""
    lines = _CONSTRAINTS.read_text(encoding="utf-8").splitlines() if _CONSTRAINTS.is_file() else []
    if versions := _outside(Requirement(line) for line in lines if "==" in line and not line.startswith("#")):
        advice = "pip install -c constraints.txt -e '.[EXTRA]' installs those of the published results"
        yield _finding("versions", f"other than in constraints.txt: {', '.join(versions)}", advice)
    else:
        yield _finding("versions", f"Python {platform.python_version()}, and packages as declared")
    print("importing every package ...", file=sys.stderr)
    others = [each for extra, modules in EXTRAS.items() if extra != "reproduce" for each in modules]
    there = [module for module in others if find_spec(module) is not None]
    for sentence in dict.fromkeys(packages.unusable(there, usable_cores()).values()):
        yield Finding("problem", "packages", sentence.removesuffix("."))
    complete: list[str] = []
    absent: list[str] = []
    for extra, modules in EXTRAS.items():
        missing = [module for module in modules if find_spec(module) is None]
        if missing and len(missing) < len(modules):
            text = str(missing_package(f"the extra {extra}", missing[0])).removesuffix(".")
            yield Finding("note", "packages", f"{text} (packages that are missing: {len(missing)})")
        else:
            (absent if missing else complete).append(extra)
    more = f"; others: {', '.join(absent)} (make .venv/.NAME installs one)" if absent else ""
    yield _finding("packages", f"installed extras: {', '.join(complete) or 'none'}{more}")
    commit = provenance.commit(Path(provenance.__file__)) or "(none: no checkout)"
    advice = "commit changes of agents, benchmark and envs before runs that are to be published"
    yield _finding("code", f"records will name the commit {commit}", advice * commit.endswith("-changed"))


def _outside(requirements: Iterable[Requirement]) -> list[str]:
    """Lists the installed packages that are in another version than is required."""
    found = []
    for each in requirements:
        if each.name == "setuptools":  # a fresh environment has its own, and only a test of ours needs it
            continue
        with suppress(PackageNotFoundError):
            installed = version(each.name).partition("+")[0]  # a build may add +cpu
            if not each.specifier.contains(installed, prereleases=True):
                found.append(f"{each.name} {installed} ({each.specifier})")
    return found


def _cache() -> Finding:
    """Returns whether what numba compiles can be kept."""
    try:
        with needed_by("benchmark doctor"):
            from agents import dynamic_programming
    except RuntimeError as error:  # numba's, while it looks for a folder
        advice = "make the folder of the code writable, or set NUMBA_CACHE_DIR to a folder that is"
        return Finding("problem", "compiling", f"{' '.join(str(error).split())}; {advice}")
    sweep: Any = dynamic_programming._sweep
    return _finding("compiling", f"compiled code is kept in {shortened(sweep._cache.cache_path)}")


def _machine(results: Path) -> Iterator[Finding]:
    """Yields what the machine has to offer."""
    cores, load, memory = usable_cores(), os.getloadavg()[0], free_memory()
    if load > cores:
        text = f"{cores}, with a load average of {load:.1f}"
        yield _finding("cores", text, "other programs slow down runs")
    else:
        yield _finding("cores", f"{cores} of {os.cpu_count()} may be used here; each job uses one thread")
    if memory is not None:
        advice = f"nets take about {_bytes(_JOB_MEMORY)} per job: give --jobs {max(1, memory // _JOB_MEMORY)}"
        yield _finding("memory", f"{_bytes(memory)} free", advice * (memory < cores * _JOB_MEMORY))
    folder, free = _disk(results)
    if folder.is_dir() and os.access(folder, os.W_OK):
        yield _finding("disk", f"{_bytes(free)} free in {folder}", "free some space" * (free < _LITTLE_DISK))
    else:
        yield _finding("disk", f"{folder} is not a folder that can be written", _OTHER_FOLDER, "problem")
    if (_CONSTRAINTS.parent / "tests").is_dir() and not any(map(shutil.which, BROWSERS)):
        advice = "install one (apt-get install chromium), or tests of the page are skipped"
        yield Finding("note", "browser", f"none of {', '.join(BROWSERS)} was found; {advice}")


def _disk(results: Path) -> tuple[Path, int]:
    """Returns the folder that is there of a path, and its free bytes."""
    folder = next(each for each in (results.absolute(), *results.absolute().parents) if each.exists())
    return folder, shutil.disk_usage(folder).free


def _store(path: Path) -> Iterator[Finding]:
    """Yields whether the store is sound."""
    for left in sorted(path.parent.glob(f"{path.name}.*")):
        if left.name == f"{path.name}.lock":  # stays, empty
            continue
        yield Finding("note", "store", f"{left} is left over from a damaged store; delete it in the end")
    try:
        with Store(path, read_only=True) as store:
            if structure := store.problem():
                yield Finding("problem", "store", f"{path} is damaged: {structure}; {REPAIR_ADVICE}")
                return
            counts = Counter(store.statuses().values())
            runs = ", ".join(f"{n:,} {status}" for status, n in sorted(counts.items())) or "none"
            again = "'run EXPERIMENT' tries failed runs again" if counts["failed"] else ""
            yield _finding("store", f"{path}: {_bytes(path.stat().st_size)}, runs: {runs}", again)
            digests = [*store.ended()]
            random.shuffle(digests)
            end, n_checked, n_damaged = time.monotonic() + _CHECK_S, 0, 0
            while n_checked < len(digests) and time.monotonic() < end:
                some = digests[n_checked : n_checked + _AT_ONCE]
                n_checked, n_damaged = n_checked + len(some), n_damaged + len(store.damaged(some))
    except NoRunsError:
        yield _finding("store", f"{path}: there are no runs yet")
    except InputError as error:
        yield Finding("problem", "store", str(error).removesuffix("."))
    else:
        text = f"{n_checked:,} of {len(digests):,} records checked, {n_damaged:,} damaged"
        state, advice = ("problem", "says what to do") if n_damaged else ("ok", "checks all")
        yield _finding("checksums", text, f"'verify' {advice}", state)


def _cluster(address: str, runs: Sequence["RunSpecification"]) -> Finding:
    """Returns whether a Dask cluster can execute these runs."""
    from benchmark.commands.run import connect

    try:
        cluster = connect(address, {run.algorithm for run in runs} or {"q_learning"})
    except InputError as error:
        return Finding("problem", "cluster", str(error).removesuffix("."))
    cluster.cancel()
    return _finding("cluster", f"{address}: workers with the same packages and code: {cluster.workers}")


def _experiment(runs: Sequence["RunSpecification"], options: argparse.Namespace) -> Iterator[Finding]:
    """Yields what it costs to execute the missing runs of an experiment."""
    from benchmark.execution.calibration import estimate
    from benchmark.execution.driver import pending

    try:
        provenance.check_packages(run.algorithm for run in runs)
    except InputError as error:
        yield Finding("problem", "runs", str(error).removesuffix("."))
        return
    with ExitStack() as stack:
        store, missing = None, list(runs)
        with suppress(InputError):  # there is none yet, or what is wrong with it has been said
            opened = stack.enter_context(Store(options.results / "runs.db", read_only=True))
            missing, store = pending(runs, opened), opened
        if not missing:
            yield _finding("runs", f"all {len(runs):,} are done")
            return
        estimated = estimate(missing, store, options.jobs, usable_cores())
    yield _finding("runs", f"{len(missing):,} of {len(runs):,} are missing, in {estimated.jobs:,} jobs")
    if estimated.unknown:
        names = ", ".join(dict.fromkeys(estimated.unknown))
        text = f"unknown for {len(estimated.unknown)} populations ({shortened(names, _LONGEST)}): "
        yield _finding("time", f"{text}no run of these is stored from a machine like this one")
    if estimated.known:
        text = f"{_duration(*estimated.seconds)} with --jobs {options.jobs}, from stored runs of "
        yield _finding("time", f"{text}{estimated.known} populations")
    if estimated.peak_memory and (free := free_memory()) is not None:
        text = f"about {_bytes(estimated.peak_memory)} at the peak; {_bytes(free)} are free"
        yield _finding("memory", text, "give fewer --jobs" * (estimated.peak_memory >= free), "problem")
    free_disk = _disk(options.results)[1]
    text = f"at most about {_bytes(estimated.size)} for records; {_bytes(free_disk)} are free"
    yield _finding("disk", text, _OTHER_FOLDER * (estimated.size >= free_disk), "problem")


def _bytes(number: float) -> str:
    """Returns a number of bytes in words.

    >>> _bytes(1_260_000_000), _bytes(90_000_000), _bytes(12_345)
    ('1.3 GB', '90 MB', '0.01 MB')
    """
    if number >= 1e9:
        return f"{number / 1e9:.1f} GB"
    return f"{number / 1e6:.0f} MB" if number >= 1e6 else f"{number / 1e6:.2f} MB"


def _duration(low: float, high: float) -> str:
    """Returns a range of seconds in words.

    >>> _duration(7.0, 20.0), _duration(50.0, 200.0), _duration(3000.0, 10_000.0)
    ('less than a minute', '1 to 3 minutes', '0.8 to 2.8 hours')
    """
    if high < 60:
        return "less than a minute"
    if high < 6000:
        return f"{max(1, round(low / 60))} to {round(high / 60)} minutes"
    return f"{low / 3600:.1f} to {high / 3600:.1f} hours"
