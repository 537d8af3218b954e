"""Numbers and claims of the text on `groups`."""

from benchmark.experiments.finding import Names, Tables, steps_of

TABLE, REPLAY_TABLE = "watkins_q_lambda, offset", "replay_table, offset"
TILES, REPLAY_TILES = "tile_coding, offset_coordinates", "replay_tiles, offset_coordinates"
DQN, PPO = "dqn, offset_factored", "ppo, offset_factored"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, cells = tables.claim, tables.rows("cells")
    runs = cells["budget"].eq(60_000).all() and cells["n"].eq(12).all()
    claim(runs, "all learners have 60,000 steps and 12 runs")

    def against(y: str, verdict: str) -> str:
        return tables.count("contrasts", x=[DQN, PPO], y=y, verdict=verdict)

    pairs = [(x, y) for x in (DQN, PPO) for y in (TABLE, REPLAY_TABLE, TILES, REPLAY_TILES)]
    n_points = {len(tables.rows("contrasts", x=x, y=y)) for x, y in pairs}
    claim(n_points == {4}, "each contrast of nets has four points")
    steps, at_128 = steps_of(tables), {"grid": "two", "point": "groups 128"}
    never = tables.row("cells", learner=PPO, **at_128)["steps"] == float("inf")
    claim(never, "most runs of PPO do not learn 128 places of two who talk")
    return {
        "steps": lambda learner, grid, places: steps(learner, grid, f"groups {places}"),
        "against": against,
        "learned": lambda grid, places: tables.number(
            "cells", "n_solved", "", learner=DQN, grid=grid, point=f"groups {places}"
        ),
        "unseen": tables.numbers("cells", "unseen_budget", "learner", ".2f", **at_128),
        "cost": tables.numbers("cpu", "cpu_time_s", "learner", "time", **at_128),
        "wrong_pings": tables.numbers("cells", "disagreements", "learner", **at_128),
    }
