"""Speed: each row compares this project with a common alternative in the same process.

Machines are noisy: the two sides of a row take turns, and the best turn of each side counts. Training whole
nets takes too long for that: rates by CPU time are the units of all turns per second.
"""

import random
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import gymnasium
import numpy as np
import pandas as pd
from numpy.random import SeedSequence

from agents import Schedule, load_algorithm
from benchmark.drawing.tables import to_markdown, write_csv
from benchmark.execution import provenance
from benchmark.folder import README, SPEED, write_manifest
from benchmark.publish import files
from envs import Model, compile_scenario, load_scenario
from envs.inputs import parse, read_toml

_ABOUT: Final = """# Speed against alternatives

`make speed` measures all of this anew; the numbers are in speed.csv.

{table}
`per_second` is this project's rate, `baseline` that of the alternative, and `ratio` the quotient of the two.
Most rates are the best of many rounds in the same run, in which rows take turns. In rows named `net_`, both
sides train whole runs with the settings of `speed_nets.toml`, in turns; these rates are totals per second of
CPU time.

Measured on: {machine}. Machines differ and are noisy; ratios differ between machines, too.
"""
_ENV: Final = "envs:Proxemic/S1-v0"
_NETS: Final = Path(__file__).with_name("speed_nets.toml")
_LOOP: Final = "a tuned Python loop over gymnasium.make: Q in lists, Python's own random numbers"
_SB3: Final = "Stable-Baselines3, by CPU time"
Side = tuple[float, Callable[[], object]]  # how many units one call of a function does


class Row(NamedTuple):
    """Two ways to do the same."""

    name: str
    unit: str
    ours: Side
    other: Side
    against: str
    is_by_cpu_time: bool = False


def measure(results: Path, *, smoke: bool) -> None:
    """Measures all rows, or very little in a smoke test, and writes a folder among those of results.

    Other commands that write there wait meanwhile, as they would disturb the measurement. A folder that
    cannot be written is an InputError before anything is measured.
    """
    import agents.sb3.training  # a missing package is refused before anything is measured

    agents.sb3.use_same_instructions()

    directory = results / (f"{SPEED}_smoke" if smoke else SPEED)
    with files.alone(results), files.replaced(directory, stale=()) as aside:
        print("speed: preparing what is measured ...", file=sys.stderr)
        frame = _measured(all_rows(smoke), 2 if smoke else 16)
        print(to_markdown(frame))
        manifest = {
            "experiment": SPEED,
            "description": "The speed of this project against common alternatives.",
            "command": "make speed",
            "argument": "",
            "report": {"kind": SPEED, "question": "", "items": []},
            "note": "Measured with `--smoke`: the numbers mean nothing." if smoke else "",
            "scenarios": {},
            "algorithms": {},
            "commits": [provenance.commit(Path(__file__))],
            "machines": [provenance.machine()],
            "processors": [provenance.processor()],
            "versions": [provenance.versions("q_learning")],
        }
        write_csv(frame, aside / "speed.csv")
        write_manifest(aside, manifest)
        readme = _ABOUT.format(table=to_markdown(frame), machine=provenance.machine())
        (aside / README).write_text(readme, encoding="utf-8")
    print(f"written to {directory}")


def _measured(rows: list[Row], n_turns: int) -> pd.DataFrame:
    """Lets the sides of each row take turns, fewer of them by CPU time, and tabulates their rates.

    The first turn of a side, which compiles, imports and fills caches, does not count.
    """
    table = []
    for row in rows:
        print(f"speed: {row.name} ...", file=sys.stderr)
        clock = time.process_time if row.is_by_cpu_time else time.perf_counter
        sides, rates = (row.ours, row.other), []
        seconds = np.empty((min(n_turns, 5) if row.is_by_cpu_time else n_turns, 2))
        for turn in np.ndindex(*seconds.shape):
            started_s = clock()
            sides[turn[1]][1]()
            seconds[turn] = clock() - started_s
        for (units, _), counted in zip(sides, seconds[1:].T, strict=True):
            rates.append(units / (counted.mean() if row.is_by_cpu_time else counted.min()))
        table.append((row.name, *rates, rates[0] / rates[1], row.unit, row.against))
    return pd.DataFrame(table, columns=["name", "per_second", "baseline", "ratio", "unit", "against"])


def all_rows(smoke: bool) -> list[Row]:
    """Lists all rows; for a smoke test they do a hundredth of the work."""

    def size(n: int) -> int:
        return max(n // 100, 1) if smoke else n

    s1 = compile_scenario(load_scenario("S1"))
    short, long = size(20_000), size(100_000)
    cells = _training(s1, "q_learning", "index", {"budget": short, "record_every": short}, 200)
    rows = [Row("q_learning_kernel", "updates", cells, (long, partial(_loop, long)), _LOOP)]
    budget = 200 if smoke else 10_000
    for net, declared in read_toml(_NETS).items():
        for observation in declared.pop("observations"):
            name = net.partition("_")[0]
            settings = declared | {"budget": budget, "time_limit": 200}
            ours = _training(s1, f"compiled_{name}", observation, settings, size(25))
            stock = _training(s1, f"sb3_{name}", observation, settings, 1)
            rows.append(Row(f"net_{net}_{observation}", "steps", ours, stock, _SB3, is_by_cpu_time=True))
    return rows


def _training(model: Model, name: str, observation: str, declared: dict[str, Any], n_agents: int) -> Side:
    algorithm, budget = load_algorithm(name), declared["budget"]
    settings = parse(algorithm.settings, declared, str(_NETS))
    seeds = [SeedSequence([0, i]) for i in range(n_agents)]
    return n_agents * budget, partial(algorithm.train, model, settings, observation, seeds, Schedule(budget))


def _loop(steps: int) -> None:
    """Learns in Python without NumPy, whose calls take longer than the arithmetic on a few numbers."""
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
