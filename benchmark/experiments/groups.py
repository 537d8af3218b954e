"""Numbers and claims of the text on `groups`."""

from collections.abc import Callable

from benchmark.experiments.finding import Names, Tables, steps_of

TABLE, REPLAY_TABLE = "watkins_q_lambda, offset", "replay_table, offset"
TILES, REPLAY_TILES = "tile_coding, offset_coordinates", "replay_tiles, offset_coordinates"
DQN, PPO = "dqn, offset_factored", "ppo, offset_factored"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, cells = tables.claim, tables.rows("cells")
    runs = cells["budget"].eq(60_000).all() and cells["n"].eq(16).all()
    claim(runs, "all learners have 60,000 steps and 16 runs")

    def verdicts(x: str, y: str) -> Callable[[str], str]:
        return lambda verdict: tables.count("contrasts", x=x, y=y, verdict=verdict)

    steps = steps_of(tables)
    at_128 = {"grid": "two", "point": "groups 128"}
    return {
        "steps": lambda learner, grid, places: steps(learner, grid, f"groups {places}"),
        "verdicts": verdicts,
        "unseen": tables.numbers("cells", "unseen_budget", "learner", ".2f", **at_128),
        "cost": tables.numbers("cpu", "cpu_time_s", "learner", "time", **at_128),
        "wrong_pings": tables.numbers("cells", "disagreements", "learner", **at_128),
        "optimal": tables.numbers("ceilings", "optimal", "grid observation", ".2f"),
        "exact_success": tables.numbers("ceilings", "success", "grid observation", ".2f"),
    }
