"""Estimates of what runs cost, against costs that are planted."""

from pathlib import Path

import numpy as np
import pytest

from benchmark.execution.calibration import DOUBT, estimate
from benchmark.execution.provenance import machine
from benchmark.execution.store import Record, Store
from benchmark.experiments import RunSpecification, load_experiment
from tests.support import specifications


def record(run: RunSpecification, seconds: float, peak_mb: float, where: str = "") -> Record:
    measured = {"wall_time_s": seconds, "peak_memory_mb": peak_mb, "machine": where or machine()}
    return Record(run.digest, run.content, "done", measured, {"greedy": np.zeros(4, np.uint8)})


COMPARED = load_experiment("compare_deep")
# A hundred runs, a job each
NETS = specifications(COMPARED, "default", "S1", "dqn_sb3", "one_hot", range(100))
TABLES = specifications(COMPARED, "default", "S1", "q_learning", "index")


def test_stored_runs_of_such_a_machine_are_believed(tmp_path: Path) -> None:
    with Store(tmp_path / "runs.db") as store:
        store.add(record(run, 3.0, 450.0) for run in NETS[:25])
        store.add([record(NETS[25], 1e6, 450.0, "another machine")])
        store.add([record(NETS[26], 3.0, 500.0)])
        estimated = estimate([*NETS, *TABLES], [*NETS[50:], *TABLES], store, 2, 2)
        few = estimate(NETS, NETS[98:], store, jobs=64, cores=2)
    assert estimated.seconds == pytest.approx((75 / DOUBT, 75 * DOUBT))
    assert estimated.size == 50 * NETS[0].record_size + len(TABLES) * TABLES[0].record_size
    assert few.seconds == pytest.approx((3 / DOUBT, 3 * DOUBT))
    for cost in (estimated, few):  # two jobs, each in a process of its own
        assert (cost.peak_memory, cost.known) == (2 * 500 * 2**20, 1)
    assert (estimated.unknown, few.unknown) == (["q_learning"], [])
