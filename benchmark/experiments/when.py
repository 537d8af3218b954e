"""Numbers and claims of the text on `when`."""

from benchmark.experiments.finding import Names, Tables

TABLE, TILES = "watkins_q_lambda, index", "tile_coding, coordinates"
PPO, DQN = "ppo, coordinates", "dqn, coordinates"
OFFSET_TABLE, OFFSET_TILES = "watkins_q_lambda, offset", "tile_coding, offset_coordinates"
OFFSET_PPO, OFFSET_DQN = "ppo, offset_coordinates", "dqn, offset_coordinates"
NETS, TILINGS = [PPO, DQN, OFFSET_PPO, OFFSET_DQN], [TILES, OFFSET_TILES]
SECOND_TILES = "tile_coding_second, coordinates"
LARGEST_ROOM, NOISIEST = "room 20x24, places 32", "noise 4, places 64"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    _check_places(tables)
    _check_all_points(tables)
    _check_settings(tables)
    _check_unseen(tables)
    _check_noise(tables)

    def places(x: str, y: str, verdict: str) -> str:
        return tables.names("contrasts", "places", grid="places", x=x, y=y, verdict=verdict)

    def twice(learner: str, places: int) -> str:
        row = tables.row("cells", grid="places", learner=learner, places=places)
        return f"{min(2 * row['steps'], 80_000):,.0f}"

    def learned(learner: str, grid: str, point: str) -> str:
        where = {"grid": grid, "learner": learner, "point": point}
        return f"{tables.number('cells', 'n_solved', '', **where)} of {tables.row('cells', **where)['n']}"

    contrasts = tables.rows("contrasts", x=NETS, y=TILINGS)
    crossed = [tables.row("crossings", x=net, y=TILES)["x_later"] for net in (PPO, DQN)]
    undecided = tables.rows("contrasts", x=NETS, y=TILINGS, verdict="undecided", grid="noise")
    return {
        "places": places,
        "steps": tables.numbers("cells", "steps", "learner places", grid="places"),
        "shuffled_steps": tables.numbers("cells", "steps", "learner", grid="code", point="permuted 100"),
        "twice": twice,
        "wrong_pings": tables.numbers("cells", "disagreements", "learner", grid="places", places=64),
        "learned": learned,
        "unseen": tables.numbers("cells", "unseen_success", "learner places", ".2f", grid="places"),
        "cpu": tables.numbers("cpu", "cpu_time_s", "learner", "time", grid="places", places=64),
        "earliest": tables.numbers("crossings", "earliest", "x y"),
        "latest": tables.numbers("crossings", "latest", "x y"),
        "n_later": tables.numbers("crossings", "x_later", "x y"),
        "n_places": len(tables.rows("contrasts", grid="places", x=TILES, y=TABLE)),
        "n_points": len(contrasts) // 4,
        "n_contrasts": len(contrasts),
        "n_slower": tables.count("contrasts", x=NETS, y=TILINGS, verdict="slower"),
        "n_undecided_with_noise": len(undecided),
        "n_crossed": sum(crossed),
        **{"table": TABLE, "tiles": TILES, "ppo": PPO, "dqn": DQN, "second_tiles": SECOND_TILES},
        **{"offset_table": OFFSET_TABLE, "offset_tiles": OFFSET_TILES},
        **{"offset_ppo": OFFSET_PPO, "offset_dqn": OFFSET_DQN},
        **{"largest_room": LARGEST_ROOM, "noisiest": NOISIEST},
    }


def _check_places(tables: Tables) -> None:
    claim = tables.claim
    ppo = tables.rows("contrasts", grid="places", x=PPO, y=TABLE).set_index("places")["verdict"]
    claim(
        ppo[ppo.eq("faster")].index.min() > ppo[ppo.ne("faster")].index.max(),
        "PPO is faster than the table from some number of places on",
    )
    at_64 = tables.rows("contrasts", grid="places", places=64).set_index(["x", "y"])
    wrong_pings, steps = at_64["wrong_pings_verdict"].to_dict(), at_64["verdict"].to_dict()
    claim(
        wrong_pings[PPO, TABLE] == wrong_pings[DQN, TABLE] == "faster"
        and wrong_pings[PPO, TILES] == wrong_pings[DQN, TILES] == "slower",
        "with 64 places, both nets make fewer wrong PINGs than the table and more than tile coding",
    )
    claim(steps[DQN, TABLE] == "undecided", "with 64 places, DQN against the table is undecided in steps")
    tiles = tables.rows("contrasts", grid="places", x=TILES, y=TABLE)
    claim(
        tiles[tiles["places"].ge(4)]["verdict"].eq("faster").all(),
        "tile coding needs fewer steps than the table with 4 or more places",
    )
    claim(tables.rows("cells")["budget"].eq(80_000).all(), "all learners have 80,000 steps")
    for x, y in [(PPO, TILES), (DQN, TILES), (OFFSET_PPO, OFFSET_TILES), (OFFSET_DQN, OFFSET_TILES)]:
        verdicts = tables.rows("contrasts", grid="places", x=x, y=y)["verdict"]
        claim(verdicts.eq("slower").all(), f"{x} needs more steps than {y} with every number of places")
    medians = tables.rows("cells", grid="places", places=64).set_index("learner")["steps"].to_dict()
    claim(
        max(medians[OFFSET_TABLE], medians[OFFSET_TILES]) < medians[TILES],
        "with 64 places, knowing the offset helps the table and tile coding more than sharing helps the "
        "table",
    )
    claim(
        medians[OFFSET_DQN] < medians[DQN] and medians[OFFSET_PPO] > medians[PPO],
        "with 64 places, the offset helps DQN, but not PPO",
    )


def _check_all_points(tables: Tables) -> None:
    claim, contrasts = tables.claim, tables.rows("contrasts", x=NETS, y=TILINGS)
    verdicts, undecided = contrasts["verdict"], contrasts[contrasts["verdict"] == "undecided"]
    claim(not verdicts.eq("faster").any(), "no net needs fewer steps than tile coding at any point")
    claim(
        verdicts.isin(["slower", "undecided"]).all(),
        "all contrasts of nets with tile coding are slower or undecided",
    )
    claim(
        undecided["grid"].ne("noise").sum() == 1,
        "all undecided contrasts of nets with tile coding but one are about noise",
    )
    levels = tables.rows("levels")
    claim(levels["reversed"].sum() == 0, "no verdict is reversed at other levels")
    claim(levels["at_all_levels"].sum() < levels["decided"].sum(), "some verdicts do not hold at all levels")


def _check_settings(tables: Tables) -> None:
    claim = tables.claim
    for net in (PPO, DQN):
        crossed = tables.row("crossings", x=net, y=TILES)
        claim(
            crossed["combinations"] == 9 == crossed["y_always"] + crossed["x_later"],
            f"in each of 9 combinations, {net} needs more steps than tile coding with all numbers of "
            "places, or fewer with many",
        )
    third = tables.rows("cells", grid="places", learner="ppo_third, coordinates")
    third = third[third["places"].le(48)]
    claim(
        third["n_solved"].max() == 3 and third["n"].eq(6).all(),
        "with its third best settings, PPO learns in at most 3 of 6 runs with up to 48 places",
    )
    second = tables.row("cells", grid="places", learner=SECOND_TILES, places=111)
    claim(
        second["n_solved"] * 2 == second["n"],
        "with its second-best settings, tile coding learns 111 places in half of the runs",
    )


def _check_unseen(tables: Tables) -> None:
    claim = tables.claim
    with_offsets = tables.rows(
        "cells", grid="places", places=64, learner=[OFFSET_TILES, OFFSET_PPO, OFFSET_DQN]
    )
    claim(
        with_offsets["unseen_success"].min() > 0.99,
        "given offsets, tile coding and nets succeed in 0.99 of episodes in unseen places",
    )
    after_4 = tables.rows("cells", grid="places", places=4).set_index("learner")
    success = after_4["unseen_success"].to_dict()
    claim(
        success[PPO] > success[TILES] > success[DQN],
        "after 4 places, DQN is not better than tile coding in unseen ones, and PPO is",
    )
    claim(
        _n_ahead(tables, PPO, 4) == 14,
        "after 4 places, PPO succeeds more often than tile coding in unseen ones in 14 pairs",
    )
    for places in (16, 64):
        for net in (PPO, DQN):
            claim(
                _n_ahead(tables, net, places) == 15,
                f"{net} succeeds more often than tile coding in unseen places in all 15 pairs after "
                f"places {places}",
            )
    shuffled = tables.rows("cells", grid="code", point="permuted 100").set_index("learner")
    solved = shuffled["solved"].to_dict()
    claim(solved[PPO] == solved[DQN] == 0, "no run of a net learns with permuted coordinates")
    claim(
        tables.rows("cells", grid="code", learner=TABLE)["steps"].nunique() == 1,
        "permuted coordinates do not affect the table",
    )


def _n_ahead(tables: Tables, net: str, places: int) -> int:
    """Returns in how many of the first 15 pairs of runs a net beats tile coding in unseen places."""
    rows = tables.rows("unseen", grid="unseen", point=f"places {places}")
    pairs = rows.pivot(index="run", columns="learner", values="unseen_success").head(15)
    return int(pairs[net].gt(pairs[TILES]).sum())


def _check_noise(tables: Tables) -> None:
    observations = ["coordinates", "index"]
    noisy = tables.rows("cells", grid="noise", point=NOISIEST, observation=observations)
    tables.claim(
        noisy["solved"].max() < 0.5, "with noise of 4 and 64 places, no learner of cells learns in most runs"
    )
