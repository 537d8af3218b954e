"""Numbers and claims of the text on `tuning_groups`."""

from benchmark.experiments.finding import Names, Tables

TILES, DQN = "tile_coding, offset_coordinates", "dqn, offset_coordinates"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, rows = tables.claim, tables.rows("chosen")
    best = rows.set_index("learner")["chosen"].to_dict()
    centre = rows[rows["observation"].isin(["centre", "centre_coordinates"])]
    ppo, nets = (rows[rows["variant"].isin(variants)] for variants in (["ppo"], ["ppo", "dqn"]))
    claim(tables.rows("cost")["trials"].eq(12).all(), "every learner has 12 trials")
    claim(rows["gain_low"].max() <= 0, "no gain over trial 0 is shown")
    claim(rows["chosen"].max() == best[TILES], "tile coding on offsets is the earliest")
    claim(centre["chosen"].eq(0).all(), "no run with the centre alone learns")
    claim(tables.row("chosen", learner=DQN)["trial"] == 0, "DQN keeps the settings of its pilot")
    claim(ppo["chosen"].max() < 0.1, "the search found nothing for PPO")
    claim(nets["chosen"].max() == best[DQN], "DQN on offsets is the earliest net")

    return {"early": tables.numbers("chosen", "chosen", "learner", ".2f"), "tiles": TILES, "dqn": DQN}
