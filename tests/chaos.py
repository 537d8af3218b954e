"""Kills drivers and workers, fills disks, takes stores away, and compares every run.

`make chaos` runs it at full length; `tests/test_make.py` runs a short version.
"""

import argparse
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from rich.progress import track

from benchmark.execution.driver import run
from benchmark.execution.executors import Threads
from benchmark.execution.store import NoRunsError, Store
from benchmark.experiments import all_specifications, load_experiment
from tests.benchmark.execution.test_cluster import Machines
from tests.benchmark.execution.test_processes import arrays_of, children
from tests.support import ROOT, small_experiment, variant

# Tables, which are trained in the driver, and in a worker
TABLES: Final = {
    "q_learning": variant(seeds=150),
    "plain": variant("tests.agents.plain:Q_LEARNING", seeds=12),
}
# Nets, which are compiled or of Stable-Baselines3, and whose workers take seconds to start
NETS: Final = {
    "dqn": variant("compiled_dqn", "one_hot", seeds=3),
    "sb3_dqn": variant("sb3_dqn", "one_hot", settings={"learning_starts": 1900}),
}


class Broken(Exception):  # noqa: N818
    """Something was lost, repeated or different."""


class Chaos:
    """A folder of results in which an experiment is executed, and disturbed."""

    machines: Machines  # if there is a cluster
    workers: list[subprocess.Popen[bytes]]

    def __init__(self, folder: Path, algorithms: Mapping[str, object], seed: int) -> None:
        """Executes an experiment undisturbed in threads, to know its results; the seed draws moments."""
        self.experiment, self.results = folder / "chaos.toml", folder / "results"
        text = small_experiment(
            scenarios=["S1", "S2", "S3"],
            horizon=200,
            evaluation_every=500,
            map_every=1000,
            settings={"budget": 2000, "time_limit": 200},
            algorithms=algorithms,
        )
        self.experiment.write_text(text, encoding="utf-8")
        self.rng = np.random.default_rng(seed)
        self.happened: Counter[str] = Counter()
        self._kept: set[str] = set()  # digests that must not be lost
        with Store(folder / "expected.db") as store:
            runs = all_specifications(load_experiment(self.experiment))
            assert run(runs, store, 1, executor=Threads(1)) == []
            self.expected = arrays_of(store.get(sorted(store.ended())))
        started = time.monotonic()
        self.finish()
        self.duration = max(time.monotonic() - started, 1.0)  # seconds that all runs take

    def start(self, *arguments: str, largest_file: int = resource.RLIM_INFINITY) -> subprocess.Popen[str]:
        """Starts a driver in a session of its own, which may write files of so many bytes."""
        options = ["--jobs", "2", "--results", str(self.results), *arguments]
        limits = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (largest_file, largest_file))
        return subprocess.Popen(
            [sys.executable, "-m", "benchmark", "run", str(self.experiment), *options],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=limits,
        )

    def check(self) -> int:
        try:
            with Store(self.results / "runs.db", read_only=True) as store:
                if problem := store.problem():
                    raise Broken(f"the store is damaged: {problem}")
                stored = arrays_of(store.get(sorted(store.ended())))
        except NoRunsError:
            stored = {}
        if lost := self._kept - stored.keys():
            raise Broken(f"{len(lost)} runs are lost")
        for digest, arrays in stored.items():
            if arrays != self.expected.get(digest):
                raise Broken(f"run {digest[:12]} is different")
        self._kept = {*stored}
        return len(stored)

    def finish(self) -> None:
        """Executes what is missing undisturbed, checks that nothing is repeated or left, and starts anew."""
        n_stored = self.check()
        process = self.start()
        output, errors = process.communicate()
        done = re.search(r"(\d+) runs done, (\d+) were done already", output)
        n_done = (int(done[1]), int(done[2])) if done else (0, len(self.expected))
        if process.returncode != 0 or n_done != (len(self.expected) - n_stored, n_stored):
            raise Broken(f"{n_done} runs done, {n_stored} were stored: {errors[-500:]}")
        if self.check() != len(self.expected):
            raise Broken("runs are missing")
        names = {path.name for path in self.results.iterdir()} - {"runs.db.lock"}
        if names != {"runs.db"}:
            raise Broken(f"left behind: {names}")
        shutil.rmtree(self.results)
        self._kept = set()

    def _wait(self, process: subprocess.Popen[str]) -> int:
        time.sleep(self.rng.uniform(0.2, self.duration))
        return int(process.poll() is None)

    # What can happen; each returns how many processes were killed

    def driver_killed(self) -> int:
        """A driver is killed or interrupted at some moment, with all it has started, or by itself."""
        process, number = self.start(), int(self.rng.choice([signal.SIGKILL, signal.SIGINT]))
        is_running = self._wait(process)
        if self.rng.random() < 0.5:
            os.killpg(process.pid, number) if is_running else None
        else:
            process.send_signal(number)
        _, errors = process.communicate(timeout=120)
        if number == signal.SIGINT and "Traceback" in errors:
            raise Broken(f"a traceback after an interrupt: {errors[-2000:]}")
        _wait_for_end(process.pid)
        return is_running

    def worker_killed(self) -> int:
        """A worker is killed; the driver starts another one."""
        process = self.start()
        self._wait(process)
        workers: list[int] = []
        while process.poll() is None and not workers:
            workers = _workers(process.pid)
            time.sleep(0.01)
        n_killed = 0
        with suppress(ProcessLookupError):
            if workers:
                os.kill(int(self.rng.choice(workers)), signal.SIGKILL)
                n_killed = 1
        process.communicate(timeout=600)
        return n_killed

    def cluster_worker_killed(self) -> int:
        """One of two workers of a Dask cluster is killed at some moment, and replaced; the driver goes on."""
        machines = self.machines
        process = self.start("--cluster", machines.address)
        is_running = self._wait(process)
        self.workers.pop(int(self.rng.integers(len(self.workers)))).kill()
        self.workers.append(machines.add(f"worker{self.rng.integers(2**31)}", preload=""))
        _end(process, "a worker was killed", codes=(0,))
        return is_running

    def one_of_two_drivers_killed(self) -> int:
        """One of two drivers of the same experiment is killed at some moment; the other goes on."""
        first, second = self.start(), self.start()
        if is_running := self._wait(first):
            os.killpg(first.pid, signal.SIGKILL)
        first.communicate()
        _wait_for_end(first.pid)
        _end(second, "the other driver was killed", codes=(0,))
        return is_running

    def disk_full(self) -> int:
        """A file may not become larger from some moment on."""
        process = self.start(largest_file=int(self.rng.uniform(20_000, 3_000_000)))
        _end(process, "a full disk", codes=(0, 1, 2), message="error: ")
        return 0

    def store_vanished(self) -> int:
        """The store is moved away, replaced or emptied, or its folder read-only; perhaps it comes back."""
        process, store, moved = self.start(), self.results / "runs.db", self.results / "moved.db"
        self._wait(process)
        way = str(self.rng.choice(["moved", "replaced", "emptied", "read-only"]))
        with suppress(FileNotFoundError):  # the driver may not have begun
            if way == "read-only":
                self.results.chmod(0o500)
            elif way == "emptied":
                os.truncate(store, 0)
            else:
                store.rename(moved)
                if way == "replaced":
                    store.write_text("another file")
        _end(process, f"a store {way}", codes=(0, 2), message=f"error: {store}: ")
        self.results.mkdir(exist_ok=True)
        self.results.chmod(0o700)
        if moved.exists() and self.rng.random() < 0.5:
            moved.replace(store)
        elif way != "read-only":
            for path in (store, moved):
                path.unlink(missing_ok=True)
            self._kept = set()
        return 0


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.chaos", description=__doc__)
    parser.add_argument("--kills", type=int, default=200, help="how many processes to kill (default: 200)")
    parser.add_argument("--seed", type=int, default=0, help="random seed of what happens when (default: 0)")
    options = parser.parse_args(arguments)
    total: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(prefix="chaos-") as folder, ExitStack() as stack:
        n_nets, n_cluster = options.kills // 5, options.kills // 10
        for name, algorithms, n_kills in (
            ("tables", TABLES, options.kills - n_nets - n_cluster),
            ("nets", TABLES | NETS, n_nets),
            ("cluster", TABLES, n_cluster),
        ):
            if not n_kills:
                continue
            (Path(folder) / name).mkdir()
            chaos = Chaos(Path(folder) / name, algorithms, options.seed)
            ways = [chaos.disk_full, chaos.store_vanished, chaos.driver_killed]
            ways += [chaos.one_of_two_drivers_killed, chaos.driver_killed]
            if name == "nets":
                ways = [chaos.worker_killed] * 3 + ways
            elif name == "cluster":
                chaos.machines = machines = stack.enter_context(Machines(Path(folder)))
                chaos.workers = [machines.add(worker, preload="") for worker in ("first", "second")]
                ways = [chaos.cluster_worker_killed]
            disturb(chaos, ways, n_kills)
            total.update(chaos.happened)
    for what, count in sorted(total.items()):
        print(f"{what:28} {count}")
    print(f"processes killed or interrupted: {total['killed']}; runs lost, repeated or different: 0")
    return 0


def disturb(chaos: Chaos, ways: Sequence[Callable[[], int]], n_kills: int) -> None:
    """Disturbs an experiment until so many processes are killed, and checks what is stored each time.

    The ways happen first in this order and then at random; each returns how many processes were killed.
    """
    todo = list(ways)
    for _ in track(range(n_kills), f"killing processes ({len(chaos.expected)} runs)"):
        killed = 0
        while not killed:
            way = todo.pop(0) if todo else ways[int(chaos.rng.integers(len(ways)))]
            killed = way()
            chaos.happened["killed"] += killed
            chaos.happened[way.__name__.replace("_", " ")] += 1
            if chaos.check() == len(chaos.expected) or chaos.rng.random() < 0.1:
                chaos.finish()
    chaos.finish()


def _end(process: subprocess.Popen[str], what: str, *, codes: Sequence[int], message: str = "") -> None:
    """Waits for the end of a driver, which must be a success, or explained by an error message."""
    _, errors = process.communicate(timeout=600)
    is_explained = process.returncode == 0 or message in errors
    if process.returncode not in codes or not is_explained or (message and "Traceback" in errors):
        raise Broken(f"{what}: exit code {process.returncode}: {errors[-2000:]}")


def _workers(pid: int) -> list[int]:
    try:
        started = {child: Path(f"/proc/{child}/cmdline").read_text() for child in children(pid)}
    except OSError:  # one has ended
        return []
    return [child for child, command in started.items() if "spawn_main" in command]


def _wait_for_end(group: int) -> None:
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    raise Broken("a killed driver's workers keep running")


if __name__ == "__main__":
    sys.exit(main())
