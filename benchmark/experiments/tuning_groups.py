"""Numbers and claims of the text on `tuning_groups`."""

from benchmark.experiments.finding import Names, Tables

TILES, DQN = "tile_coding, offset_coordinates", "dqn, offset_coordinates"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, rows = tables.claim, tables.rows("chosen").set_index("learner")
    best, variant = rows["chosen"], rows["variant"]
    centre = best[rows["observation"].isin(["centre", "centre_coordinates"])]
    claim(tables.values("cost", "trials") == {12}, "every learner has 12 trials")
    claim(rows["gain_low"].max() <= 0, "no gain over trial 0 is shown")
    claim(best.max() == best[TILES], "tile coding on offsets is the earliest")
    claim(centre.eq(0).all(), "no run with the centre alone learns")
    claim(rows["trial"][DQN] == 0, "DQN keeps the settings of its pilot")
    claim(best[variant.eq("ppo")].max() < 0.1, "the search found nothing for PPO")
    claim(best[variant.isin(["ppo", "dqn"])].max() == best[DQN], "the earliest net is DQN")
    return {"early": tables.numbers("chosen", "chosen", "learner", ".2f")}
