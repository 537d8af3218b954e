"""The command `report`: the folder that it writes."""

from pathlib import Path

import pytest

from benchmark.commands import parse_seeds
from benchmark.commands.report import folder_name, other_seeds
from tests.benchmark.studies.conftest import experiment_of

EXPERIMENT = """
description = "Two tables."
scenarios = ["S1"]
horizon = 200
evaluation_every = 200
map_every = 200
settings = { budget = 200 }
algorithms.one = { algorithm = "q_learning", observations = ["index"], seeds = 100 }
algorithms.two = { algorithm = "sarsa", observations = ["index"], seeds = 100 }
"""


@pytest.mark.parametrize(
    ("given", "partial", "name"),
    [
        (None, False, "mine"),
        ("0-99", False, "mine"),
        ("0-9", False, "mine_seeds_0-9"),
        ("100-199", False, "mine_seeds_100-199"),
        ("7", False, "mine_seeds_7"),
        ("0-99", True, "mine_partial"),
        ("0-9", True, "mine_seeds_0-9_partial"),
    ],
)
def test_other_seeds_than_the_declared_ones_have_a_folder_of_their_own(
    given: str | None, partial: bool, name: str, tmp_path: Path
) -> None:
    experiment = experiment_of(tmp_path / "mine.toml", EXPERIMENT)
    seeds = other_seeds(experiment, parse_seeds(given))
    assert folder_name(experiment, seeds, partial=partial) == name


def test_seeds_are_the_declared_ones_only_if_they_are_those_of_every_variant(tmp_path: Path) -> None:
    mixed = EXPERIMENT.replace(
        "seeds = 100 }\nalgorithms.two", "seeds = 100, first_seed = 100 }\nalgorithms.two"
    )
    experiment = experiment_of(tmp_path / "mine.toml", mixed)
    for text in ("0-99", "100-199", "0-199"):
        assert other_seeds(experiment, parse_seeds(text)) == parse_seeds(text)
