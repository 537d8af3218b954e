"""Numbers and claims of the text on `when`."""

from benchmark.experiments.finding import Names, Tables, steps_of

TABLE, REPLAY_TABLE = "watkins_q_lambda, index", "replay_table, index"
TILES, REPLAY_TILES = "tile_coding, coordinates", "replay_tiles, coordinates"
DQN, PPO, FACTORED_PPO = "dqn, coordinates", "ppo, centred", "ppo, factored"
OFFSET_TABLE, REPLAY_OFFSET_TABLE = "watkins_q_lambda, offset", "replay_table, offset"
OFFSET_TILES, REPLAY_OFFSET_TILES = "tile_coding, offset_coordinates", "replay_tiles, offset_coordinates"
OFFSET_DQN, OFFSET_PPO = "dqn, offset_tiles", "ppo, offset_factored"
PLAIN_OFFSET_DQN, PLAIN_OFFSET_PPO = "dqn, offset_coordinates", "ppo, offset_coordinates"
FACTORED_OFFSET_DQN = "dqn, offset_factored"
LINEAR_DQN, LINEAR_Q = "dqn_linear, offset_factored", "linear_q_lambda, offset_factored"
TILED_LINEAR_DQN, TILED_LINEAR_Q = "dqn_linear, offset_tiles", "linear_q_lambda, offset_tiles"
EARLIER_TILES, EARLIER_PPO = "tile_coding_earlier, coordinates", "ppo_earlier, coordinates"
EARLIER_DQN = "dqn_earlier, coordinates"
_CELLS = {"nets": [DQN, PPO, FACTORED_PPO], "tables": [TABLE, REPLAY_TABLE, TILES, REPLAY_TILES]}
_OFFSETS = {
    "nets": [OFFSET_DQN, OFFSET_PPO],
    "tables": [OFFSET_TABLE, REPLAY_OFFSET_TABLE, OFFSET_TILES, REPLAY_OFFSET_TILES],
}
_GRIDS = ["places", "rooms", "feedback"]  # each point of the map once
_AT = {"grid": "forms", "point": "places 64"}


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, contrasts, steps = tables.claim, tables.rows("contrasts", **_AT), steps_of(tables)
    cells = tables.rows("cells", grid=[*_GRIDS, "forms"])
    claim(cells["n"].eq(16).all() and cells["budget"].eq(60_000).all(), "all have 16 runs of 60,000 steps")
    verdicts = contrasts.set_index(["x", "y"])["verdict"].to_dict()
    for verdict, pairs in _expected().items():
        for x, y in pairs:
            claim(verdicts[x, y] == verdict, f"with 64 places, {x} against {y} is {verdict}")

    failures = contrasts.set_index(["x", "y"])["failures_verdict"].to_dict()
    fewer = all(failures[DQN, y] == "faster" for y in _CELLS["tables"])
    claim(fewer, "given cells, DQN fails less often in new places than tables and tile coding")
    claim(failures[OFFSET_PPO, OFFSET_TILES] == "slower", "given offsets, PPO fails more often there")
    claim(failures[OFFSET_DQN, OFFSET_TILES] == "undecided", "given offsets, DQN's failures are undecided")
    of_nets = tables.rows("contrasts", grid=_GRIDS, x=[*_CELLS["nets"], *_OFFSETS["nets"]])
    faster = of_nets[of_nets["verdict"] == "faster"]
    claim({*faster["y"]} <= {TABLE}, "nets learn faster than tables without replay only")
    at_random = tables.values("cells", "unseen_budget", **_AT, learner=[TABLE, REPLAY_TABLE])
    claim(len(at_random) == 1, "given cells, all tables act in new places as if untrained: at random")
    factored = tables.rows("cells", **_AT, learner=["dqn, factored", FACTORED_PPO])
    claim(not factored["n_solved"].any(), "no net learns 64 places from one-hot rows and columns of cells")

    def versus(offset: bool, i: int, verdict: str) -> str:
        """Returns how many contrasts of nets with the i-th alternative without a net have this verdict."""
        known = _OFFSETS if offset else _CELLS
        return tables.count("contrasts", grid=_GRIDS, x=known["nets"], y=known["tables"][i], verdict=verdict)

    def forms(y: str, verdict: str) -> str:
        """Returns how many contrasts of other forms of input with plain coordinates have this verdict."""
        return tables.count("contrasts", grid="forms", y=y, x=_forms_of(tables, y), verdict=verdict)

    return {
        "steps": lambda learner, grid="forms", point="places 64": steps(learner, grid, point),
        "versus": versus,
        "forms": forms,
        "pair": lambda x, y: tables.count("contrasts", grid=_GRIDS, x=x, y=y, verdict="faster"),
        "unseen": tables.numbers("cells", "unseen_budget", "learner", ".2f", **_AT),
        "unseen_after_4": tables.numbers(
            "cells", "unseen_budget", "learner", ".2f", grid="unseen", point="places 4"
        ),
        "wrong_pings": tables.numbers("cells", "disagreements", "learner", **_AT),
        "cpu": tables.numbers("cpu", "cpu_time_s", "learner", "time", **_AT),
        "shuffled": lambda learner: steps(learner, "code", "permuted 100"),
        "n_points": tables.count("contrasts", grid=_GRIDS, x=DQN, y=TABLE),
        "beside_sb3": lambda learner: steps(learner, "reference", "room 10x12, places 16"),
    }


def _forms_of(tables: Tables, y: str) -> list[object]:
    return [*tables.values("contrasts", "x", grid="forms", y=y)]


def _expected() -> dict[str, list[tuple[str, str]]]:
    """Returns what the text says of single contrasts with 64 places."""
    return {
        "faster": [
            (OFFSET_DQN, PLAIN_OFFSET_DQN), (REPLAY_TABLE, TABLE), (OFFSET_DQN, TILED_LINEAR_DQN),
            (TILES, TABLE), (OFFSET_TILES, OFFSET_TABLE),
        ],
        "slower": [
            (TILED_LINEAR_DQN, TILED_LINEAR_Q), (OFFSET_PPO, OFFSET_TILES), (EARLIER_DQN, EARLIER_TILES),
            ("dqn_linear, tiles", "linear_q_lambda, tiles"),
        ],
        "undecided": [
            (OFFSET_PPO, PLAIN_OFFSET_PPO), (OFFSET_DQN, OFFSET_TABLE), (OFFSET_PPO, OFFSET_TABLE),
            (OFFSET_DQN, OFFSET_TILES), (FACTORED_OFFSET_DQN, LINEAR_DQN), (LINEAR_DQN, LINEAR_Q),
        ],
    }  # fmt: skip
