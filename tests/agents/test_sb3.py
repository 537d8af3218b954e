"""Stable-Baselines3's algorithms: adapter, settings, and training, repeatable bit by bit.

`test_nets` compares the compiled algorithms with them; what all four have in common is tested here.
"""

import inspect
import math
import pickle
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from numpy.random import SeedSequence
from stable_baselines3.common.vec_env import DummyVecEnv

from agents import DeepTraining, Schedule, check_training, load_algorithm
from agents.nets.dqn import DqnNetSettings
from agents.nets.ppo import PpoNetSettings
from agents.policy import ALL_ACTIONS, contains
from agents.sb3 import algorithms
from agents.sb3.extractors import PeopleExtractor, PlanesExtractor
from agents.sb3.settings import PolicyArguments, Sb3Settings
from agents.sb3.vec_env import SB3VecEnv
from envs import EVENTS, InputError, compile_scenario, load_scenario
from envs.arrays import Floats
from envs.inputs import parse
from envs.observations import compile_seen
from tests.agents import MOODS, Changes

S1 = compile_scenario(load_scenario("S1"))
DQN = DqnNetSettings(budget=400, time_limit=50, train_freq=2, learning_rate=1e-3)
PPO = PpoNetSettings(budget=400, time_limit=50, n_steps=50, n_envs=2, batch_size=32, n_epochs=2)
SETTINGS: dict[str, Sb3Settings] = {
    "sb3_dqn": DQN,
    "sb3_ppo": PPO,
    "compiled_dqn": DQN,
    "compiled_ppo": PPO,
}

# Random starts, random changes of an observed phase and, in S2, random feedback.
CHANGING: Changes = {
    "grid.start": [[0, 0], [9, 0], [0, 11]],
    "observe": ["agent", "phase", "wrong_pings"],
    "phases": MOODS,
}


# The adapter


@pytest.mark.parametrize(
    ("scenario", "n", "overrides", "observation"),
    [
        ("S1", 5, {}, "one_hot"),
        ("S3", 4, {}, "coordinates"),
        ("S2", 1, {}, "one_hot"),
        ("S2", 1, CHANGING, "coordinates"),
        ("Anywhere", 1, {}, "one_hot"),
    ],
)
def test_vec_env_steps_as_stable_baselines3s_own_does(
    scenario: str, n: int, overrides: Changes, observation: str
) -> None:
    model = compile_scenario(load_scenario(scenario, overrides))
    ours: Any = SB3VecEnv(model, observation, n, 7)
    arguments: Any = {"observation": observation, "overrides": overrides, "max_episode_steps": 7}
    theirs: Any = DummyVecEnv(
        [lambda: gymnasium.make(f"envs:Proxemic/{scenario}-v0", **arguments)] * n
    )
    ours.seed(3)
    theirs.seed(3)
    assert np.array_equal(ours.reset(), theirs.reset())
    actions = np.random.default_rng(0).choice(5, size=(250, n), p=[0.1, 0.1, 0.1, 0.1, 0.6])
    at_end = "terminal_observation", "TimeLimit.truncated", "is_success"
    are_truncated, wrong = list[bool](), 0
    for action in actions:
        (*arrays, infos), (*their_arrays, their_infos) = ours.step(action), theirs.step(action)
        for array, their_array in zip(arrays, their_arrays, strict=True):
            assert np.array_equal(array, their_array)
            assert array.dtype == their_array.dtype
        for info, expected in zip(infos, their_infos, strict=True):
            wrong += EVENTS[expected["event"]] in ("wrong_ping", "last_wrong_ping")
            is_over = "terminal_observation" in expected
            np.testing.assert_equal(info, {key: expected[key] for key in at_end} if is_over else {})
            if is_over:
                are_truncated.append(expected["TimeLimit.truncated"])
    assert 5 < sum(are_truncated) < len(are_truncated) - 5
    assert ours.disagreements == wrong > 50


# Settings


@pytest.mark.parametrize("method", [algorithms.DQN, algorithms.PPO])
def test_settings_have_sb3s_names_and_defaults(method: Any) -> None:
    parameters = inspect.signature(method.load().__init__).parameters
    ours = {"budget", "time_limit", "n_envs", "policy_kwargs"}
    for key, field in method.settings.model_fields.items():
        if key not in ours:
            assert field.default == parameters[key].default, key


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        # 5 * 2000 = 10,000; 2048 does not divide it, nor does a number between
        ("sb3_ppo", {}, 2000),
        ("sb3_ppo", {"n_envs": 4}, 1250),  # 2 * 4 * 1250
        ("sb3_contrib:TRPO", {}, 2000),
        ("sb3_dqn", {"budget": 9999}, 3),
    ],
)
def test_a_rollout_whose_length_is_not_set_divides_the_budget(
    name: str, values: Changes, expected: int
) -> None:
    settings: Any = parse(load_algorithm(name).settings, values, "mine.toml")
    length = "train_freq" if name == "sb3_dqn" else "n_steps"
    assert getattr(settings, length) == settings.arguments[length] == expected


# Features extractors


@pytest.mark.parametrize(
    ("changes", "observation", "arguments", "expected"),
    [
        # 2 + 2 * 3 numbers would pass for those of three people without badges
        ({}, "coordinates", {}, "per_person = 2, sees_agent = true; accepted: per_person = 3, "),
        ({}, "centred", {"per_person": 1}, "per_person = 1, .* accepted: per_person = 3, "),
        ({}, "relative_centred", {"per_person": 3}, "accepted: per_person = 3, sees_agent = false"),
        ({}, "coordinates", {"per_person": 3, "sees_agent": False}, "accepted: .*agent = true"),
        ({"onlookers.badge": False}, "coordinates", {"per_person": 3}, "accepted: per_person = 2,"),
        ({}, "factored", {"per_person": 3}, "factored of agent, issuer; accepted: coord"),
        ({"observe": ["agent", "issuer", "wrong_pings"]}, "coordinates", {"per_person": 3},
         "of agent, issuer, wrong_pings; accepted: coordinates"),
    ],
)  # fmt: skip
def test_what_is_not_made_of_people_is_refused(
    changes: Changes, observation: str, arguments: Changes, expected: str
) -> None:
    crowd = {"onlookers": {"people": 1, "ways": 8, "badge": True}, "issuer.places": 4}
    model = compile_seen(load_scenario("Anywhere", crowd | changes), observation)
    policy = PolicyArguments(
        features_extractor_class="agents.sb3.extractors:PeopleExtractor",
        features_extractor_kwargs=arguments,
    )
    settings, schedule = DQN.model_copy(update={"policy_kwargs": policy}), Schedule(400, (0, 400))
    with pytest.raises(InputError, match=f"^PeopleExtractor in Anywhere: .*{expected}"):
        algorithms.DQN.train(model, settings, observation, [SeedSequence(1)], schedule)


@pytest.mark.parametrize(
    ("name", "observation", "extractor", "arguments"),
    [
        ("sb3_dqn", "relative_coordinates", PeopleExtractor, {"sees_agent": False}),
        ("sb3_ppo", "coordinates", PeopleExtractor, {}),
        ("sb3_dqn", "planes", PlanesExtractor, {}),
        ("stable_baselines3:A2C", "planes", PlanesExtractor, {}),
    ],
)
def test_agents_learn_with_features_extractors(
    name: str, observation: str, extractor: type, arguments: Changes
) -> None:
    algorithm: Any = load_algorithm(name)
    model = compile_seen(load_scenario("Anywhere", {"issuer.places": 5}), observation)
    policy = {
        "features_extractor_class": f"agents.sb3.extractors:{extractor.__name__}",
        "features_extractor_kwargs": arguments,
    }
    settings = parse(algorithm.settings, {"budget": 400, "policy_kwargs": policy}, "mine.toml")
    settings = pickle.loads(pickle.dumps(settings))  # as for another process
    kept = list[Any]()
    schedule = Schedule(400, (0, 200, 400), keep=kept.append)
    training = algorithm.train(model, settings, observation, [SeedSequence(1)], schedule)
    check_training(training, model, 1, schedule)
    (agent,) = kept
    assert extractor in [type(module) for module in agent.policy.modules()]


# Training


def trained(
    name: str,
    seeds: Sequence[int] = (0,),
    points: Sequence[int] = (0, 200, 400),
    observation: str = "one_hot",
    may_end: Any = None,
    **changes: Any,
) -> Any:
    settings = SETTINGS[name].model_copy(update=changes)
    schedule = Schedule(settings.budget, tuple(points), tuple(points[::2]), may_end)
    sequences = [SeedSequence([4, seed]) for seed in seeds]
    return load_algorithm(name).train(S1, settings, observation, sequences, schedule)


@pytest.mark.parametrize("name", SETTINGS)
def test_same_seed_gives_the_same_weights_however_often_the_policy_is_kept(name: str) -> None:
    alone = trained(name)
    torch.rand(3)
    np.random.rand(3)  # noqa: NPY002
    together = trained(name, (1, 0), range(0, 401, 100))
    assert isinstance(together, DeepTraining)
    assert (together.weights[1] == alone.weights[0]).all()
    assert (together.weights[0] != together.weights[1]).any()
    for key in ("greedy", "disagreements"):
        assert np.array_equal(getattr(together, key)[1, ::2], getattr(alone, key)[0])


@pytest.mark.parametrize("prefix", ["sb3_", "compiled_"])
def test_updates_and_parameters_by_hand(prefix: str) -> None:
    dqn = trained(f"{prefix}dqn", observation="coordinates")
    assert dqn.updates[0] == (400 - 100) / 2
    assert dqn.parameters[0] == (2 * 64 + 64) + (64 * 64 + 64) + (64 * 5 + 5)
    linear = trained(f"{prefix}dqn", policy_kwargs=PolicyArguments(net_arch=()))
    assert linear.parameters[0] == 120 * 5 + 5
    ppo = trained(f"{prefix}ppo", observation="coordinates")
    assert ppo.updates[0] == 2 * math.ceil(100 / 32) * 4
    body = (2 * 64 + 64) + (64 * 64 + 64)
    assert ppo.parameters[0] == 2 * body + (64 * 5 + 5) + (64 + 1)


@pytest.mark.parametrize("name", SETTINGS)
def test_divergence_is_reported_and_counts_as_random(name: str) -> None:
    points = list(range(0, 401, 100))
    result = trained(name, points=points, learning_rate=1e38)
    lost = points.index(int(result.diverged_at[0]))
    assert lost > 0
    assert (result.greedy[0, lost:] == ALL_ACTIONS).all()
    assert contains(result.greedy[0, :lost]).sum(axis=-1).max() == 1
    is_lost = [step >= lost for step in (0, 2, 4)]  # the map steps
    assert np.isnan(result.values[0]).all(axis=(1, 2)).tolist() == is_lost
    if "ppo" in name:
        assert (result.stochastic[0, lost:] == 0.2).all()
    else:
        assert np.isnan(result.q[0]).all()


@pytest.mark.parametrize("name", SETTINGS)
def test_after_an_early_end_the_last_policy_stays(name: str) -> None:
    whole, asked = trained(name, points=[*range(0, 401, 50)]), list[Floats]()

    def may_end(i: int, table: Floats) -> bool:
        assert i == len(asked)
        asked.append(table)
        return i == 4

    ended = trained(name, points=[*range(0, 401, 50)], may_end=may_end)
    assert np.array_equal([1 << table.argmax(axis=1) for table in asked], ended.greedy[0, :5])
    for key in ("greedy", "disagreements"):
        assert np.array_equal(getattr(ended, key)[:, :5], getattr(whole, key)[:, :5])
    assert (ended.greedy[:, 5:] == ended.greedy[:, 4:5]).all()
    assert (np.diff(ended.disagreements[0, 5:]) == 0).all()
    assert ended.updates[0] < whole.updates[0]
