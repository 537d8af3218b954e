"""What the tables of `sb3` show."""

from collections.abc import Mapping

import pandas as pd

TABLE = "q_learning, index"
TRPO = "sb3_trpo, one_hot"


def finding(tables: Mapping[str, pd.DataFrame]) -> str:
    """Checks all claims, and returns the text."""
    contrasts, summary = tables["contrasts"], tables["summary"]
    mean = tables["aggregate"].set_index("learner")["success"].map("{:.2f}".format)
    assert (summary["n"] == 10).all(), "there are ten runs"
    assert (summary["budget"] == 10_000).all(), "there are 10,000 steps"
    assert [*summary["scenario"].unique()] == ["S1", "S2", "S3"], "scenarios are S1, S2 and S3"
    assert (contrasts["y"] == TABLE).all(), "all are compared with the paper's table"
    assert (contrasts["success_margin"] == 0.1).all(), "the margin is 0.1"
    assert (contrasts["success_verdict"] == "undecided").all(), "all are undecided by success"
    by_score = contrasts.set_index("x")["score_verdict"].to_dict()
    assert by_score.pop(TRPO) == "worse", "TRPO is worse by score"
    assert {*by_score.values()} == {"undecided"}, "the others are undecided by score"
    searched = contrasts["x"][contrasts["differs"].str.contains("searched")]
    assert {*searched} == {*by_score}, "DQN, PPO and QR-DQN have searched settings, TRPO has not"
    return f"""
With 10,000 steps and ten runs in each of the paper's three scenarios, it is undecided (margin 0.1,
level 5 %) whether Stable-Baselines3's DQN and PPO, and sb3-contrib's QR-DQN and TRPO, succeed more
or less often than the paper's table; only DQN, PPO and QR-DQN have searched settings. Success rates
are {mean["sb3_dqn, one_hot"]} (DQN), {mean["sb3_ppo, one_hot"]} (PPO),
{mean["sb3_qrdqn, one_hot"]} (QR-DQN), {mean[TRPO]} (TRPO) and {mean[TABLE]} (the table). By score,
TRPO is worse than the table; the others are undecided.

**Caveats.** Numbers are means over S1, S2 and S3. Ten runs in each are too few: with 30, in
`compare_deep`, DQN is better than the paper's table, and there are tables and tile coding with
searched settings. QR-DQN has the settings that were searched for DQN.
"""
