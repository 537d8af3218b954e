"""The display of an experiment's progress."""

import io

import numpy as np
import pytest
from rich.console import Console

from benchmark.execution.plan import plan
from benchmark.execution.progress import Display
from benchmark.execution.store import Record
from benchmark.experiments import (
    Condition,
    Experiment,
    RunSpecification,
    all_specifications,
    load_experiment,
)

COMPARED = load_experiment("compare_deep_smoke")
REPLICATION = load_experiment("reproduce_smoke")


def ended(run: RunSpecification, status: str = "done") -> Record:
    arrays = {"updates": np.array(400)} if status != "failed" else {}
    return Record(run.digest, "{}", status, {}, arrays)


def shown(display: Display) -> list[str]:
    """The lines of the display."""
    console = Console(width=110, color_system=None, file=io.StringIO())
    with console.capture() as capture:
        console.print(display)
    return capture.get().splitlines()


def table(experiment: Experiment) -> dict[str, list[str]]:
    """The rows of the display before the start."""
    lines = shown(Display(experiment, None, set(), plan(all_specifications(experiment))))[2:-2]
    split = [line.rsplit(maxsplit=len(experiment.scenarios)) for line in lines]
    return {row: entries for row, *entries in split}


@pytest.mark.parametrize("is_terminal", [True, False])
def test_progress_is_shown_as_a_table_or_as_a_line(is_terminal: bool) -> None:
    runs = all_specifications(COMPARED)
    file = io.StringIO()
    console = Console(file=file, force_terminal=is_terminal, width=110)
    display = Display(COMPARED, None, {runs[0].digest}, plan(runs[1:]), console)
    first, second = (run for run in runs if (run.arm, run.scenario.name) == ("dqn_sb3", "S2"))
    with display:
        display.start([first])
        display.start([second])
        display.advance([ended(first, "failed")])
        assert any(line.split()[-3:] == ["0/2", ">1", "!1"] for line in shown(display))
        display.advance([ended(second, "diverged")])
    lines = shown(display)
    assert lines[1].split() == ["S1", "S2"]
    rows = {" ".join(line.split()[:2]): line.split()[2:] for line in lines[2:]}
    assert rows["q_learning, index"] == ["1/4", "0/4"]
    assert rows["dqn_sb3, one_hot"] == ["0/2", "1/2", "!1"]
    assert "2 of 76 runs" in lines[-1]
    if is_terminal:
        assert "dqn_sb3, one_hot" in file.getvalue()
    else:
        assert file.getvalue().startswith("compare_deep_smoke: 2 of 76 runs, 1 failed, ")
        assert file.getvalue().count("\n") == 1


def test_readings_are_the_rows_of_a_replication() -> None:
    rows = table(REPLICATION)
    # The reading max_q measures the runs of the default one, and has none of its own.
    assert list(rows) == [name for name in REPLICATION.readings if name != "max_q"]
    assert rows["default"] == ["0/12"] * 3
    assert rows["equal_pay"] == ["0/6", "0/6", "-"]  # S3 pays as by default
    counts = [int(entry.split("/")[1]) for row in rows.values() for entry in row if entry != "-"]
    assert sum(counts) == len(all_specifications(REPLICATION))


@pytest.mark.parametrize("arms", [1, 2])
def test_rows_name_condition_and_learner_where_there_are_several(arms: int) -> None:
    algorithms = dict(list(COMPARED.algorithms.items())[:arms])
    one = COMPARED.model_copy(update={"algorithms": algorithms})
    assert list(table(one)) == [f"{name}, index" for name in algorithms]
    conditions = {"paper": Condition(), "low": Condition(settings={"budget": 200})}
    learners = [f", {name}, index" for name in algorithms] if arms > 1 else [""]
    expected = [f"default/budget={name}{learner}" for name in conditions for learner in learners]
    assert list(table(one.model_copy(update={"sweep": {"budget": conditions}}))) == expected
