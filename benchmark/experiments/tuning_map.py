"""Numbers and claims of the text on `tuning_map`."""

from benchmark.experiments.finding import Names, Tables

TABLE, TILES = "watkins_q_lambda, index", "tile_coding, coordinates"
OFFSET_TABLE, OFFSET_TILES = "watkins_q_lambda, offset", "tile_coding, offset_coordinates"
REPLAY_TABLE, REPLAY_OFFSET_TABLE = "replay_table, index", "replay_table, offset"
PPO, OFFSET_PPO, OFFSET_DQN = "ppo, coordinates", "ppo, offset_factored", "dqn, offset_factored"
PLAIN_PPO, PLAIN_DQN = "ppo, offset_coordinates", "dqn, offset_coordinates"
TILED_DQN = "dqn, offset_tiles"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, chosen = tables.claim, tables.rows("chosen")
    total = tables.rows("effort", scenario="all").set_index("learner")["total"]
    nets = total[total.index.str.match("dqn,|ppo,")]
    offsets = nets[nets.index.str.contains("offset")]
    is_best = [nets.drop(offsets.index).idxmin(), offsets.idxmin()] == [PPO, OFFSET_PPO]
    claim(is_best, "PPO with these forms has the smallest effort of nets")
    is_dqn = nets[nets.index.str.startswith("dqn, offset")].idxmin() == OFFSET_DQN
    claim(is_dqn, "DQN of offsets has the smallest effort with one-hot rows and columns")
    hall = tables.rows("effort", scenario="LargeHall", variant="dqn").set_index("observation")["learned"]
    claim(not hall[["coordinates", "centred", "factored"]].any(), "given cells, DQN learns in no large hall")
    claim(tables.values("cost", "trials") == {63}, "every learner and form has 64 trials, trial 0 included")
    mean = chosen.groupby("learner")["chosen"].mean()
    of_nets = mean[mean.index.str.match("(?:dqn|ppo), offset")]
    others = mean[mean.index.str.match("(?:watkins_q_lambda|replay_table|tile_coding|replay_tiles), offset")]
    claim(
        of_nets.max() < others.min(),
        "given offsets, picks of nets learn later than those of tables and tiles",
    )

    def picks(learner: str) -> str:
        values = chosen[chosen["learner"] == learner]["chosen"]
        return f"{values.min():.2f} to {values.max():.2f}"

    return {
        "total": tables.numbers("effort", "total", "learner", scenario="all"),
        "learned": tables.numbers("effort", "learned", "learner", scenario="all"),
        "default": tables.numbers("effort", "default", "learner", scenario="all"),
        "cpu": tables.numbers("cost", "cpu_time_s", "learner", "time"),
        "picks": picks,
    }
