"""Examines the installation, the machine and the store, and estimates what an experiment costs here."""

import argparse
import os
import platform
import random
import shutil
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, metadata, version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from rich.console import Console
from rich.text import Text

from benchmark.commands import parse_jobs, parse_seeds
from benchmark.execution import provenance
from benchmark.execution.machine import free_memory, usable_cores
from benchmark.execution.store import REPAIR_ADVICE, NoRunsError, Store
from envs import InputError
from envs.inputs import EXTRAS, missing_package, needed_by, shortened

if TYPE_CHECKING:
    from benchmark.execution.calibration import Estimate
    from benchmark.experiments import RunSpecification

BROWSERS: Final = ("chromium", "chromium-browser", "google-chrome")  # the tests of the page need one of them
_PROJECT: Final = "proxemic-benchmark"
_ROOT: Final = Path(__file__).parents[2]
_COLOURS: Final = {"ok": "green", "note": "yellow", "problem": "bold red"}
_SOURCES: Final = {
    "stored": "from stored runs",
    "calibrated": "from small jobs",
    "similar": "from similar populations",
}
_MOST_NAMED: Final = 3  # of a list
_LONGEST: Final = 200  # characters of an error
_CHECK_S: Final = 3.0  # how long to verify checksums
_AT_ONCE: Final = 100  # records
_JOB_MEMORY: Final = 500_000_000  # bytes of a job of nets, about
_LITTLE_DISK: Final = 1_000_000_000  # bytes
_MANY_FREE: Final = 0.2  # of a store


@dataclass(frozen=True)
class Finding:
    """What was found about something; if it is not "ok", the text says what to do."""

    state: str  # a key of `_COLOURS`
    subject: str
    text: str


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code: 0 if there is no problem, else 1."""
    options.jobs = parse_jobs(options.jobs)
    seeds = parse_seeds(options.seeds)
    if seeds is not None and options.experiment is None:
        raise InputError("--seeds: accepted only together with an experiment.")
    cache = _cache()
    runs = []
    # Without a cache nothing that is compiled can be imported.
    if options.experiment is not None and cache.state == "ok":
        from benchmark.experiments import all_specifications, load_experiment

        runs = all_specifications(load_experiment(options.experiment), seeds)
    console = Console()
    has_problem = False
    for finding in _findings(options, cache, runs):
        line = Text(f"{finding.state:8}", style=_COLOURS[finding.state])
        console.print(line.append(f"{finding.subject:10} {finding.text}", style="default"), soft_wrap=True)
        has_problem |= finding.state == "problem"
    return 1 if has_problem else 0


def _findings(
    options: argparse.Namespace, cache: Finding, runs: Sequence["RunSpecification"]
) -> Iterator[Finding]:
    """Yields all findings."""
    yield from _installation()
    yield cache
    yield from _machine(options.results)
    yield from _store(options)
    if options.cluster is not None:
        yield _cluster(options.cluster, runs)
    if runs:
        yield from _experiment(runs, options)


# The installation


def _installation() -> Iterator[Finding]:
    """Yields whether packages are there, in which versions, and what records will say of the code."""
    absent = {extra: [m for m in modules if find_spec(m) is None] for extra, modules in EXTRAS.items()}
    python, ranges = _declared()
    outside = (
        [] if platform.python_version() in python else [f"Python {platform.python_version()} ({python})"]
    )
    for extra, requirements in ranges.items():
        if absent.get(extra):  # it may bound what others bring
            continue
        for requirement in requirements:
            installed = _version(requirement.name)
            if installed is not None and not requirement.specifier.contains(installed, prereleases=True):
                outside.append(f"{requirement.name} {installed} ({requirement.specifier})")
    published = _published()
    others = [
        f"{name} {installed} ({wanted})"
        for name, wanted in published.items()
        if (installed := _version(name)) not in (None, wanted)
    ]
    if outside:
        advice = "install accepted ones, as pip install -e '.[EXTRA]' does"
        yield Finding("problem", "versions", f"not accepted: {_listed(outside)}; {advice}")
    if others:
        what = f"{len(others)} of {len(published)} differ from constraints.txt, that of the published results"
        advice = "pip install -c constraints.txt -e '.[EXTRA]' installs those"
        yield Finding("note", "versions", f"{what}: {_listed(others)}; {advice}")
    if not outside and not others:
        those = ", packages as in constraints.txt" if published else ", packages in the declared ranges"
        yield Finding("ok", "versions", f"Python {platform.python_version()}{those}")
    for extra, modules in absent.items():
        if modules:
            message = str(missing_package(f"the extra {extra}", modules[0])).removesuffix(".")
            more = f" ({len(modules)} packages are missing)" if len(modules) > 1 else ""
            yield Finding("note", "packages", f"{message}{more}")
    if there := [extra for extra, modules in absent.items() if not modules]:
        yield Finding("ok", "packages", f"complete extras: {', '.join(there)}")
    yield _code()


def _declared() -> tuple[SpecifierSet, dict[str, list[Requirement]]]:
    """Returns the accepted versions of Python, and what the core ("") and each extra require."""
    file = _ROOT / "pyproject.toml"
    if file.is_file():  # a checkout, which need not be installed
        project = tomllib.loads(file.read_text(encoding="utf-8"))["project"]
        lines = {"": project["dependencies"]} | project["optional-dependencies"]
        found = {extra: [Requirement(line) for line in lines[extra]] for extra in ("", *EXTRAS)}
        return SpecifierSet(project["requires-python"]), found
    try:
        about = metadata(_PROJECT)
    except PackageNotFoundError:
        return SpecifierSet(), {}
    every = [Requirement(line) for line in about.get_all("Requires-Dist") or ()]
    return SpecifierSet(about["Requires-Python"] or ""), {
        extra: [each for each in every if _is_of(each, extra)] for extra in ("", *EXTRAS)
    }


def _is_of(requirement: Requirement, extra: str) -> bool:
    """Returns whether the core or an extra has a requirement."""
    is_core = requirement.marker is None or requirement.marker.evaluate({"extra": ""})
    return (
        is_core
        if not extra
        else requirement.marker is not None and requirement.marker.evaluate({"extra": extra})
    )


def _published() -> dict[str, str]:
    """Returns the versions of packages that made the published results, if this is a checkout."""
    file = _ROOT / "constraints.txt"
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    return dict(line.split("==") for line in lines if "==" in line and not line.startswith("#"))


def _version(package: str) -> str | None:
    """Returns the installed version of a package, without what a build adds, as in 2.13.0+cpu."""
    try:
        return version(package).partition("+")[0]
    except PackageNotFoundError:
        return None


def _code() -> Finding:
    """Returns what provenance will say of the code."""
    if shutil.which("git") is None:
        return Finding("note", "code", "git was not found: records will not name a commit; install git")
    commit = provenance.commit(Path(provenance.__file__))
    if commit is None:
        return Finding("ok", "code", "not a checkout: records name no commit")
    if commit.endswith("-changed"):
        advice = "commit changes of agents, benchmark and envs before runs that are to be published"
        return Finding("note", "code", f"records will name the commit {commit}; {advice}")
    return Finding("ok", "code", f"commit {commit}, without changes")


# The machine


def _cache() -> Finding:
    """Returns whether what numba compiles can be kept."""
    try:
        with needed_by("benchmark doctor"):
            from agents import dynamic_programming
    except RuntimeError as error:  # numba's, while it looks for a folder
        advice = "make the folder of the code writable, or set NUMBA_CACHE_DIR to a folder that is"
        return Finding("problem", "compiling", f"{' '.join(str(error).split())}; {advice}")
    sweep: Any = dynamic_programming._sweep
    return Finding("ok", "compiling", f"compiled code is kept in {shortened(sweep._cache.cache_path)}")


def _machine(results: Path) -> Iterator[Finding]:
    """Yields what the machine has to offer."""
    cores, there = usable_cores(), os.cpu_count() or 1
    if cores < there:
        yield Finding("ok", "cores", f"{cores} of {there} may be used here; each job uses one thread")
    elif (load := os.getloadavg()[0]) > cores:
        advice = "wait for other programs to end: they slow down runs, and estimates include that"
        yield Finding("note", "cores", f"{cores}, with a load average of {load:.1f}; {advice}")
    else:
        yield Finding("ok", "cores", f"{cores}; each job uses one thread")
    threads = os.environ.get("OMP_NUM_THREADS", "1")
    if threads != "1":
        text = (
            f"OMP_NUM_THREADS = {shortened(threads)}, while each job of a net trains in one thread; unset it"
        )
        yield Finding("note", "threads", text)
    memory = free_memory()
    if memory is not None:
        text = f"{_bytes(memory)} free"
        if memory < cores * _JOB_MEMORY:
            n_jobs = max(1, memory // _JOB_MEMORY)
            advice = f"with nets, which take about {_bytes(_JOB_MEMORY)} per job, give --jobs {n_jobs}"
            yield Finding("note", "memory", f"{text}; {advice}")
        else:
            yield Finding("ok", "memory", text)
    yield _disk(results)
    if (_ROOT / "tests").is_dir():
        browser = next(filter(None, map(shutil.which, BROWSERS)), None)
        if browser is None:
            advice = "install one (apt-get install chromium), or tests of the page are skipped"
            yield Finding("note", "browser", f"none of {', '.join(BROWSERS)} was found; {advice}")
        else:
            yield Finding("ok", "browser", browser)


def _disk(results: Path) -> Finding:
    """Returns whether results can be written."""
    folder = results.absolute()
    while not folder.exists():
        folder = folder.parent
    if not folder.is_dir():
        return Finding("problem", "disk", f"{folder} is not a folder; choose another one with --results")
    if not os.access(folder, os.W_OK):
        advice = "make it so, or choose another one with --results"
        return Finding("problem", "disk", f"{folder} is not writable; {advice}")
    free = shutil.disk_usage(folder).free
    if free < _LITTLE_DISK:
        advice = "free some, or choose another folder with --results"
        return Finding("note", "disk", f"{_bytes(free)} free in {folder}; {advice}")
    return Finding("ok", "disk", f"{_bytes(free)} free in {folder}")


# The store


def _store(options: argparse.Namespace) -> Iterator[Finding]:
    """Yields whether the store is sound."""
    path = options.results / "runs.db"
    journal = path.with_name(f"{path.name}-journal")
    is_written = journal.exists()
    for name in (f"{path.name}.damaged", f"{path.name}.salvaged"):
        left = path.with_name(name)
        if left.exists():
            size, advice = _bytes(left.stat().st_size), "delete it when the store is complete again"
            yield Finding("note", "store", f"{left} ({size}) is left over from a damaged store; {advice}")
    try:
        with Store(path, read_only=True) as store:
            yield from _content(store, path)
    except NoRunsError:
        yield Finding("ok", "store", f"{path}: there are no runs yet")
    except InputError as error:
        yield Finding("problem", "store", str(error).removesuffix("."))
    if is_written and journal.exists():
        advice = "run doctor again when it has ended"
        yield Finding("note", "store", f"another process is writing to {path}; {advice}")
    elif is_written:
        yield Finding("ok", "store", f"{path}: an interrupted write has been undone")


def _content(store: Store, path: Path) -> Iterator[Finding]:
    """Yields whether an open store is sound."""
    structure = store.problem()
    if structure:
        yield Finding("problem", "store", f"{path} is damaged: {structure}; {REPAIR_ADVICE}")
        return
    counts = Counter(store.statuses().values())
    size, free = store.size()
    runs = ", ".join(f"{counts[each]:,} {each}" for each in ("done", "diverged", "failed") if counts[each])
    text = f"{path}: {_bytes(size)}, runs: {runs or 'none'}"
    if counts["failed"]:
        yield Finding("note", "store", f"{text}; 'run EXPERIMENT' tries failed runs again")
    else:
        yield Finding("ok", "store", text)
    if free > _MANY_FREE * size:
        advice = f"further runs fill it; sqlite3 {path} VACUUM gives it back"
        yield Finding("note", "store", f"{_bytes(free)} of {_bytes(size)} are unused; {advice}")
    digests = [*store.ended()]
    random.shuffle(digests)
    end = time.monotonic() + _CHECK_S
    n_checked, damaged = 0, 0
    while n_checked < len(digests) and time.monotonic() < end:
        some = digests[n_checked : n_checked + _AT_ONCE]
        damaged += len(store.damaged(some))
        n_checked += len(some)
    if damaged:
        text = f"{damaged} of {n_checked:,} checked records are damaged; 'verify' says what to do"
        yield Finding("problem", "checksums", text)
    elif n_checked == len(digests):
        yield Finding("ok", "checksums", f"correct in all {n_checked:,} records")
    else:
        text = f"correct in {n_checked:,} of {len(digests):,} records, drawn at random; 'verify' checks all"
        yield Finding("ok", "checksums", text)


def _cluster(address: str, runs: Sequence["RunSpecification"]) -> Finding:
    """Returns whether a Dask cluster can execute these runs."""
    from benchmark.commands.run import connect

    try:
        cluster = connect(address, {run.algorithm for run in runs} or {"q_learning"})
    except InputError as error:
        return Finding("problem", "cluster", str(error).removesuffix("."))
    cluster.cancel()
    return Finding("ok", "cluster", f"{address}: workers with the same packages and code: {cluster.workers}")


# The experiment


def _experiment(runs: Sequence["RunSpecification"], options: argparse.Namespace) -> Iterator[Finding]:
    """Yields what it costs to execute the missing runs of an experiment."""
    from benchmark.execution.calibration import LIMIT_S, estimate
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
            yield Finding("ok", "runs", f"all {len(runs):,} are done")
            return
        print(f"estimating the cost, for at most {LIMIT_S:.0f} s ...", file=sys.stderr)
        estimated = estimate(missing, store, options.jobs, usable_cores())
    text = f"{len(missing):,} of {len(runs):,} are missing, in {estimated.jobs:,} jobs"
    yield Finding("ok", "runs", text)
    for failure in estimated.failures:
        advice = "check its algorithm and settings"
        yield Finding("problem", "runs", f"a small job failed: {shortened(failure, _LONGEST)}; {advice}")
    unknown = estimated.unknown
    known = len({run.population for run in missing}) - len(unknown)
    which = f"for {known} of {known + len(unknown)} populations"
    if known:
        sources = ", ".join(
            f"{n} {_SOURCES[source]}" for source, n in sorted(estimated.sources.items(), reverse=True)
        )
        yield Finding(
            "ok", "time", f"{_duration(*estimated.seconds)} with --jobs {options.jobs}, {which} ({sources})"
        )
    if unknown:
        names = _listed(list(dict.fromkeys(run.arm for run in unknown)))
        advice = "compiled code is kept, so try again"
        text = f"unknown for {len(unknown)} populations ({names}): {LIMIT_S:.0f} s was not enough; {advice}"
        yield Finding("note", "time", text)
    if known:
        yield from _needs(estimated, options)


def _needs(estimated: "Estimate", options: argparse.Namespace) -> Iterator[Finding]:
    """Yields whether memory and disk are enough."""
    peak, free = estimated.peak_memory, free_memory()
    if peak is not None and free is not None:
        text = f"about {_bytes(peak)} at the peak; {_bytes(free)} are free"
        if peak < free:
            yield Finding("ok", "memory", text)
        else:
            yield Finding("problem", "memory", f"{text}; give fewer --jobs")
    folder = options.results.absolute()
    while not folder.exists():
        folder = folder.parent
    free = shutil.disk_usage(folder).free
    text = f"about {_bytes(estimated.size)} for records; {_bytes(free)} are free"
    if estimated.size < free:
        yield Finding("ok", "disk", text)
    else:
        yield Finding("problem", "disk", f"{text}; choose another folder with --results")


# Words


def _listed(texts: Sequence[str]) -> str:
    """Returns texts as a list, or the first of a longer one.

    >>> _listed(["a", "b", "c", "d", "e"])
    'a, b, c and 2 more'
    """
    more = f" and {len(texts) - _MOST_NAMED} more" if len(texts) > _MOST_NAMED else ""
    return ", ".join(texts[:_MOST_NAMED]) + more


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
