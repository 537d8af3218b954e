"""Saved models: the same policy as the model in memory, and no code from a file is run."""

import json
import pickle
from base64 import b64encode
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import ZipFile

import gymnasium
import numpy as np
import pytest
import torch
from sb3_contrib import QRDQN, TRPO
from stable_baselines3 import A2C, DQN, PPO
from stable_baselines3.common.sb2_compat.rmsprop_tf_like import RMSpropTFLike
from stable_baselines3.common.torch_layers import FlattenExtractor

from agents.sb3.tables import agent_table, saved_table
from benchmark.assessment import assess
from envs import InputError, compile_scenario, load_scenario

S1 = compile_scenario(load_scenario("S1"))


class Doubled(FlattenExtractor):
    """A net of a user, in a module that only the user can name."""

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        return 2 * super().forward(observations)


class OwnPPO(PPO):
    """An algorithm of a user."""


class Payload(NamedTuple):
    """Leaves a marker when it is unpickled."""

    marker: Path

    def __reduce__(self) -> Any:
        return Path.touch, (self.marker,)


def saved(path: Path, cls: Any = PPO, net: Any = None, **arguments: Any) -> Any:
    env = gymnasium.make("envs:Proxemic/S1-v0", observation="coordinates")
    model = cls("MlpPolicy", env, seed=0, device="cpu", policy_kwargs=net, **arguments).learn(64)
    model.save(path)
    return model


ROLLOUT = {"n_steps": 64}
REPLAY = {"learning_starts": 20, "learning_rate": lambda left: 1e-3 * left}


@pytest.mark.parametrize(
    ("cls", "arguments", "net"),
    [
        (PPO, ROLLOUT, {"activation_fn": torch.nn.ELU, "net_arch": {"pi": [9], "vf": []}}),
        (A2C, {}, {"optimizer_class": RMSpropTFLike}),
        (DQN, REPLAY, {"net_arch": []}),
        (DQN, REPLAY, {"activation_fn": torch.nn.Tanh, "optimizer_kwargs": {"eps": 1e-3}}),
        (QRDQN, REPLAY, {"n_quantiles": 7, "optimizer_class": torch.optim.SGD}),
        (TRPO, {"n_steps": 64, "batch_size": 64}, None),
        (OwnPPO, ROLLOUT, {"features_extractor_class": Doubled}),
    ],
)
def test_policies_are_those_in_memory(cls: Any, arguments: Any, net: Any, tmp_path: Path) -> None:
    file, name = tmp_path / "model.zip", f"{cls.__module__}:{cls.__name__}"
    model = saved(file, cls, net, **arguments)
    table, is_value = saved_table(file, name, S1, "coordinates")
    for other in (model, cls.load(file, device="cpu")):
        expected = agent_table(other, "agent", S1, "coordinates")
        assert np.array_equal(table, expected[0])
        assert is_value == expected[1]


NEEDED = ("policy_class", "policy_kwargs", "observation_space", "action_space", "_last_obs")


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        *((f"data/{key}", rf"cannot be loaded: {key} needs pathlib\S+touch, which could") for key in NEEDED),
        *((f"data/{key}", "") for key in ("clip_range", "ep_info_buffer", "env", "more")),
        ("policy.pth", r"cannot be loaded: Weights only load failed; "),
        ("policy.optimizer.pth", r"cannot be loaded: Weights only load failed; "),
        ("normalization", r"n\.pkl: cannot be used: it needs pathlib\S+touch, which could"),
    ],
)
def test_payloads_are_not_run(
    entry: str, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    payload, marker = Payload(tmp_path / "marker"), tmp_path / "marker"
    saved(tmp_path / "good.zip", **ROLLOUT)
    with ZipFile(tmp_path / "good.zip") as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    name, _, key = entry.partition("/")
    options: dict[str, Any] = {}
    if key:
        pickled = {":serialized:": b64encode(pickle.dumps(payload)).decode()}
        (tmp_path / "imported.py").write_text(f"open({str(marker)!r}, 'w')", encoding="utf-8")
        monkeypatch.syspath_prepend(tmp_path)
        value = "imported:Id-v0" if key == "env" else pickled
        content[name] = json.dumps(json.loads(content[name]) | {key: value}).encode()
    elif name in content:
        torch.save(payload, tmp_path / name)
        content[name] = (tmp_path / name).read_bytes()
    else:
        options["normalization"] = tmp_path / "n.pkl"
        options["normalization"].write_bytes(pickle.dumps(payload))
    with ZipFile(tmp_path / "bad.zip", "w") as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    options |= {"algorithm": "stable_baselines3:PPO", "scenario": "S1", "observation": "coordinates"}
    if expected:
        with pytest.raises(InputError, match=f"{expected}.*accepted: what "):
            assess(tmp_path / "bad.zip", **options)
    else:
        assess(tmp_path / "bad.zip", **options)
    assert not marker.exists()
    pickle.loads(pickle.dumps(payload))
    assert marker.exists()
