"""A grid, declared in an experiment's file: its conditions, its runs and their records."""

from pathlib import Path

from agents.tabular.learner import Q_LEARNING as Q_LEARNING
from benchmark.__main__ import main
from benchmark.experiments import all_specifications
from tests.benchmark.studies.conftest import experiment_of
from tests.support import small_experiment, variant

PLAIN = small_experiment(
    scenarios=["S1", "S3"],
    horizon=200,
    settings={"learning_rate": 0.6, "budget": 200},
    algorithms={"q_learning": variant(seeds=3)},
)
GRID = f"""
stream = "plain"
{PLAIN}
[readings.default]
question = "Is there a longest episode?"
answer = "no"

[readings.time_limit]
question = "Is there a longest episode?"
answer = "20 steps"
settings = {{ time_limit = 20 }}

[grids.both.axes]
learning_rate = {{ paper = {{}}, "0.2" = {{ settings = {{ learning_rate = 0.2 }} }} }}
cost = {{ paper = {{}}, half = {{ scenarios = ["S1"], scenario = {{ "rewards.other" = -0.05 }} }} }}
"""


def test_conditions_are_the_product_of_readings_and_axes(tmp_path: Path) -> None:
    grid = experiment_of(tmp_path / "grid.toml", GRID)
    assert list(grid.conditions) == [
        f"{reading}/both/learning_rate={rate}/cost={cost}"
        for reading in ("default", "time_limit")
        for rate in ("paper", "0.2")
        for cost in ("paper", "half")
    ]
    values = {}
    for population in grid.populations:
        first = population.runs()[0]
        assert [run.seed for run in population.runs()] == [0, 1, 2]
        settings, cost = first.settings.model_dump(), first.scenario.rewards.other
        names = population.condition.name, population.scenario.name
        values[names] = settings["learning_rate"], settings["time_limit"], cost
    assert values["default/both/learning_rate=paper/cost=paper", "S1"] == (0.6, None, -0.1)
    assert values["default/both/learning_rate=0.2/cost=half", "S1"] == (0.2, None, -0.05)
    assert values["time_limit/both/learning_rate=0.2/cost=half", "S1"] == (0.2, 20, -0.05)
    assert values["time_limit/both/learning_rate=paper/cost=half", "S3"] == (0.6, 20, -0.1)  # not in S3


def test_a_grid_keeps_the_runs_of_the_experiment_without_it(tmp_path: Path) -> None:
    texts = {"plain": PLAIN, "grid": GRID}
    experiments = [experiment_of(tmp_path / f"{name}.toml", text) for name, text in texts.items()]
    plain, grid = map(all_specifications, experiments)
    # Two readings and two learning rates in both scenarios; two costs in S1 alone.
    assert len(grid) == len({run.digest for run in grid}) == 2 * 2 * 3 * (2 + 1)
    unchanged = [run for run in grid if run.condition == "default/both/learning_rate=paper/cost=paper"]
    assert [run.digest for run in unchanged] == [run.digest for run in plain]
    assert len({run.folder for run in grid}) == len(grid)


def test_a_readme_says_which_settings_vary_and_what_is_from_outside(tmp_path: Path) -> None:
    path, outside = tmp_path / "grid.toml", GRID.replace('"q_learning",', f'"{__name__}:Q_LEARNING",')
    path.write_text(f'report = "comparison"\n{outside}', encoding="utf-8")
    assert main(["run", str(path), "--results", str(tmp_path / "results"), "--report"]) == 0
    text = " ".join((tmp_path / "results" / "grid" / "README.md").read_text("utf-8").split())
    assert (
        "declared; `learning_rate` changed in the grid `both`; `time_limit` changed in the reading `t" in text
    )
    assert "if what is not this project's (`q_learning`) draws every random number from its seed" in text
