"""Classes like those of Stable-Baselines3 by their import path, and models that they have saved."""

import inspect
import subprocess
import sys
from typing import Any

import pytest
from numpy.random import SeedSequence
from stable_baselines3 import A2C, DQN

from agents import Schedule, Training, load_algorithm
from envs import InputError, Model, compile_scenario, load_scenario
from envs.inputs import parse
from tests.support import ROOT

HERE = __name__
S1 = compile_scenario(load_scenario("S1"))


def settings_of(path: str, **values: Any) -> Any:
    return parse(load_algorithm(path, "mine.toml").settings, values, "mine.toml")


def trained(path: str, model: Model = S1, observation: str = "one_hot", **values: Any) -> Training:
    settings = settings_of(path, **({"budget": 400, "time_limit": 50} | values))
    schedule = Schedule(
        settings.budget, (0, settings.budget // 2, settings.budget), (0, settings.budget)
    )
    return load_algorithm(path).train(
        model, settings, observation, [SeedSequence([5, 0])], schedule
    )


# Classes that users could write


class Stepwise(DQN):
    """Has arguments of its own and passes the others on."""

    def __init__(
        self, *args: Any, warm_up: int = 50, schedule: Any = lambda x: x, **kwargs: Any
    ) -> None:
        self.warm_up, self.schedule = warm_up, schedule
        super().__init__(*args, **kwargs)


class Hidden(A2C):
    """Passes another number of steps than its signature says."""

    def __init__(self, policy: Any, env: Any, n_steps: int = 5, **kwargs: Any) -> None:
        super().__init__(policy, env, n_steps=2 * n_steps, **kwargs)


# Training


def test_steps_that_are_not_those_declared_are_an_error() -> None:
    with pytest.raises(
        InputError, match="Hidden: a rollout began after 10 steps; accepted: after 5"
    ):
        trained(f"{HERE}:Hidden")


# Settings


@pytest.mark.parametrize("path", ["stable_baselines3:DQN", "sb3_contrib:TRPO"])
def test_defaults_are_the_classs_and_part_of_the_identity(path: str) -> None:
    algorithm: Any = load_algorithm(path)
    signature = inspect.signature(algorithm.load().__init__).parameters
    settings = settings_of(path, budget=10_240)
    written = settings.model_dump(mode="json")
    for key in written.keys() & signature.keys() - {"policy_kwargs"}:
        assert written[key] == signature[key].default, key
    assert settings.discount_factor == 0.99


def test_arguments_that_are_passed_on_are_settings_too() -> None:
    settings = settings_of(f"{HERE}:Stepwise", warm_up=70, train_freq=8)
    assert settings.arguments == {"warm_up": 70, "train_freq": 8, "buffer_size": 10_000}
    assert settings.rollout == 8
    written = settings_of(f"{HERE}:Stepwise").model_dump(mode="json")
    # a function: the class's own default
    assert (written["warm_up"], written["schedule"]) == (50, None)


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        (
            "stable_baselines3:A2C",
            {"learning_rat": 1.0},
            r"learning_rat \(did you mean learning_rate\?\)",
        ),
        (
            "stable_baselines3:A2C",
            {"policy_kwargs": {"ortho_int": True}},
            "cannot be trained: .*ortho_int",
        ),
        (
            "stable_baselines3:SAC",
            {},
            "SAC cannot be trained: The algorithm only supports .*Box.* Discrete",
        ),
    ],
)
def test_what_cannot_be_trained_is_refused(
    name: str, values: dict[str, Any], expected: str
) -> None:
    with pytest.raises(InputError, match=f"^mine.toml: .*?{expected}") as refusal:
        settings_of(name, **values)
    assert str(refusal.value).endswith(".")


def test_missing_packages_get_a_sentence_and_names_need_no_torch() -> None:
    code = (
        "import sys; from agents import ALGORITHMS, load_algorithm\n"
        "for name in ALGORITHMS: load_algorithm(name).settings(budget=10240)\n"
        "assert not {'torch', 'stable_baselines3'} & set(sys.modules)\n"
        "sys.modules['torch'] = None\n"
        "try: load_algorithm('sb3_contrib:QRDQN', 'mine.toml')\n"
        "except ValueError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.startswith("mine.toml: algorithm sb3_contrib:QRDQN cannot be imported: "), (
        done.stderr
    )
    assert done.stdout.count("\n") == 1
    assert "make .venv/.deep installs it" in done.stdout
