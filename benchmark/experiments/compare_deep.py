"""What the tables of `compare_deep` show."""

from collections.abc import Mapping
from itertools import product

import pandas as pd

from envs.words import listed

PAPER, TABLE, TILES = "q_learning, index", "watkins_q_lambda, index", "tile_coding, coordinates"
SMALL = "small_steps, index"
DQN, PPO, SB3_DQN, SB3_PPO = (f"{name}, one_hot" for name in ("dqn", "ppo", "sb3_dqn", "sb3_ppo"))
DEFAULTS = [f"{name}_default, one_hot" for name in ("sb3_dqn", "sb3_ppo")]
TABLES = {PAPER: "the paper's table", TABLE: "the Q(λ) table", TILES: "tile coding"}
NETS = {  # what the text calls them
    SB3_DQN: "Stable-Baselines3's DQN",
    SB3_PPO: "Stable-Baselines3's PPO",
    DQN: "compiled DQN",
    PPO: "compiled PPO",
}


def finding(tables: Mapping[str, pd.DataFrame]) -> str:
    """Checks all claims, and returns the text."""
    contrasts, summary = tables["contrasts"], tables["summary"].set_index("learner")
    means = tables["aggregate"].set_index("learner")[["success", "score"]].map("{:.2f}".format)
    mean, score = means["success"], means["score"]
    pairs = contrasts.set_index(["x", "y"])
    verdicts, sizes = pairs["success_verdict"], summary["n"]
    success = summary.set_index("scenario", append=True)["success"]
    for net in NETS:
        assert verdicts[net, PAPER] == "better", "nets are better than the paper's table"
        assert "better" not in verdicts[net, TILES], "no net is better than tile coding"
        for table, scenario in product((PAPER, TABLE), ("S1", "S2", "S3")):
            is_ahead = success[net, scenario] > success[table, scenario]
            assert is_ahead == (scenario == "S2"), "nets are ahead of tables in S2 alone"
    assert summary["success"][SMALL].min() > 0.995, (
        "with other settings, the paper's table succeeds"
    )
    assert (contrasts["success_margin"] == 0.1).all(), "the margin is 0.1"
    assert (summary["budget"] == 10_000).all(), "there are 10,000 steps"
    assert (sizes[[*TABLES, DQN, PPO]] == 100).all(), "there are 100 runs"
    (n_sb3,) = {*sizes[[SB3_DQN, SB3_PPO]]}
    (n_default,) = {*sizes[DEFAULTS]}

    def each(learner: str) -> str:
        return listed(f"{value:.2f}" for value in summary["success"][learner])

    rows = [
        f"| {title}, {mean[net]} | {' | '.join(verdicts[net, table] for table in TABLES)} |"
        for net, title in NETS.items()
    ]
    against = " | ".join(f"against {title}, {mean[name]}" for name, title in TABLES.items())
    line = "\n"
    return f"""
After 10,000 steps in S1, S2 and S3, the paper's own table succeeds with a probability of
{each(PAPER)}. With searched settings, a Q(λ) table has {each(TABLE)}, tile coding, from
coordinates, {each(TILES)}, Stable-Baselines3's DQN {each(SB3_DQN)}, and its PPO, a stochastic
policy, {each(SB3_PPO)}. No net is shown to be better than tile coding. Only in S2 is the mean
success of nets higher than that of these two tables, and there settings matter: with a learning
rate of 0.2 and an epsilon of 0.1, chosen in these scenarios, a table like the paper's has
{each(SMALL)}.

| mean success over all three | {against} |
|---|---|---|---|
{line.join(rows)}

**Verdicts** are on the net of each row (margin 0.1, level 5 %). Learners have 100 runs in each
scenario, Stable-Baselines3's own {n_sb3}. All but the paper's table have searched settings here.

**Compiled nets** against Stable-Baselines3's own: DQN has {mean[DQN]} against {mean[SB3_DQN]}
(*{verdicts[DQN, SB3_DQN]}*), PPO {mean[PPO]} against {mean[SB3_PPO]} (*{verdicts[PPO, SB3_PPO]}*).
On coordinates instead of one-hot cells, compiled DQN has {mean["dqn, coordinates"]}, and PPO
{mean["ppo, coordinates"]}.

**Defaults.** Without a search, Stable-Baselines3's DQN succeeds with a probability of
{each(DEFAULTS[0])}, its PPO with {each(DEFAULTS[1])} ({n_default} runs in each scenario).

**Scores,** which also count steps: Stable-Baselines3's DQN has {score[SB3_DQN]}, the Q(λ) table
{score[TABLE]} (*{pairs["score_verdict"][SB3_DQN, TABLE]}*).
"""
