"""Numbers and claims of the text on `tuning_tables`."""

from benchmark.experiments.finding import Names, Tables

TABLE, OFFSET_TABLE = "watkins_q_lambda, index", "watkins_q_lambda, offset"
REPLAY_TABLE, REPLAY_OFFSET_TABLE = "replay_table, index", "replay_table, offset"
TILES, OFFSET_TILES = "tile_coding, coordinates", "tile_coding, offset_coordinates"
REPLAY_TILES, REPLAY_OFFSET_TILES = "replay_tiles, coordinates", "replay_tiles, offset_coordinates"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, chosen = tables.claim, tables.rows("chosen")
    claim(tables.values("cost", "trials") == {255}, "every learner has 256 trials, trial 0 included")
    by_learner = chosen.groupby("learner")["chosen"]
    mean, low, high = by_learner.mean(), by_learner.min(), by_learner.max()
    for plain, replay in ((TABLE, REPLAY_TABLE), (OFFSET_TABLE, REPLAY_OFFSET_TABLE),
                          (TILES, REPLAY_TILES), (OFFSET_TILES, REPLAY_OFFSET_TILES)):  # fmt: skip
        claim(mean[plain] < mean[replay], f"picks of {replay} learn earlier than those of {plain}")

    def picks(learner: str) -> str:
        return f"{low[learner]:.2f} to {high[learner]:.2f}"

    return {
        "picks": picks,
        "total": tables.numbers("effort", "total", "learner", scenario="all"),
        "drawn": tables.numbers("effort", "drawn", "learner", scenario="all"),
        "cpu": tables.numbers("cost", "cpu_time_s", "learner", "time"),
    }
