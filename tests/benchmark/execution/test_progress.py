"""The display of an experiment's progress."""

import io

import numpy as np
import pytest
from rich.console import Console

from benchmark.execution.plan import Job, plan
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


def shown(display: Display, width: int = 110) -> list[str]:
    """The lines of the display."""
    console = Console(width=width, color_system=None, file=io.StringIO())
    with console.capture() as capture:
        console.print(display)
    return capture.get().splitlines()


def table(experiment: Experiment) -> dict[str, list[str]]:
    """The rows of the display before the start."""
    runs = all_specifications(experiment)
    lines = shown(Display(experiment, None, set(), plan(runs)))[2:-2]
    split = [line.rsplit(maxsplit=len(experiment.scenarios)) for line in lines]
    return {row: entries for row, *entries in split}


def jobs_of(arm: str, observation: str, scenario: str) -> list[Job]:
    return [
        job
        for job in plan(all_specifications(COMPARED))
        if (job[0].arm, job[0].observation, job[0].scenario.name) == (arm, observation, scenario)
    ]


def test_table_shows_what_is_done_running_and_failed() -> None:
    runs = all_specifications(COMPARED)
    screen = io.StringIO()
    console = Console(file=screen, force_terminal=True, width=110)
    display = Display(COMPARED, None, {runs[0].digest}, plan(runs[1:]), console)
    (first,), (second,) = jobs_of("dqn_sb3", "one_hot", "S2")
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
    assert "dqn_sb3, one_hot" in screen.getvalue()


def test_output_that_is_no_terminal_gets_a_line() -> None:
    runs = all_specifications(COMPARED)
    file = io.StringIO()
    display = Display(COMPARED, None, {runs[0].digest}, plan(runs[1:]), Console(file=file, width=200))
    job = plan(runs[1:])[0]
    with display:
        display.start(job)
        display.advance([ended(run) for run in job])
    assert file.getvalue().startswith(f"compare_deep_smoke: {1 + len(job)} of 76 runs, ")
    assert "updates/s" in file.getvalue()
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
    conditions = {"paper": Condition(), "low": Condition(settings={"budget": 200})}
    algorithms = dict(list(COMPARED.algorithms.items())[:arms])
    changes = {"algorithms": algorithms, "sweep": {"budget": conditions}}
    swept = COMPARED.model_copy(update=changes)
    learners = [f", {name}, index" for name in algorithms] if arms > 1 else [""]
    expected = [f"default/budget={name}{learner}" for name in conditions for learner in learners]
    assert list(table(swept)) == expected


def test_one_population_is_named_after_its_learner() -> None:
    algorithms = {"q_learning": COMPARED.algorithms["q_learning"]}
    assert list(table(COMPARED.model_copy(update={"algorithms": algorithms}))) == ["q_learning, index"]
