"""What the tables of `equivalence` show."""

from collections.abc import Mapping

import pandas as pd

DQN, PPO_AGAIN = "dqn, coordinates", "ppo_again, coordinates"


def finding(tables: Mapping[str, pd.DataFrame]) -> str:
    """Checks all claims, and returns the text."""
    contrasts = tables["contrasts"].set_index(["scenario", "x"])
    verdicts = contrasts["success_verdict"].replace("equivalent", "within margin")  # as it was
    others = verdicts.drop(("S2", DQN))
    assert verdicts["S2", DQN] == "undecided", "DQN on coordinates is undecided in S2"
    assert (others == "within margin").all(), "all others are within the margin"
    assert (contrasts["success_margin"] == 0.15).all(), "the margin is 0.15"
    assert (tables["summary"]["budget"] == 10_000).all(), "there are 10,000 steps"
    rows = contrasts.loc["S2"].to_dict("index")
    text = "{success_x:.2f} against {success_y:.2f}"
    dqn, again = (text.format_map(rows[name]) for name in (DQN, PPO_AGAIN))
    return f"""
Nets compiled here succeed as often as those of Stable-Baselines3, within 0.15 (level 5 %), in
{len(others)} of {len(contrasts)} contrasts with 10,000 steps and at least {contrasts["n"].min()}
runs on each side. The other one, DQN on coordinates in S2, is undecided ({dqn}).

**A difference that was chance.** With 100 earlier runs of Stable-Baselines3's, PPO on coordinates
was worse in S2 (0.47 against 0.60, not adjusted). With fresh seeds and more runs, it has
{again}, and is within 0.15.
"""
