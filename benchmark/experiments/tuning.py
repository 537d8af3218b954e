"""Numbers and claims of the text on `tuning`."""

from benchmark.experiments.finding import Names, Tables

TABLE, TILES = "watkins_q_lambda, offset", "tile_coding, offset_coordinates"
NET, PPO = "dqn, one_hot", "ppo, coordinates"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, rows = tables.claim, tables.rows("chosen")
    best = rows.set_index("learner")["chosen"].to_dict()
    nets = rows[rows["variant"].isin(["dqn", "ppo"])]
    others = rows[~rows["variant"].isin(["dqn", "ppo", "tile_coding"])]
    named = tables.rows("chosen", learner=[TABLE, TILES, PPO, NET])
    claim(others["chosen"].max() == best[TABLE], "the best table is that of offsets")
    claim(nets["chosen"].max() == best[NET], "the best net is DQN on one-hot cells")
    claim(named["gain_low"].min() > 0, "all four rise")
    claim(tables.rows("cost")["trials"].eq(48).all(), "every learner has 48 trials")
    lows = tables.rows("chosen", learner=[TABLE, TILES])["chosen_low"]
    claim(
        tables.row("chosen", learner=NET)["chosen_high"] < lows.min(),
        "the best net stays below the best table and tile coding",
    )

    def gain(learner: str) -> str:
        before, after = (
            tables.number("chosen", column, ".2f", learner=learner) for column in ("default", "chosen")
        )
        return f"from {before} to {after}"

    return {"gain": gain, "table": TABLE, "tiles": TILES, "net": NET, "ppo": PPO}
