"""Estimates of what runs cost, against costs that are planted."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmark.execution.calibration import estimate
from benchmark.execution.store import Record
from benchmark.experiments import RunSpecification, all_specifications, load_experiment
from tests.support import ROOT, specifications


def record(run: RunSpecification, seconds: float, peak_mb: float) -> Record:
    measured = {"wall_time_s": seconds, "peak_memory_mb": peak_mb}
    return Record(run.digest, run.content, "done", measured, {"greedy": np.zeros(4, np.uint8)})


COMPARED = load_experiment("compare_deep")
# A hundred runs, a job each
NETS = specifications(COMPARED, "default", "S1", "sb3_dqn", "one_hot", range(100))
TABLES = specifications(COMPARED, "default", "S1", "q_learning", "index")
MADE = """variant,observation,runs,cpu_time_s
q_learning,index,100,1.0
sb3_dqn,one_hot,10,90.0
"""


def publish(folder: Path, costs: str = MADE, **more: object) -> Path:
    """Publishes that 100 tables took a second of CPU time each, 10 nets 90, and all of them 2,000 s."""
    algorithms = {"q_learning": {"settings": {"index": 0}}, "sb3_dqn": {"settings": {"one_hot": 0}}}
    manifest = {"busy_time_s": 2000.0, "runs": 110, "algorithms": algorithms} | more
    folder.mkdir(exist_ok=True)
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    if costs:
        (folder / "cost.csv").write_text(costs, encoding="utf-8")
    return folder


def test_runs_share_the_time_of_published_ones_by_cpu_time(tmp_path: Path) -> None:
    text, time_s, costs = estimate([*NETS[50:], *TABLES], publish(tmp_path), 2)
    assert [costs[NETS[50].digest], costs[TABLES[0].digest]] == pytest.approx([180, 2])
    assert time_s == pytest.approx(50 * 180 / 2 + 100 * 2 / 2)
    assert text == f"about 77 minutes with 2 workers, if as fast as for the results in {tmp_path}"
    assert estimate(NETS[:4], tmp_path, 64).time_s == pytest.approx(180)  # no job is shorter than its run
    assert estimate(NETS[:1], tmp_path, 1).text.startswith("about 3 minutes with 1 worker, if ")


def test_without_a_table_of_costs_runs_are_alike_and_unknown_learners_are_named(tmp_path: Path) -> None:
    assert estimate(NETS[:1], publish(tmp_path, ""), 2).time_s == pytest.approx(2000 / 110)
    publish(tmp_path, "", algorithms={"q_learning": {"settings": {"index": {}}}})
    for folder, what in ((tmp_path, "sb3_dqn"), (tmp_path / "none", "this experiment")):
        text, time_s, costs = estimate(NETS[:2], folder, 2)
        assert text == f"for an unknown time: there are no results of {what} yet"
        assert (time_s, [*costs.values()]) == (0, [1, 1])


@pytest.mark.parametrize("name", ["ablation", "compare_deep", "equivalence", "reproduce"])
def test_costs_of_published_results_add_up(name: str) -> None:
    folder = ROOT / "results" / name
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    missing = all_specifications(load_experiment(name))
    assert sum(estimate(missing, folder, 2).costs.values()) == pytest.approx(
        manifest["busy_time_s"], rel=0.01
    )
