"""What `make speed` measures: two ways to do the same, in S1 unless stated otherwise."""

import math
import random
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count, cycle, islice, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import gymnasium
import numba
import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from agents import Schedule, load_algorithm
from agents.dynamic_programming import evaluate
from agents.nets import arithmetic
from agents.policy import uniform_policy
from agents.process import N_ACTIONS
from agents.sb3.settings import DqnSettings, PpoSettings, Sb3Settings
from agents.tabular import learner
from benchmark.execution.store import Record, Store
from envs import Model, ProxemicVectorEnv, compile_scenario, load_scenario
from envs.inputs import parse, read_toml

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

_ENV: Final = "envs:Proxemic/S1-v0"
_NETS: Final = Path(__file__).with_name("speed_nets.toml")
Work = Callable[[], float]  # returns how many units it has done
_Size = Callable[[int], int]  # makes a number of repetitions smaller if little is to be measured
_Numbers = NDArray[np.float32]


class Row(NamedTuple):
    """Two ways to do the same."""

    name: str
    unit: str
    sides: tuple[Work, Work]  # of this project, and of the alternative
    against: str
    is_by_cpu_time: bool = False
    products: float = 0.0  # multiplications and additions in products of matrices, per unit


def all_rows(smoke: bool, scratch: Path) -> list[Row]:
    """Lists all rows, which need an empty folder; for a smoke test they do a hundredth of the work."""

    def size(n: int) -> int:
        return max(n // 100, 1) if smoke else n

    rows = [*_tabular_rows(size), *_growth_rows(size, scratch), *_sb3_rows(size), _products_row(size)]
    return [*rows, *_net_rows(size(25), budget=200 if smoke else 10_000)]


# Rows without deep learning, with the paper's constants


def _tabular_rows(size: _Size) -> list[Row]:
    model = compile_scenario(load_scenario("S1"))
    batched, sync = (
        gymnasium.make_vec(_ENV, num_envs=1000, vectorization_mode=mode, max_episode_steps=-1)
        for mode in ("vector_entry_point", "sync")
    )
    learned = partial(_kernel, model, 200, size(20_000)), partial(_python_q_learning, size(100_000))
    two, one = (partial(_kernel, model, 200, size(100_000), 10, threads) for threads in (2, 1))
    steps = _stepping(batched, size(500)), _stepping(sync, size(10))
    # No policy visits more states than the random one.
    exact = partial(_repeat, size(100), partial(evaluate, model, uniform_policy(model), 200))
    simulated = partial(_simulated, size(1000))
    tuned = "a tuned Python loop over gymnasium.make: Q in lists, Python's own random numbers"
    return [
        Row("q_learning_kernel", "updates", learned, tuned),
        Row("q_learning_threads", "updates", (two, one), "one thread, by two"),
        Row("vector_env_1000", "steps", steps, "gymnasium.vector.SyncVectorEnv"),
        Row("evaluate", "policies", (exact, simulated), "1,000 simulated episodes, uniform random policy"),
    ]


def _kernel(model: Model, agents: int, steps: int, record_every: int = 1, threads: int = 1) -> float:
    """Trains agents by Q-learning, with their visited max Q recorded; returns the number of updates."""
    settings = learner.Settings(budget=steps, record_every=record_every)
    seeds = [SeedSequence([0, i]) for i in range(agents)]
    learner.train(model, settings, seeds, Schedule(steps), threads=threads)
    return agents * steps


def _python_q_learning(steps: int) -> float:
    """Learns in Python without NumPy, whose calls take longer than the arithmetic on a few numbers."""
    env = gymnasium.make(_ENV, max_episode_steps=-1)
    rng = random.Random(0)
    q = [[0.0] * 5 for _ in range(120)]
    visited_max = []
    observation, _ = env.reset(seed=0)
    for _ in range(steps):
        row = q[observation]
        best = max(row)
        visited_max.append(best)
        if rng.random() < 0.6:
            action = rng.randrange(5)
        else:
            action = rng.choice([a for a in range(5) if row[a] == best])
        following, reward, terminated, truncated, _ = env.step(action)
        target = float(reward) + (0.0 if terminated else 0.9 * max(q[following]))
        row[action] += 0.6 * (target - row[action])
        observation = env.reset()[0] if terminated or truncated else following
    return steps


def _simulated(episodes: int) -> float:
    """Simulates episodes of the random policy, of which 1,000 count as an evaluation."""
    env = gymnasium.make(_ENV, max_episode_steps=200)
    rng = random.Random(0)
    env.reset(seed=0)
    total, n_ended = 0.0, 0
    while n_ended < episodes:
        _, reward, terminated, truncated, _ = env.step(rng.randrange(N_ACTIONS))
        total += float(reward)
        if terminated or truncated:
            env.reset()
            n_ended += 1
    return episodes / 1000


def _stepping(envs: "gymnasium.vector.VectorEnv[object, object, object] | VecEnv", times: int) -> Work:
    """Resets vectorised envs; returns what steps them with random actions."""
    envs.reset()
    actions = cycle(np.random.default_rng(0).integers(0, N_ACTIONS, (50, envs.num_envs)))
    return partial(_repeat, times, lambda: envs.step(next(actions)), envs.num_envs)


def _repeat(times: int, call: Callable[[], object], units: float = 1) -> float:
    """Calls a function so many times; returns how many units it has done, which are given for one call."""
    for _ in range(times):
        call()
    return times * units


# How cost grows: a ratio of 1 means in proportion


def _growth_rows(size: _Size, scratch: Path) -> list[Row]:
    small, large = (compile_scenario(load_scenario(name)) for name in ("S1", "Anywhere"))
    many, one = (partial(_kernel, small, n, size(20_000)) for n in (1000, 1))
    anywhere, s1 = (partial(_kernel, model, 100, size(100_000), 100) for model in (large, small))

    def reading(n: int) -> Work:
        path = scratch / f"{n}.db"
        q = np.random.default_rng(0).random((120, 5))
        with Store(path) as store:
            store.add(Record(f"{i:064}", "{}", "done", {}, {"q": q}) for i in range(n))

        def read() -> float:
            with Store(path, read_only=True) as store:
                return len(store.statuses())

        return read

    in_s1 = f"the same in S1; Anywhere has {len(large.observation):,} states"
    stored = reading(size(10_000)), reading(size(100))
    return [
        Row("q_learning_agents", "updates", (many, one), "1 agent at a time, by 1,000"),
        Row("q_learning_anywhere", "updates", (anywhere, s1), in_s1),
        Row("stored_statuses", "runs", stored, "a store of 100 runs, by one of 10,000"),
    ]


# Rows of deep learning


def _sb3_rows(size: _Size) -> list[Row]:
    """Returns the rows of environments for Stable-Baselines3, with one-hot observations."""
    from stable_baselines3.common.vec_env import DummyVecEnv

    from agents.sb3.vec_env import SB3VecEnv

    make_env = partial(gymnasium.make, _ENV, observation="one_hot", max_episode_steps=200)
    rows = []
    for n_envs, times in ((8, 1000), (64, 300)):
        envs = ProxemicVectorEnv(n_envs, "S1", "one_hot", autoreset_mode="SameStep", max_episode_steps=200)
        native, stock = SB3VecEnv(envs), DummyVecEnv([make_env] * n_envs)
        steps = _stepping(native, size(times)), _stepping(stock, size(times // 4))
        rows.append(Row(f"vec_env_{n_envs}", "steps", steps, "stable_baselines3's DummyVecEnv"))
    return rows


def _products_row(size: _Size) -> Row:
    """Returns the row of the products of matrices that nets consist of."""
    shape, times = (64, 128, 128), size(4000)
    a, b = np.ones(shape[:2], np.float32), np.ones(shape[1:], np.float32)
    c, zeros = np.empty((64, 128), np.float32), np.zeros(128, np.float32)

    @numba.njit  # type: ignore[untyped-decorator]
    def multiply(a: _Numbers, b: _Numbers, c: _Numbers, zeros: _Numbers) -> None:
        for _ in range(times):
            arithmetic.multiply(shape, (zeros, 0), (a, 0, 128, 1), (b, 0, 128, 1), (c, 0, 128, 1))

    units = 2.0 * math.prod(shape)
    ours = partial(_repeat, 1, partial(multiply, a.ravel(), b.ravel(), c.ravel(), zeros), times * units)
    blas = partial(_repeat, times, partial(np.dot, a, b, out=c), units)
    against = "NumPy's BLAS, 64 × 128 by 128 × 128, float32"
    return Row("matrix_products", "operations", (ours, blas), against, is_by_cpu_time=True)


def _net_rows(n_agents: int, budget: int) -> list[Row]:
    """Returns the rows of training nets for a budget; this project trains several agents in a turn."""
    model, declared = compile_scenario(load_scenario("S1")), read_toml(_NETS)

    def train(
        name: str, settings: Sb3Settings, observation: str, n_agents: int, seeds: Iterator[int]
    ) -> float:
        streams = [SeedSequence([0, seed]) for seed in islice(seeds, n_agents)]
        load_algorithm(name).train(model, settings, observation, streams, Schedule(budget))
        return n_agents * budget

    rows = []
    for row_name in ("dqn_one_hot", "dqn_coordinates", "dqn_linear", "ppo_one_hot", "ppo_coordinates"):
        net, observation = (row_name, "one_hot") if row_name in declared else row_name.split("_", 1)
        name = net.removesuffix("_linear")
        cls = DqnSettings if name == "dqn" else PpoSettings
        settings = parse(cls, declared[net] | {"budget": budget, "time_limit": 200}, str(_NETS))
        ours = partial(train, f"compiled_{name}", settings, observation, n_agents, count())
        stock = partial(train, name, settings, observation, 1, count())
        rows.append(
            Row(
                name=f"net_{row_name}",
                unit="steps",
                sides=(ours, stock),
                against="Stable-Baselines3, by CPU time",
                is_by_cpu_time=True,
                products=_products(settings, observation),
            )
        )
    return rows


def _products(settings: Sb3Settings, observation: str) -> float:
    """Returns the multiplications and additions in products of matrices per step of training a net in S1."""
    n_inputs = 0 if observation == "one_hot" else 2  # a one-hot observation is the choice of a row
    if isinstance(settings, DqnSettings):
        outputs, passes = [N_ACTIONS], settings.batch_size * settings.gradient_steps / settings.rollout
    else:
        assert isinstance(settings, PpoSettings)
        outputs, passes = [N_ACTIONS, 1], settings.n_epochs
    total = 0.0
    for n_outputs in outputs:
        first, *others = pairwise([n_inputs, *settings.policy_kwargs.net_arch, n_outputs])
        # Outputs and slopes of weights; behind the first layer also slopes of inputs.
        total += 4 * math.prod(first) + 6 * sum(map(math.prod, others))
    return total * passes
