"""Numbers and claims of the text on `tuning_map`."""

from benchmark.experiments.finding import Names, Tables

TABLE, TILES = "watkins_q_lambda, index", "tile_coding, coordinates"
OFFSET_TABLE, OFFSET_TILES = "watkins_q_lambda, offset", "tile_coding, offset_coordinates"
REPLAY_TABLE, REPLAY_OFFSET_TABLE = "replay_table, index", "replay_table, offset"
REPLAY_OFFSET_TILES = "replay_tiles, offset_coordinates"
PPO, DQN, OFFSET_PPO, OFFSET_DQN = (
    "ppo, centred",
    "dqn, coordinates",
    "ppo, offset_factored",
    "dqn, offset_factored",
)
PLAIN_PPO, PLAIN_DQN = "ppo, offset_coordinates", "dqn, offset_coordinates"
TILED_DQN = "dqn, offset_tiles"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, chosen = tables.claim, tables.rows("chosen")
    effort = tables.rows("effort", scenario="all").set_index("learner")
    total, drawn = effort["total"], effort["drawn"]
    nets = total[total.index.str.match("dqn,|ppo,")]
    for offset in (False, True):
        for name, best in (("dqn", (DQN, OFFSET_DQN)), ("ppo", (PPO, OFFSET_PPO))):
            of_forms = nets[nets.index.str.match(f"{name}, {'' if offset else '(?!offset)'}")]
            claim(of_forms.idxmin() == best[offset], f"{best[offset]} has the smallest total of its forms")
    claim(total[OFFSET_TABLE] < nets.min(), "with trial 0, a table of offsets needs fewer steps than nets")
    default = effort["default"]
    claim(max(default[OFFSET_TABLE], default[OFFSET_TILES]) < float("inf"), "both learn with the defaults")
    claim((default[nets.index] == float("inf")).all(), "no net learns in all scenes with its defaults")
    rising = REPLAY_OFFSET_TILES, OFFSET_TILES, TILED_DQN, REPLAY_OFFSET_TABLE, OFFSET_PPO, OFFSET_TABLE
    of_drawn = [drawn[each] for each in rising]
    claim(of_drawn == sorted(of_drawn), "without trial 0, given offsets, learners have this order")
    claim(tables.values("cost", "trials") == {63}, "every learner and form has 64 trials, trial 0 included")

    def picks(learner: str) -> str:
        values = chosen[chosen["learner"] == learner]["chosen"]
        return f"{values.min():.2f} to {values.max():.2f}"

    def learned(learner: str, scenario: str = "all") -> str:
        return tables.number("effort", "learned", "", learner=learner, scenario=scenario)

    return {
        "total": tables.numbers("effort", "total", "learner", scenario="all"),
        "drawn": tables.numbers("effort", "drawn", "learner", scenario="all"),
        "learned": learned,
        "cpu": tables.numbers("cost", "cpu_time_s", "learner", "time"),
        "picks": picks,
    }
