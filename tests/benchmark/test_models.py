"""Models act as they predict; what may change them, and untrusted files, are refused."""

import re
from contextlib import nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import wrappers
from sb3_contrib import QRDQN, MaskablePPO, RecurrentPPO
from stable_baselines3 import A2C, DQN, PPO
from stable_baselines3.common import vec_env
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.sb2_compat.rmsprop_tf_like import RMSpropTFLike
from stable_baselines3.common.torch_layers import FlattenExtractor

from agents import load_algorithm
from agents.sb3.tables import agent_table
from benchmark.__main__ import main
from benchmark.assess import Assessment, assess, load_model
from envs import InputError, ProxemicEnv, compile_scenario, load_scenario
from envs.inputs import parse
from envs.observations import observation_table

MOODY = compile_scenario(load_scenario("Moody"))  # has two observed parts
SB3_PPO = {"algorithm": "stable_baselines3:PPO"}
ROLLOUT: Any = {"n_steps": 64, "n_epochs": 1}
REPLAY = {"learning_starts": 20, "learning_rate": lambda left: 1e-3 * left}


def env(*around: Any) -> Any:
    made = gymnasium.make("envs:Proxemic/S1-v0", observation="coordinates")
    for wrap in around:
        made = wrap(made)
    return made


def scored(agent: Any, **options: Any) -> Assessment:
    return assess(agent, **{"scenario": "S1", "observation": "coordinates", **options})


class Doubled(FlattenExtractor):
    """A net of a user, in a module that only the user can name."""

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        return 2 * super().forward(observations)


class OwnPPO(PPO):
    """An algorithm of a user."""


@pytest.mark.parametrize(
    ("cls", "arguments", "net"),
    [
        (PPO, ROLLOUT, {"activation_fn": torch.nn.ELU, "net_arch": {"pi": [9], "vf": []}}),
        (A2C, {}, {"optimizer_class": RMSpropTFLike}),
        (QRDQN, REPLAY, {"n_quantiles": 7, "optimizer_class": torch.optim.SGD}),
        (OwnPPO, ROLLOUT, {"features_extractor_class": Doubled}),
    ],
)
def test_saved_models_act_as_they_predict(
    cls: Any, arguments: Any, net: Any, tmp_path: Path
) -> None:
    file, name = tmp_path / "model.zip", f"{cls.__module__}:{cls.__name__}"
    moody = gymnasium.make("envs:Proxemic/Moody-v0", observation="one_hot")
    model: Any = cls(
        "MlpPolicy", moody, seed=0, device="cpu", policy_kwargs=net, **arguments
    ).learn(64)
    model.save(file)
    table, is_value = agent_table(model, MOODY, "one_hot")
    loaded: Any = load_model(str(file), name)
    assert np.array_equal(agent_table(loaded, MOODY, "one_hot")[0], table)
    observations = observation_table(MOODY, "one_hot")
    actions, _ = model.predict(observations, deterministic=True)
    options: dict[str, Any] = {"scenario": "Moody", "observation": "one_hot"}
    assert (assess(model, **options).policy == np.eye(5)[actions]).all()
    if not is_value:
        tensor, _ = model.policy.obs_to_tensor(observations)
        probabilities = model.policy.get_distribution(tensor).distribution.probs.detach().numpy()
        assert assess(model, stochastic=True, **options).policy == pytest.approx(
            probabilities, abs=1e-6
        )


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A PPO and a DQN that were trained for some steps in S1."""
    folder = tmp_path_factory.mktemp("saved")
    algorithms: Any = ((PPO, ROLLOUT), (DQN, {"learning_starts": 20, "buffer_size": 100}))
    for cls, settings in algorithms:
        cls("MlpPolicy", env(), seed=0, device="cpu", **settings).learn(64).save(
            folder / cls.__name__
        )
    return {name: folder / f"{name}.zip" for name in ("PPO", "DQN")}


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"observation": "one_hot"}, r"agent: observation_space = .* accepted in S1 with"),
        ({"stochastic": True}, "stochastic: accepted only with action probabilities"),
    ],
)
def test_mistakes_about_models(
    saved: dict[str, Path], options: dict[str, Any], expected: str
) -> None:
    with pytest.raises(InputError, match=expected):
        scored(DQN.load(saved["DQN"]), **options)


# Files that run code


class Payload(NamedTuple):
    """Leaves a marker when it is unpickled."""

    marker: Path

    def __reduce__(self) -> Any:
        return Path.touch, (self.marker,)


def test_a_file_is_loaded_only_if_it_is_trusted(
    saved: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, marker = tmp_path / "bad.zip", tmp_path / "marker"
    model = PPO.load(saved["PPO"])
    model.payload = Payload(marker)  # type: ignore[attr-defined]
    model.save(file)
    command = ["assess", "--model", str(file), "--observation", "coordinates"]
    command += ["--algorithm", "stable_baselines3:PPO"]
    assert main(command) == 2
    assert f"--model {file}: loading a model runs any code" in capsys.readouterr().err
    assert not marker.exists()
    assert main([*command, "--trust"]) == 0
    assert marker.exists()
    assert (
        f"success              {scored(PPO.load(saved['PPO'])).success:g}"
        in capsys.readouterr().out
    )
    for option, value in (("--algorithm", "stable_baselines3:DQN"), ("--model", "missing.zip")):
        assert main([*command, "--trust", option, value]) == 2
        assert "cannot be loaded: " in capsys.readouterr().err


# What models depend on besides their nets


class Shifted(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Changes actions."""

    def step(self, action: Any) -> Any:
        return self.env.step((action + 1) % 5)


class Flipped(ProxemicEnv):
    """Keeps the space of observations."""

    def _observe(self) -> Any:
        return 1 - super()._observe()


def patched() -> Any:
    made = env()
    made.unwrapped.step = lambda action: ProxemicEnv.step(made.unwrapped, 4 - action)
    return made


@pytest.mark.parametrize(
    ("made", "named"),
    [
        (patched, "ProxemicEnv"),
        (lambda: env(wrappers.RecordEpisodeStatistics, wrappers.NormalizeReward), ""),
        (lambda: vec_env.VecMonitor(vec_env.VecCheckNan(vec_env.DummyVecEnv([env]))), ""),
        (lambda: env(Shifted), "Shifted"),
        (lambda: env(lambda inner: wrappers.StickyAction(inner, 0.5)), "StickyAction"),
        (lambda: vec_env.VecNormalize(vec_env.DummyVecEnv([env])), "VecNormalize"),
        (lambda: make_vec_env(lambda: Flipped("S1", "coordinates")), "Flipped"),
    ],
)
def test_wrappers_that_may_change_something_are_refused(made: Any, named: str) -> None:
    expected = f"includes {named}, which may .*accepted: a function .*lambda o"
    with pytest.raises(InputError, match=expected) if named else nullcontext():
        scored(PPO("MlpPolicy", made(), device="cpu", n_steps=64))


@pytest.mark.parametrize(
    ("cls", "policy", "expected"),
    [
        (MaskablePPO, "MlpPolicy", "MaskablePPO needs more than .*: it takes action_masks"),
        (RecurrentPPO, "MlpLstmPolicy", "RecurrentPPO needs more than .* lstm_states"),
    ],
)
def test_masks_and_memories_are_refused_by_name(cls: Any, policy: str, expected: str) -> None:
    size = {"policy_kwargs": {"lstm_hidden_size": 4}} if cls is RecurrentPPO else {}
    model = cls(policy, env(), device="cpu", **size)
    path = f"{cls.__module__}:{cls.__name__}"
    for agent in (model, model.predict):
        with pytest.raises(InputError, match=expected):
            scored(agent)
    if cls is RecurrentPPO:
        with pytest.raises(InputError, match="for a model without memory"):
            scored(lambda o: model.predict(o, deterministic=True))
    else:
        with pytest.raises(InputError, match=f"cannot be trained: {expected}"):
            parse(load_algorithm(path).settings, {"budget": 10240}, "mine.toml")
        scored(lambda o: model.predict(o, deterministic=True))


def test_what_a_file_does_not_say_is_not_trusted(saved: dict[str, Path], tmp_path: Path) -> None:
    PPO.load(saved["PPO"], env=env()).save(tmp_path / "again")  # which forgets the last observation
    with pytest.raises(InputError, match=r"agent: its last observation in training is missing"):
        scored(PPO.load(tmp_path / "again"))
    exact = scored(PPO.load(saved["PPO"]))
    assert (exact.note, "note" in repr(exact)) == ("", False)
    loaded, reset = PPO.load(saved["PPO"], env=env()), PPO.load(saved["PPO"])
    reset.set_env(env())
    for found in map(scored, (loaded, reset, loaded.predict)):
        assert np.array_equal(found.policy, exact.policy)
        assert f"note: {found.note}" in repr(found)
        assert re.match("its last observation in training is missing: .* is wrong", found.note)
    assert scored(PPO("MlpPolicy", env(), device="cpu")).note == ""
    loaded.policy.double()
    with pytest.raises(InputError, match=r"accepted: a net in single precision; .*float\(\)"):
        scored(loaded)
