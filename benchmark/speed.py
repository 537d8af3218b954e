"""The command `speed`: compares this project with common alternatives in the same process.

The two sides of a row take turns, since machines are noisy; rates are totals of all turns but the
first, per second of CPU time.
"""

import argparse
import random
import sys
import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import pandas as pd
from numpy.random import SeedSequence

from agents import Schedule, load_algorithm
from benchmark.folder import README, alone, write_text
from benchmark.provenance import provenance
from envs import Model, compile_scenario, load_scenario
from envs.inputs import parse, read_toml

_ABOUT = """# Speed against alternatives

Steps per second of CPU time while training in S1: of this project, of an alternative in the same
process (`baseline`), and how many times as many the first makes. Rows named `net_` train with the
settings of `speed_nets.toml`. `make speed` measures all of it anew.

```text
{table}
```

Measured on: {machine}. Machines differ and are noisy; ratios differ, too.
"""
_ENV = "envs:Proxemic/S1-v0"
_NETS = Path(__file__).with_name("speed_nets.toml")
_LOOP = "a tuned Python loop over gymnasium.make: Q in lists, Python's own random numbers"
_SB3 = "Stable-Baselines3"
_TURNS = 6


class Side(NamedTuple):
    """A function, and how many steps one call of it makes."""

    steps: int
    work: Callable[[], object]


Row = tuple[str, Side, Side, str]  # name, this project, an alternative, and what that is


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code.

    Other commands that write results wait meanwhile, as they would disturb the measurement.
    """
    import agents.sb3.training  # a missing package is refused before anything is measured

    agents.sb3.use_same_instructions()
    folder = options.results / ("speed_smoke" if options.smoke else "speed")
    with alone(options.results):
        frame = measured(all_rows(options.smoke))
        made = provenance("q_learning")
        text = _ABOUT.format(
            table=frame.to_string(index=False, float_format="{:,.1f}".format),
            machine=f"{made['machine']}, {made['processor']}",
        )
        write_text(folder / README, text)
    print(f"{text}\nwritten to {folder}")
    return 0


def measured(rows: Iterable[Row]) -> pd.DataFrame:
    """Lets the sides of each row take turns, and tabulates their rates.

    The first turn of a side, which compiles, imports and fills caches, does not count.
    """
    table = []
    for name, *sides, against in rows:
        print(f"speed: {name} ...", file=sys.stderr)
        seconds = [0.0, 0.0]
        for turn in range(_TURNS):
            for i, side in enumerate(sides):
                started = time.process_time()
                side.work()
                seconds[i] += time.process_time() - started if turn else 0.0
        ours, other = (
            side.steps * (_TURNS - 1) / spent for side, spent in zip(sides, seconds, strict=True)
        )
        table.append((name, ours, other, ours / other, against))
    return pd.DataFrame(table, columns=["name", "per_second", "baseline", "ratio", "against"])


def all_rows(smoke: bool) -> list[Row]:
    """Lists all rows; for a smoke test they do a hundredth of the work."""
    share = 100 if smoke else 1
    s1, budget = compile_scenario(load_scenario("S1")), 20_000 // share
    cells = _training(s1, "q_learning", "index", {"budget": budget, "record_every": budget}, 200)
    loop = Side(5 * budget, partial(_loop, 5 * budget))
    rows = [("q_learning_kernel", cells, loop, _LOOP)]
    for net, declared in read_toml(_NETS).items():
        name = net.partition("_")[0]
        for observation in declared.pop("observations"):
            settings = declared | {"budget": 200 if smoke else 10_000, "time_limit": 200}
            ours = _training(s1, f"compiled_{name}", observation, settings, 1 if smoke else 25)
            stock = _training(s1, f"sb3_{name}", observation, settings, 1)
            rows.append((f"net_{net}_{observation}", ours, stock, _SB3))
    return rows


def _training(
    model: Model, name: str, observation: str, declared: dict[str, Any], n_agents: int
) -> Side:
    algorithm, budget = load_algorithm(name), declared["budget"]
    settings = parse(algorithm.settings, declared, str(_NETS))
    seeds = [SeedSequence([0, i]) for i in range(n_agents)]
    given = model, settings, observation, seeds, Schedule(budget)
    return Side(n_agents * budget, partial(algorithm.train, *given))


def _loop(steps: int) -> None:
    """Learns in Python without NumPy, whose calls take longer than arithmetic on a few numbers."""
    env = gymnasium.make(_ENV, max_episode_steps=-1)
    rng = random.Random(0)
    q = [[0.0] * 5 for _ in range(120)]
    observation, _ = env.reset(seed=0)
    for _ in range(steps):
        row = q[observation]
        best = max(row)
        if rng.random() < 0.6:
            action = rng.randrange(5)
        else:
            action = rng.choice([a for a in range(5) if row[a] == best])
        following, reward, terminated, truncated, _ = env.step(action)
        target = float(reward) + (0.0 if terminated else 0.9 * max(q[following]))
        row[action] += 0.6 * (target - row[action])
        observation = env.reset()[0] if terminated or truncated else following
