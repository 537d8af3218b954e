"""The command `report`: the folder that it writes."""

from pathlib import Path

import pytest

from benchmark.commands import parse_seeds
from benchmark.commands.report import folder_name, other_seeds
from tests.benchmark.studies.conftest import experiment_of
from tests.support import small_experiment, variant


@pytest.mark.parametrize(
    ("given", "name"),
    [(None, "mine"), ("0-99", "mine"), ("100-199", "mine_seeds_100-199"), ("7", "mine_seeds_7")],
)
def test_other_seeds_than_the_declared_ones_have_a_folder_of_their_own(
    given: str | None, name: str, tmp_path: Path
) -> None:
    text = small_experiment(algorithms={"table": variant(seeds=100)})
    experiment = experiment_of(tmp_path / "mine.toml", text)
    seeds = other_seeds(experiment, parse_seeds(given))
    assert folder_name(experiment, seeds) == name


def test_seeds_are_the_declared_ones_only_if_they_are_those_of_every_variant(tmp_path: Path) -> None:
    variants = {"one": variant(seeds=100), "two": variant(seeds=100, first_seed=100)}
    experiment = experiment_of(tmp_path / "mine.toml", small_experiment(algorithms=variants))
    for text in ("0-99", "100-199", "0-199"):
        assert other_seeds(experiment, parse_seeds(text)) == parse_seeds(text)
