"""Numbers and claims of the text on `crowd`."""

from benchmark.experiments.finding import Names, Tables, steps_of

TABLE, TOLD = "watkins_q_lambda, index", "tile_told, offset_coordinates"
TILES, EARLIER_TILES = "tile_coding, coordinates", "tile_coding_earlier, coordinates"
PAIRS, EARLIER_PAIRS = "tile_pairs, coordinates", "tile_pairs_earlier, coordinates"
AGENT_PAIRS, EARLIER_AGENT_PAIRS = "tile_agent_pairs, coordinates", "tile_agent_pairs_earlier, coordinates"
DQN, PPO = "dqn, coordinates", "ppo, coordinates"
PEOPLE_PPO, IMAGE_PPO = "people_ppo, coordinates", "image_ppo, planes"
_POINTS = {n: f"onlookers {n}" for n in (0, 1, 2, 4, 8, 16)}
_JOINT, _ALL_PAIRS, _TOLD_PAIRS = (TILES, EARLIER_TILES), (PAIRS, EARLIER_PAIRS), (AGENT_PAIRS, EARLIER_AGENT_PAIRS)


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, steps = tables.claim, steps_of(tables)
    cells = tables.rows("cells", grid="crowd")
    main = cells[~cells["learner"].isin([PEOPLE_PPO, IMAGE_PPO])]
    claim(main["n"].eq(16).all() and cells["budget"].eq(100_000).all(), "all have 16 runs of 100,000 steps")
    contrasts = tables.rows("contrasts", grid="crowd").set_index(["x", "y", "point"])

    def points_with(verdict: str, x: str, y: str, unit: str = "verdict") -> list[int]:
        return [n for n, point in _POINTS.items() if contrasts.loc[(x, y, point), unit] == verdict]

    for key in ("verdict", "failures_verdict"):
        for (x, y), _ in contrasts.groupby(level=[0, 1], sort=False):
            print(key, x, y, {v: points_with(v, x, y, key) for v in set(contrasts[key])})
    return {
        "steps": lambda learner, n: steps(learner, "crowd", _POINTS[n]),
    }
