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
from scipy.stats import chisquare, kstest
from stable_baselines3.common.utils import LinearSchedule

from agents import DeepTraining, Schedule, load_algorithm
from agents.batched import dqn, kernels, ppo
from agents.batched.nets import Activation, Nets, Parameters, layer_shapes
from agents.batched.settings import BatchedDqnSettings, BatchedPpoSettings
from agents.batched.training import Streams, input_table
from agents.dynamic_programming import evaluate
from agents.policy import ALL_ACTIONS, mask_policy
from agents.sb3 import algorithms
from agents.sb3.settings import PolicyArguments
from agents.sb3.training import make_agent
from agents.sb3.vec_env import SB3VecEnv
from envs import InputError, Model, ProxemicVectorEnv, compile_scenario, load_scenario
from envs.observations import observation_blocks, observation_table

S1 = compile_scenario(load_scenario("S1"))
S2 = compile_scenario(load_scenario("S2"))
# Three observed parts, two outcomes of every action, and six starts. O = 490.
MOODS = compile_scenario(
    load_scenario(
        "S1",
        {
            "grid": {"rows": 7, "columns": 7, "start": [[0, 0], [6, 0], [0, 6]]},
            "issuer.position": [4, 4],
            "phases": [
                {"name": "calm", "next": {"tense": 0.3}},
                {
                    "name": "tense",
                    "next": {"calm": 0.5},
                    "regions": {"uncomfortable_radius": 2, "target_radius": 3},
                },
            ],
            "first_phase": "any",
            "observe": ["agent", "phase", "wrong_pings"],
        },
    )
)
NOISY_MOODS = compile_scenario(
    load_scenario(MOODS.scenario, {"issuer.feedback": {"kind": "uniform", "low": -1.0, "high": 1.0}})
)
# So many observations, 13,320, that nets are not read for all of them while they learn.
ANYWHERE = compile_scenario(
    load_scenario("S1", {"issuer.position": "anywhere", "observe": ["agent", "issuer"]})
)
SCENES = {"S1": S1, "moods": MOODS, "noisy moods": NOISY_MOODS, "anywhere": ANYWHERE}
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
CHECKED_AGENTS = [0, 2]


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
        self.observations: list[NDArray[np.int64]] = []  # (N, E) before the steps
        self.next_observations: list[NDArray[np.int64]] = []  # (N, E) after them, before resets
        self.batches: list[tuple[NDArray[np.int64], ...]] = []  # (N, B) each


def nets_of(module: Any) -> Any:
    """Returns the class of the nets of an algorithm's module."""
    return dqn.QNets if module is dqn else ppo.ActorCritics


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

    wrap(monkeypatch, nets_of(module), "draw_weights", keep_first)
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


class Replayed(ProxemicVectorEnv):
    """An env whose random numbers are such that one agent's observations come again.

    Of what the agent did, it gets the random numbers alone: it must be in the same states by itself.
    """

    def __init__(self, drawn: Drawn, agent: int, n_envs: int, *arguments: Any, **keywords: Any) -> None:
        self.wanted = [observations[agent] for observations in drawn.observations]  # (E,) of each step
        self.wanted_next = [observations[agent] for observations in drawn.next_observations]
        self.n_taken = 0
        super().__init__(n_envs, *arguments, **keywords)

    def advance(self, actions: NDArray[Any], *_: Any) -> Any:
        assert np.array_equal(self.model.observation[self._state], self.wanted[self.n_taken])
        following = self.model.observation[self.model.next_state[self._state, actions]]  # (E, K)
        probability = self.model.probability[self._state, actions]
        fits = (following == self.wanted_next[self.n_taken][:, None]) & (probability > 0)
        assert fits.any(axis=1).all()
        below = np.column_stack([np.zeros(len(fits)), probability[:, :-1].cumsum(axis=1)])
        self.n_taken += 1
        outcome = below[np.arange(len(fits)), fits.argmax(axis=1)]
        return super().advance(actions, None, outcome)

    def restart(self, envs: NDArray[np.intp], _: Any) -> None:
        if self.n_taken == len(self.wanted):  # after the last step
            return super().restart(envs, np.zeros(len(envs)))
        fits = self.model.observation[self.model.starts] == self.wanted[self.n_taken][envs, None]
        assert (fits.sum(axis=1) == 1).all()
        return super().restart(envs, (fits.argmax(axis=1) + 0.5) / fits.shape[1])


def stock_agent(name: str, settings: Any, observation: str, model: Model, drawn: Drawn, agent: int) -> Any:
    """Returns an agent of Stable-Baselines3 with the same settings, in the scene as the agent met it."""
    method = algorithms.DQN.method if name == "batched_dqn" else algorithms.PPO.method
    limit = settings.time_limit
    env = Replayed(
        drawn,
        agent,
        settings.n_envs,
        model.scenario,
        observation,
        max_episode_steps=limit,
        autoreset_mode="SameStep",
    )
    theirs = method.settings.model_validate(settings.model_dump(exclude={"device"}))
    return make_agent(method, theirs, SB3VecEnv(env))


def in_turn(*cases: tuple[str, dict[str, Any]]) -> list[tuple[str, str, dict[str, Any]]]:
    """Gives the cases the two forms of observation by turns; the case without changes gets both."""
    given = [(OBSERVATIONS[i % 2], *case) for i, case in enumerate(cases)]
    return [*given, *((OBSERVATIONS[1], scene, changes) for scene, changes in cases if not changes)]


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
    # Greedy from the start.
    {
        "exploration_initial_eps": 0.0,
        "exploration_final_eps": 0.0,
        "learning_starts": 0,
        "n_envs": 3,
        "train_freq": 1,
        "target_update_interval": 2,
        "batch_size": 40,
        "buffer_size": 60,
    },
]


@pytest.mark.filterwarnings("ignore:The number of environments used")
@pytest.mark.parametrize(
    ("observation", "scene", "changes"),
    in_turn(
        *(("S1", changes) for changes in DQN_CHANGES),
        ("moods", {"n_envs": 2, "n_steps": 3, "time_limit": 11, "buffer_size": 90, "gradient_steps": 2}),
        ("anywhere", {"tau": 0.3, "target_update_interval": 7}),
        ("anywhere", {"batch_size": 90, "target_update_interval": 400}),  # read for all observations
    ),
    ids=str,
)
def test_dqn_is_stable_baselines3s(
    observation: str, scene: str, changes: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    model = SCENES[scene]
    changes = {"budget": 600} | changes
    settings = settings_of("batched_dqn", **changes)
    drawn = recorded(monkeypatch, dqn)
    rates: list[float] = []

    def keep_actions(_: Any, arguments: tuple[Any, ...]) -> None:
        _, _, _, epsilon, replay, row = arguments
        if len(replay.action):  # not when it is compiled
            drawn.actions.append(replay.action[:, row].astype(np.int64))
            drawn.observations.append(replay.observation[:, row].astype(np.int64))
            drawn.next_observations.append(replay.next_observation[:, row].astype(np.int64))
            rates.append(epsilon)

    wrap(monkeypatch, kernels, "act", keep_actions)
    wrap(
        monkeypatch,
        dqn.QNets,
        "draw",
        lambda batch, _: drawn.batches.append(tuple(part.copy() for part in batch)),
    )
    training = trained("batched_dqn", observation, model=model, points=(0, 600), **changes)
    n_updates = len(drawn.batches)
    assert n_updates >= 200
    assert training.updates.tolist() == [n_updates] * N_AGENTS
    for agent in CHECKED_AGENTS:
        stock = stock_agent("batched_dqn", settings, observation, model, drawn, agent)
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
            if rates[-1] == 0.0:
                greedy, _ = stock.policy.predict(stock._last_obs, deterministic=True)
                assert np.array_equal(actions[0], greedy)
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
    {"batch_size": 64, "n_epochs": 20},
]


@pytest.mark.parametrize(
    ("observation", "scene", "changes"),
    in_turn(
        *(("S1", changes) for changes in PPO_CHANGES),
        ("moods", {"target_kl": 0.004, "learning_rate": 3e-3, "n_envs": 4, "n_steps": 5, "time_limit": 7}),
        ("anywhere", {"clip_range_vf": 0.05, "n_envs": 5, "n_steps": 8, "time_limit": 7}),
    ),
    ids=str,
)
def test_ppo_is_stable_baselines3s(
    observation: str, scene: str, changes: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    model = SCENES[scene]
    settings = settings_of("batched_ppo", **changes)
    drawn = recorded(monkeypatch, ppo)
    shape = N_AGENTS, settings.n_envs, settings.n_steps

    def keep_actions(_: Any, arguments: tuple[Any, ...]) -> None:
        first, after, n_observations, rollout, results, _ = arguments[5:]
        for t in range(first, after):
            for kept, values in (
                (drawn.actions, rollout.action),
                (drawn.observations, rollout.observed % n_observations),
                (drawn.next_observations, results.next_observed % n_observations),
            ):
                kept.append(values.reshape(shape)[:, :, t].copy())

    def keep_orders(_: Any, arguments: tuple[Any, ...]) -> None:
        if len(arguments[1]):
            drawn.batches.append((arguments[1].copy(),))

    wrap(monkeypatch, kernels, "roll_out", keep_actions)
    wrap(monkeypatch, kernels, "shuffle", keep_orders)
    training = trained("batched_ppo", observation, model=model, points=(0, 400), **changes)
    for agent in CHECKED_AGENTS:
        stock = stock_agent("batched_ppo", settings, observation, model, drawn, agent)
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


def agents_at_start(model: Model, n_envs: int) -> kernels.Agents:
    """Returns two agents with streams of their own."""
    seeds = np.arange(1, 9, dtype=np.uint64).reshape(2, 4) * np.uint64(0x9E3779B97F4A7C15)
    shape = 2, n_envs
    return kernels.Agents(
        seeds, np.full(shape, model.start, np.int64), np.zeros(shape, np.int64), np.zeros(2, np.int64)
    )


def replay_of(*shape: int) -> kernels.Replay:
    """Returns empty buffers, (N, C, E)."""
    return kernels.Replay(*(np.zeros(shape, kind) for kind in ("i4", "i1", "f4", "i4", "?", "?")))


@pytest.mark.parametrize(
    "model",
    [
        S1,
        S2,
        compile_scenario(load_scenario("S3")),
        NOISY_MOODS,
        ANYWHERE,
        compile_scenario(load_scenario("Walking")),
    ],
    ids=["S1", "S2", "S3", "moods", "anywhere", "walking"],
)
def test_agents_step_as_the_vector_env_does(model: Model) -> None:
    """Given the draws, of which there are no others than those made here, in this order."""
    n_agents, n_envs, n_steps, limit, epsilon = 2, 3, 400, 8, 0.5
    world, shape = kernels.world_of(model, limit), (n_agents, n_envs)
    agents, replay = agents_at_start(model, n_envs), replay_of(n_agents, n_steps, n_envs)
    env = ProxemicVectorEnv(n_agents * n_envs, model.scenario, max_episode_steps=limit)
    streams = agents.streams.copy()

    def draw(is_random: bool) -> float:
        """Draws from the stream of agent n, if there is something to draw."""
        return float(kernels._draw(streams, n)) if is_random else np.nan

    uniform, outcome, start = (np.full(shape, np.nan) for _ in range(3))
    for n, e in np.ndindex(shape):
        start[n, e] = draw(len(model.starts) > 1)
    kernels.start(world, agents)
    assert np.array_equal(streams, agents.streams)
    env.restart(np.arange(n_agents * n_envs), start.ravel())
    wrong = np.zeros(shape, dtype=np.int64)
    for row in range(n_steps):
        assert np.array_equal(env._state, agents.state.ravel())
        before = env.observe()
        q = np.tile(np.array([0, 0, 0, 0, 1], np.float32), (*shape, 1))
        kernels.act(world, agents, q, epsilon, replay, row)
        actions = np.full(shape, 4)
        for n in range(n_agents):
            explores = draw(True) < epsilon
            for e in range(n_envs):
                random = draw(True)
                actions[n, e] = int(random * 5) if explores else 4
                uniform[n, e] = draw(model.is_noisy)
                outcome[n, e] = draw(model.n_outcomes > 1)
                ends = replay.terminated[n, row, e] or replay.truncated[n, row, e]
                start[n, e] = draw(ends and len(model.starts) > 1)
        assert np.array_equal(streams, agents.streams)
        assert np.array_equal(actions, replay.action[:, row])
        taken, grid, issuer, terminated, truncated = env.advance(
            actions.ravel(), uniform.ravel(), outcome.ravel()
        )
        assert np.array_equal(replay.observation[:, row].ravel(), before)
        assert np.array_equal(replay.next_observation[:, row].ravel(), env.observe())
        assert np.array_equal(replay.reward[:, row].ravel(), (grid + issuer).astype(np.float32))
        assert np.array_equal(replay.terminated[:, row].ravel(), terminated)
        assert np.array_equal(replay.truncated[:, row].ravel(), truncated & ~terminated)
        wrong += model.is_wrong_ping.take(taken).reshape(shape)
        ended = np.flatnonzero(terminated | truncated)
        env.restart(ended, start.ravel()[ended])
    assert agents.disagreements.tolist() == wrong.sum(axis=1).tolist()
    assert min(replay.terminated.sum(), replay.truncated.sum()) > 5
    share = (replay.action != 4).mean()  # half of the steps explore, a fifth of these by PING
    assert abs(share - 0.4) < 4 * np.sqrt(0.4 * 0.6 / (n_steps * n_agents))


def test_first_episodes_start_anywhere_they_may() -> None:
    streams = Streams([SeedSequence([4, seed]) for seed in range(600)])
    states = streams.agents(kernels.world_of(MOODS, None), 4).state
    counts = np.bincount(states.ravel(), minlength=len(MOODS.observation))
    assert np.flatnonzero(counts).tolist() == sorted(MOODS.starts.tolist())
    assert chisquare(counts[MOODS.starts]).pvalue > 1e-3
    assert (states != states[:, :1]).any()
    few = Streams([SeedSequence([4, seed]) for seed in (7, 3)]).agents(kernels.world_of(MOODS, None), 4)
    assert np.array_equal(few.state, states[[7, 3]])


def test_issuers_rewards_are_uniform() -> None:
    agents, n_steps = agents_at_start(S2, 2), 1000
    replay = replay_of(2, n_steps, 2)
    q = np.tile(np.array([0, 0, 0, 0, 1], np.float32), (2, 2, 1))
    for row in range(n_steps):
        kernels.act(kernels.world_of(S2, None), agents, q, 0.0, replay, row)
    assert (replay.action == 4).all()
    assert (replay.terminated.sum(axis=1) == n_steps // 5).all()  # by the fifth wrong PING
    noise = replay.reward + np.where(replay.terminated, 1.0, 0.4)
    assert kstest(noise.ravel(), "uniform", (-1, 2)).pvalue > 1e-3
    assert len(np.unique(noise)) > 0.99 * noise.size


@pytest.mark.parametrize("is_of_envs", [False, True])
def test_actions_are_drawn_from_their_probabilities(is_of_envs: bool) -> None:
    agents, n_steps = agents_at_start(S1, 2), 5000
    shape = 2, 2 * n_steps
    rollout = kernels.Rollout(*(np.zeros(shape, kind) for kind in ("i8", "i8", "f4", "f4", "f4", "f4")))
    results = kernels.Results(*(np.zeros(shape, kind) for kind in ("f4", "i8", "?", "?")))
    expected = np.array([0.1, 0.3, 0.05, 0.25, 0.3], np.float32)
    probability = np.tile(expected, (2, 2 if is_of_envs else 120, 1))
    counts = np.zeros((2, n_steps), np.int64)
    world = kernels.world_of(S1, None)
    for t in range(n_steps) if is_of_envs else [0]:
        kernels.roll_out(
            world,
            agents,
            probability,
            np.log(probability),
            is_of_envs,
            t,
            t + 1 if is_of_envs else n_steps,
            120,
            rollout,
            results,
            counts,
        )
    shares = np.bincount(rollout.action.ravel(), minlength=5) / rollout.action.size
    assert shares == pytest.approx(expected, abs=4 * np.sqrt(0.25 / rollout.action.size))
    assert np.exp(rollout.old_log_probability) == pytest.approx(expected[rollout.action])
    assert counts[:, -1].tolist() == agents.disagreements.tolist()
    assert (np.diff(counts) >= 0).all()


def test_mini_batches_are_drawn_uniformly() -> None:
    streams = agents_at_start(S1, 1).streams
    order = np.zeros((2, 8), dtype=np.int64)
    times = np.zeros((8, 8))  # how often each item came to each place
    for _ in range(2000):
        kernels.shuffle(streams, order)
        assert (np.sort(order) == np.arange(8)).all()
        for row in order:
            times[np.arange(8), row] += 1
    assert np.abs(times / 4000 - 1 / 8).max() < 5 * np.sqrt(1 / 8 * 7 / 8 / 4000)
    rows, envs = np.zeros((2, 4000), dtype=np.int64), np.zeros((2, 4000), dtype=np.int64)
    kernels.draw_batches(streams, 10, 3, rows, envs)
    counts = np.bincount((rows * 3 + envs).ravel(), minlength=30)
    assert len(counts) == 30
    assert np.abs(counts / 8000 - 1 / 30).max() < 5 * np.sqrt(1 / 30 / 8000)


def test_large_grids_have_observations_of_their_own() -> None:
    large = compile_scenario(load_scenario("S1", {"grid.rows": 200, "grid.columns": 200, "ping_limit": 2}))
    agents = agents_at_start(large, 1)
    agents.state[:] = 39_990
    replay = replay_of(2, 1, 1)
    kernels.act(kernels.world_of(large, None), agents, np.zeros((2, 1, 5), np.float32), 0.0, replay, 0)
    assert replay.observation.ravel().tolist() == [39_990] * 2
    assert replay.next_observation.ravel().tolist() == [39_790] * 2  # a move up


# Nets


def first_weights(name: str, observation: str, monkeypatch: pytest.MonkeyPatch) -> list[NDArray[np.float32]]:
    drawn = recorded(monkeypatch, dqn if name == "batched_dqn" else ppo)
    trained(name, observation, policy_kwargs={"net_arch": (64, 48)})
    return drawn.first


@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_first_weights_of_dqn_are_those_of_linear_layers(
    observation: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = first_weights("batched_dqn", observation, monkeypatch)
    for weights, biases in zip(first[::2], first[1::2], strict=True):
        bound = 1 / np.sqrt(weights.shape[1])
        values = np.concatenate([weights.ravel(), biases.ravel()])
        assert kstest(values, "uniform", (-bound, 2 * bound)).pvalue > 1e-3
        assert not np.array_equal(weights[0], weights[1])


@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_first_weights_of_ppo_are_orthogonal(observation: str, monkeypatch: pytest.MonkeyPatch) -> None:
    first = first_weights("batched_ppo", observation, monkeypatch)
    gains = [np.sqrt(2), np.sqrt(2), 0.01, np.sqrt(2), np.sqrt(2), 1.0]
    for weights, biases, gain in zip(first[::2], first[1::2], gains, strict=True):
        assert not biases.any()
        for matrix in weights:
            short = matrix if matrix.shape[0] <= matrix.shape[1] else matrix.T
            assert short @ short.T == pytest.approx(gain**2 * np.eye(len(short)), abs=1e-5)


@pytest.mark.parametrize("activation", ["relu", "tanh"])
def test_nets_of_one_hot_parts_are_those_of_the_whole_rows(activation: Activation) -> None:
    """Adding up a row of weights for each part is multiplying by observations of zeros and ones."""
    rows = torch.from_numpy(observation_table(MOODS, "one_hot"))
    blocks = torch.from_numpy(observation_blocks(MOODS))
    generator = torch.Generator().manual_seed(0)
    shapes = list(layer_shapes(rows.shape[1], (16, 8), 5))
    values = [torch.randn(3, *shape, generator=generator) for shape in shapes]
    observed = torch.randint(490, (3, 64), generator=generator) + 490 * torch.arange(3)[:, None]
    slope = torch.randn(3, 64, 5, generator=generator)
    gradients = [[torch.zeros_like(value) for value in values] for _ in range(2)]
    outputs = []
    for table, written in zip((rows, blocks), gradients, strict=True):
        nets = Nets(values, written, activation, table)
        outputs.append(nets.forward(observed).clone())
        nets.backward(slope)
    assert torch.allclose(outputs[0], outputs[1], rtol=1e-4, atol=1e-4)
    for dense, sparse in zip(*gradients, strict=True):
        assert dense.abs().max() > 1
        assert torch.allclose(dense, sparse, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_many_observations_are_read_in_chunks(observation: str, monkeypatch: pytest.MonkeyPatch) -> None:
    table, n_inputs = input_table(ANYWHERE, observation, torch.device("cpu"))
    generator = torch.Generator().manual_seed(0)
    shapes = layer_shapes(n_inputs, (16,), 5)
    values = [torch.randn(2, *shape, generator=generator) for shape in shapes]
    nets = Nets(values, [], "relu", table)
    observed = torch.arange(2 * 13_320).view(2, -1)
    whole = nets.forward(observed)
    sizes = []
    wrap(monkeypatch, Nets, "forward", lambda chunk, _: sizes.append(chunk.shape[1]))
    assert torch.allclose(nets.read(observed), whole, rtol=1e-5, atol=1e-5)
    assert len(sizes) > 1
    assert max(sizes) <= 2000
    sizes.clear()
    assert torch.allclose(nets.read(observed[:, :2000]), whole[:, :2000], rtol=1e-5, atol=1e-5)
    assert sizes == [2000]


def test_agents_that_stop_early_make_steps_of_their_own() -> None:
    """Each agent's steps are those of torch's Adam, and gradients that are left out may be infinite."""
    shapes = [(3, 4), (1, 4)]
    parameters = Parameters(2, shapes, 0.01, 1e-5, 1e9, torch.device("cpu"), stops_early=True)
    theirs = [[torch.nn.Parameter(torch.zeros(shape)) for shape in shapes] for _ in range(2)]
    optimizers = [torch.optim.Adam(values, lr=0.01, eps=1e-5) for values in theirs]
    generator = torch.Generator().manual_seed(0)
    for learning in ([1, 1], [1, 0], [0, 1], [1, 0], [1, 1]):
        for gradient in parameters.gradients:
            gradient.copy_(torch.randn(gradient.shape, generator=generator))
        for agent in range(2):
            for value, gradient in zip(theirs[agent], parameters.gradients, strict=True):
                value.grad = gradient[agent].clone()
            if learning[agent]:
                optimizers[agent].step()
            else:
                parameters.gradients[0][agent, 0, 0] = -torch.inf
        with torch.no_grad():
            parameters.step(torch.tensor(learning, dtype=torch.bool))
    assert parameters.n_steps.tolist() == [4, 3]
    for agent in range(2):
        for ours, their in zip(parameters.values, theirs[agent], strict=True):
            assert torch.allclose(ours[agent], their, rtol=1e-6, atol=1e-8)


# Any batch


def equal(one: DeepTraining, other: DeepTraining, rows: Any = slice(None)) -> bool:
    """Returns whether all results are equal, bit for bit; times aside."""
    return all(
        np.array_equal(getattr(one, field.name)[rows], getattr(other, field.name), equal_nan=True)
        for field in fields(one)
        if field.name != "cpu_time_s"
    )


@pytest.mark.parametrize("observation", OBSERVATIONS)
@pytest.mark.parametrize(
    ("name", "scene", "changes"),
    [
        ("batched_dqn", "S1", {"policy_kwargs": {"net_arch": (128, 128)}, "batch_size": 64}),
        ("batched_dqn", "S1", {"policy_kwargs": {"net_arch": ()}, "n_steps": 3, "batch_size": 128}),
        (
            "batched_dqn",
            "S1",
            {"policy_kwargs": {"net_arch": (33,)}, "tau": 0.3, "n_envs": 2, "batch_size": 17},
        ),
        ("batched_dqn", "noisy moods", {"policy_kwargs": {"net_arch": (128, 128)}, "n_envs": 2}),
        ("batched_dqn", "anywhere", {"policy_kwargs": {"net_arch": (128, 128)}, "batch_size": 64}),
        ("batched_ppo", "S1", {"policy_kwargs": {"net_arch": (128, 128)}, "n_steps": 50, "batch_size": 100}),
        ("batched_ppo", "S1", {"policy_kwargs": {"net_arch": ()}, "batch_size": 17, "ent_coef": 0.1}),
        ("batched_ppo", "S1", {"policy_kwargs": {"net_arch": (33,)}, "batch_size": 13, "clip_range_vf": 0.1}),
        ("batched_ppo", "S1", {"target_kl": 0.004, "learning_rate": 3e-3, "batch_size": 39}),
        ("batched_ppo", "noisy moods", {"policy_kwargs": {"net_arch": (128, 128)}}),
        ("batched_ppo", "anywhere", {"policy_kwargs": {"net_arch": (128, 128)}, "n_envs": 4, "n_steps": 25}),
    ],
    ids=str,
)
def test_bits_of_an_agent_do_not_depend_on_its_batch(
    name: str, observation: str, scene: str, changes: dict[str, Any]
) -> None:
    changes, model = {"budget": 200} | changes, SCENES[scene]
    points = (200,) if scene == "anywhere" else (0, 100, 200)  # many observations take long to read
    together = trained(name, observation, [*range(25)], model, points, **changes)
    for seeds in ([24], [6, 0], [5, 4, 3, 2, 1]):
        assert equal(together, trained(name, observation, seeds, model, points, **changes), seeds)
    assert len(np.unique(together.weights, axis=0)) == 25


def rows_of(training: DeepTraining, rows: list[int]) -> DeepTraining:
    """Returns the results of some agents."""
    return DeepTraining(**{field.name: getattr(training, field.name)[rows] for field in fields(training)})


@pytest.mark.parametrize("scene", ["S1", "anywhere"])
@pytest.mark.parametrize("name", SETTINGS)
def test_a_diverged_agent_counts_as_random_and_disturbs_no_other(
    name: str, scene: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = SCENES[scene]
    sound = trained(name, seeds=[0, 2], model=model)
    module = dqn if name == "batched_dqn" else ppo
    wrap(
        monkeypatch,
        nets_of(module),
        "draw_weights",
        lambda _, arguments: arguments[0].parameters.values[0][1].fill_(torch.nan),
    )
    training = trained(name, model=model)
    assert training.diverged_at.tolist() == [-1, 0, -1]
    assert equal(training, sound, [0, 2])
    assert (training.greedy[1] == ALL_ACTIONS).all()
    assert np.isnan(training.values[1]).all()
    assert np.isnan(training.q[1]).all()
    assert (training.stochastic[1] == 0.2).all()
    assert training.disagreements[1].tolist() == [0, 0, 0]


@pytest.mark.parametrize("name", SETTINGS)
def test_divergence_between_two_points_counts_from_the_next(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = (0, 160, 200, 390, 400)
    sound = trained(name, points=points)
    n_steps = 0

    def poison(_: Any, arguments: tuple[Any, ...]) -> None:
        nonlocal n_steps
        n_steps += 1
        if n_steps == {"batched_dqn": 31, "batched_ppo": 80}[name]:  # after step 162, and after step 160
            arguments[0].values[0][1].fill_(torch.nan)

    wrap(monkeypatch, Parameters, "step", poison)
    training = trained(name, points=points)
    first = {"batched_dqn": 200, "batched_ppo": 160}[name]
    assert training.diverged_at.tolist() == [-1, first, -1]
    assert equal(training, rows_of(sound, [0, 2]), [0, 2])
    counts = training.disagreements[1].tolist()
    assert counts[1] == sound.disagreements[1, 1]
    # Of DQN as at step 200, where it is seen; of PPO as at step 160, since it can draw no action from there.
    assert counts[2:] == [counts[2]] * 3
    assert counts[2] == counts[1] if name == "batched_ppo" else counts[2] >= counts[1]
    has_policy = (training.greedy[1] != ALL_ACTIONS).all(axis=1)
    assert has_policy.tolist() == [point < first for point in points]


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
def test_policies_and_values_are_of_one_net(name: str) -> None:
    training = trained(name, model=MOODS, points=(0, 130, 200, 390, 400))  # maps at 0, 200 and 400
    is_mapped = np.array([True, False, True, False, True])
    assert training.greedy.shape == (N_AGENTS, 5, 490)
    assert np.array_equal(training.greedy[:, is_mapped], 1 << training.values.argmax(axis=-1))
    if name == "batched_dqn":
        assert np.array_equal(training.values[:, -1], training.q)
        assert training.stochastic.shape == (N_AGENTS, 0, 490, 5)
    else:
        assert np.array_equal(training.values, training.stochastic[:, is_mapped].astype(np.float32))
        assert np.array_equal(training.greedy, 1 << training.stochastic.argmax(axis=-1))
    assert len(np.unique(training.values, axis=1)[0]) == 3


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
    assert trained("batched_dqn", gradient_steps=0).updates.tolist() == [0] * 3
    cells, phases, pings = 49, 2, 5
    hidden = (cells + phases + pings) * 24 + 24 + 24 * 16 + 16
    training = trained("batched_dqn", model=MOODS)
    assert training.parameters.tolist() == [hidden + 16 * 5 + 5] * 3


def test_torch_is_set_and_left_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    def state() -> tuple[int, bool, bool]:
        flushes = (torch.tensor([1e-39]) * 0.5).item() == 0
        return torch.get_num_threads(), torch.is_grad_enabled(), flushes

    before, during = state(), set()
    wrap(monkeypatch, kernels, "act", lambda *_: during.add(state()))
    trained("batched_dqn")
    assert during == {(1, False, True)}
    assert state() == before
    assert before[1:] == (True, False)


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
