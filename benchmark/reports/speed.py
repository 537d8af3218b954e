"""Speed: each row compares this project with a common alternative, in the same run.

Machines are noisy, so all rows take turns for many rounds, and within a row its two sides do. The best round
of each side counts. Training whole runs takes too long for that: in rows named `net_`, the two sides train in
turns, and rates are the steps of all turns per second of CPU time.
"""

import math
import os
import random
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from itertools import count, cycle, islice, pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple, NoReturn

import gymnasium
import numba
import numpy as np
import pandas as pd
from numpy.random import SeedSequence
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from agents import Schedule, load_algorithm
from agents.dynamic_programming import evaluate
from agents.nets import arithmetic
from agents.policy import uniform_policy
from agents.process import N_ACTIONS
from agents.sb3.settings import DqnSettings
from agents.tabular import learner
from benchmark.execution.executors.processes import Processes
from benchmark.execution.progress import time_left
from benchmark.execution.provenance import commit, machine, processor, versions
from benchmark.experiments import (
    DEFAULT_CONDITION,
    Experiment,
    Reporting,
    RunSpecification,
    load_experiment,
    specifications,
)
from benchmark.reports import draw, files
from benchmark.reports.folder import Folder
from benchmark.reports.item import Report, entry, item
from envs import InputError, Model, ProxemicVectorEnv, compile_scenario, load_scenario

_ENV: Final = "envs:Proxemic/S1-v0"
Turn = tuple[float, float]  # units and seconds
Work = Callable[[], float]  # returns how many units it has done


class Row(NamedTuple):
    """Two ways to do the same."""

    name: str
    unit: str
    sides: tuple[Work, Work]  # ours and the other
    against: str
    products: float = 0.0  # multiplications and additions in products of matrices, per unit


Rates = list[tuple[Row, list[float]]]  # of both sides


@item("speed", "rates of this project and of common alternatives, from the same run", is_measured=True)
def speed(rates: Rates) -> Iterator[dict[str, Any]]:
    """Tabulates the rates of all rows."""
    limit = next(max(both) for row, both in rates if row.name == "matrix_products")
    for row, (ours, stock) in rates:
        yield {
            "name": row.name,
            "per_second": ours,
            "baseline": stock,
            "ratio": ours / stock,
            "of_limit": ours * row.products / limit or None,
            "unit": row.unit,
            "against": row.against,
        }


@speed.sentence
def _(table: pd.DataFrame, _: Folder) -> str:
    nets = table[table["name"].str.startswith("net_")].sort_values("ratio")
    rows = table[table["name"] == "q_learning_kernel"].iloc[0], nets.iloc[0], nets.iloc[-1]
    q_learning, low, high = (entry(row, "ratio", "speed") for row in rows)
    return (
        f"Tabular Q-learning is {q_learning} times as fast as a tuned Python loop over Gymnasium. Nets train "
        f"{low} to {high} times as fast as with Stable-Baselines3, per second of CPU time."
    )


def measure(results: Path, *, smoke: bool) -> None:
    """Measures and prints the rates of all rows, and writes a folder of results.

    Other reports wait meanwhile: they would disturb.

    Args:
      results: The folder of all results.
      smoke: Whether to measure very little, to try the code; it has a folder of its own.

    Raises:
      InputError: The folder cannot be written; then nothing is measured.
    """
    directory = results / (f"{REPORT.name}_smoke" if smoke else REPORT.name)
    is_stale = draw.was_made(directory, REPORT.items)
    with files.alone(results), files.replaced(directory, is_stale) as aside:
        taken: Any = _rates(smoke)
        for row, (ours, stock) in taken:
            print(f"{row.name:24} {ours:14,.0f} {row.unit}/s, {ours / stock:8.3g} times {row.against}")
        manifest = {
            "experiment": REPORT.name,
            "description": "The speed of this project against common alternatives.",
            "command": "make speed",
            "argument": "",  # none: the command `report` does not draw it
            "report": Reporting(kind=f"{__name__}:REPORT").model_dump(mode="json"),
            "partial": "",
            "note": "Measured with `--smoke`: the numbers mean nothing." if smoke else "",
            "scenarios": {},
            "algorithms": {},
            "facts": {},
            "commits": [commit(Path(__file__))],
            "machines": [machine()],
            "processors": [processor()],
            "versions": [versions("q_learning")],
        }
        draw.publish(REPORT.items, taken, aside, manifest)
    print(f"written to {directory}")


def _rates(smoke: bool) -> Rates:
    """Measures the rates of both sides of every row."""
    workers = Processes(os.cpu_count() or 1)
    try:
        rows = [*_rows(smoke), *_deep_rows(smoke, workers)]
        trained = [_products_row(smoke), *_net_rows(smoke)]
        first, others = range(2 * len(rows)), range(2 * len(rows), 2 * (len(rows) + len(trained)))
        clocks = [time.perf_counter] * len(first) + [time.process_time] * len(others)
        sides = [work for row in (*rows, *trained) for work in row.sides]
        order = [*first, *others, *[*first] * (1 if smoke else 15), *[*others] * (1 if smoke else 4)]
        turns = _take_turns(sides, clocks, order)
    finally:
        workers.cancel()
    rates = [_best(turns[i]) for i in first] + [_overall(turns[i]) for i in others]
    return [(row, rates[2 * i : 2 * i + 2]) for i, row in enumerate([*rows, *trained])]


def _take_turns(
    sides: Sequence[Work], clocks: Sequence[Callable[[], float]], order: Sequence[int]
) -> list[list[Turn]]:
    """Returns the turns of each side, but for its first, which compiles, imports and fills caches.

    The order begins with every side. Then the time left is shown: each turn is expected to take as long as
    the last one of its side.
    """
    turns: list[list[Turn]] = [[] for _ in sides]
    seconds = [0.0] * len(sides)
    columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TextColumn("elapsed")
    with Progress(*columns, console=Console(stderr=True)) as progress:
        task = progress.add_task(f"0 of {len(order)} turns", total=len(order))
        for n, side in enumerate(order, start=1):
            started_s, started = time.monotonic(), clocks[side]()
            turns[side].append((sides[side](), clocks[side]() - started))
            seconds[side] = time.monotonic() - started_s
            left = time_left(sum(seconds[each] for each in order[n:])) if n >= len(sides) else ""
            progress.update(task, completed=n, description=f"{n} of {len(order)} turns{left}")
    return [taken[1:] for taken in turns]


def _best(turns: list[Turn]) -> float:
    return max(done / seconds for done, seconds in turns)


def _overall(turns: list[Turn]) -> float:
    return sum(done for done, _ in turns) / sum(seconds for _, seconds in turns)


def _refuse(experiment: Experiment, *_: object) -> NoReturn:
    raise InputError(f"{experiment.argument}: report: accepted: a report that can be drawn of an experiment.")


REPORT: Final = Report(
    name="speed",
    question="How fast is this project?",
    check=_refuse,
    load=_refuse,
    items=(speed,),
    document=Path(__file__).with_name("speed.md.jinja"),
)


# Rows without deep learning, with the paper's constants


def _rows(smoke: bool) -> list[Row]:
    """Returns these rows; on S1 unless they say otherwise."""
    model, largest = compile_scenario(load_scenario("S1")), compile_scenario(load_scenario("Anywhere"))
    short, long = (200, 1000) if smoke else (20_000, 100_000)  # steps
    batched, sync = (
        gymnasium.make_vec(_ENV, num_envs=1000, vectorization_mode=mode, max_episode_steps=-1)
        for mode in ("vector_entry_point", "sync")
    )
    learned = partial(_kernel, model, 200, short), partial(_python_q_learning, long)
    two, one = (partial(_kernel, model, 200, long, threads=n, record_every=10) for n in (2, 1))
    anywhere, s1 = (partial(_kernel, each, 100, long, record_every=100) for each in (largest, model))
    steps = _stepping(batched, 5 if smoke else 500), _stepping(sync, 1 if smoke else 10)
    # No policy visits more states than the random one.
    exact = partial(_repeat, 1 if smoke else 100, partial(evaluate, model, uniform_policy(model), 200))
    simulated = partial(_simulated, 10 if smoke else 1000)
    tuned = "a tuned Python loop over gymnasium.make: Q in lists, Python's own random numbers"
    in_s1 = f"the same in S1; Anywhere has {len(largest.observation):,} states"
    return [
        Row("q_learning_kernel", "updates", learned, tuned),
        Row("q_learning_threads", "updates", (two, one), "one thread, by two"),
        Row("q_learning_anywhere", "updates", (anywhere, s1), in_s1),
        Row("vector_env_1000", "steps", steps, "gymnasium.vector.SyncVectorEnv"),
        Row("evaluate", "policies", (exact, simulated), "1,000 simulated episodes, uniform random policy"),
    ]


def _kernel(model: Model, agents: int, steps: int, threads: int = 1, record_every: int = 1) -> float:
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
    total = 0.0
    for seed in [0, *[None] * (episodes - 1)]:
        env.reset(seed=seed)
        over = False
        while not over:
            _, reward, terminated, truncated, _ = env.step(rng.randrange(N_ACTIONS))
            total += float(reward)
            over = terminated or truncated
    return episodes / 1000


def _stepping(envs: Any, times: int) -> Work:
    """Resets vectorised envs; returns what steps them with random actions."""
    envs.reset()
    actions = cycle(np.random.default_rng(0).integers(0, N_ACTIONS, (50, envs.num_envs)))
    return partial(_repeat, times, lambda: envs.step(next(actions)), envs.num_envs)


def _repeat(times: int, call: Callable[[], object], units: float = 1) -> float:
    """Calls a function so many times; returns how many units it has done, which are given for one call."""
    for _ in range(times):
        call()
    return times * units


# Rows of deep learning, with the settings of `speed_nets.toml`, on S1


@cache
def _nets() -> Experiment:
    return load_experiment(Path(__file__).with_name("speed_nets.toml"))


def _deep_runs(variant: str, observation: str, budget: int, seeds: Sequence[int]) -> list[RunSpecification]:
    """Lists runs of the nets that are measured, with a budget."""
    changed = _nets().model_copy(update={"settings": _nets().settings | {"budget": budget}})
    return specifications(changed, DEFAULT_CONDITION, "S1", variant, observation, seeds)


def _deep_rows(smoke: bool, workers: Processes) -> list[Row]:
    """Returns the rows of Stable-Baselines3's agents here and elsewhere, with one-hot observations."""
    import torch
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import DummyVecEnv

    from agents.sb3 import algorithms
    from agents.sb3.tables import policy_table
    from agents.sb3.training import make_agent
    from agents.sb3.vec_env import SB3VecEnv

    budget = 200 if smoke else 2000
    methods = {"dqn": algorithms.DQN, "ppo": algorithms.PPO}
    seeds = range(os.cpu_count() or 1)
    runs = {name: _deep_runs(f"{name}_sb3", "one_hot", budget, seeds) for name in methods}
    dqn: Any = runs["dqn"][0].settings
    limit = {"max_episode_steps": dqn.time_limit}
    make_env = partial(gymnasium.make, _ENV, observation="one_hot", **limit)

    def native(n_envs: int) -> SB3VecEnv:
        return SB3VecEnv(ProxemicVectorEnv(n_envs, "S1", "one_hot", autoreset_mode="SameStep", **limit))

    def ours(name: str) -> float:
        for future in [workers.submit([run]) for run in runs[name]]:
            assert future.result()[0].error is None
        return budget * len(runs[name])

    def stock(name: str) -> float:
        settings: Any = runs[name][0].settings
        env = DummyVecEnv([lambda: Monitor(make_env())] * settings.n_envs)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="You have specified a mini-batch size")
            methods[name].load()("MlpPolicy", env, **settings.arguments).learn(budget)
        return budget

    pool = f"the same over DummyVecEnv([Monitor(env)]), one process of {torch.get_num_threads()} threads"
    rows = [
        Row(f"sb3_{name}", "steps", (partial(ours, name), partial(stock, name)), pool) for name in methods
    ]
    for n_envs, times in ((8, 1000), (64, 300)):
        n_ours, n_other = (5, 5) if smoke else (times, times // 4)
        steps = _stepping(native(n_envs), n_ours), _stepping(DummyVecEnv([make_env] * n_envs), n_other)
        rows.append(Row(f"vec_env_{n_envs}", "steps", steps, "stable_baselines3's DummyVecEnv"))

    agent = make_agent(methods["dqn"].load(), dqn, native(1))
    table = np.eye(120, dtype=np.float32)  # all one-hot observations in S1
    many = partial(policy_table, agent, torch.as_tensor(table))
    each = cycle(table)
    single = partial(_repeat, 120, lambda: agent.predict(next(each), deterministic=True))
    maps = partial(_repeat, 5 if smoke else 500, many), partial(_repeat, 1 if smoke else 10, single)
    return [*rows, Row("map_all_cells", "maps", maps, "120 single predicts")]


def _products_row(smoke: bool) -> Row:
    """Returns the row of the products of matrices that nets consist of."""
    shape, times = (64, 128, 128), 10 if smoke else 4000
    a, b = np.ones(shape[:2], np.float32), np.ones(shape[1:], np.float32)
    c, zeros = np.empty((64, 128), np.float32), np.zeros(128, np.float32)

    @numba.njit  # type: ignore[untyped-decorator]
    def multiply(a: Any, b: Any, c: Any, zeros: Any) -> None:
        for _ in range(times):
            arithmetic.multiply(shape, (zeros, 0), (a, 0, 128, 1), (b, 0, 128, 1), (c, 0, 128, 1))

    compiled = partial(multiply, a.ravel(), b.ravel(), c.ravel(), zeros)
    units = 2.0 * math.prod(shape)
    ours = partial(_repeat, 1, compiled, times * units)
    other = partial(_repeat, times, partial(np.dot, a, b, out=c), units)
    against = "NumPy's BLAS, 64 × 128 by 128 × 128, float32"
    return Row("matrix_products", "operations", (ours, other), against)


def _net_rows(smoke: bool) -> list[Row]:
    """Returns the rows of training whole runs of nets."""
    budget = 200 if smoke else 10_000

    def train(variant: str, observation: str, seeds: Iterator[int]) -> float:
        # A run of ours takes well below a second.
        n_seeds = 1 if variant.endswith("_sb3") or smoke else 25
        runs = _deep_runs(variant, observation, budget, list(islice(seeds, n_seeds)))
        model, streams = compile_scenario(runs[0].scenario), [run.seed_sequence for run in runs]
        algorithm = load_algorithm(runs[0].algorithm)
        algorithm.train(model, runs[0].settings, observation, streams, Schedule(budget))
        return float(len(runs) * budget)

    rows = []
    for name in ("dqn_one_hot", "dqn_coordinates", "dqn_linear", "ppo_one_hot", "ppo_coordinates"):
        variant, observation = (name, "one_hot") if name == "dqn_linear" else name.split("_", 1)
        ours, other = (partial(train, each, observation, count()) for each in (variant, f"{variant}_sb3"))
        products = _products(_deep_runs(variant, observation, budget, [0])[0].settings, observation)
        against = "Stable-Baselines3, by CPU time"
        rows.append(Row(f"net_{name}", "steps", (ours, other), against, products))
    return rows


def _products(settings: Any, observation: str) -> float:
    """Returns the multiplications and additions in products of matrices per step of training a net in S1."""
    n_inputs = 0 if observation == "one_hot" else 2  # a one-hot observation is the choice of a row
    if isinstance(settings, DqnSettings):
        outputs, passes = [N_ACTIONS], settings.batch_size * settings.gradient_steps / settings.rollout
    else:
        outputs, passes = [N_ACTIONS, 1], settings.n_epochs
    total = 0.0
    for n_outputs in outputs:
        first, *others = pairwise([n_inputs, *settings.policy_kwargs.net_arch, n_outputs])
        # Outputs and slopes of weights; behind the first layer also slopes of inputs.
        total += 4 * math.prod(first) + 6 * sum(map(math.prod, others))
    return float(total * passes)
