"""The command `report`: the folder that it writes."""

from dataclasses import replace

import pytest

from benchmark.commands import parse_seeds
from benchmark.commands.report import folder_name, other_seeds
from benchmark.experiments import Experiment, load_experiment

FIRST, *_ = load_experiment("reproduce").populations


def with_seeds(*ranges: range) -> Experiment:
    """Returns the experiment with a population for each of these ranges of seeds."""
    populations = [replace(FIRST, seeds=seeds) for seeds in ranges]
    return replace(load_experiment("reproduce"), populations=populations)


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
    given: str | None, partial: bool, name: str
) -> None:
    experiment = with_seeds(range(100))
    seeds = other_seeds(experiment, parse_seeds(given))
    assert folder_name(experiment, seeds, partial=partial) == name


def test_seeds_are_the_declared_ones_only_if_they_are_those_of_every_variant() -> None:
    own, other = range(100), range(100, 200)
    for ranges, declared in (([other], "100-199"), ([own, own], "0-99"), ([own, other], None)):
        experiment = with_seeds(*ranges)
        for text in ("0-99", "100-199", "0-199"):
            seeds = parse_seeds(text)
            assert other_seeds(experiment, seeds) == (None if text == declared else seeds)
