"""Classes like those of Stable-Baselines3 by their import path, and models that they have saved."""

import inspect
import subprocess
import sys
from typing import Any

import pytest

from agents import load_algorithm
from envs import InputError
from envs.inputs import parse
from tests.support import ROOT


def settings_of(path: str, **values: Any) -> Any:
    return parse(load_algorithm(path, "mine.toml").settings, values, "mine.toml")


@pytest.mark.parametrize("path", ["stable_baselines3:DQN", "sb3_contrib:TRPO"])
def test_defaults_are_the_classs_and_part_of_the_identity(path: str) -> None:
    algorithm: Any = load_algorithm(path)
    signature = inspect.signature(algorithm.load().__init__).parameters
    settings = settings_of(path, budget=10_240)
    written = settings.model_dump(mode="json")
    for key in written.keys() & signature.keys() - {"policy_kwargs"}:
        assert written[key] == signature[key].default, key
    assert settings.discount_factor == 0.99


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
