"""README of the repository and of `results`, with the numbers of published tables."""

from collections.abc import Mapping
from pathlib import Path
from textwrap import fill
from typing import Final

import pandas as pd

from benchmark.experiment import PUBLISHED
from benchmark.folder import README, Folder
from envs import InputError

_PAPER: Final = "q_learning, index"
_SB3: Final = ["sb3_dqn, one_hot", "sb3_ppo, one_hot"]
_SHOWN: Final = {  # learners of the table, by what README calls them
    "the paper's table": _PAPER,
    "Q(λ) table, tuned": "watkins_q_lambda, index",
    "tile coding, tuned": "tile_coding, coordinates",
    "SB3's DQN, tuned": _SB3[0],
    "SB3's PPO, tuned": _SB3[1],
}
_BASELINES: Final = ["watkins_q_lambda, index", "tile_coding, coordinates"]
Tables = Mapping[str, pd.DataFrame]


def answer(results: Path, name: str) -> str:
    """Returns what was found: the first paragraph below the title of a folder's README."""
    text = (results / name / README).read_text(encoding="utf-8")
    return text.split("\n\n")[1]


def index(results: Path) -> str:
    """Returns README of `results`."""
    found = [
        f"- [{name}]({name}/README.md): {answer(results, name)}" for name in _published(results)
    ]
    listed = "\n".join(
        fill(each, 100, subsequent_indent="  ", break_on_hyphens=False) for each in found
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
    """Returns README; raises an InputError if a folder does not show what README says."""
    tables = {name: Folder(results / name).tables() for name in _published(results)}
    try:
        return f"""\
{_START}
{_replicated(results)}
{_compared(tables["compare_deep"], tables["tuning"])}
{_OWN}
{_words(tables["equivalence"])}"""
    except AssertionError as error:
        raise InputError(f"README: the published tables do not show that {error}.") from error


_START: Final = """\
# Proxemic benchmark

*When does deep RL earn its keep over a table?* An agent walks up to a person and must learn, from
rewards alone, where to stop and ask whether it is close enough (*PING*). This suite replicates the
Q-learning of Millán-Arias, Fernandes and Cruz
([arXiv 2108.03730](https://arxiv.org/abs/2108.03730)) and compares tables and tile coding with DQN
and PPO of [Stable-Baselines3](https://stable-baselines3.readthedocs.io) (SB3), in
[Gymnasium](https://gymnasium.farama.org) gridworlds small enough to evaluate every policy exactly.
So far, no net is shown to learn in fewer steps than tile coding.

```sh
make reproduce            # the paper's figure and claims, in results/reproduce/ (2 minutes)
make compare-deep SEEDS=5 # the learners below, in results/compare_deep_seeds_0-4/ (7 minutes)
make test                 # the quick tests (4 minutes)
```

Needed: Python 3.11 or newer, make, git. Use `git clone --depth 1`: the history is 90 MB. Then open
`results/index.html`.
"""


def _replicated(results: Path) -> str:
    found = fill(answer(results, "reproduce"), 100, break_on_hyphens=False)
    return f"""\
## The paper, replicated

![The paper's figure, replicated](results/reproduce/figure.svg)

{found}
[Claim by claim](results/reproduce/README.md)
"""


def _compared(tables: Tables, tuning: Tables) -> str:
    """Returns what README says of the paper's scenarios, after checking it."""
    summary, contrasts = tables["summary"], tables["contrasts"]
    sizes = summary.set_index("learner")["n"]
    for name in _SHOWN.values():
        assert {*sizes[[name]]} == {30 if name in _SB3 else 100}, f"{name} has so many runs"
    assert {*summary["budget"]} == {10_000}, "runs have 10,000 steps"
    nets = contrasts["x"].isin([*_SB3, "dqn, one_hot", "ppo, one_hot"])
    verdicts = contrasts[nets & contrasts["y"].isin(_BASELINES)]["success_verdict"]
    assert len(verdicts) == 8, "four nets are compared with both"
    assert "better" not in {*verdicts}, "no net beats a tuned table or tile coding"
    paper = contrasts[contrasts["y"] == _PAPER].set_index("x")
    in_s2 = paper[paper["scenario"] == "S2"]["success_verdict"]
    assert {*in_s2[_SB3]} == {"better"}, "SB3's nets are better than the paper's table in S2"
    tuned = paper["success_verdict"]["q_learning_tuned, index"]
    assert tuned == "better", "the table is better with tuned constants"
    defaults = summary[summary["learner"].str.match(r"(sb3_)?dqn_default,")]
    assert {*defaults["success"]} == {0.0}, "DQN never succeeds with its defaults"
    assert tuning["cost"]["trials"].nunique() == 1, "all were searched equally long"
    success = summary.pivot(index="learner", columns="scenario", values="success")
    rows = [
        f"| {title} | {' | '.join(f'{share:.2f}' for share in success.loc[name])} |"
        for title, name in _SHOWN.items()
    ]
    table = "\n".join(rows)
    return f"""\
## Tables against DQN and PPO

![Success over training](results/compare_deep/curves.svg)

| success after 10,000 steps | S1 | S2 | S3 |
|---|---|---|---|
{table}

*Means over 100 runs (SB3: 30); shades: 95 % intervals. Tuned: the best of
{tuning["cost"]["trials"].iloc[0] + 1} settings in four other scenarios.*

With random feedback (S2), both nets succeed more often than the paper's table. Over all three
scenarios, so does that table when tuned, and no net is shown to beat the tuned Q(λ) table or tile
coding. With SB3's defaults, DQN never succeeds.
[All learners and verdicts](results/compare_deep/README.md)
"""


_OWN: Final = """\
## Benchmark your own algorithm

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

For several runs, copy [sb3.toml](benchmark/experiments/sb3.toml) to `mine.toml`, name a class like
SB3's (`algorithm = "sb3_contrib:TRPO"`), and run
`.venv/bin/python -m benchmark run mine.toml --report`. More:
[scenarios](envs/scenarios/README.md#at-a-glance), [your scene](benchmark/guide.md),
[your learner](agents/README.md), [data frames](benchmark/README.md#data-frames).
"""


def _words(equivalence: Tables) -> str:
    contrasts = equivalence["contrasts"]
    assert {*contrasts["success_margin"]} == {0.15}, "nets are compared within 0.15"
    verdicts = contrasts["success_verdict"]
    is_within = verdicts.isin(["equivalent", "within margin"])
    assert (is_within | verdicts.eq("undecided")).all(), "nets are equivalent or undecided"
    assert len(verdicts) == 8, "nets are compared in 8 tests"
    n_undecided = verdicts.eq("undecided").sum()
    return f"""\
## Words

- **PING:** in a ring around the person, it succeeds and ends the episode. Elsewhere it costs, and
  the fifth wrong PING ends the episode.
- **S1, S2, S3:** the person gives no feedback, random feedback, or feedback by distance.
- **Success:** the exact probability of a correct PING. *Learned* at step *s*: success stays at 0.9
  or above until step 2*s*, or the end.
- **Tile coding:** values are sums of weights that neighbouring cells share.
- **DQN and PPO in harder scenes** are our own, compiled. They succeed as often as SB3's,
  within 0.15, in {is_within.sum()} of 8 [tests](results/equivalence/README.md);
  {n_undecided} is undecided.

Small gridworlds do not model personal space.

[Results](results/README.md), [commands](benchmark/README.md), [design](CONTRIBUTING.md),
[citation](CITATION.cff). MIT licence.
"""
