"""A grid and a reading, declared in an experiment's file: their conditions and runs."""

from pathlib import Path

from benchmark.experiments import all_specifications
from tests.benchmark.studies.conftest import experiment_of
from tests.support import small_experiment, variant

PLAIN = small_experiment(
    stream="plain", settings={"learning_rate": 0.6, "budget": 200}, algorithms={"q_learning": variant()}
)
GRID = f"""
{PLAIN}
[grids.both]
scenario = {{ "rewards.other" = -0.05 }}

[grids.both.axes]
rate = {{ "0.6" = {{}}, "0.2" = {{ settings = {{ learning_rate = 0.2 }} }} }}
limit = {{ "20" = {{ settings = {{ time_limit = 20 }} }} }}
"""
READINGS = f"""
{PLAIN}
[readings.limit]
question = "Is there a longest episode?"
answer = "20 steps"
settings = {{ time_limit = 20 }}

[readings.default]
question = "Is there a longest episode?"
answer = "no"
"""


def test_conditions_are_the_points_of_a_grid(tmp_path: Path) -> None:
    found = {}
    for population in experiment_of(tmp_path / "grid.toml", GRID).populations:
        settings, scenario = population.first.settings.model_dump(), population.scenario
        values = settings["learning_rate"], settings["time_limit"], scenario.rewards.other
        found[population.condition.name] = values
    assert found == {"both/rate=0.6/limit=20": (0.6, 20, -0.05), "both/rate=0.2/limit=20": (0.2, 20, -0.05)}


def test_a_reading_adds_runs_and_keeps_those_of_the_experiment_without_it(tmp_path: Path) -> None:
    experiments = [experiment_of(tmp_path / "mine.toml", text) for text in (PLAIN, READINGS)]
    plain, runs = map(all_specifications, experiments)
    assert [run.condition for run in runs] == ["default", "limit"] * 2
    assert [run.digest for run in runs[::2]] == [run.digest for run in plain]
    assert [run.settings.time_limit for run in runs] == [None, 20] * 2
    assert len({run.folder for run in runs}) == len(runs)
