"""Measures speed: each row compares this project with a common alternative, in the same run.

Machines are noisy, so all rows take turns for many rounds, and within a row its two sides do. The best round
of each side counts. Training whole runs takes too long for that: in rows named `net_`, the two sides train in
turns, and rates are the steps of all turns per second of CPU time.
"""

import math
import os
import platform
import random
import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count, islice, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium
import numba
import numpy as np
import pandas as pd
from numpy.random import SeedSequence
from rich.console import Console
from rich.progress import track

from agents import Schedule, load_algorithm
from agents.dynamic_programming import evaluate
from agents.nets import arithmetic
from agents.policy import uniform_policy
from agents.process import N_ACTIONS
from agents.sb3.settings import DqnSettings
from agents.tabular import learner
from benchmark.drawing import tables
from benchmark.execution.executors.processes import Processes
from benchmark.experiments import (
    DEFAULT_CONDITION,
    RunSpecification,
    load_experiment,
    specifications,
)
from envs import InputError, Model, ProxemicVectorEnv, compile_scenario, load_scenario
from envs.inputs import needed_by

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

_ENV = "envs:Proxemic/S1-v0"


class Row(NamedTuple):
    """Two ways to do the same; each callable works once and returns how many units it has done."""

    name: str
    unit: str
    ours: Callable[[], float]
    stock: Callable[[], float]
    against: str
    products: float = 0.0  # multiplications and additions in products of matrices, per unit


def measure(directory: Path, *, smoke: bool) -> None:
    """Measures every row, prints the table, and writes `speed.csv`, `.md`, `.tex` and a README.

    Args:
      directory: Where to write.
      smoke: Whether to do very little, to try the code; the rates then mean nothing.

    Raises:
      InputError: The folder cannot be written.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        (directory / "speed.csv").touch()
    except OSError as error:
        raise InputError(
            f"{directory}: cannot be written: {error.strerror}; choose another folder with --results."
        ) from error
    rows = []
    workers = Processes(os.cpu_count() or 1)
    try:
        compared = [*_rows(smoke), *_deep_rows(smoke, workers)]
        rates = _compare(compared, rounds=1 if smoke else 15)
    finally:
        workers.cancel()
    trained = [_products_row(smoke), *_net_rows(smoke)]
    compared += trained
    rates += _take_turns(trained, turns=1 if smoke else 4)
    limit = max(rates[compared.index(trained[0])])  # of products of matrices
    for row, (ours, stock) in zip(compared, rates, strict=True):
        rows.append(
            {
                "name": row.name,
                "per_second": ours,
                "baseline": stock,
                "ratio": ours / stock,
                "of_limit": ours * row.products / limit or None,
                "unit": row.unit,
                "against": row.against,
            }
        )
        print(f"{row.name:24} {ours:14,.0f} {row.unit}/s, {ours / stock:8.3g} times {row.against}")
    frame = pd.DataFrame(rows)
    tables.write_table(frame, directory / "speed")
    (directory / "README.md").write_text(_readme(frame), encoding="utf-8")
    print(f"written to {directory}")


def _readme(frame: pd.DataFrame) -> str:
    """Returns the README of the folder."""
    return f"""# speed

Made by `make speed`, on a machine with {os.cpu_count()} cores ({platform.machine()}). `per_second` is this
project's rate, `baseline` that of the alternative. Most rates are the best of many rounds in the same run,
in which rows take turns. In rows named `net_`, both sides train whole runs with the settings of
`compare_deep`, in turns. These rates, and those of `matrix_products`, are totals per second of CPU time.
Machines differ and are noisy; `ratio` is less so.

`of_limit` is the time that the products of matrices in training would take alone, at the faster rate of
`matrix_products`, divided by the time of training. Products are counted as in Stable-Baselines3, but without
the zeros of one-hot observations and without the target net. It can be above 1, since this project computes
an observation that occurs several times in a mini-batch once.

{tables.to_markdown(frame)}"""


def _compare(rows: list[Row], rounds: int) -> list[tuple[float, float]]:
    """Returns the best rates of both sides of every row, per second."""
    best = [[0.0, 0.0] for _ in rows]
    for row in rows:  # compile, import and fill caches first
        row.ours()
        row.stock()
    for _ in track(range(rounds), "measuring", console=Console(stderr=True)):
        for row, rates in zip(rows, best, strict=True):
            for i, side in enumerate((row.ours, row.stock)):
                started = time.perf_counter()
                done = side()
                rates[i] = max(rates[i], done / (time.perf_counter() - started))
    return [(ours, stock) for ours, stock in best]


def _take_turns(rows: list[Row], turns: int) -> list[tuple[float, float]]:
    """Returns the rates of both sides of every row over all turns, per second of CPU time."""
    rates = []
    for row in track(rows, "training", console=Console(stderr=True)):
        done, seconds = [0.0, 0.0], [0.0, 0.0]
        for _ in range(turns):
            for i, side in enumerate((row.ours, row.stock)):
                started = time.process_time()
                done[i] += side()
                seconds[i] += time.process_time() - started
        rates.append((done[0] / seconds[0], done[1] / seconds[1]))
    return rates


def _products_row(smoke: bool) -> Row:
    """Returns the row of the products of matrices that nets consist of."""
    shape, times = (64, 128, 128), 10 if smoke else 4000
    a, b = np.ones(shape[:2], np.float32), np.ones(shape[1:], np.float32)
    c, zeros = np.empty((64, 128), np.float32), np.zeros(128, np.float32)

    def multiply(a: Any, b: Any, c: Any, zeros: Any, times: int) -> None:
        for _ in range(times):
            arithmetic.multiply(shape, (zeros, 0), (a, 0, 128, 1), (b, 0, 128, 1), (c, 0, 128, 1))

    compiled = numba.njit(multiply)

    def ours() -> float:
        compiled(a.ravel(), b.ravel(), c.ravel(), zeros, times)
        return 2.0 * np.prod(shape) * times

    def stock() -> float:
        for _ in range(times):
            np.dot(a, b, out=c)
        return 2.0 * np.prod(shape) * times

    ours()
    return Row("matrix_products", "operations", ours, stock, "NumPy's BLAS, 64 × 128 by 128 × 128, float32")


def _net_rows(smoke: bool) -> list[Row]:
    """Returns the rows of training nets, with the settings of `compare_deep`, on S1."""
    declared = load_experiment("compare_deep")
    shortest = 200  # steps

    def train(arm: str, observation: str, seeds: Iterator[int], budget: int) -> float:
        changed = declared.model_copy(update={"settings": declared.settings | {"budget": budget}})
        algorithm = load_algorithm(declared.algorithms[arm].algorithm)
        # A run of ours takes well below a second.
        chosen = list(islice(seeds, 25 if algorithm.placement == "thread" and budget > shortest else 1))
        runs = specifications(changed, DEFAULT_CONDITION, "S1", arm, observation, chosen)
        model, streams = compile_scenario(runs[0].scenario), [run.seed_sequence for run in runs]
        algorithm.train(model, runs[0].settings, observation, streams, Schedule(budget))
        return float(len(runs) * budget)

    def row(arm: str, observation: str, name: str) -> Row:
        budget = shortest if smoke else declared.settings["budget"]
        arms = [arm, f"{arm}_sb3"]
        for trained in arms:  # compile and import first
            train(trained, observation, iter([0]), shortest)
        ours, stock = (partial(train, trained, observation, count(), budget) for trained in arms)
        (run,) = specifications(declared, DEFAULT_CONDITION, "S1", arm, observation, [0])
        against = "Stable-Baselines3, trained as in compare_deep, by CPU time"
        return Row(f"net_{name}", "steps", ours, stock, against, _products(run.settings, observation))

    return [
        row("dqn", "one_hot", "dqn_one_hot"),
        row("dqn", "coordinates", "dqn_coordinates"),
        row("dqn_linear", "one_hot", "dqn_linear"),
        row("ppo", "one_hot", "ppo_one_hot"),
        row("ppo", "coordinates", "ppo_coordinates"),
    ]


def _products(settings: Any, observation: str) -> float:
    """Returns the multiplications and additions in products of matrices per step of training a net in S1."""
    n_inputs = 0 if observation == "one_hot" else 2  # a one-hot observation is the choice of a row
    total = 0.0
    for n_outputs in (N_ACTIONS,) if isinstance(settings, DqnSettings) else (N_ACTIONS, 1):
        first, *others = pairwise([n_inputs, *settings.policy_kwargs.net_arch, n_outputs])
        # Outputs and slopes of weights; behind the first layer also slopes of inputs.
        total += 4 * math.prod(first) + 6 * sum(map(math.prod, others))
    if isinstance(settings, DqnSettings):
        total *= settings.batch_size * settings.gradient_steps / settings.rollout
    else:
        total *= settings.n_epochs
    return total


def _rows(smoke: bool) -> list[Row]:
    """Returns the rows without deep learning, with the paper's constants; on S1 unless they say otherwise."""
    size = 0.01 if smoke else 1.0
    model, largest = compile_scenario(load_scenario("S1")), compile_scenario(load_scenario("Anywhere"))

    def kernel() -> float:
        return _kernel(model, 200, round(20_000 * size), threads=1)

    return [
        Row(
            "q_learning_kernel",
            "updates",
            kernel,
            lambda: _numpy_q_learning(round(25_000 * size)),
            "a plain Python loop over gymnasium.make, Q in NumPy",
        ),
        Row(
            "q_learning_kernel_lists",
            "updates",
            kernel,
            lambda: _list_q_learning(round(100_000 * size)),
            "the same loop tuned: Q in lists, Python's own random numbers",
        ),
        Row(
            "q_learning_threads",
            "updates",
            lambda: _kernel(model, 200, round(100_000 * size), threads=2, record_every=10),
            lambda: _kernel(model, 200, round(100_000 * size), threads=1, record_every=10),
            "one thread, by two",
        ),
        Row(
            "q_learning_anywhere",
            "updates",
            lambda: _kernel(largest, 100, round(100_000 * size), threads=1, record_every=100),
            lambda: _kernel(model, 100, round(100_000 * size), threads=1, record_every=100),
            f"the same in S1; Anywhere has {len(largest.observation):,} states",
        ),
        Row(
            "vector_env_1000",
            "steps",
            lambda: _vector_env("vector_entry_point", max(round(500 * size), 5)),
            lambda: _vector_env("sync", max(round(10 * size), 1)),
            "gymnasium.vector.SyncVectorEnv",
        ),
        Row(
            "evaluate",
            "policies",
            lambda: _exact(model, max(round(100 * size), 1)),
            lambda: _simulated(model, round(1000 * size), 1000),
            "1,000 simulated episodes, uniform random policy",
        ),
    ]


def _deep_rows(smoke: bool, workers: Processes) -> list[Row]:
    """Returns the rows of deep learning, with the settings of `compare_deep`, one-hot, on S1."""
    size = 0.01 if smoke else 1.0
    with needed_by("benchmark speed"):
        import torch
        from stable_baselines3.common.monitor import Monitor
        from stable_baselines3.common.vec_env import DummyVecEnv

        from agents.sb3 import algorithms
        from agents.sb3.tables import policy_table
        from agents.sb3.training import make_agent
        from agents.sb3.vec_env import SB3VecEnv
    methods = {"dqn": algorithms.DQN, "ppo": algorithms.PPO}
    cores = os.cpu_count() or 1
    declared = load_experiment("compare_deep")
    limit = declared.settings["time_limit"]

    def make_env() -> gymnasium.Env[Any, Any]:
        return gymnasium.make(_ENV, observation="one_hot", max_episode_steps=limit)

    def runs(name: str) -> list[RunSpecification]:
        budget = {"budget": round(2000 * size) // 200 * 200 or 200}
        short = declared.model_copy(update={"settings": declared.settings | budget})
        return specifications(short, DEFAULT_CONDITION, "S1", f"{name}_sb3", "one_hot", range(cores))

    def ours(name: str) -> float:
        for future in [workers.submit([run]) for run in runs(name)]:
            assert future.result()[0].error is None
        return sum(run.settings.budget for run in runs(name))

    def stock(name: str) -> float:
        settings: Any = runs(name)[0].settings
        env = DummyVecEnv([lambda: Monitor(make_env())] * settings.n_envs)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="You have specified a mini-batch size")
            methods[name].load()("MlpPolicy", env, **settings.arguments).learn(settings.budget)
        return float(settings.budget)

    def native(n_envs: int) -> SB3VecEnv:
        return SB3VecEnv(
            ProxemicVectorEnv(n_envs, "S1", "one_hot", max_episode_steps=limit, autoreset_mode="SameStep")
        )

    def steps(env: "VecEnv", n_steps: int) -> float:
        actions = np.random.default_rng(0).integers(0, 5, (n_steps, env.num_envs))
        env.reset()
        for action in actions:
            env.step(action)
        return n_steps * env.num_envs

    dqn_settings: Any = runs("dqn")[0].settings
    agent = make_agent(methods["dqn"], dqn_settings, native(1))
    table = np.eye(120, dtype=np.float32)
    observations = torch.as_tensor(table)

    def maps(times: int) -> float:
        for _ in range(times):
            policy_table(agent, observations)
        return times

    def single_maps(times: int) -> float:
        for _ in range(times):
            for observation in table:
                agent.predict(observation, deterministic=True)
        return times

    pool = f"the same over DummyVecEnv([Monitor(env)]), one process of {torch.get_num_threads()} threads"
    rows = [Row(f"sb3_{name}", "steps", partial(ours, name), partial(stock, name), pool) for name in methods]
    for n_envs, n_steps in ((8, 1000), (64, 300)):
        native_env, stock_env = native(n_envs), DummyVecEnv([make_env] * n_envs)
        n_native, n_stock = max(round(n_steps * size), 5), max(round(n_steps * size / 4), 5)
        rows.append(
            Row(
                f"vec_env_{n_envs}",
                "steps",
                partial(steps, native_env, n_native),
                partial(steps, stock_env, n_stock),
                "stable_baselines3's DummyVecEnv",
            )
        )
    many, few = max(round(500 * size), 1), max(round(10 * size), 1)
    rows.append(
        Row("map_all_cells", "maps", partial(maps, many), partial(single_maps, few), "120 single predicts")
    )
    return rows


def _kernel(model: Model, agents: int, steps: int, threads: int, record_every: int = 1) -> float:
    """Trains agents by Q-learning, with their visited max Q recorded; returns the number of updates."""
    settings = learner.Settings(budget=steps, record_every=record_every)
    seeds = [SeedSequence([0, i]) for i in range(agents)]
    learner.train(model, settings, seeds, Schedule(steps), threads=threads)
    return agents * steps


def _numpy_q_learning(steps: int) -> float:
    """Learns as Q-learning is usually written; returns the number of updates."""
    env = gymnasium.make(_ENV, max_episode_steps=-1)
    rng = np.random.default_rng(0)
    q = np.zeros((120, 5))
    visited_max = np.empty(steps)
    observation, _ = env.reset(seed=0)
    for t in range(steps):
        best = q[observation].max()
        visited_max[t] = best
        if rng.random() < 0.6:
            action = rng.integers(5)
        else:
            candidates = np.flatnonzero(q[observation] == best)
            action = candidates[rng.integers(len(candidates))]
        following, reward, terminated, truncated, _ = env.step(action)
        target = float(reward) + (0.0 if terminated else 0.9 * q[following].max())
        q[observation, action] += 0.6 * (target - q[observation, action])
        observation = env.reset()[0] if terminated or truncated else following
    return steps


def _list_q_learning(steps: int) -> float:
    """Learns the same without NumPy, whose calls take longer than the arithmetic on a few numbers."""
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


def _vector_env(mode: str, steps: int) -> float:
    """Steps 1,000 envs with random actions; `_ENVS` keeps them, so the time to make them does not count."""
    if mode not in _ENVS:
        _ENVS[mode] = gymnasium.make_vec(_ENV, num_envs=1000, vectorization_mode=mode, max_episode_steps=-1)
        _ENVS[mode].reset(seed=0)
    env = _ENVS[mode]
    actions = np.random.default_rng(0).integers(0, 5, (50, 1000))
    for t in range(steps):
        env.step(actions[t % 50])
    return steps * 1000


_ENVS: dict[str, gymnasium.vector.VectorEnv] = {}


def _exact(model: Model, times: int) -> float:
    """Evaluates the uniform random policy exactly; no policy visits more states."""
    policy = uniform_policy(model)
    for _ in range(times):
        evaluate(model, policy, 200)
    return times


def _simulated(model: Model, episodes: int, per_evaluation: int) -> float:
    """Simulates episodes of the same policy; returns to how many evaluations they amount."""
    env = gymnasium.make(_ENV, max_episode_steps=200)
    rng = random.Random(0)
    weights = [list(row) for row in uniform_policy(model).cumsum(axis=1)]
    actions = range(5)
    total = 0.0
    env.reset(seed=0)
    for _ in range(episodes):
        observation, _ = env.reset()
        over = False
        while not over:
            action = rng.choices(actions, cum_weights=weights[observation])[0]
            observation, reward, terminated, truncated, _ = env.step(action)
            total += float(reward)
            over = terminated or truncated
    return episodes / per_evaluation
