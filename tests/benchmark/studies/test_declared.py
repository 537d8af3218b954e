"""What a comparison declares, what follows if it declares none, and what is refused."""

from pathlib import Path

import pytest

from benchmark.experiments import Experiment
from benchmark.studies import report_of
from benchmark.studies.comparison.declared import Plan, plan_of
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
CONTRAST = '["net, one_hot", "table, index"]'
TILES = 'algorithms.tiles = { algorithm = "linear_q_lambda", observations = ["coordinates"], seeds = 20 }\n'


def declared(tmp_path: Path, reporting: str = "", more: str = "") -> Experiment:
    return experiment_of(
        tmp_path / "mine.toml", f'{BASE}{more}\n[report]\nkind = "comparison"\n{reporting}\n'
    )


def plan(experiment: Experiment) -> Plan:
    return plan_of(experiment, report_of(experiment).check().declared)


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


def test_without_declaration_nets_have_to_beat_all_tables_and_linear_learners(tmp_path: Path) -> None:
    found = plan(declared(tmp_path, more=TILES))
    baselines = ["other, index", "table, index", "tiles, coordinates"]
    nets = ["net, one_hot", "net, coordinates"]  # without their references
    assert [*found.baseline] == baselines
    assert found.contrasts == tuple((x, y) for x in nets for y in baselines)
    assert (found.nets, {*found.drawn}) == (nets, {*baselines, *nets})


def test_a_baseline_may_be_of_any_family(tmp_path: Path) -> None:
    net, baselines = "net, one_hot", ["tiles, coordinates", "net, coordinates", "table, index"]
    pairs = [[net, baseline] for baseline in baselines] + [baselines[1:]]
    found = plan(declared(tmp_path, f"baseline = {baselines}\ncontrasts = {pairs}", TILES))
    assert found.nets == [net]  # a baseline need not beat others, even if it is deep
    assert found.drawn == [*baselines, net]


@pytest.mark.parametrize(
    ("reporting", "names"),
    [
        ('items = ["nowhere.to:be_found"]', ["nowhere.to:be_found"]),
        ('contrasts = [["net, one-hot", "table, index"]]', ["report.contrasts", "net, one-hot", "one_hot"]),
        ('contrasts = [["net, one_hot", "net, one_hot"]]', ["report.contrasts", "net, one_hot"]),
        (f'baseline = ["net_sb3, one_hot"]\ncontrasts = [{CONTRAST}]', ["baseline", "net_sb3, one_hot"]),
        (
            f'baseline = ["other, index", "table, index"]\ncontrasts = [{CONTRAST}]',
            ["report.contrasts", "net, one_hot", "other, index"],
        ),
        ("margins = { success = 0.0 }", ["margins.success", "0.0"]),
        (f"contrasts = [{CONTRAST}]\nlater = [{CONTRAST}]", ["report.contrasts, later: ", "is named twice"]),
    ],
)
def test_mistakes_get_one_sentence_before_any_run(tmp_path: Path, reporting: str, names: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        report_of(declared(tmp_path, reporting)).check()
    assert [name for name in ["mine.toml", *names] if name not in str(caught.value)] == []


@pytest.mark.parametrize(
    ("more", "word"),
    [
        ("algorithms.x = {} settings = {{ budget_unit = 'episodes' }} }}", "accepted: steps"),
        (
            "algorithms.x = {} settings = {{ budget = 400 }} }}",
            r"accepted: the same for all, not \[200, 400\]",
        ),
        ("grids.all.axes.noise = {{ 0 = {{}}, 1 = {{ settings.time_limit = 40 }} }}", "readings, grids: "),
    ],
)
def test_experiments_that_cannot_be_compared_are_refused(tmp_path: Path, more: str, word: str) -> None:
    table = '{ algorithm = "q_learning", observations = ["index"], seeds = 20,'
    with pytest.raises(InputError, match=word):
        report_of(declared(tmp_path, more=more.format(table))).check()
