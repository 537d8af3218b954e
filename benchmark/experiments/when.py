"""Numbers and claims of the text on `when`."""

from benchmark.experiments.finding import Names, Tables, steps_of

TABLE, REPLAY_TABLE = "watkins_q_lambda, index", "replay_table, index"
TILES, REPLAY_TILES = "tile_coding, coordinates", "replay_tiles, coordinates"
DQN, FACTORED_DQN, PPO = "dqn, coordinates", "dqn, factored", "ppo, centred"
PLAIN_PPO, FACTORED_PPO = "ppo, coordinates", "ppo, factored"
OFFSET_TABLE, REPLAY_OFFSET_TABLE = "watkins_q_lambda, offset", "replay_table, offset"
OFFSET_TILES, REPLAY_OFFSET_TILES = "tile_coding, offset_coordinates", "replay_tiles, offset_coordinates"
OFFSET_DQN, OFFSET_PPO = "dqn, offset_tiles", "ppo, offset_factored"
PLAIN_OFFSET_DQN, PLAIN_OFFSET_PPO = "dqn, offset_coordinates", "ppo, offset_coordinates"
FACTORED_OFFSET_DQN, CENTRED_OFFSET_DQN = "dqn, offset_factored", "dqn, offset_centred"
CENTRED_OFFSET_PPO = "ppo, offset_centred"
LINEAR_DQN, LINEAR_Q = "dqn_linear, offset_tiles", "linear_q_lambda, offset_tiles"
FACTORED_LINEAR_DQN, FACTORED_LINEAR_Q = "dqn_linear, offset_factored", "linear_q_lambda, offset_factored"
NETS = [DQN, FACTORED_DQN, PPO, OFFSET_DQN, OFFSET_PPO]
TILINGS = [TILES, REPLAY_TILES, OFFSET_TILES, REPLAY_OFFSET_TILES]
TABLES = [TABLE, REPLAY_TABLE, OFFSET_TABLE, REPLAY_OFFSET_TABLE]
FORMS = {"grid": "forms", "point": "places 64"}


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    steps = steps_of(tables)

    def learned(learner: str, grid: str, point: str) -> str:
        return f"{tables.number('cells', 'n_solved', '', grid=grid, point=point, learner=learner)} of 16"

    return {
        "steps": lambda learner, grid="forms", point="places 64": steps(learner, grid, point),
        "learned": learned,
        "unseen": tables.numbers("cells", "unseen_budget", "learner", ".2f", **FORMS),
        "unseen_after": tables.numbers("cells", "unseen_budget", "learner point", ".2f", grid="unseen"),
        "wrong_pings": tables.numbers("cells", "disagreements", "learner", **FORMS),
        "cpu": tables.numbers("cpu", "cpu_time_s", "learner", "time", **FORMS),
        "fastest": tables.numbers("cells", "steps_fastest", "learner", **FORMS),
        "slowest": tables.numbers("cells", "steps_slowest", "learner", **FORMS),
        "n_slower": tables.count("contrasts", x=NETS, y=TILINGS, verdict="slower"),
        "n_contrasts": tables.count("contrasts", x=NETS, y=TILINGS),
    }
