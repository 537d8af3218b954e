"""Worker processes: nothing is lost or repeated when they, or their driver, are killed or interrupted."""

import fcntl
import multiprocessing
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final, TextIO

import llvmlite.binding
import pytest

from benchmark.__main__ import main
from benchmark.execution.driver import pending, run
from benchmark.execution.executors import Threads
from benchmark.execution.executors.cluster import refusal
from benchmark.execution.job import execute_job
from benchmark.execution.store import Record, Store
from benchmark.experiments import all_specifications, load_experiment
from envs import InputError
from tests.support import ROOT

PATIENCE_S: Final = 180  # on a loaded machine; nothing waits that long elsewhere
EXPERIMENT: Final = """
description = "Tables in plain Python: eight jobs of a fifth of a second."
scenarios = ["S1"]
horizon = 50
evaluation_every = 60000
map_every = 60000
settings = { budget = 60000 }
algorithms.plain = { algorithm = "tests.agents.plain:Q_LEARNING", observations = ["index"], seeds = 8 }
"""


def arrays_of(records: Sequence[Record]) -> dict[str, dict[str, bytes]]:
    return {
        record.digest: {name: values.tobytes() for name, values in record.arrays.items()}
        for record in records
    }


def test_killed_worker_costs_its_run_alone_and_is_tried_again(tmp_path: Path) -> None:
    def kill() -> None:
        until(multiprocessing.active_children)
        multiprocessing.active_children()[0].kill()

    (tmp_path / "mine.toml").write_text(EXPERIMENT, encoding="utf-8")
    runs = all_specifications(load_experiment(tmp_path / "mine.toml"))

    with Store(tmp_path / "runs.db") as store:
        killer = threading.Thread(target=kill)
        killer.start()
        (error,) = run(runs, store, 2)
        killer.join()
        assert "signal 9" in error
        statuses = store.statuses()
        (failed,) = (run for run in runs if statuses[run.digest] == "failed")
        assert store.get([failed.digest])[0].error == error
        assert pending(runs, store) == [failed]
        assert run(runs, store, 1, executor=Threads(1)) == []
        assert pending(runs, store) == []


ASKING = """
import os
from agents import SequentialAlgorithm
from agents.tabular.learner import Settings

NAMES = "MKL_CBWR", "ATEN_CPU_CAPABILITY"

class Asking(SequentialAlgorithm):
    settings = Settings

    def train_agent(self, *_):
        raise ValueError([os.environ.get(name) for name in NAMES])

ASKING = Asking()
"""


def test_workers_alone_set_what_agents_of_sb3_depend_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not llvmlite.binding.get_host_cpu_features().get("avx2"):
        pytest.skip("a processor without AVX2")
    for name in ("MKL_CBWR", "ATEN_CPU_CAPABILITY"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "asking_for_variables.py").write_text(ASKING)
    text = EXPERIMENT.replace("tests.agents.plain:Q_LEARNING", "asking_for_variables:ASKING")
    (tmp_path / "asking.toml").write_text(text.replace("seeds = 8", "seeds = 1"))
    (asked,) = all_specifications(load_experiment(str(tmp_path / "asking.toml")))
    with Store(tmp_path / "runs.db") as store:
        assert run([asked], store, 1) == ["ValueError: ['AVX2', 'avx2']"]
    assert "MKL_CBWR" not in os.environ
    worker: Any = SimpleNamespace(address="", state=SimpleNamespace(nthreads=1))
    assert refusal({}, worker, ()) is None
    assert os.environ["MKL_CBWR"] == "AVX2"


def n_stored(results: Path) -> int:
    try:
        with Store(results / "runs.db", read_only=True) as store:
            return len(store.statuses())
    except InputError:
        return 0  # not created yet


def until(is_true: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not is_true():
        assert time.monotonic() < deadline, "too slow"
        time.sleep(0.05)


def test_second_driver_waits_for_the_first_and_repeats_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first stores a run meanwhile, and is killed, which releases its lock."""
    compiled = EXPERIMENT.replace("tests.agents.plain:Q_LEARNING", "q_learning")  # in threads
    (experiment := tmp_path / "compiled.toml").write_text(compiled, encoding="utf-8")
    runs = all_specifications(load_experiment(experiment))
    code = (
        "import sys; from pathlib import Path; from benchmark.execution.store import Store\n"
        "with Store(Path(sys.argv[1])) as store, store.alone():\n"
        "    print(flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "runs.db")]
    first = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert first.stdout is not None
    first.stdout.readline()

    def lock(file: TextIO, operation: int) -> None:
        if operation == fcntl.LOCK_EX:  # now the second has to wait
            with Store(tmp_path / "runs.db") as store:
                store.add(execute_job(runs[:1]))
            first.kill()
            first.communicate()
        flock(file, operation)

    flock = fcntl.flock
    monkeypatch.setattr(fcntl, "flock", lock)
    arguments = ["run", str(experiment), "--results", str(tmp_path), "--jobs", "1"]
    assert main(arguments) == 0
    said = capsys.readouterr()
    assert said.err.count("runs.db: waiting for another command that trains runs ...") == 1
    assert f"{len(runs) - 1} runs done, 1 were done already" in said.out
