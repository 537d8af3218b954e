"""The command `report`: the folder that it writes."""

from pathlib import Path

import pytest

from benchmark.commands import parse_seeds
from benchmark.commands.report import folder_name, other_seeds
from benchmark.experiments import load_experiment
from tests.benchmark.studies.conftest import experiment_of


@pytest.mark.parametrize(
    ("given", "partial", "name"),
    [
        (None, False, "ablation"),
        ("0-99", False, "ablation"),
        ("100-199", False, "ablation_seeds_100-199"),
        ("7", False, "ablation_seeds_7"),
        ("0-99", True, "ablation_partial"),
        ("0-9", True, "ablation_seeds_0-9_partial"),
    ],
)
def test_other_seeds_than_the_declared_ones_have_a_folder_of_their_own(
    given: str | None, partial: bool, name: str
) -> None:
    experiment = load_experiment("ablation")
    seeds = other_seeds(experiment, parse_seeds(given))
    assert folder_name(experiment, seeds, partial=partial) == name


def test_seeds_are_the_declared_ones_only_if_they_are_those_of_every_variant(tmp_path: Path) -> None:
    variant = next(iter(load_experiment("ablation").declared.algorithms))
    change = f'changes = {{ "algorithms.{variant}.first_seed" = 100 }}'
    experiment = experiment_of(tmp_path / "mine.toml", f'extends = "ablation"\ndescription = ""\n{change}')
    for text in ("0-99", "100-199", "0-199"):
        assert other_seeds(experiment, parse_seeds(text)) == parse_seeds(text)
