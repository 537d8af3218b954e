"""Numbers and claims of the text on `tuning`."""

from benchmark.experiments.finding import Names, Tables, gain_of

TABLE, TILES = "watkins_q_lambda, offset", "tile_coding, offset_coordinates"
NET, PPO = "dqn, one_hot", "ppo, coordinates"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, rows = tables.claim, tables.rows("chosen").set_index("learner")
    best, variant = rows["chosen"], rows["variant"]
    nets, others = best[variant.isin(["dqn", "ppo"])], best[~variant.isin(["dqn", "ppo", "tile_coding"])]
    claim(others.max() == best[TABLE], "the best table is that of offsets")
    claim(nets.max() == best[NET], "the best net is DQN on one-hot cells")
    claim(rows.loc[[TABLE, TILES, PPO, NET]]["gain_low"].min() > 0, "all four rise")
    claim(tables.values("cost", "trials") == {48}, "every learner has 48 trials")
    is_below = rows["chosen_high"][NET] < rows["chosen_low"][[TABLE, TILES]].min()
    claim(is_below, "the best net stays below the best table and tile coding")
    return {"gain": gain_of(tables)}
