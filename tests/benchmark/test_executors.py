"""Worker processes: nothing is lost or repeated when they, or their driver, are killed."""

import multiprocessing
import os
import threading
from pathlib import Path

import llvmlite.binding
import pytest

from benchmark.executors import Threads
from benchmark.run import execute, pending
from benchmark.store import Store
from tests.support import SLOW_EXPERIMENT, all_specifications, made, until


def test_killed_worker_costs_its_run_alone_and_is_tried_again(tmp_path: Path) -> None:
    def kill() -> None:
        until(multiprocessing.active_children)
        multiprocessing.active_children()[0].kill()

    runs = all_specifications(made(tmp_path / "mine.toml", SLOW_EXPERIMENT))

    with Store(tmp_path / "runs.db") as store:
        killer = threading.Thread(target=kill)
        killer.start()
        (error,) = execute(runs, store, 2)
        killer.join()
        assert "signal 9" in error
        statuses = store.statuses()
        (failed,) = (run for run in runs if statuses[run.digest] == "failed")
        assert store.get([failed.digest])[0].error == error
        assert pending(runs, store) == [failed]
        assert execute(runs, store, 1, executor=Threads(1)) == []
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
    text = SLOW_EXPERIMENT.replace("tests.agents.plain:Q_LEARNING", "asking_for_variables:ASKING")
    text = text.replace("seeds = 8", "seeds = 1")
    (asked,) = all_specifications(made(tmp_path / "asking.toml", text))
    with Store(tmp_path / "runs.db") as store:
        assert execute([asked], store, 1) == ["ValueError: ['AVX2', 'avx2']"]
    assert "MKL_CBWR" not in os.environ
