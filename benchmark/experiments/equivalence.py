"""What the tables of `equivalence` show."""

from collections.abc import Mapping

import pandas as pd

DQN, PPO_AGAIN = "dqn, coordinates", "ppo_again, coordinates"


def finding(tables: Mapping[str, pd.DataFrame]) -> str:
    """Checks all claims, and returns the text."""
    contrasts = tables["contrasts"].set_index(["scenario", "x"])
    again = contrasts.loc[[("S2", DQN), ("S2", PPO_AGAIN)]]
    verdicts = contrasts["success_verdict"].replace("equivalent", "within margin")  # as it was
    others = verdicts.drop(("S2", DQN))
    assert verdicts["S2", DQN] == "undecided", "DQN on coordinates is undecided in S2"
    assert (others == "within margin").all(), "all others are within the margin"
    assert (contrasts["success_margin"] == 0.15).all(), "the margin is 0.15"
    assert (tables["summary"]["budget"] == 10_000).all(), "there are 10,000 steps"
    text = "{success_x:.2f} against {success_y:.2f}"
    dqn, ppo = map(text.format_map, again.to_dict("records"))
    return f"""
Nets compiled here succeed as often as those of Stable-Baselines3, within 0.15 (level 5 %), in
{len(others)} of {len(contrasts)} contrasts with 10,000 steps and at least {contrasts["n"].min()}
runs on each side. The other one, DQN on coordinates in S2, is undecided ({dqn}).

**A difference that was chance.** With 100 earlier runs of Stable-Baselines3's, PPO on coordinates
was worse in S2 (0.47 against 0.60, not adjusted). With fresh seeds and more runs, it has
{ppo}, and is within 0.15.
"""
