"""The command that writes the agent of a run: it acts as the run's record says."""

import json
import re
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import yaml  # type: ignore[import-untyped]
from stable_baselines3 import DQN, PPO

from agents.policy import mask_policy
from benchmark.__main__ import main
from benchmark.assess import assess
from benchmark.experiment import load_experiment
from benchmark.export import find_run
from benchmark.run import execute
from benchmark.store import Record, Store
from tests.support import ROOT, small_experiment, variant

LEARNERS = {name: f"{name}, one_hot" for name in ("dqn", "ppo", "stock")}
LEARNERS |= {"tiles": "tiles, coordinates", "table": "table"}
SHORT: Any = {"settings": {"n_steps": 100}}
TOLD: Any = {"settings": {"n_steps": 100, "policy_kwargs": {"ortho_init": "print()"}}}
RATES = {"learning_rate": 1e-5, "policy_kwargs": {"optimizer_kwargs": {"eps": 1e-5}}}
EXPERIMENT = small_experiment(
    scenarios=["S1", "S3"],
    settings={"budget": 600, "time_limit": 50},
    algorithms={
        "tiles": variant("linear_q_lambda", "coordinates"),
        "dqn": variant("compiled_dqn", "coordinates", "one_hot", settings=RATES),
        "ppo": variant("compiled_ppo", "one_hot", **SHORT),
        "table": variant("q_learning", "index"),
        "stock": variant("stable_baselines3:PPO", "one_hot", **TOLD),
    },
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an experiment; tests export runs with seed 1 in S3."""
    folder = tmp_path_factory.mktemp("export")
    (folder / "small.toml").write_text(EXPERIMENT, encoding="utf-8")
    return folder


def trained(folder: Path, name: str) -> Record:
    run, _ = find_run(load_experiment(folder / "small.toml"), LEARNERS[name], "1", "S3")
    with Store(folder / "runs.db") as store:
        assert execute([run], store, 1) == []
        return store.get([run.digest])[0]


def export(folder: Path, name: str, file: str) -> int:
    learner = LEARNERS[name]
    command = ["export", str(folder / "small.toml"), "--learner", learner, "--seed", "1"]
    return main([*command, "--scenario", "S3", str(folder / file)])


@pytest.mark.parametrize(
    "name", ["tiles", "dqn", "ppo", "table", pytest.param("stock", marks=pytest.mark.slow)]
)
def test_files_act_as_recorded(name: str, folder: Path) -> None:
    assert export(folder, name, f"{name}.npz") == 0
    record = trained(folder, name)
    arrays = record.arrays
    with np.load(folder / f"{name}.npz", allow_pickle=False) as file:
        assert json.loads(str(file["about"]))["digest"] == record.digest
        assert (file["greedy"] == mask_policy(arrays["greedy"][-1])).all()
        assert (file["q"] == arrays["q"]).all()
        assert (file["stochastic"] == arrays["stochastic"].reshape(-1, 5)).all()
        observations = file["observations"]
    if name in ("tiles", "table"):
        assert export(folder, name, f"{name}.zip") == 2
        return
    assert export(folder, name, f"{name}.zip") == 0
    model: Any = (DQN if name == "dqn" else PPO).load(folder / f"{name}.zip")
    assert (model.num_timesteps, json.loads(model.about)["digest"]) == (600, record.digest)
    actions = model.predict(observations, deterministic=True)[0]
    assert (1 << actions == arrays["greedy"][-1]).all()
    tensor, _ = model.policy.obs_to_tensor(observations)
    if name == "dqn":
        assert model.q_net(tensor).detach().numpy() == pytest.approx(arrays["q"], abs=1e-5)
    else:
        found = model.policy.get_distribution(tensor).distribution.probs.detach().numpy()
        assert found == pytest.approx(arrays["stochastic"][-1], abs=1e-6)


def test_settings_are_hyperparameters_of_the_zoo(folder: Path) -> None:
    """They are read as YAML, of which JSON's 1e-05 would be a text."""
    assert export(folder, "dqn", "dqn.yml") == 0
    given = yaml.safe_load((folder / "dqn.yml").read_text())["default"]
    assert [given.pop(key) for key in ("n_timesteps", "policy", "n_envs")] == [600, "MlpPolicy", 1]
    text = given.pop("policy_kwargs")
    assert text == "dict(net_arch=[64, 64], optimizer_kwargs={'eps': 1e-05})"
    env = gymnasium.make("envs:Proxemic/S3-v0", observation="one_hot")
    agent = DQN("MlpPolicy", env, policy_kwargs=eval(text), **given)
    assert (agent.learning_rate, agent.batch_size, agent.buffer_size) == (1e-5, 32, 600)
    assert export(folder, "tiles", "tiles.yml") == 2
    assert export(folder, "stock", "stock.yml") == 0  # a text stays one where this is evaluated
    assert "dict(ortho_init='print()')" in (folder / "stock.yml").read_text()


def test_documented_reader(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    assert export(folder, "table", "table.npz") == 0
    guide = (ROOT / "benchmark" / "README.md").read_text(encoding="utf-8")
    codes = re.findall(r"```python\n(.*?)```", guide, flags=re.DOTALL)
    read: dict[str, Any] = {}
    exec(next(code for code in codes if "np.load" in code), read)
    assert read["is_over"]
    policy = assess(read["act"], scenario="S3", observation="index").policy
    assert policy == pytest.approx(np.load("table.npz")["greedy"])
