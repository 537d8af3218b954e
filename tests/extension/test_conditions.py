"""A sweep, declared in an experiment's file: its conditions, its runs and their records."""

from pathlib import Path

import pytest

from benchmark.experiments import Experiment, all_specifications
from tests.benchmark.reports.conftest import experiment_of

UNSWEPT = """
description = "A table in S1 and S3."
scenarios = ["S1", "S3"]
horizon = 200
evaluation_every = 100
map_every = 200
settings = { learning_rate = 0.6, budget = 200 }
algorithms.q_learning = { algorithm = "q_learning", observations = ["index"], seeds = 3 }
"""

SWEPT = f"""
stream = "unswept"
{UNSWEPT}
[readings.default]
question = "Is there a longest episode?"
answer = "no"

[readings.time_limit]
question = "Is there a longest episode?"
answer = "20 steps"
settings = {{ time_limit = 20 }}

[sweep]
learning_rate = {{ paper = {{}}, low = {{ settings = {{ learning_rate = 0.2 }} }} }}
cost = {{ paper = {{}}, half = {{ scenarios = ["S1"], scenario = {{ "rewards.other" = -0.05 }} }} }}
"""


@pytest.fixture
def experiments(tmp_path: Path) -> tuple[Experiment, Experiment]:
    """The experiment without its sweep, and with it."""
    return experiment_of(tmp_path / "unswept.toml", UNSWEPT), experiment_of(tmp_path / "swept.toml", SWEPT)


def test_conditions_are_the_product_of_readings_and_axes(experiments: tuple[Experiment, Experiment]) -> None:
    _, swept = experiments
    assert list(swept.conditions) == [
        f"{reading}/learning_rate={rate}/cost={cost}"
        for reading in ("default", "time_limit")
        for rate in ("paper", "low")
        for cost in ("paper", "half")
    ]
    values = {}
    for population in swept.populations:
        first = population.runs()[0]
        assert [run.seed for run in population.runs()] == [0, 1, 2]
        settings, cost = first.settings.model_dump(), first.scenario.rewards.other
        names = population.condition.name, population.scenario.name
        values[names] = settings["learning_rate"], settings["time_limit"], cost
    assert values["default/learning_rate=paper/cost=paper", "S1"] == (0.6, None, -0.1)
    assert values["default/learning_rate=low/cost=half", "S1"] == (0.2, None, -0.05)
    assert values["time_limit/learning_rate=low/cost=half", "S1"] == (0.2, 20, -0.05)
    assert values["time_limit/learning_rate=paper/cost=half", "S3"] == (0.6, 20, -0.1)  # not in S3


def test_sweep_keeps_the_runs_of_the_experiment_without_it(
    experiments: tuple[Experiment, Experiment],
) -> None:
    plain, swept = (all_specifications(experiment) for experiment in experiments)
    # Two readings and two learning rates in both scenarios; two costs in S1 alone.
    assert len(swept) == len({run.digest for run in swept}) == 2 * 2 * 3 * (2 + 1)
    unchanged = [run for run in swept if run.condition == "default/learning_rate=paper/cost=paper"]
    assert [run.digest for run in unchanged] == [run.digest for run in plain]
    assert len({run.folder for run in swept}) == len(swept)
