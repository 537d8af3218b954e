"""Models act as they predict, no code of a file runs, and what may change them is refused."""

import json
import pickle
from base64 import b64encode
from contextlib import nullcontext
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import ZipFile

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
from agents.sb3.tables import agent_table, saved_table
from benchmark.assess import Assessment, assess
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
    model = cls("MlpPolicy", moody, seed=0, device="cpu", policy_kwargs=net, **arguments).learn(64)
    model.save(file)
    table, is_value = saved_table(file, name, MOODY, "one_hot")
    for other in (model, cls.load(file, device="cpu")):
        expected = agent_table(other, "agent", MOODY, "one_hot")
        assert np.array_equal(table, expected[0])
        assert is_value == expected[1]
    observations = observation_table(MOODY, "one_hot")
    actions, _ = model.predict(observations, deterministic=True)
    options: dict[str, Any] = {"scenario": "Moody", "observation": "one_hot"}
    assert (assess(file, algorithm=name, **options).policy == np.eye(5)[actions]).all()
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
        ({"observation": "one_hot"}, r"zip: observation_space = .* accepted in S1 with"),
        (SB3_PPO, "zip: cannot be loaded: .* accepted: what model.save of stable_baselines3:PPO"),
        ({"stochastic": True}, "stochastic = True: accepted only with action probabilities"),
    ],
)
def test_mistakes_about_saved_models(
    saved: dict[str, Path], options: dict[str, Any], expected: str
) -> None:
    with pytest.raises(InputError, match=expected):
        scored(saved["DQN"], **{"algorithm": "stable_baselines3:DQN", **options})


# Files that run code


class Payload(NamedTuple):
    """Leaves a marker when it is unpickled."""

    marker: Path

    def __reduce__(self) -> Any:
        return Path.touch, (self.marker,)


NEEDED = ("policy_class", "observation_space", "_last_obs")


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        *(
            (f"data/{key}", rf"cannot be loaded: {key} needs pathlib\S+touch, which could")
            for key in NEEDED
        ),
        *((f"data/{key}", "") for key in ("clip_range", "env")),
        ("policy.pth", r"cannot be loaded: Weights only load failed; "),
        ("policy.optimizer.pth", r"cannot be loaded: Weights only load failed; "),
    ],
)
def test_payloads_are_not_run(
    entry: str,
    expected: str,
    saved: dict[str, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    payload, marker = Payload(tmp_path / "marker"), tmp_path / "marker"
    with ZipFile(saved["PPO"]) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    name, _, key = entry.partition("/")
    if key:
        pickled = {":serialized:": b64encode(pickle.dumps(payload)).decode()}
        (tmp_path / "imported.py").write_text(f"open({str(marker)!r}, 'w')", encoding="utf-8")
        monkeypatch.syspath_prepend(tmp_path)
        value = "imported:Id-v0" if key == "env" else pickled
        content[name] = json.dumps(json.loads(content[name]) | {key: value}).encode()
    else:
        torch.save(payload, tmp_path / name)
        content[name] = (tmp_path / name).read_bytes()
    with ZipFile(tmp_path / "bad.zip", "w") as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    refused = pytest.raises(InputError, match=f"{expected}.*accepted: what ")
    with refused if expected else nullcontext():
        scored(tmp_path / "bad.zip", **SB3_PPO)
    assert not marker.exists()
    pickle.loads(pickle.dumps(payload))
    assert marker.exists()


# What models depend on besides their nets


class Shifted(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Changes actions."""

    def step(self, action: Any) -> Any:
        return self.env.step((action + 1) % 5)


class Flipped(ProxemicEnv):
    """Keeps the space of observations."""

    def _observe(self) -> Any:
        return 1 - super()._observe()


@pytest.mark.parametrize(
    ("made", "named"),
    [
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
def test_masks_and_memories_are_refused_by_name(
    cls: Any, policy: str, expected: str, tmp_path: Path
) -> None:
    size = {"policy_kwargs": {"lstm_hidden_size": 4}} if cls is RecurrentPPO else {}
    model = cls(policy, env(), device="cpu", **size)
    model.save(tmp_path / "model.zip")
    path = f"{cls.__module__}:{cls.__name__}"
    for agent, algorithm in ((model, None), (model.predict, None), (tmp_path / "model.zip", path)):
        with pytest.raises(InputError, match=expected):
            scored(agent, algorithm=algorithm)
    if cls is RecurrentPPO:
        with pytest.raises(InputError, match="for a model without memory"):
            scored(lambda o: model.predict(o, deterministic=True))
    else:
        with pytest.raises(InputError, match=f"cannot be trained: {expected}"):
            parse(load_algorithm(path).settings, {"budget": 10240}, "mine.toml")
        scored(lambda o: model.predict(o, deterministic=True))


def test_what_a_file_does_not_say_is_not_trusted(saved: dict[str, Path], tmp_path: Path) -> None:
    PPO.load(saved["PPO"], env=env()).save(tmp_path / "again")  # which forgets the last observation
    with pytest.raises(
        InputError, match=r"again\.zip: its last observation in training is missing"
    ):
        scored(tmp_path / "again", **SB3_PPO)
    loaded = scored(PPO.load(saved["PPO"], env=env()))
    assert np.array_equal(scored(saved["PPO"], **SB3_PPO).policy, loaded.policy)
