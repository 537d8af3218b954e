"""Estimates of how long runs take, against costs that are planted, and the display of their progress."""

import io
import re
from pathlib import Path

import pytest
from rich.console import Console

from benchmark.execution.progress import Display, estimate
from benchmark.experiments import load_experiment
from benchmark.folder import write_manifest
from tests.support import specifications

COMPARED = load_experiment("compare_deep")
NETS = specifications(COMPARED, "default", "S1", "sb3_dqn", "one_hot", range(50))
TABLES = specifications(COMPARED, "default", "S1", "q_learning", "index")
COSTS = """variant,observation,runs,cpu_time_s
q_learning,index,100,1.0
sb3_dqn,one_hot,10,90.0
"""


def publish(folder: Path, costs: str = COSTS, **more: object) -> Path:
    """Publishes that 100 tables took a second of CPU time each, 10 nets 90, and all of them 2,000 s."""
    algorithms = {"q_learning": {"settings": {"index": 0}}, "sb3_dqn": {"settings": {"one_hot": 0}}}
    manifest = {"report": {"kind": ""}, "scenarios": {}, "algorithms": algorithms}
    folder.mkdir(exist_ok=True)
    if costs:
        (folder / "cost.csv").write_text(costs, encoding="utf-8")
    write_manifest(folder, manifest | {"busy_time_s": 2000.0, "runs": 110} | more)
    return folder


def test_runs_share_the_time_of_published_ones_by_cpu_time_or_else_equally(tmp_path: Path) -> None:
    folder = publish(tmp_path / "by_cpu_time")
    text, costs = estimate([*NETS, *TABLES], folder, 2)
    assert [costs[NETS[0].digest], costs[TABLES[0].digest]] == pytest.approx([180, 2])
    assert text == f"about 77 minutes with 2 workers, if as fast as for the results in {folder}"
    assert estimate(NETS[:4], folder, 64)[0].startswith("about 3 minutes with 64 workers, if ")
    assert sum(estimate(NETS[:1], publish(tmp_path / "equal", ""), 2)[1].values()) == 2000 / 110


def test_the_time_of_learners_without_results_is_unknown(tmp_path: Path) -> None:
    text, costs = estimate(NETS[:2], tmp_path / "none", 2)
    assert text == f"for an unknown time: {tmp_path / 'none'} has no results of these learners"
    assert [*costs.values()] == [1, 1]


@pytest.mark.parametrize("is_terminal", [True, False])
def test_runs_are_counted_in_a_bar_or_in_occasional_lines(
    is_terminal: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr("benchmark.execution.progress.time.monotonic", lambda: now[0])
    console = Console(file=(file := io.StringIO()), force_terminal=is_terminal, width=110, color_system=None)
    monkeypatch.setattr("benchmark.execution.progress.Console", lambda **_: console)
    with Display("mine", {"slow": 9000.0, "failing": 500.0, "quick": 500.0}, 1233) as display:
        display._progress.refresh()
        now[0] = 20.0
        display.advance(["failing"], 1)
        now[0] = 300.0
        display.advance(["quick"])
        now[0] = 1500.0  # nothing has ended since
    lines = [" ".join(re.sub("[━╸╺]", "", line).split()) for line in file.getvalue().splitlines()]
    before = "mine: 1,234 of 1,236 done, 1 failed, about 45 minutes left"  # a tenth has taken 300 s
    last = before.replace("45", "25")
    if is_terminal:
        assert "mine 1,233 of 1,236 done" in "".join(lines)
        assert last.replace(":", "") in "".join(lines[-2:])
    else:
        assert lines == [before, last]
