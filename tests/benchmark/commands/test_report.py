"""The command `report`: the folder that it writes."""

import pytest

from benchmark.commands import parse_seeds
from benchmark.commands.report import folder_name, other_seeds
from benchmark.experiments import load_experiment

DECLARED = load_experiment("reproduce")
(VARIANT,) = (
    variant.model_copy(update={"seeds": 100, "first_seed": 0}) for variant in DECLARED.algorithms.values()
)
DEFAULT = {"default": DECLARED.readings["default"].model_copy(update={"seeds": None})}
REPRODUCE = DECLARED.model_copy(update={"algorithms": {"q_learning": VARIANT}, "readings": DEFAULT})


@pytest.mark.parametrize(
    ("given", "partial", "name"),
    [
        (None, False, "reproduce"),
        ("0-99", False, "reproduce"),
        ("0-9", False, "reproduce_seeds_0-9"),
        ("100-199", False, "reproduce_seeds_100-199"),
        ("7", False, "reproduce_seeds_7"),
        ("0-99", True, "reproduce_partial"),
        ("0-9", True, "reproduce_seeds_0-9_partial"),
    ],
)
def test_other_seeds_than_the_declared_ones_have_a_folder_of_their_own(
    given: str | None, partial: bool, name: str
) -> None:
    seeds = other_seeds(REPRODUCE, parse_seeds(given))
    assert folder_name(REPRODUCE, seeds, partial=partial) == name


def test_seeds_are_the_declared_ones_only_if_they_are_those_of_every_variant() -> None:
    other = VARIANT.model_copy(update={"first_seed": 100})
    for variants, declared in (([other], "100-199"), ([VARIANT, VARIANT], "0-99"), ([VARIANT, other], None)):
        algorithms = {str(i): variant for i, variant in enumerate(variants)}
        experiment = REPRODUCE.model_copy(update={"algorithms": algorithms})
        for text in ("0-99", "100-199", "0-199"):
            seeds = parse_seeds(text)
            assert other_seeds(experiment, seeds) == (None if text == declared else seeds)
