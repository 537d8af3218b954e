"""README of the repository and of `results`, with the numbers of published tables."""

import re
from collections.abc import Mapping
from pathlib import Path
from textwrap import TextWrapper, fill

import pandas as pd

from benchmark.experiment import PUBLISHED
from benchmark.experiments import compare_deep
from benchmark.folder import README, Folder
from envs import InputError

_SHOWN = {  # learners of the table, by what README calls them
    "the paper's table": "q_learning, index",
    "the same, tuned here": "small_steps, index",
    "Q(λ) table, tuned": "watkins_q_lambda, index",
    "tile coding, tuned": "tile_coding, coordinates",
    "SB3's DQN, tuned": "sb3_dqn, one_hot",
    "SB3's PPO, tuned": "sb3_ppo, one_hot",
}
Tables = Mapping[str, pd.DataFrame]


def answer(results: Path, name: str) -> str:
    """Returns what was found: the first paragraph below the title of a folder's README."""
    text = (results / name / README).read_text(encoding="utf-8")
    return text.split("\n\n")[1]


def index(results: Path) -> str:
    """Returns README of `results`."""
    style = TextWrapper(100, subsequent_indent="  ", break_on_hyphens=False)
    listed = "\n".join(
        style.fill(f"- [{name}]({name}/README.md): {answer(results, name)}")
        for name in _published(results)
    )
    return f"""\
# Results

`make report` puts these results on one page, `index.html`, without training. The page needs no
server and no network. Its explorer shows what agents have learned, cell by cell, and how they walk.

{listed}
- [speed](speed/README.md): How fast this project is, compared with common alternatives.

## Scenarios

![Maps of all shipped scenarios](scenes.svg)

*Where places are drawn anew in every episode, one is shown. The
[gallery](../envs/scenarios/README.md#gallery) says what each scenario is.*

## Files

An experiment is a table of runs, `runs.csv.gz`. Everything else in its folder is made from it and
from `curves.csv.gz`, which has a row per run and evaluation. `from benchmark import runs, curves`
reads both. `columns.csv` says what the columns of all tables mean, and `manifest.json` what made
the runs. `runs.db`, which is not in the repository, has all records of the runs made here.
"""


def _published(results: Path) -> list[str]:
    """Lists the published experiments whose results are there."""
    return [name for name in PUBLISHED if (results / name / README).is_file()]


def readme(results: Path) -> str:
    """Returns README; raises an InputError if a folder does not show what README says.

    What is said of a folder that is not there is left out.
    """
    there = _published(results)
    sections = [_START, _drawn(results, "reproduce", "The paper, replicated", "Claim by claim")]
    try:
        if {"compare_deep", "tuning"} <= {*there}:
            tables = [Folder(results / name).tables() for name in ("compare_deep", "tuning")]
            sections.append(_compared(*tables))
        if others := [name for name in ("when", "suite") if name in there]:
            sections.append(
                _drawn(results, others[0], "When deep RL earns its keep", "All learners")
            )
    except AssertionError as error:
        raise InputError(f"README: the published tables do not show that {error}.") from error
    own = [_BENCH, _ASSESS] if "suite" in there else [_ASSESS]
    return "\n".join([*sections, "## Benchmark your own algorithm\n", *own, _WORDS])


_START = """\
# Proxemic benchmark

*When does deep RL earn its keep over a table?* An agent walks up to a person and must learn, from
rewards alone, where to stop and ask whether it is close enough (*PING*). This suite replicates the
Q-learning of Millán-Arias, Fernandes and Cruz
([arXiv 2108.03730](https://arxiv.org/abs/2108.03730)) and compares tables and tile coding with DQN
and PPO of [Stable-Baselines3](https://stable-baselines3.readthedocs.io) (SB3), in
[Gymnasium](https://gymnasium.farama.org) gridworlds small enough to evaluate every policy exactly.

```sh
make reproduce            # the paper's figure and claims, in results/reproduce/ (2 minutes)
make compare-deep SEEDS=5 # the learners below, in results/compare_deep_seeds_0-4/ (5 minutes)
make test                 # the quick tests (4 minutes)
```

Needed: Python 3.11 or newer, make, git. Clone with `--depth 1`: the history is 110 MB. Then open
`results/index.html`.
"""


def _drawn(results: Path, name: str, title: str, more: str) -> str:
    """Returns a section of what was found in a folder, and of its first figure."""
    text = (results / name / README).read_text(encoding="utf-8")
    figure = re.findall(r"!\[.*\]\((.*)\)", text)[0]
    found = fill(answer(results, name), 100, break_on_hyphens=False)
    return f"""\
## {title}

![{title}](results/{name}/{figure})

{found}
[{more}](results/{name}/README.md)
"""


def _compared(tables: Tables, tuning: Tables) -> str:
    """Returns what README says of the paper's scenarios, after checking it."""
    summary, contrasts = tables["summary"], tables["contrasts"].set_index(["x", "y"])
    paper, small, table, tiles, *nets = _SHOWN.values()
    verdicts = contrasts["success_verdict"]
    compare_deep.finding(tables)  # checks most of what is said here, too
    (n_sb3,) = {*summary.set_index("learner")["n"][nets]}
    assert tuning["chosen"]["trials"].nunique() == 1, "all were searched equally long"
    success = summary.pivot(index="learner", columns="scenario", values="success")
    rows = [
        f"| {title} | {' | '.join(f'{share:.2f}' for share in success.loc[name])} |"
        for title, name in _SHOWN.items()
    ]
    lines = "\n".join(rows)
    (compiled,) = {verdicts[net.removeprefix("sb3_"), net] for net in nets}
    assert compiled == "within margin", "compiled nets are as good as SB3's"

    def both(baseline: str) -> str:
        dqn, ppo = (verdicts[net, baseline] for net in nets)
        return f"*{dqn}*" if dqn == ppo else f"*{dqn}* (DQN) and *{ppo}* (PPO)"

    dqn, ppo = (success.loc[f"sb3_{net}_default, one_hot"].mean() for net in ("dqn", "ppo"))
    return f"""\
## Tables against DQN and PPO

![Success over training](results/compare_deep/curves.svg)

| success after 10,000 steps | S1 | S2 | S3 |
|---|---|---|---|
{lines}

*Means over 100 runs (SB3: {n_sb3}); shades: 95 % intervals. Tuned: the best of
{tuning["chosen"]["trials"].iloc[0] + 1} settings in other scenarios.*

Over all three, SB3's nets are {both(paper)} than the paper's table, {both(table)} against the
tuned Q(λ) table and {both(tiles)} against tile coding. Only in S2 is their mean success higher than
these tables', and there settings matter: with a learning rate of 0.2 and an epsilon of 0.1, chosen
here, a table like the paper's has {success.loc[small].min():.2f} everywhere. With SB3's defaults,
DQN has {dqn:.2f} and PPO {ppo:.2f}. Elsewhere, nets are our own, compiled; here, their mean success
is within 0.1 of SB3's.
[All learners and verdicts](results/compare_deep/README.md)
"""


_BENCH = """\
```sh
make bench ALGO=sb3_contrib:TRPO # in eight scenes, beside other learners (15 minutes)
```

`ALGO` is any [class like SB3's](benchmark/README.md#your-own-algorithm).
"""
_ASSESS = """\
After `make .venv/.deep`, run this with `.venv/bin/python`:

```python
import gymnasium
from stable_baselines3 import PPO

from benchmark.assess import assess

env = gymnasium.make("envs:Proxemic/S1-v0", observation="one_hot")
settings = {"n_steps": 500, "batch_size": 50, "n_epochs": 5, "gamma": 0.95, "learning_rate": 0.0014}
model = PPO("MlpPolicy", env, seed=0, device="cpu", **settings).learn(10_000)
result = assess(model, scenario="S1", observation="one_hot")
print(result)  # exact success and score
result.draw("map.png")
```

More: [scenarios](envs/scenarios/README.md#at-a-glance), [your scene](benchmark/guide.md),
[your experiment](benchmark/experiments/README.md), [your learner](agents/README.md),
[data frames](benchmark/README.md#data-frames).
"""


_WORDS = """\
## Words

- **PING:** in a ring around the person, it succeeds and ends the episode. Elsewhere it costs, and
  the fifth wrong one ends the episode.
- **S1, S2, S3:** the person gives no feedback, random feedback, or feedback by distance.
- **Success:** the exact probability of a correct PING. *Learned* at step *s*: success stays at 0.9
  or above until step 2*s*, or the end.
- **Tile coding:** values are sums of weights that neighbouring cells share.

Small gridworlds do not model personal space.

[Results](results/README.md), [commands](benchmark/README.md), [design](CONTRIBUTING.md),
[citation](CITATION.cff). MIT licence.
"""
