"""The batched DQN and PPO: equal to Stable-Baselines3's update by update, and to themselves in any batch."""

from collections import deque
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
import torch
from numpy.random import SeedSequence
from numpy.typing import NDArray
from stable_baselines3.common.utils import LinearSchedule

from agents import DeepTraining, Schedule, load_algorithm
from agents.batched import dqn, kernels, ppo
from agents.batched.settings import BatchedDqnSettings, BatchedPpoSettings
from agents.dynamic_programming import evaluate
from agents.policy import ALL_ACTIONS, mask_policy
from agents.sb3 import algorithms
from agents.sb3.settings import PolicyArguments
from agents.sb3.training import make_agent
from agents.sb3.vec_env import SB3VecEnv
from envs import InputError, Model, ProxemicVectorEnv, compile_scenario, load_scenario
from envs.model import EVENTS

S1 = compile_scenario(load_scenario("S1"))
S2 = compile_scenario(load_scenario("S2"))
SETTINGS: dict[str, Any] = {
    "batched_dqn": BatchedDqnSettings(
        budget=400,
        time_limit=30,
        train_freq=2,
        learning_rate=1e-3,
        target_update_interval=50,
        exploration_fraction=0.8,
        policy_kwargs=PolicyArguments(net_arch=(24, 16)),
    ),
    "batched_ppo": BatchedPpoSettings(
        budget=400,
        time_limit=30,
        n_envs=2,
        n_steps=20,
        batch_size=20,
        n_epochs=10,
        policy_kwargs=PolicyArguments(net_arch=(24, 16)),
    ),
}
OBSERVATIONS = ["one_hot", "coordinates"]
N_AGENTS = 3


def settings_of(name: str, **changes: Any) -> Any:
    return type(SETTINGS[name]).model_validate(SETTINGS[name].model_dump() | changes)


def trained(
    name: str,
    observation: str = "one_hot",
    seeds: list[int] | None = None,
    model: Model = S1,
    points: tuple[int, ...] = (0, 200, 400),
    **changes: Any,
) -> DeepTraining:
    settings = settings_of(name, **changes)
    sequences = [SeedSequence([4, seed]) for seed in (seeds or range(N_AGENTS))]
    training = load_algorithm(name).train(
        model, settings, observation, sequences, Schedule(settings.budget, points, points[::2])
    )
    assert isinstance(training, DeepTraining)
    return training


# Equal to Stable-Baselines3. Both make a whole run. What the batched agents drew at random (first weights,
# actions, mini-batches) is handed to an agent of Stable-Baselines3; then its final weights must be the same.


class Drawn:
    """What a batched run drew, agent by agent."""

    def __init__(self) -> None:
        self.learner: Any = None
        self.first: list[NDArray[np.float32]] = []  # first weights and biases, (N, ...) each
        self.actions: list[NDArray[np.int64]] = []  # (N, E) of every step of the envs
        self.batches: list[tuple[NDArray[np.int64], ...]] = []  # (N, B) each


def wrap(
    monkeypatch: pytest.MonkeyPatch, owner: Any, name: str, after: Callable[[Any, tuple[Any, ...]], None]
) -> None:
    """Has something done after each call of a function, with its result and arguments."""
    original = getattr(owner, name)

    def wrapped(*arguments: Any) -> Any:
        result = original(*arguments)
        after(result, arguments)
        return result

    monkeypatch.setattr(owner, name, wrapped)


def recorded(monkeypatch: pytest.MonkeyPatch, module: Any) -> Drawn:
    """Records what the next run draws."""
    drawn = Drawn()

    def keep_first(_: Any, arguments: tuple[Any, ...]) -> None:
        drawn.learner = arguments[0]
        drawn.first = [value.numpy().copy() for value in drawn.learner.parameters.values]

    wrap(monkeypatch, module.Learner, "draw_weights", keep_first)
    return drawn


def set_weights(net: torch.nn.Module, values: list[NDArray[np.float32]], agent: int) -> None:
    """Copies weights and biases of an agent into linear layers."""
    layers = [layer for layer in net.modules() if isinstance(layer, torch.nn.Linear)]
    assert len(layers) == len(values) // 2
    for i, layer in enumerate(layers):
        layer.weight.data.copy_(torch.from_numpy(values[2 * i][agent].T.copy()))
        layer.bias.data.copy_(torch.from_numpy(values[2 * i + 1][agent, 0].copy()))


def check_weights(net: torch.nn.Module, values: list[torch.Tensor], agent: int) -> None:
    """Checks that linear layers have an agent's weights, within 1e-4 of their size."""
    layers = [layer for layer in net.modules() if isinstance(layer, torch.nn.Linear)]
    for i, layer in enumerate(layers):
        for ours, theirs in (
            (values[2 * i][agent].T, layer.weight.detach()),
            (values[2 * i + 1][agent, 0], layer.bias.detach()),
        ):
            assert torch.linalg.vector_norm(ours - theirs) <= 1e-4 * torch.linalg.vector_norm(theirs)


def stock_agent(name: str, settings: Any, observation: str) -> Any:
    """Returns an agent of Stable-Baselines3 with the same settings, on S1."""
    method = algorithms.DQN.method if name == "batched_dqn" else algorithms.PPO.method
    env = ProxemicVectorEnv(
        settings.n_envs, "S1", observation, max_episode_steps=settings.time_limit, autoreset_mode="SameStep"
    )
    theirs = method.settings.model_validate(settings.model_dump(exclude={"device"}))
    return make_agent(method, theirs, SB3VecEnv(env))


DQN_CHANGES: list[dict[str, Any]] = [
    {},
    {"learning_rate": 1e-2, "gamma": 0.7, "policy_kwargs": {"net_arch": ()}},
    {"buffer_size": 150, "batch_size": 50, "policy_kwargs": {"net_arch": (128, 128)}},
    {"learning_starts": 173, "train_freq": 4, "gradient_steps": 3},
    {"n_envs": 4, "train_freq": 5, "gradient_steps": -1, "buffer_size": 203},
    {"tau": 0.3, "target_update_interval": 7},
    {"n_steps": 3, "time_limit": 11, "buffer_size": 90},
    {"n_steps": 4, "n_envs": 2, "max_grad_norm": 0.01, "time_limit": None, "gradient_steps": 2},
    {"exploration_initial_eps": 0.9, "exploration_final_eps": 0.2, "exploration_fraction": 0.3},
]


@pytest.mark.parametrize("changes", DQN_CHANGES, ids=str)
@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_dqn_is_stable_baselines3s(
    observation: str, changes: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    changes = {"budget": 600} | changes
    settings = settings_of("batched_dqn", **changes)
    drawn = recorded(monkeypatch, dqn)
    rates: list[float] = []

    def keep_actions(_: Any, arguments: tuple[Any, ...]) -> None:
        _, _, _, epsilon, replay, row = arguments
        drawn.actions.append(replay.action[:, row].astype(np.int64))
        rates.append(epsilon)

    wrap(monkeypatch, kernels, "act", keep_actions)
    wrap(
        monkeypatch,
        dqn.Learner,
        "draw",
        lambda batch, _: drawn.batches.append(tuple(part.copy() for part in batch)),
    )
    training = trained("batched_dqn", observation, **changes)
    n_updates = len(drawn.batches)
    assert n_updates >= 200
    assert training.updates.tolist() == [n_updates] * N_AGENTS
    for agent in range(N_AGENTS):
        stock = stock_agent("batched_dqn", settings, observation)
        set_weights(stock.q_net, drawn.first, agent)
        set_weights(stock.q_net_target, drawn.first, agent)
        actions = deque(actions[agent] for actions in drawn.actions)
        their_rates: list[float] = []

        def act(
            learning_starts: int,
            *_: Any,
            stock: Any = stock,
            actions: Any = actions,
            rates: Any = their_rates,
        ) -> Any:
            rates.append(1.0 if stock.num_timesteps < learning_starts else stock.exploration_rate)
            return (actions[0], actions.popleft())

        indices = deque(part[agent] for batch in drawn.batches for part in batch)

        def draw(low: int, high: int, size: Any, indices: Any = indices) -> NDArray[np.int64]:
            rows = np.asarray(indices.popleft())
            assert low == 0
            assert rows.max() < high
            assert rows.shape == (size if isinstance(size, tuple) else (size,))
            return rows

        monkeypatch.setattr(stock, "_sample_action", act)
        monkeypatch.setattr(np.random, "randint", draw)
        stock.learn(settings.budget)
        monkeypatch.undo()
        assert not actions
        assert not indices
        assert rates == pytest.approx(their_rates)
        check_weights(stock.q_net, drawn.learner.parameters.values, agent)


PPO_CHANGES: list[dict[str, Any]] = [
    {},
    {"learning_rate": 1e-2, "gamma": 0.7, "policy_kwargs": {"net_arch": ()}},
    {"batch_size": 40, "ent_coef": 0.05, "n_epochs": 20, "policy_kwargs": {"net_arch": (128, 128)}},
    {"batch_size": 17, "gae_lambda": 0.5, "vf_coef": 1.5},
    {"batch_size": 13, "clip_range": 0.02, "learning_rate": 3e-3},
    {"clip_range_vf": 0.05, "learning_rate": 3e-3},
    {"normalize_advantage": False, "max_grad_norm": 0.05, "time_limit": 7},
    {"target_kl": 0.004, "learning_rate": 3e-3, "n_envs": 4, "n_steps": 5},
    {"n_envs": 1, "n_steps": 40, "batch_size": 39, "time_limit": None},
]


@pytest.mark.parametrize("changes", PPO_CHANGES, ids=str)
@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_ppo_is_stable_baselines3s(
    observation: str, changes: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = settings_of("batched_ppo", **changes)
    drawn = recorded(monkeypatch, ppo)
    shape = N_AGENTS, settings.n_envs, settings.n_steps

    def keep_actions(_: Any, arguments: tuple[Any, ...]) -> None:
        by_env = arguments[7].action.reshape(shape)
        drawn.actions.extend(by_env[:, :, t].copy() for t in range(settings.n_steps))

    wrap(monkeypatch, kernels, "roll_out", keep_actions)
    wrap(
        monkeypatch,
        kernels,
        "shuffle",
        lambda _, arguments: drawn.batches.append((arguments[1].copy(),)),
    )
    training = trained("batched_ppo", observation, **changes)
    for agent in range(N_AGENTS):
        stock = stock_agent("batched_ppo", settings, observation)
        half = len(drawn.first) // 2
        actors = torch.nn.ModuleList([stock.policy.mlp_extractor.policy_net, stock.policy.action_net])
        critics = torch.nn.ModuleList([stock.policy.mlp_extractor.value_net, stock.policy.value_net])
        set_weights(actors, drawn.first[:half], agent)
        set_weights(critics, drawn.first[half:], agent)
        actions = deque(torch.from_numpy(actions[agent]) for actions in drawn.actions)
        rollouts = settings.budget // settings.rollout
        orders = [
            deque(
                batch[0][agent]
                for batch in drawn.batches[i * settings.n_epochs : (i + 1) * settings.n_epochs]
            )
            for i in range(rollouts)
        ]

        def sample(_: Any, __: Any = None, actions: Any = actions) -> torch.Tensor:
            sampled: torch.Tensor = actions.popleft()
            return sampled

        def permute(n: int, orders: Any = orders, stock: Any = stock) -> NDArray[np.int64]:
            order = orders[stock.num_timesteps // settings.rollout - 1].popleft()
            assert len(order) == n
            return np.asarray(order)

        monkeypatch.setattr(torch.distributions.Categorical, "sample", sample)
        monkeypatch.setattr(np.random, "permutation", permute)
        stock.learn(settings.budget)
        monkeypatch.undo()
        assert not actions
        n_steps = int(next(iter(stock.policy.optimizer.state.values()))["step"])
        assert training.updates[agent] == n_steps
        whole = rollouts * settings.n_epochs * -(-settings.rollout // settings.batch_size)
        assert 20 < n_steps < whole if settings.target_kl else n_steps == whole >= 200
        check_weights(actors, drawn.learner.parameters.values[:half], agent)
        check_weights(critics, drawn.learner.parameters.values[half:], agent)


def test_exploration_is_scheduled_as_in_stable_baselines3() -> None:
    settings = settings_of("batched_dqn", exploration_initial_eps=0.9, exploration_fraction=0.37)
    schedule = LinearSchedule(0.9, 0.05, 0.37)
    for taken in range(401):
        assert dqn.exploration_rate(settings, taken) == schedule(1.0 - taken / 400)


# Acting


@pytest.mark.parametrize("scenario", ["S1", "S2", "S3"])
def test_agents_step_as_the_vector_env_does(scenario: str) -> None:
    model = compile_scenario(load_scenario(scenario))
    n_agents, n_envs, n_steps, limit = 2, 3, 400, 20
    world = kernels.world_of(model, limit)
    seeds = np.arange(1, 9, dtype=np.uint64).reshape(2, 4) * np.uint64(0x9E3779B97F4A7C15)
    shape = n_agents, n_envs
    agents = kernels.Agents(
        seeds, np.full(shape, model.start), np.zeros(shape, np.int64), np.zeros(n_agents, np.int64)
    )
    buffer = [np.zeros((n_agents, n_steps, n_envs), kind) for kind in ("i2", "i1", "f4", "i2", "?", "?")]
    replay = kernels.Replay(*buffer)
    for row in range(n_steps):
        q = np.tile(np.array([0, 0, 0, 0, 1], np.float32), (*shape, 1))
        kernels.act(world, agents, q, 0.5, replay, row)
    env = ProxemicVectorEnv(n_agents * n_envs, scenario, max_episode_steps=limit, autoreset_mode="SameStep")
    cells, _ = env.reset()
    wrong = np.zeros(n_agents * n_envs, dtype=np.int64)
    for row in range(n_steps):
        assert np.array_equal(cells, replay.observation[:, row].ravel())
        actions = replay.action[:, row].ravel().astype(np.int64)
        cells, _, terminated, truncated, info = env.step(actions)
        following = cells.copy()
        ended = terminated | truncated
        if ended.any():
            following[ended] = info["final_obs"][ended].astype(np.int64)
        assert np.array_equal(following, replay.next_observation[:, row].ravel())
        assert np.array_equal(terminated, replay.terminated[:, row].ravel())
        assert np.array_equal(truncated & ~terminated, replay.truncated[:, row].ravel())
        event = np.where(ended, info["final_info"]["event"], info["event"]) if ended.any() else info["event"]
        grid, issuer = (
            np.where(ended, info["final_info"][name], info[name]) if ended.any() else info[name]
            for name in ("grid_reward", "issuer_reward")
        )
        received = replay.reward[:, row].ravel()
        if scenario == "S2":  # the issuer's reward is drawn
            assert (np.abs(received - grid) <= np.where(actions == 4, 1.0, 1e-6)).all()
        else:
            assert received == pytest.approx(grid + issuer, abs=1e-6)
        wrong += np.isin(event, [EVENTS.index("wrong_ping"), EVENTS.index("last_wrong_ping")])
    assert agents.disagreements.tolist() == wrong.reshape(shape).sum(axis=1).tolist()
    share = (replay.action != 4).mean()  # half of the steps explore, a fifth of these by PING
    assert abs(share - 0.4) < 4 * np.sqrt(0.4 * 0.6 / (n_steps * n_agents))


def test_issuers_rewards_and_probabilities_are_drawn_from_the_right_distributions() -> None:
    n_agents, n_envs, n_steps = 2, 2, 5000
    world = kernels.world_of(S2, None)
    seeds = np.arange(1, 9, dtype=np.uint64).reshape(2, 4) * np.uint64(0x9E3779B97F4A7C15)
    shape = n_agents, n_envs
    agents = kernels.Agents(
        seeds, np.full(shape, S2.start), np.zeros(shape, np.int64), np.zeros(n_agents, np.int64)
    )
    size = n_agents, n_envs * n_steps
    rollout = kernels.Rollout(*(np.zeros(size, kind) for kind in ("i8", "i8", "f4", "f4", "f4", "f4")))
    expected = np.array([0.1, 0.3, 0.05, 0.25, 0.3], np.float32)
    probability = np.tile(expected, (n_agents, 120, 1))
    value = np.zeros((n_agents, 120), np.float32)
    counts = np.zeros((n_agents, n_steps), np.int64)
    kernels.roll_out(world, agents, probability, np.log(probability), value, 0.0, 0.0, rollout, counts)
    shares = np.bincount(rollout.action.ravel(), minlength=5) / rollout.action.size
    assert shares == pytest.approx(expected, abs=4 * np.sqrt(0.25 / rollout.action.size))
    assert np.exp(rollout.old_log_probability) == pytest.approx(expected[rollout.action])
    # Without a discount an advantage is the reward: at a wrong PING, -0.4 and the issuer's.
    cells = rollout.cell % 120
    wrong = (rollout.action == 4) & (cells == 0)
    noise = np.sort(rollout.advantage[wrong] + 0.4)  # the fifth costs 1, as far below
    noise = noise[np.abs(noise) <= 1]
    assert np.abs(noise.mean()) < 0.2
    assert counts[:, -1].tolist() == agents.disagreements.tolist()
    assert (np.diff(counts) >= 0).all()


# Any batch


def equal(one: DeepTraining, other: DeepTraining, rows: Any = slice(None)) -> bool:
    """Returns whether all results are equal, bit for bit; times aside."""
    return all(
        np.array_equal(getattr(one, field.name)[rows], getattr(other, field.name), equal_nan=True)
        for field in fields(one)
        if field.name != "cpu_time_s"
    )


@pytest.mark.parametrize("observation", OBSERVATIONS)
@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("net_arch", [(), (128, 128), (33,)])
def test_bits_of_an_agent_do_not_depend_on_its_batch(
    name: str, observation: str, net_arch: tuple[int, ...]
) -> None:
    changes: dict[str, Any] = {"policy_kwargs": {"net_arch": net_arch}, "batch_size": 40}
    together = trained(name, observation, [*range(7)], **changes)
    for seeds in ([3], [6, 0], [5, 4, 3, 2, 1]):
        assert equal(together, trained(name, observation, seeds, **changes), seeds)
    assert len(np.unique(together.weights, axis=0)) == 7


@pytest.mark.parametrize("name", SETTINGS)
def test_a_diverged_agent_counts_as_random_and_disturbs_no_other(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    sound = trained(name, seeds=[0, 2])
    module = dqn if name == "batched_dqn" else ppo
    wrap(
        monkeypatch,
        module.Learner,
        "draw_weights",
        lambda _, arguments: arguments[0].parameters.values[0][1].fill_(torch.nan),
    )
    training = trained(name)
    assert training.diverged_at.tolist() == [-1, 0, -1]
    assert equal(training, sound, [0, 2])
    assert (training.greedy[1] == ALL_ACTIONS).all()
    assert np.isnan(training.values[1]).all()
    assert np.isnan(training.q[1]).all()
    assert (training.stochastic[1] == 0.2).all()
    assert training.disagreements[1].tolist() == [0, 0, 0]


# What is kept


@pytest.mark.parametrize("name", SETTINGS)
def test_last_snapshot_is_the_final_net_and_the_first_the_untrained(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = recorded(monkeypatch, dqn if name == "batched_dqn" else ppo)
    training = trained(name, points=(0, 130, 390, 400))
    read = drawn.learner.action_values if name == "batched_dqn" else drawn.learner.probabilities
    final = read().numpy()
    assert training.greedy[:, -1].tolist() == (1 << final.argmax(axis=2)).tolist()
    if name == "batched_dqn":
        assert np.array_equal(training.q, final.astype(np.float64))
        assert training.stochastic.shape == (N_AGENTS, 0, 120, 5)
    else:
        assert training.stochastic[:, -1] == pytest.approx(final, abs=1e-6)
        assert training.stochastic.sum(axis=-1) == pytest.approx(1.0)
        assert training.q.shape == (N_AGENTS, 0, 5)
    for value, first in zip(drawn.learner.parameters.values, drawn.first, strict=True):
        value.copy_(torch.from_numpy(first))
    assert training.values[:, 0] == pytest.approx(read().numpy(), abs=1e-6)


@pytest.mark.parametrize("name", SETTINGS)
def test_more_snapshots_change_no_result(name: str) -> None:
    few, many = trained(name), trained(name, points=tuple(range(0, 401, 20)))
    assert np.array_equal(few.weights, many.weights)
    assert np.array_equal(few.disagreements, many.disagreements[:, ::10])
    assert np.array_equal(few.greedy, many.greedy[:, ::10])
    assert (np.diff(many.disagreements) >= 0).all()
    assert many.disagreements[:, -1].min() > 0
    assert (np.diff(many.cpu_time_s) >= 0).all()
    assert (many.cpu_time_s[:, -1] > 0).all()


def test_parameters_and_updates_by_hand() -> None:
    assert trained("batched_dqn").parameters.tolist() == [120 * 24 + 24 + 24 * 16 + 16 + 16 * 5 + 5] * 3
    hidden = 2 * 24 + 24 + 24 * 16 + 16
    training = trained("batched_ppo", "coordinates")
    assert training.parameters.tolist() == [2 * hidden + 16 * 5 + 5 + 16 + 1] * 3
    assert training.updates.tolist() == [400 // 40 * 10 * 2] * 3


def test_torch_is_left_as_it_was() -> None:
    threads = torch.get_num_threads()
    trained("batched_dqn")
    assert torch.get_num_threads() == threads
    assert torch.is_grad_enabled()
    tiny = torch.tensor([1e-39])
    assert (tiny * 0.5).item() > 0


@pytest.mark.parametrize("name", SETTINGS)
def test_calls_without_agents_or_for_another_budget_are_refused(name: str) -> None:
    train = load_algorithm(name).train
    with pytest.raises(ValueError, match="0 agents"):
        train(S1, SETTINGS[name], "one_hot", [], Schedule(400))
    with pytest.raises(ValueError, match="made for a budget of 300"):
        train(S1, SETTINGS[name], "one_hot", [SeedSequence(0)], Schedule(300))


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")
@pytest.mark.parametrize("name", SETTINGS)
def test_a_device_that_is_not_there_gets_a_sentence(name: str) -> None:
    with pytest.raises(InputError, match='device = "cuda": torch finds no CUDA device here; accepted: "cpu"'):
        trained(name, device="cuda")


# Learning


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("batched_dqn", {"budget": 4000, "learning_rate": 3e-3, "gamma": 0.9, "target_update_interval": 100}),
        (
            "batched_ppo",
            {
                "budget": 6000,
                "n_envs": 4,
                "n_steps": 25,
                "batch_size": 100,
                "learning_rate": 2e-3,
                "gamma": 0.95,
            },
        ),
    ],
)
@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_most_agents_solve_a_small_scene(name: str, changes: dict[str, Any], observation: str) -> None:
    small = compile_scenario(
        load_scenario("S1", {"grid.rows": 6, "grid.columns": 6, "issuer.position": [3, 3]})
    )
    training = trained(
        name,
        observation,
        [*range(10)],
        small,
        (0, changes["budget"]),
        policy_kwargs={"net_arch": (64,)},
        **changes,
    )
    success = evaluate(small, mask_policy(training.greedy[:, -1]), 200).success
    assert (success > 0.99).sum() >= 7
