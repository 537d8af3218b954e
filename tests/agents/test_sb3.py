"""Stable-Baselines3's algorithms: the adapter, the settings, and training that is repeatable bit by bit.

`test_nets` compares the compiled algorithms with them; what all four have in common is tested here.
"""

import inspect
import math
import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from numpy.random import SeedSequence
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import DummyVecEnv

from agents import DeepTraining, Schedule, check_training, load_algorithm
from agents.dynamic_programming import solve
from agents.policy import ALL_ACTIONS, contains
from agents.sb3 import algorithms, tables
from agents.sb3.extractors import PeopleExtractor, PlanesExtractor
from agents.sb3.settings import DqnSettings, PolicyArguments, PpoSettings, Sb3Settings
from agents.sb3.tables import readable_table, saved_table
from agents.sb3.training import make_agent
from agents.sb3.vec_env import SB3VecEnv
from envs import EVENTS, InputError, ProxemicVectorEnv, compile_scenario, load_scenario
from envs.inputs import parse
from envs.model import PING
from envs.observations import compile_seen, observation_table
from tests.agents import MOODS

S1 = compile_scenario(load_scenario("S1"))
DQN = DqnSettings(budget=400, time_limit=50, train_freq=2, learning_rate=1e-3)
PPO = PpoSettings(budget=400, time_limit=50, n_steps=50, n_envs=2, batch_size=32, n_epochs=2)
METHODS: dict[str, Any] = {"sb3_dqn": algorithms.DQN, "sb3_ppo": algorithms.PPO}
COMPILED: dict[str, Any] = {name: load_algorithm(name) for name in ("compiled_dqn", "compiled_ppo")}
SETTINGS: dict[str, Sb3Settings] = {"sb3_dqn": DQN, "sb3_ppo": PPO, "compiled_dqn": DQN, "compiled_ppo": PPO}

# Random starts, random changes of an observed phase and, in S2, random feedback.
CHANGING: dict[str, Any] = {
    "grid.start": [[0, 0], [9, 0], [0, 11]],
    "observe": ["agent", "phase", "wrong_pings"],
    "phases": MOODS,
}


def vec_env(
    n: int, scenario: str = "S1", observation: str = "coordinates", limit: int = 7, **overrides: Any
) -> SB3VecEnv:
    return SB3VecEnv(ProxemicVectorEnv(n, scenario, observation, overrides, max_episode_steps=limit))


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
    scenario: str, n: int, overrides: dict[str, Any], observation: str
) -> None:
    ours: Any = vec_env(n, scenario, observation, **overrides)
    arguments: Any = {"observation": observation, "overrides": overrides, "max_episode_steps": 7}
    theirs: Any = DummyVecEnv([lambda: gymnasium.make(f"envs:Proxemic/{scenario}-v0", **arguments)] * n)
    ours.seed(3)
    theirs.seed(3)
    assert np.array_equal(ours.reset(), theirs.reset())
    actions = np.random.default_rng(0).choice(5, size=(250, n), p=[0.1, 0.1, 0.1, 0.1, 0.6])
    truncated = terminated = wrong = 0
    kept: list[Any] = []
    for action in actions:
        (*arrays, infos), (*their_arrays, their_infos) = ours.step(action), theirs.step(action)
        kept.append((arrays, [array.copy() for array in arrays]))
        for array, their_array in zip(arrays, their_arrays, strict=True):
            assert np.array_equal(array, their_array)
            assert array.dtype == their_array.dtype
        for info, expected in zip(infos, their_infos, strict=True):
            wrong += EVENTS[expected["event"]] in ("wrong_ping", "last_wrong_ping")
            assert info.get("TimeLimit.truncated", False) is expected["TimeLimit.truncated"]
            assert ("terminal_observation" in info) == ("terminal_observation" in expected)
            if "terminal_observation" in info:
                assert info["is_success"] is expected["is_success"]
                assert np.array_equal(info["terminal_observation"], expected["terminal_observation"])
                truncated += int(expected["TimeLimit.truncated"])
                terminated += not expected["TimeLimit.truncated"]
    assert truncated > 5
    assert terminated > 5
    assert ours.disagreements == wrong > 50
    assert all(map(np.array_equal, *pair) for pair in kept)  # what was returned is not written over


# Settings


@pytest.mark.parametrize("name", METHODS)
def test_settings_have_sb3s_names_and_defaults(name: str) -> None:
    settings = METHODS[name].settings
    parameters = inspect.signature(METHODS[name].load().__init__).parameters
    ours = {"budget", "time_limit", "n_envs", "policy_kwargs"}
    for key, field in settings.model_fields.items():
        if key not in ours:
            assert field.default == parameters[key].default, key


@pytest.mark.parametrize("name", METHODS)
def test_default_net_is_sb3s(name: str) -> None:
    settings = METHODS[name].settings.model_validate({"budget": 10240})
    ours = make_agent(METHODS[name].load(), settings, vec_env(1))
    theirs = METHODS[name].load()("MlpPolicy", vec_env(1))
    assert str(ours.policy) == str(theirs.policy)
    groups = [
        {key: value for key, value in agent.policy.optimizer.param_groups[0].items() if key != "params"}
        for agent in (ours, theirs)
    ]
    fused = {"fused": None} if "fused" in groups[1] else {}
    assert groups[0] | fused == groups[1]
    assert groups[0]["eps"] == settings.adam_epsilon
    changed = settings.model_validate({"budget": 10240, "policy_kwargs": {"optimizer_kwargs": {"eps": 0.5}}})
    agent = make_agent(METHODS[name].load(), changed, vec_env(1))
    assert agent.policy.optimizer.param_groups[0]["eps"] == 0.5 == changed.adam_epsilon
    assert type(ours.policy.optimizer) is type(theirs.policy.optimizer)


def test_replay_buffer_is_as_large_as_the_budget() -> None:
    assert DqnSettings(budget=400, buffer_size=50).arguments["buffer_size"] == 50
    settings = DqnSettings(budget=400, n_envs=4, train_freq=1)
    agent: Any = make_agent(METHODS["sb3_dqn"].load(), settings, vec_env(4))
    assert agent.replay_buffer.observations.nbytes == 400 * 2 * 4


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("sb3_ppo", {"n_steps": 2048}, "budget = 10000 is not a whole .* 2048 steps .*; .* 8192 or 10240"),
        ("sb3_ppo", {"n_steps": 2000, "n_envs": 8}, "rollouts of 16000 steps .*; accepted .*: 16000"),
        ("sb3_dqn", {"train_freq": 3}, "rollouts of 3 steps .*; accepted with this rollout: 9999 or 10002"),
        ("sb3_ppo", {"n_steps": 1}, "n_steps = 1: .*2"),
        ("sb3_ppo", {"policy_kwargs": {"net_arc": [5]}}, r"did you mean net_arch\?"),
        ("sb3_dqn", {"exploration_fraction": 0.0}, "exploration_fraction = 0.0"),
        ("sb3_dqn", {"policy_kwargs": {"net_arch": [0]}}, "net_arch.0 = 0"),
        ("compiled_dqn", {"policy_kwargs": {"net_arch": [5000]}}, "net_arch.0 = 5000: .*4096"),
        ("sb3_dqn", {"buffer_size": 10**9}, "buffer_size = 1000000000: .*10000000"),
        ("sb3_ppo", {"n_steps": 10**9}, "n_steps = 1000000000: .*1000000"),
        ("compiled_dqn", {"policy_kwargs": {"features_extractor_class": "a:B"}},
         "mine.toml: policy_kwargs.features_extractor_class = a:B: accepted: .* sb3_dqn or sb3_ppo"),
        ("sb3_ppo", {"policy_kwargs": {"features_extractor_class": "PlanesExtractor"}},
         "features_extractor_class = PlanesExtractor: accepted: module:attribute"),
        ("sb3_ppo", {"policy_kwargs": {"features_extractor_kwargs": {"a": 1}}},
         "features_extractor_kwargs without features_extractor_class: accepted: both"),
        ("stable_baselines3:PPO", {"policy_kwargs": {"features_extractor_class": "torch.nn:Linear"}},
         "PPO cannot be trained: policy_kwargs: features_extractor_class torch.nn:Linear: accepted"),
    ],
)  # fmt: skip
def test_settings_that_cannot_be_are_refused(name: str, values: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        parse(load_algorithm(name).settings, values, "mine.toml")


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("sb3_ppo", {}, 2000),  # 5 * 2000 = 10,000; 2048 does not divide it, nor does a number between
        ("compiled_ppo", {}, 2000),
        ("sb3_ppo", {"n_envs": 4}, 1250),  # 2 * 4 * 1250
        ("sb3_ppo", {"budget": 1000}, 1000),  # at most the budget
        ("sb3_ppo", {"budget": 8192}, 2048),
        ("sb3_ppo", {"n_steps": 100}, 100),
        ("sb3_contrib:TRPO", {}, 2000),
        ("sb3_dqn", {"budget": 9999}, 3),
    ],
)
def test_a_rollout_whose_length_is_not_set_divides_the_budget(
    name: str, values: dict[str, Any], expected: int
) -> None:
    settings: Any = parse(load_algorithm(name).settings, values, "mine.toml")
    length = settings.train_freq if name == "sb3_dqn" else settings.n_steps
    assert length == expected
    assert settings.arguments["train_freq" if name == "sb3_dqn" else "n_steps"] == expected


# Features extractors

PEOPLE, PLANES = (f"agents.sb3.extractors:{name}Extractor" for name in ("People", "Planes"))


def with_extractor(path: str, **arguments: Any) -> Any:
    policy = {"features_extractor_class": path, "features_extractor_kwargs": arguments}
    return parse(PolicyArguments, policy, "mine.toml")


@pytest.mark.parametrize("marks_first", [False, True])
@pytest.mark.parametrize("per_person", [2, 3])
def test_people_are_embedded_alike_and_added_up(per_person: int, marks_first: bool) -> None:
    n_people = 4
    space = spaces.Box(0, 1, (2 + n_people * per_person,), np.float32)
    extractor = PeopleExtractor(space, 5, per_person, marks_first=marks_first).double()
    rows = np.random.default_rng(1).random((6, *space.shape))
    w1, b1, w2, b2 = (values.detach().numpy() for values in extractor.parameters())
    expected = np.zeros((6, 2 + 5))
    for o, row in enumerate(rows):
        expected[o, :2] = row[:2]
        for i in range(n_people):
            person = row[2 + i * per_person : 2 + (i + 1) * per_person]
            given = np.concatenate([row[:2], person, [float(i == 0)] * marks_first])
            expected[o, 2:] += np.maximum(w2 @ np.maximum(w1 @ given + b1, 0) + b2, 0)
    features = extractor(torch.tensor(rows)).detach().numpy()
    assert np.allclose(features, expected, atol=1e-12)
    assert extractor.features_dim == 7
    people = rows[:, 2:].reshape(6, n_people, per_person)

    def moved(*order: int) -> Any:
        given = np.concatenate([rows[:, :2], people[:, [*order]].reshape(6, -1)], axis=1)
        return extractor(torch.tensor(given)).detach().numpy()

    assert np.allclose(moved(0, 3, 1, 2), features, atol=1e-12)
    assert np.allclose(moved(1, 0, 2, 3), features, atol=1e-12) == (not marks_first)


@pytest.mark.parametrize(
    ("extractor", "arguments", "shape", "expected"),
    [
        (
            PeopleExtractor,
            {},
            (2,),
            r"shape \(2,\); accepted: coordinates, 2 of the agent and per_person = 2 of",
        ),
        (PeopleExtractor, {"per_person": 3}, (6,), r"shape \(6,\); accepted: .* per_person = 3"),
        (PeopleExtractor, {}, (4, 5, 6), r"shape \(4, 5, 6\); accepted: coordinates"),
        (PlanesExtractor, {}, (4,), r"shape \(4,\); accepted: images"),
    ],
)
def test_extractors_refuse_other_observations(
    extractor: Any, arguments: dict[str, Any], shape: tuple[int, ...], expected: str
) -> None:
    with pytest.raises(InputError, match=expected):
        extractor(spaces.Box(0, 1, shape, np.float32), **arguments)


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize(
    ("observation", "path", "n_parameters", "n_features"),
    [
        ("planes", PLANES, 4 * 9 * 16 + 16 + 16 * 9 * 32 + 32 + 32 * 5 * 6 * 128 + 128, 128),
        ("coordinates", PEOPLE, 5 * 64 + 64 + 64 * 64 + 64, 2 + 64),
    ],
)
def test_agents_learn_with_features_extractors(
    name: str,
    observation: str,
    path: str,
    n_parameters: int,
    n_features: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model, kept = compile_scenario(load_scenario("Anywhere", {"issuer.places": 5})), list[Any]()
    settings = SETTINGS[name].model_copy(update={"policy_kwargs": with_extractor(path)})
    schedule = Schedule(400, (0, 200, 400), keep=kept.append)

    def train() -> Any:
        return METHODS[name].train(model, settings, observation, [SeedSequence(1)], schedule)

    training = train()
    check_training(training, model, 1, schedule)
    assert training.diverged_at[0] == -1
    agent, last = kept[-1], training.stochastic[0, -1] if "ppo" in name else training.q[0]
    body = (n_features * 64 + 64) + (64 * 64 + 64)
    heads = [5, 1] if "ppo" in name else [5]
    assert training.parameters[0] == n_parameters + sum(body + 64 * n + n for n in heads)
    # Saved, it is the same table, also if images are read in parts.
    agent.save(tmp_path / "agent.zip")
    monkeypatch.setattr(tables, "_AT_ONCE", 99)
    cls = f"stable_baselines3:{name[4:].upper()}"
    assert np.allclose(saved_table(tmp_path / "agent.zip", cls, model, observation)[0], last, atol=1e-6)
    assert (train().weights == training.weights).all()


def test_names_of_features_extractors_stay_names_until_an_agent_is_made() -> None:
    policy = with_extractor(PEOPLE, width=8)
    settings = PPO.model_copy(update={"policy_kwargs": policy})
    written = {"features_extractor_class": PEOPLE, "features_extractor_kwargs": {"width": 8}}
    for each in (settings, pickle.loads(pickle.dumps(settings))):
        assert each.model_dump(mode="json")["policy_kwargs"] == {"net_arch": [64, 64], **written}
        assert each.arguments["policy_kwargs"] == {
            "net_arch": [64, 64], **written, "features_extractor_class": PeopleExtractor,
        }  # fmt: skip
    assert PPO.model_dump(mode="json")["policy_kwargs"] == {"net_arch": [64, 64]}
    algorithm = load_algorithm("stable_baselines3:A2C")
    imported: Any = parse(algorithm.settings, {"budget": 100, "policy_kwargs": written}, "mine.toml")
    assert pickle.loads(pickle.dumps(imported)).arguments["policy_kwargs"] == {
        **written, "features_extractor_class": PeopleExtractor,
    }  # fmt: skip
    model = compile_scenario(load_scenario("Anywhere", {"issuer.places": 5}))
    schedule = Schedule(100, (0, 100))
    check_training(
        algorithm.train(model, imported, "coordinates", [SeedSequence(1)], schedule), model, 1, schedule
    )


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("no_such_module:Net", "no_such_module:Net cannot be imported: No module named"),
        ("agents.sb3.extractors:PlaneExtractor", "cannot be imported: .*did you mean PlanesExtractor"),
        ("numpy:ndarray", "numpy:ndarray: accepted: a subclass of .*BaseFeaturesExtractor"),
    ],
)
def test_what_is_no_features_extractor_is_refused(path: str, expected: str) -> None:
    with pytest.raises(InputError, match=f"^policy_kwargs: features_extractor_class .*{expected}"):
        trained("sb3_ppo", policy_kwargs=with_extractor(path))


# Training


@pytest.mark.parametrize("name", METHODS)
def test_sb3s_own_algorithms_learn_from_where_several_people_are(name: str) -> None:
    values: Any = {"learning_starts": 50} if name == "sb3_dqn" else {"n_steps": 100, "batch_size": 50}
    for observation in ("offset", "offset_one_hot", "offset_coordinates"):
        arguments: Any = {"observation": observation, "overrides": {"issuer.places": 5}}
        env = gymnasium.make("envs:Proxemic/ThreeTalking-v0", **arguments)
        model = compile_seen(load_scenario("ThreeTalking", {"issuer.places": 5}), observation)
        agent = METHODS[name].load()("MlpPolicy", env, seed=1, **values).learn(200)
        table = observation_table(model, observation)
        assert readable_table(agent, torch.as_tensor(table)).shape == (model.n_observations, 5)
        assert (table.reshape(len(table), -1) == env.reset(seed=1)[0]).all(axis=1).any()


def trained(
    name: str,
    seed: int = 0,
    points: Sequence[int] = (0, 200, 400),
    observation: str = "one_hot",
    may_end: Any = None,
    **changes: Any,
) -> Any:
    settings = SETTINGS[name].model_copy(update=changes)
    schedule = Schedule(settings.budget, tuple(points), tuple(points[::2]), may_end)
    return (METHODS | COMPILED)[name].train(S1, settings, observation, [SeedSequence([4, seed])], schedule)


@pytest.mark.parametrize("name", SETTINGS)
def test_same_seed_gives_the_same_weights_however_often_the_policy_is_kept(name: str) -> None:
    alone = trained(name, 0)
    torch.rand(3)
    np.random.rand(3)  # noqa: NPY002
    seeds = [SeedSequence([4, 1]), SeedSequence([4, 0])]
    schedule = Schedule(400, tuple(range(0, 401, 100)), (0, 200, 400))
    together = (METHODS | COMPILED)[name].train(S1, SETTINGS[name], "one_hot", seeds, schedule)
    check_training(together, S1, 2, schedule)
    assert isinstance(together, DeepTraining)
    assert (together.weights[1] == alone.weights[0]).all()
    assert (together.weights[0] != together.weights[1]).any()
    for key in ("greedy", "disagreements"):
        assert np.array_equal(getattr(together, key)[1, ::2], getattr(alone, key)[0])
    assert np.array_equal(together.q[1], alone.q[0])
    # SB3 takes the first of several best actions.
    assert (1 << together.values.argmax(axis=-1) == together.greedy[:, ::2]).all()
    last = together.stochastic[:, -1] if "ppo" in name else together.q
    assert (together.values[:, -1] == last.astype(np.float32)).all()
    assert (together.greedy[:, 0] != together.greedy[:, -1]).any()
    assert together.disagreements[0, 0] == 0 < together.disagreements[0, -1]
    assert (np.diff(together.disagreements) >= 0).all()
    assert (np.diff(together.cpu_time_s) > 0).all()


def test_training_leaves_the_global_generators_and_threads_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    step_wait, met = SB3VecEnv.step_wait, []

    def counted(self: SB3VecEnv) -> Any:
        met.append((self.num_envs, torch.get_num_threads()))
        return step_wait(self)

    monkeypatch.setattr(SB3VecEnv, "step_wait", counted)
    np.random.seed(1)  # noqa: NPY002
    before = torch.get_rng_state(), torch.get_num_threads()
    trained("sb3_dqn", points=[], n_envs=4, train_freq=1)
    assert met == [(4, 1)] * 100  # exactly the declared steps, on one thread
    assert torch.equal(torch.get_rng_state(), before[0])
    assert torch.get_num_threads() == before[1]
    assert np.random.rand() == np.random.RandomState(1).rand()  # noqa: NPY002


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


def test_linear_layer_over_one_hot_learns_the_optimal_values() -> None:
    settings = DqnSettings(
        budget=4000, time_limit=50, train_freq=2, learning_rate=1e-2, gamma=0.9, batch_size=128,
        target_update_interval=50, exploration_fraction=1.0, exploration_final_eps=1.0,
        policy_kwargs=PolicyArguments(net_arch=()),
    )  # fmt: skip
    room = {"grid.rows": 5, "grid.columns": 6, "issuer.position": [2, 4], "regions.target_radius": 2}
    small = compile_scenario(load_scenario("S1", room | {"regions.uncomfortable_radius": 1}))
    q = METHODS["sb3_dqn"].train(small, settings, "one_hot", [SeedSequence(1)], Schedule(4000)).q[0]
    expected = solve(small, 0.9).q[small.start]  # with no wrong PING so far, and the moves alone
    assert q[small.start, :PING] == pytest.approx(expected[:PING], abs=0.1)


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


def test_errors_of_torch_are_no_divergence(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any) -> NDArray[Any]:
        raise ValueError("something else")

    monkeypatch.setattr(SB3VecEnv, "step_wait", broken)
    with pytest.raises(ValueError, match="something else"):
        trained("sb3_ppo")


@pytest.mark.parametrize("name", SETTINGS)
def test_after_an_early_end_the_last_policy_stays(name: str) -> None:
    whole, asked = trained(name, points=[*range(0, 401, 50)]), list[NDArray[np.float64]]()

    def may_end(i: int, table: NDArray[np.float64]) -> bool:
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
    assert (whole.weights != ended.weights).any()
