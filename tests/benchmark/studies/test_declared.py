"""What a comparison takes for a table or a net, and what it refuses."""

from pathlib import Path

import pytest

from benchmark.experiments import Experiment
from benchmark.studies import report_of
from envs import InputError
from tests.benchmark.studies.conftest import experiment_of

BASE = """
description = "Tables and nets."
scenarios = ["S1", "S2"]
horizon = 50
evaluation_every = 100
map_every = 100
settings = { budget = 200 }
algorithms.other = { algorithm = "q_learning", observations = ["index"], seeds = 20 }
algorithms.table = { algorithm = "q_learning", observations = ["index"], seeds = 20 }
algorithms.net = { algorithm = "compiled_dqn", observations = ["one_hot", "coordinates"], seeds = 20 }
algorithms.net_sb3 = { reference_for = "net", algorithm = "sb3_dqn", seeds = 20 }
"""


def declared(tmp_path: Path, reporting: str = "", more: str = "") -> Experiment:
    return experiment_of(
        tmp_path / "mine.toml", f'{BASE}{more}\n[report]\nkind = "comparison"\n{reporting}\n'
    )


@pytest.mark.parametrize(
    ("algorithm", "forms", "layers", "family"),
    [
        ("compiled_ppo", ["one_hot"], [8, 8], "deep"),
        ("compiled_ppo", ["one_hot", "offset_one_hot"], [], "tabular"),
        ("stable_baselines3:DQN", ["one_hot"], [], "tabular"),
        ("compiled_dqn", ["one_hot", "coordinates"], [], "deep"),
    ],
)
def test_a_net_without_hidden_layers_over_one_hot_cells_is_a_table(
    tmp_path: Path, algorithm: str, forms: list[str], layers: list[int], family: str
) -> None:
    settings = f"budget = 2048, policy_kwargs.net_arch = {layers}"
    net = f'algorithms.x = {{ algorithm = "{algorithm}", observations = {forms}, seeds = 2 }}\n'
    text = BASE.partition("algorithms.other")[0].replace("budget = 200", settings) + net
    experiment = experiment_of(tmp_path / "nets.toml", text)
    assert {learner.family for learner in experiment.learners.values()} == {family}


@pytest.mark.parametrize(
    ("reporting", "more", "names"),
    [
        ('items = ["nowhere.to:be_found"]', "", ["nowhere.to:be_found"]),
        ('contrasts = [["net, one-hot", "table, index"]]', "", ["contrasts", "net, one-hot", "one_hot"]),
        ('baseline = ["net_sb3, one_hot"]', "", ["baseline", "net_sb3, one_hot"]),
        ("", "algorithms.x = {} settings = {{ budget_unit = 'episodes' }} }}", ["budget_unit"]),
        ("", "algorithms.x = {} settings = {{ budget = 400 }} }}", ["budget", "the same for all"]),
        (
            "",
            "grids.all.axes.noise = {{ 0 = {{}}, 1 = {{ settings.time_limit = 40 }} }}",
            ["readings, grids"],
        ),
    ],
)
def test_what_cannot_be_compared_is_refused_before_any_run(
    tmp_path: Path, reporting: str, more: str, names: list[str]
) -> None:
    table = '{ algorithm = "q_learning", observations = ["index"], seeds = 20,'
    with pytest.raises(InputError) as caught:
        report_of(declared(tmp_path, reporting, more.format(table))).check()
    assert [name for name in ["mine.toml", *names] if name not in str(caught.value)] == []
