"""Numbers and claims of the text on `groups`."""

from benchmark.experiments.finding import Names, Tables

TABLE, CELLS = "watkins_q_lambda, offset", "watkins_q_lambda, index"
NEAREST, TWO_NEAREST = "watkins_q_lambda, nearest", "watkins_q_lambda, two_nearest"
TILES, CELL_TILES = "tile_coding, offset_coordinates", "tile_coding, coordinates"
PPO, DQN = "ppo, offset_coordinates", "dqn, offset_coordinates"
CELL_PPO, CELL_DQN = "ppo, coordinates", "dqn, coordinates"
ENTROPY, MAP_PPO = "ppo_entropy, offset_coordinates", "ppo_map, offset_coordinates"
TALKING = ["two", "three"]
MANY = "groups 1024"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    _check_steps(tables)
    _check_dqn(tables)
    _check_cells(tables)
    _check_exact(tables)
    _check_ppo(tables)

    def steps(learner: str, grid: str, places: int = 1024) -> str:
        return tables.number("cells", "steps", grid=grid, learner=learner, point=f"groups {places}")

    def learned(learner: str, grid: str, point: str = MANY) -> str:
        return tables.number("cells", "n_solved", "", grid=grid, learner=learner, point=point)

    def unseen(learner: str, grid: str, places: int) -> str:
        where = {"grid": grid, "learner": learner, "point": f"groups {places}"}
        return tables.number("cells", "unseen_success", ".2f", **where)

    success = tables.numbers("cells", "success", "learner grid point", ".2f")

    def with_cost(learner: str, cost: str) -> str:
        point = f"cost {cost}"
        return f"{success(learner, 'wrong_ping', point)} ({learned(learner, 'wrong_ping', point)})"

    late = {"grid": "three", "point": MANY, "step": 25_700}
    return {
        "steps": steps,
        "shuffled_steps": tables.numbers("cells", "steps", "learner", grid="code", point="permuted 100"),
        "learned": learned,
        "success": success,
        "in_training": tables.numbers("success", "success", "variant observation", ".2f", **late),
        "unseen": unseen,
        "cost": tables.numbers("cpu", "cpu_time_s", "learner", "time", grid="two", point=MANY),
        "wrong_pings": tables.numbers("cells", "disagreements", "learner", grid="two", point=MANY),
        "optimal": tables.numbers("ceilings", "optimal", "grid observation", ".2f"),
        "exact_success": tables.numbers("ceilings", "success", "grid observation", ".2f"),
        "with_cost": with_cost,
        **{"table": TABLE, "cells": CELLS, "nearest": NEAREST, "two_nearest": TWO_NEAREST},
        **{"tiles": TILES, "ppo": PPO, "dqn": DQN, "entropy": ENTROPY, "map_ppo": MAP_PPO},
        **{"cell_tiles": CELL_TILES, "cell_ppo": CELL_PPO, "cell_dqn": CELL_DQN},
        "nearest_tiles": "tile_coding, nearest_coordinates",
    }


def _check_steps(tables: Tables) -> None:
    claim, cells = tables.claim, tables.rows("cells")
    runs = cells["budget"].eq(80_000).all() and cells["n"].eq(15).all()
    claim(runs, "all learners have 80,000 steps and 15 runs")
    claim(
        tables.rows("cells", grid=TALKING, learner=NEAREST)["n_solved"].eq(0).all(),
        "a table of the nearest offset learns in no run with people who talk",
    )
    claim(
        tables.rows("contrasts", x=TILES, y=TABLE)["verdict"].eq("faster").all(),
        "tile coding of offsets is faster than the table at all points",
    )
    claim(
        tables.rows("contrasts", x=[PPO, DQN], y=TILES)["verdict"].eq("slower").all(),
        "both nets are slower than tile coding at all points",
    )
    claim(
        _verdict(tables, TWO_NEAREST, TABLE, "three", MANY) == "faster",
        "with 1,024 places of three, a table of the two nearest is faster",
    )
    strangers = tables.rows("contrasts", grid="strangers", point=MANY, x=[NEAREST, DQN], y=TABLE)
    claim(
        strangers["verdict"].eq("faster").all(),
        "with 1,024 places of strangers, the nearest offset and DQN are faster than the table of all",
    )
    others = tables.rows("contrasts", grid=["one", *TALKING], x=[PPO, DQN], y=TABLE)
    claim(not others["verdict"].eq("faster").any(), "no net is faster than the table but with strangers")


def _check_dqn(tables: Tables) -> None:
    claim, rows = tables.claim, tables.rows("contrasts", x=DQN, y=TABLE)
    claim(
        rows[rows["point"] == "groups 16"]["verdict"].eq("slower").all(),
        "DQN needs more steps than the table with 16 places in all scenes",
    )
    one = _verdict(tables, DQN, TABLE, "one", "groups 110")
    two = _verdict(tables, DQN, TABLE, "two", "groups 128")
    claim(
        one == two == "slower",
        "DQN needs more steps than the table with 110 places of one person and 128 of two who talk",
    )
    claim(
        rows[rows["grid"].isin(TALKING)]["verdict"].eq("undecided").sum() == 3,
        "DQN against the table is undecided at three points with people who talk",
    )
    wrong_pings = tables.rows("contrasts", grid=["three", "strangers"], point=MANY, x=DQN, y=TABLE)
    claim(
        [*wrong_pings["wrong_pings_verdict"]] == ["faster", "faster"],
        "DQN makes fewer wrong PINGs than the table with 1,024 places of strangers and of three",
    )
    steps = [11_700, 17_300, 25_700, 37_900]
    late = tables.rows("success", grid="three", point=MANY, step=steps)
    dqn, table = (late[late["learner"] == name]["success"].to_numpy() for name in (DQN, TABLE))
    claim(
        len(dqn) == len(table) == len(steps) and (dqn > table).all(),
        "with 1,024 places of three, DQN is ahead of the table from 11,700 to 37,900 steps",
    )
    levels = tables.row("levels", x=DQN, y=TILES)
    claim(
        levels["points"] == levels["at_all_levels"],
        "DQN needs more steps than tile coding at all points and levels",
    )


def _check_cells(tables: Tables) -> None:
    claim = tables.claim
    unseen = tables.rows("unseen", grid="cells")
    pairs = unseen.pivot(index="run", columns="learner", values="unseen_success")
    for net in (CELL_PPO, CELL_DQN):
        claim(
            pairs[net].gt(pairs[CELL_TILES]).sum() == 15,
            f"{net} succeeds more often than tile coding on coordinates in unseen places in all 15 pairs",
        )
    nets = tables.rows("contrasts", grid="cells", x=[CELL_PPO, CELL_DQN], y=CELL_TILES)
    claim(nets["verdict"].eq("slower").all(), "given only cells, both nets need more steps than tile coding")
    claim(
        _verdict(tables, CELL_TILES, TABLE, "two", MANY) == "undecided",
        "with 1,024 places of two, tile coding on coordinates against a table of offsets is undecided",
    )
    claim(
        tables.row("contrasts", grid="cells", x=CELL_TILES, y=TABLE)["verdict"] == "faster",
        "with 128 places of two, tile coding on coordinates is faster than a table of offsets",
    )
    claim(
        tables.rows("cells", grid="code", learner=CELLS)["success"].nunique() == 1,
        "the table is not affected by permuted coordinates",
    )


def _check_exact(tables: Tables) -> None:
    nearest = tables.row("ceilings", grid="strangers", observation="nearest")
    tables.claim(nearest["success"] > 0.999, "with strangers, the nearest offset is enough for success")
    states = tables.rows("ceilings", observation="index").set_index("grid")["states"]
    tables.claim(
        [*states.drop("one")] == [600 * 5830, 600 * 1083, 600 * 1969],
        "strangers have 5,830 places, two who talk 1,083 and three 1,969",
    )


def _check_ppo(tables: Tables) -> None:
    variants = ["ppo", "ppo_entropy", "ppo_map"]
    tables.claim(
        tables.rows("cells", grid="wrong_ping", variant=variants)["n_solved"].max() < 8,
        "PPO learns in fewer than half of the runs, whatever its entropy, costs and settings",
    )


def _verdict(tables: Tables, x: str, y: str, grid: str, point: str) -> object:
    return tables.row("contrasts", grid=grid, point=point, x=x, y=y)["verdict"]
