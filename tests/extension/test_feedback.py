"""Feedback from outside: functions in a module beside a scenario's file."""

import re
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from benchmark.experiment import load_experiment
from envs import Ping, compile_scenario, load_scenario
from envs.inputs import InputError
from envs.model import PING
from envs.sources import digest_of_source
from tests.support import ROOT, small_experiment

S1 = ROOT / "envs" / "scenarios" / "S1.toml"
(POLITE,) = re.findall(
    r"```python\n(# polite.*?)```", (S1.parent / "README.md").read_text(), flags=re.DOTALL
)


def distance(ping: Ping) -> float:
    return -ping.distance / ping.farthest


def uniform(_: Ping) -> tuple[int, float]:
    return -1, 1.0


def odd(_: Ping) -> object:
    return "much"


CASES = [("S3", distance), ("S2", uniform), ("TwoPeople", distance), ("Turning", distance)]


@pytest.mark.parametrize(("name", "function"), CASES)
def test_functions_can_be_what_shipped_kinds_are(name: str, function: object) -> None:
    kind = getattr(function, "__name__", "")
    shipped = {} if name == "S2" else {"issuer.feedback": {"kind": "distance"}}
    own = {"issuer.feedback": {"kind": f"{__name__}:{kind}"}}
    expected, model = (compile_scenario(load_scenario(name, changes)) for changes in (shipped, own))
    for key, value in vars(expected).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(getattr(model, key), value, err_msg=key)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (
            f"{__name__}:odd",
            "no number; accepted: a number from -1,000,000 to 1,000,000, or a pair",
        ),
        ("no_such_module:f", "cannot be imported: No module named 'no_such_module'"),
    ],
)
def test_mistakes_are_one_sentence(kind: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        gymnasium.make("Proxemic/S1-v0", overrides={"issuer.feedback.kind": kind})
    assert len(error.value.args) == 1


def test_example_of_the_guide_is_found_beside_its_scenario(tmp_path: Path) -> None:
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    (scenes / "polite.py").write_text(POLITE, encoding="utf-8")
    text = S1.read_text(encoding="utf-8").replace('kind = "none"', 'kind = "polite:polite"')
    (scenes / "Polite.toml").write_text(text, encoding="utf-8")
    (tmp_path / "mine.toml").write_text(
        small_experiment(scenarios=["scenes/Polite.toml"]), encoding="utf-8"
    )
    env = gymnasium.make("Proxemic/S1-v0", scenario=scenes / "Polite.toml")
    env.reset()
    # The farthest start is 14 steps away, and so is the agent.
    rewards = [round(float(env.step(PING)[1]) + 0.4, 9) for _ in range(4)]
    assert rewards == [-0.5, -0.5, -0.5, -0.6]
    model = compile_scenario(load_scenario(scenes / "Polite.toml"))
    beside = 5 * 12 + 8  # the cell above the person, which is uncomfortable
    assert (model.issuer_reward[beside, PING], model.issuer_noise[beside, PING]) == (-0.75, 0.25)
    vector = gymnasium.make_vec("Proxemic/S1-v0", num_envs=2, scenario=scenes / "Polite.toml")
    vector.reset()
    assert vector.step(np.array([PING, PING]))[1].tolist() == [-0.9, -0.9]
    # Runs depend on it.
    (population,) = load_experiment(tmp_path / "mine.toml").populations
    assert digest_of_source("polite") in population.first.content
