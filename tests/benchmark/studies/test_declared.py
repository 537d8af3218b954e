"""What a comparison declares, what follows if it declares none, and what is refused."""

from pathlib import Path

import pytest

from benchmark.experiments import Experiment
from benchmark.studies import report_of
from benchmark.studies.comparison.declared import (
    contrasts_of,
    decisive_learners,
    drawn_learners,
    effects_of,
    reporting_of,
    side_name,
)
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
grids.all.axes.noise = { high = {}, low = { settings = { time_limit = 40 } } }
"""
CONTRAST = '["net, one_hot", "table, index"]'


def declared(tmp_path: Path, reporting: str = "") -> Experiment:
    return experiment_of(tmp_path / "mine.toml", f'{BASE}\n[report]\nkind = "comparison"\n{reporting}\n')


NETS_OF_ONE = """
description = "Nets with and without hidden layers."
scenarios = ["S1"]
horizon = 50
evaluation_every = 100
map_every = 100
settings = { budget = 2048, policy_kwargs.net_arch = LAYERS }
algorithms.x = { algorithm = "ALGORITHM", observations = FORMS, seeds = 2 }
"""


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
    text = NETS_OF_ONE.replace("LAYERS", str(layers)).replace("ALGORITHM", algorithm)
    experiment = experiment_of(tmp_path / "nets.toml", text.replace("FORMS", str(forms)))
    assert {learner.family for learner in experiment.learners.values()} == {family}


def test_by_default_nets_are_compared_with_all_tables_and_linear_learners(tmp_path: Path) -> None:
    experiment = experiment_of(
        tmp_path / "mine.toml", f"{TILES}{BASE}{OTHER}"
    )  # `mine` does not say of what kind it is
    nets = ["net, one_hot", "net, coordinates"]  # a reference is no learner of its own
    reporting, baselines = reporting_of(experiment), ("tiles, coordinates", "other, index", "table, index")
    assert reporting.baseline == baselines
    assert decisive_learners(experiment) == nets
    assert contrasts_of(experiment) == [({"learner": x}, {"learner": y}) for x in nets for y in baselines]
    assert drawn_learners(experiment) == [*baselines, *nets, "mine, index"]
    assert experiment.learners["mine, index"].title == "mine on the cells' index"
    assert (reporting.margins.success, reporting.margins.score) == (0.1, 0.05)
    assert reporting.pool == "scenarios"


OTHER = (
    'algorithms.mine = { algorithm = "tests.agents.plain:Q_LEARNING", observations = ["index"], seeds = 2 }'
)
TILES = """
algorithms.tiles.algorithm = "tests.benchmark.studies.made:TILES"
algorithms.tiles.observations = ["coordinates"]
algorithms.tiles.seeds = 20
report.kind = "comparison"
"""


def test_a_baseline_may_be_of_any_family(tmp_path: Path) -> None:
    net, baselines = "net, one_hot", ["tiles, coordinates", "net, coordinates", "table, index"]
    pairs = [[net, baseline] for baseline in baselines] + [baselines[1:]]
    reporting = f"report.baseline = {baselines}\nreport.contrasts = {pairs}\n"
    experiment = experiment_of(tmp_path / "mine.toml", f"{TILES}{reporting}{BASE}")
    report_of(experiment)  # which checks it
    assert experiment.learners["tiles, coordinates"].title == "tiles on coordinates"
    assert decisive_learners(experiment) == [net]  # a baseline need not beat others, even if it is deep


@pytest.mark.parametrize("baseline", ['["table, index"]', '["table, index", "other, index"]'])
def test_sides_are_columns_with_values(tmp_path: Path, baseline: str) -> None:
    more = f"""
    baseline = {baseline}
    contrasts = [{CONTRAST}, ["net, one_hot", "other, index"],
                 ["S1 @ net, one_hot", "net, one_hot @ S2"],
                 ["default/all/noise=high", "default/all/noise=low"]]
    effects = [["S1", "S2", "size"]]
    """
    experiment = declared(tmp_path, more)
    net = {"learner": "net, one_hot"}
    contrasts = [
        (net, {"learner": "table, index"}),
        (net, {"learner": "other, index"}),
        (net | {"scenario": "S1"}, net | {"scenario": "S2"}),
        ({"condition": "default/all/noise=high"}, {"condition": "default/all/noise=low"}),
    ]
    assert contrasts_of(experiment) == contrasts
    assert effects_of(experiment) == [("size", ({"scenario": "S1"}, {"scenario": "S2"}))]
    assert decisive_learners(experiment) == ["net, one_hot"]
    assert side_name(contrasts[2][0]) == "net, one_hot @ S1"
    report_of(experiment)  # which checks it


@pytest.mark.parametrize(
    ("reporting", "names"),
    [
        ('omit = ["summery"]', ["report.omit", "summery", "summary"]),
        ('items = ["nowhere.to:be_found"]', ["nowhere.to:be_found"]),
        ('items = ["envs:ACTIONS"]', ["envs:ACTIONS"]),
        ('contrasts = [["net, one-hot", "table, index"]]', ["report.contrasts.0", "net, one-hot", "one_hot"]),
        ('effects = [["S1", "S4", "noise"]]', ["report.effects.0", "S4"]),
        ('contrasts = [["S1 @ S2", "S2 @ S1"]]', ["report.contrasts.0", "at most one scenario"]),
        ('contrasts = [["net, one_hot", "net, one_hot"]]', ["report.contrasts.0", "net, one_hot"]),
        ('contrasts = [["net, one_hot @ S1", "table, index"]]', ["report.contrasts.0"]),
        (f'baseline = ["net_sb3, one_hot"]\ncontrasts = [{CONTRAST}]', ["baseline net_sb3, one_hot"]),
        (
            f'baseline = ["net, one_hot"]\ncontrasts = [{CONTRAST}]',
            ["contrasts", '"LEARNER", "net, one_hot"'],
        ),
        (f'baseline = ["tables, index"]\ncontrasts = [{CONTRAST}]', ["report.baseline", "table, index"]),
        (f'baseline = ["other, index"]\ncontrasts = [{CONTRAST}]', ["report.contrasts", "other, index"]),
        ('baseline = ["table, index"]', ["report.contrasts", "table, index"]),
        ('baseline = ["table, index"]\ncontrasts = [["table, index", "net, one_hot"]]', ["contrasts"]),
        (f"baseline = 1\ncontrasts = [{CONTRAST}]", ["report.baseline"]),
        (
            f'baseline = ["other, index", "table, index"]\ncontrasts = [{CONTRAST}]',
            ["report.contrasts", "net, one_hot", "other, index"],
        ),
        ("margins = { success = 0.0 }", ["report.margins.success", "0.0"]),
        (
            'effects = [["net, one_hot @ S1", "table, index @ S1", "a"], '
            '["S1 @ table, index", "S1 @ net, one_hot", "b"]]',
            ["report.effects: ", "S1 @ net, one_hot and S1 @ table, index is named twice"],
        ),
        ('effects = [["S1", "S2", "a"], ["net, one_hot", "table, index", " a"]]', ["a is named twice"]),
        (f'baseline = ["table, index", "table, index"]\ncontrasts = [{CONTRAST}]', ["index is named twice"]),
    ],
)
def test_mistakes_get_one_sentence_before_any_run(tmp_path: Path, reporting: str, names: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        report_of(declared(tmp_path, reporting))
    assert [name for name in ["mine.toml", *names] if name not in str(caught.value)] == []


PLANNER = 'algorithms.search = { algorithm = "memoryless", observations = ["index"], seeds = 2 }'


@pytest.mark.parametrize(
    ("text", "word"),
    [
        (BASE.partition("algorithms.other")[0] + f'{PLANNER}\nreport = "comparison"', "planner"),
        (f'{BASE}{PLANNER}\n[report]\nkind = "comparison"\nbaseline = ["search, index"]', "baseline search"),
        (BASE.replace("200 }", '200, budget_unit = "episodes" }') + 'report = "comparison"', "budget_unit"),
        (BASE, r"report is missing; add a \[report\] table"),
    ],
)
def test_experiments_that_cannot_be_compared_are_refused(tmp_path: Path, text: str, word: str) -> None:
    with pytest.raises(InputError, match=word):
        report_of(experiment_of(tmp_path / "mine.toml", text))
