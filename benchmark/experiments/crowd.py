"""Numbers and claims of the text on `crowd`."""

from benchmark.experiments.finding import Names, Tables, steps_of
from envs.words import listed

TABLE, TOLD = "watkins_q_lambda, index", "tile_told, offset_coordinates"
TILES, PICKED_TILES = "tile_coding_earlier, coordinates", "tile_coding, coordinates"
PAIRS, PICKED_PAIRS = "tile_pairs_earlier, coordinates", "tile_pairs, coordinates"
AGENT_PAIRS, PICKED_AGENT_PAIRS = "tile_agent_pairs_earlier, coordinates", "tile_agent_pairs, coordinates"
DQN, PPO = "dqn, coordinates", "ppo, coordinates"
CONTROL_TILES, CONTROL_PPO = "control_tiles, coordinates", "control_ppo, coordinates"
_NUMBERS = (0, 1, 2, 4, 8, 16)  # of onlookers
_COMPARED = [TILES, PAIRS, AGENT_PAIRS, DQN, PPO]
_CONTROLS = {"shuffled": "permuted 100", "fixed": "ways 1", "hidden": "seen 0"}


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, steps = tables.claim, steps_of(tables)
    cells = tables.rows("cells", grid="crowd")
    claim(cells["budget"].eq(100_000).all(), "all runs have 100,000 steps")
    claim(cells[cells["learner"].isin(_COMPARED)]["n"].eq(16).all(), "compared learners have 16 runs")

    def at(x: str, y: str, verdict: str, column: str = "verdict") -> str:
        """Returns with which numbers of onlookers a contrast has a verdict."""
        rows = tables.rows("contrasts", grid="crowd", x=x, y=y).set_index("point")[column]
        return listed(n for n in _NUMBERS if rows[f"onlookers {n}"] == verdict)

    return {
        "at": at,
        "steps": lambda learner, n: steps(learner, "crowd", f"onlookers {n}"),
        "control": lambda learner, grid: steps(learner, grid, _CONTROLS[grid]),
        "unseen": lambda learner, n: tables.number(
            "cells", "unseen_budget", ".2f", grid="crowd", learner=learner, point=f"onlookers {n}"
        ),
        "cpu": tables.numbers("cpu", "cpu_time_s", "learner point", "time", grid="crowd"),
        "wrong_pings": tables.numbers("cells", "disagreements", "learner point", grid="crowd"),
    }
