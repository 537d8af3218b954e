"""What models depend on besides their nets: it is honoured, or refused by name, and never scored wrongly."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers
from sb3_contrib import MaskablePPO, RecurrentPPO
from stable_baselines3 import A2C, DQN, PPO
from stable_baselines3.common import vec_env
from stable_baselines3.common.callbacks import CheckpointCallback
from stable_baselines3.common.env_util import make_vec_env

from agents import load_algorithm
from benchmark.__main__ import main
from benchmark.assessment import Assessment, assess
from envs import InputError, ProxemicEnv, compile_scenario, load_scenario
from envs.inputs import parse
from envs.observations import observation_table

TABLE = observation_table(compile_scenario(load_scenario("S1")), "coordinates")
SETTINGS: Any = {PPO: {"n_steps": 64, "n_epochs": 1}, DQN: {"learning_starts": 20}}


def env(*around: Any) -> Any:
    made = gymnasium.make("envs:Proxemic/S1-v0", observation="coordinates")
    for wrap in around:
        made = wrap(made)
    return made


def scored(agent: Any, **options: Any) -> Assessment:
    return assess(agent, scenario="S1", observation="coordinates", **options)


@pytest.mark.parametrize("cls", [PPO, DQN])
def test_normalised_models_are_scored_as_they_predict(cls: Any, tmp_path: Path) -> None:
    venv = vec_env.VecNormalize(vec_env.DummyVecEnv([env, env]))
    saver = CheckpointCallback(50, str(tmp_path), "at", save_vecnormalize=True)
    model = cls("MlpPolicy", venv, seed=0, device="cpu", **SETTINGS[cls]).learn(128, saver)
    model.save(tmp_path / "model")
    venv.save(str(tmp_path / "stats.pkl"))
    expected, _ = model.predict(venv.normalize_obs(TABLE), deterministic=True)
    file = {"algorithm": f"stable_baselines3:{cls.__name__}"}
    given = file | {"normalization": tmp_path / "stats.pkl"}
    for assessment in (scored(model), scored(model.predict), scored(tmp_path / "model", **given)):
        assert (assessment.policy.argmax(axis=1) == expected).all()
    # A callback saves the model before it is given the observation that the statistics have seen.
    steps, other = tmp_path / "at_100_steps.zip", tmp_path / "at_vecnormalize_100_steps.pkl"
    scored(steps, **file, normalization=other)
    for path in (tmp_path / "broken.pkl", tmp_path / "missing.pkl", other):
        (tmp_path / "broken.pkl").write_bytes(b"x")
        with pytest.raises(InputError, match=f"{path.name}: cannot be used: .*; accepted: what VecNormalize"):
            scored(tmp_path / "model", **given | {"normalization": path})
    with pytest.raises(InputError, match=r"model.zip: its last observation .* as normalization, or a"):
        scored(tmp_path / "model", **file)
    submission = tmp_path / "board" / "mine.toml"
    options = ["--observation", "coordinates", "--model", str(tmp_path / "model"), "--learner", "l"]
    options += ["--algorithm", file["algorithm"], "--training-steps", "128", "--search-trials", "0"]
    assert main(["assess", *options, "--submit", str(submission)]) == 2
    assert not submission.parent.exists()
    options += ["--normalization", str(given["normalization"]), "--submit", str(submission)]
    assert main(["assess", *options]) == 0
    assert "model.zip, SHA-256" in submission.read_text("utf-8")


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
        (lambda: make_vec_env(env, 2), ""),
        (lambda: env(wrappers.RecordEpisodeStatistics, wrappers.NormalizeReward, wrappers.Autoreset), ""),
        (lambda: env(lambda inner: wrappers.TransformReward(inner, float)), ""),
        (lambda: vec_env.VecMonitor(vec_env.VecCheckNan(vec_env.DummyVecEnv([env]))), ""),
        (lambda: env(Shifted), "Shifted"),
        (lambda: env(lambda inner: wrappers.StickyAction(inner, 0.5)), "StickyAction"),
        (lambda: env(wrappers.NormalizeObservation), "NormalizeObservation"),
        (lambda: vec_env.VecFrameStack(vec_env.DummyVecEnv([env]), 2), "VecFrameStack"),
        (lambda: make_vec_env(lambda: Flipped("S1", "coordinates")), "Flipped"),
    ],
)
def test_wrappers_that_may_change_something_are_refused(made: Any, named: str) -> None:
    model = PPO("MlpPolicy", made(), device="cpu", n_steps=64)
    if not named:
        scored(model)
        return
    with pytest.raises(InputError, match=f"includes {named}, which may .*accepted: a function .*lambda o"):
        scored(model)


class Minded(A2C):
    """Its predict says something else than its net."""

    def predict(self, *args: Any, **kwargs: Any) -> Any:
        actions, state = super().predict(*args, **kwargs)
        return (actions + 1) % 5, state


@pytest.mark.parametrize(
    ("cls", "policy", "expected"),
    [
        (MaskablePPO, "MlpPolicy", "MaskablePPO depends on .*: it takes action_masks"),
        (RecurrentPPO, "MlpLstmPolicy", "RecurrentPPO has a memory"),
        (Minded, "MlpPolicy", "predict of Minded .* other actions than its net"),
    ],
)
def test_masks_and_memories_are_refused_by_name(cls: Any, policy: str, expected: str, tmp_path: Path) -> None:
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


def test_success_with_a_score_of_zero_is_explained() -> None:
    text = str(scored(lambda o: 3 if o[1] < 0.4 else 1 if o[0] < 0.9 else 0)).splitlines()
    assert text[1].startswith("  success ")
    assert "is below a random policy's, -" in text[3]


def test_what_a_file_does_not_say_is_not_trusted(tmp_path: Path) -> None:
    model = PPO("MlpPolicy", env(), device="cpu", n_steps=64).learn(64)
    model.save(tmp_path / "model")
    PPO.load(tmp_path / "model", env=env()).save(tmp_path / "again")  # which forgets the last observation
    with pytest.raises(InputError, match=r"again\.zip: its last observation in training is missing"):
        scored(tmp_path / "again", algorithm="stable_baselines3:PPO")
    assert np.array_equal(scored(model).policy, scored(PPO.load(tmp_path / "model", env=env())).policy)
