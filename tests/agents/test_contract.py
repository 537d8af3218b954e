"""The contract between algorithms and the rest of the project."""

from dataclasses import fields, replace
from typing import Any

import pytest
from numpy.random import SeedSequence
from numpy.typing import NDArray

from agents import Schedule, Training, check_training, load_algorithm
from agents.tabular.learner import Q_LEARNING, Settings
from envs import InputError, ProxemicEnv

MODEL = ProxemicEnv().model  # 120 observations, 5 actions
SCHEDULE = Schedule(30, (0, 10, 30), (0, 30))
SETTINGS = Settings(budget=30)
SEEDS = [SeedSequence(0), SeedSequence(1)]
TRAINING = Q_LEARNING.train(MODEL, SETTINGS, "index", SEEDS, SCHEDULE)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("q_lerning", r"mine.toml: unknown algorithm q_lerning \(did you mean q_learning\?\)"),
        (
            "agents.policy:mask_polcy",
            r"no attribute 'mask_polcy' \(did you mean mask_policy\?\)\.$",
        ),
        ("agents.policy:mask_policy", "is not an algorithm"),
    ],
)
def test_wrong_names_get_a_sentence(name: str, expected: str) -> None:
    with pytest.raises(InputError, match=expected) as refusal:
        load_algorithm(name, "mine.toml")
    assert "pip" not in str(refusal.value)  # it would install whatever has the misspelt name


@pytest.mark.parametrize("name", [field.name for field in fields(Training)])
def test_fields_of_other_shapes_are_refused(name: str) -> None:
    check_training(TRAINING, MODEL, 2, SCHEDULE)
    array: NDArray[Any] = getattr(TRAINING, name)
    for wrong in (array[:1], array[..., :1][..., None]):
        with pytest.raises(ValueError, match=f"{name}: shape .* accepted: "):
            check_training(replace(TRAINING, **{name: wrong}), MODEL, 2, SCHEDULE)
