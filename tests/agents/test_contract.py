"""The contract between algorithms and the rest of the project."""

from dataclasses import fields, replace
from typing import Any

import pytest
from numpy.random import SeedSequence
from numpy.typing import NDArray

from agents import Schedule, Training, check_training, load_algorithm
from agents.people import PEOPLE_EXTRACTOR
from agents.tabular.learner import Q_LEARNING, Settings
from envs import InputError, ProxemicEnv
from envs.inputs import parse
from tests.agents import Changes

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


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("q_learning", {"epsilon": 0, "budget_unit": "episodes"}, "epsilon = 0"),
        ("q_learning", {"trace_decay": 0.5}, "unknown key trace_decay"),
        ("watkins_q_lambda", {"backward_passes": 2}, "= 2 needs time_limit <= 10,000,000"),
        ("linear_q_lambda", {"tile_width": 0}, "tile_width = 0"),
        ("sb3_ppo", {"n_steps": 2048}, "budget = 10000 is not .* 2048 steps .*; accepted: a multi"),
        ("sb3_dqn", {"exploration_fraction": 0.0}, "exploration_fraction = 0.0"),
        ("sb3_ppo", {"policy_kwargs": {"net_arc": [5]}}, r"did you mean net_arch\?"),
        ("compiled_dqn", {"policy_kwargs": {"features_extractor_class": "a:B"}},
         "policy_kwargs.features_extractor_class: accepted: .* sb3_dqn or sb3_ppo"),
        ("compiled_dqn", {"policy_kwargs": {"features_extractor_class": PEOPLE_EXTRACTOR,
         "features_extractor_kwargs": {"breadth": 5}}}, "unknown key breadth; accepted: "),
        ("stable_baselines3:PPO",
         {"policy_kwargs": {"features_extractor_class": "torch.nn:Linear"}},
         "PPO cannot be trained: policy_kwargs: features_extractor_class torch.nn:Linear: accept"),
    ],
)  # fmt: skip
def test_settings_that_cannot_be_are_refused(name: str, values: Changes, expected: str) -> None:
    with pytest.raises(InputError, match=f"^mine.toml: .*{expected}"):
        parse(load_algorithm(name).settings, values, "mine.toml")


@pytest.mark.parametrize("name", [field.name for field in fields(Training)])
def test_fields_of_other_shapes_are_refused(name: str) -> None:
    check_training(TRAINING, MODEL, 2, SCHEDULE)
    array: NDArray[Any] = getattr(TRAINING, name)
    for wrong in (array[:1], array[..., :1][..., None]):
        with pytest.raises(ValueError, match=f"{name}: shape .* accepted: "):
            check_training(replace(TRAINING, **{name: wrong}), MODEL, 2, SCHEDULE)
