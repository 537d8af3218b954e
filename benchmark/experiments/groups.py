"""Numbers and claims of the text on `groups`."""

from benchmark.experiments.finding import Names, Tables

TABLE, CELLS = "watkins_q_lambda, offset", "watkins_q_lambda, index"
NEAREST, TWO_NEAREST = "watkins_q_lambda, nearest", "watkins_q_lambda, two_nearest"
TILES, CELL_TILES = "tile_coding, offset_coordinates", "tile_coding, coordinates"
NEAREST_TILES = "tile_coding, nearest_coordinates"
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

    def steps(learner: str, grid: str, places: int = 1024) -> str:
        return tables.number("cells", "steps", grid=grid, learner=learner, point=f"groups {places}")

    def learned(learner: str, grid: str, point: str = MANY) -> str:
        return tables.number("cells", "n_solved", "", grid=grid, learner=learner, point=point)

    unseen_at = tables.numbers("cells", "unseen_success", "learner grid point", ".2f")
    success = tables.numbers("cells", "success", "learner grid point", ".2f")

    def with_cost(learner: str, cost: str) -> str:
        where = learner, "wrong_ping", f"cost {cost}"
        return f"{success(*where)} ({learned(*where)})"

    late = {"grid": "three", "point": MANY, "step": 25_700}
    return {
        "steps": steps,
        "shuffled_steps": tables.numbers("cells", "steps", "learner", grid="code", point="permuted 100"),
        "learned": learned,
        "success": success,
        "in_training": tables.numbers("success", "success", "variant observation", ".2f", **late),
        "unseen": lambda learner, grid, places: unseen_at(learner, grid, f"groups {places}"),
        "cost": tables.numbers("cpu", "cpu_time_s", "learner", "time", grid="two", point=MANY),
        "wrong_pings": tables.numbers("cells", "disagreements", "learner", grid="two", point=MANY),
        "optimal": tables.numbers("ceilings", "optimal", "grid observation", ".2f"),
        "exact_success": tables.numbers("ceilings", "success", "grid observation", ".2f"),
        "with_cost": with_cost,
    }


def _check_steps(tables: Tables) -> None:
    claim, cells = tables.claim, tables.rows("cells")
    runs = cells["budget"].eq(80_000).all() and cells["n"].eq(15).all()
    claim(runs, "all learners have 80,000 steps and 15 runs")
    nearest = tables.values("cells", "n_solved", grid=TALKING, learner=NEAREST)
    claim(nearest == {0}, "a table of the nearest offset learns in no run with people who talk")
    tiles = tables.values("contrasts", "verdict", x=TILES, y=TABLE)
    claim(tiles == {"faster"}, "tile coding of offsets is faster than the table at all points")
    nets = tables.values("contrasts", "verdict", x=[PPO, DQN], y=TILES)
    claim(nets == {"slower"}, "both nets are slower than tile coding at all points")
    three = tables.values("contrasts", "verdict", grid="three", point=MANY, x=TWO_NEAREST, y=TABLE)
    claim(three == {"faster"}, "with 1,024 places of three, a table of the two nearest is faster")
    far = tables.values("contrasts", "verdict", grid="strangers", point=MANY, x=[NEAREST, DQN], y=TABLE)
    claim(far == {"faster"}, "with 1,024 places of strangers, both are faster")
    others = tables.values("contrasts", "verdict", grid=["one", *TALKING], x=[PPO, DQN], y=TABLE)
    claim("faster" not in others, "no net is faster than the table but with strangers")
    few = tables.rows("cells", grid="wrong_ping", variant=["ppo", "ppo_entropy", "ppo_map"])["n_solved"].max()
    claim(few < 8, "PPO learns in fewer than half of the runs, whatever is changed")


def _check_dqn(tables: Tables) -> None:
    claim, rows = tables.claim, tables.rows("contrasts", x=DQN, y=TABLE)
    verdicts = rows.set_index(["grid", "point"])["verdict"]
    at_16 = verdicts.xs("groups 16", level="point")
    claim(at_16.eq("slower").all(), "DQN is slower than the table with 16 places everywhere")
    is_slower = verdicts["one", "groups 110"] == verdicts["two", "groups 128"] == "slower"
    claim(is_slower, "DQN is slower than the table with 110 places of one, 128 of two")
    n_undecided = verdicts[TALKING].eq("undecided").sum()
    claim(n_undecided == 3, "DQN against the table is undecided at three points")
    wrong_pings = tables.rows("contrasts", grid=["three", "strangers"], point=MANY, x=DQN, y=TABLE)
    has_fewer = [*wrong_pings["wrong_pings_verdict"]] == ["faster", "faster"]
    claim(has_fewer, "DQN makes fewer wrong PINGs than the table with 1,024 places")
    steps = [11_700, 17_300, 25_700, 37_900]
    late = tables.rows("success", grid="three", point=MANY, step=steps)
    dqn, table = (late[late["learner"] == name]["success"].to_numpy() for name in (DQN, TABLE))
    is_ahead = len(dqn) == len(table) == len(steps) and (dqn > table).all()
    claim(is_ahead, "with 1,024 places of three, DQN is ahead from 11,700 to 37,900 steps")
    levels = tables.row("levels", x=DQN, y=TILES)
    is_slower = levels["points"] == levels["at_all_levels"]
    claim(is_slower, "DQN needs more steps than tile coding at all points and levels")


def _check_cells(tables: Tables) -> None:
    claim = tables.claim
    unseen = tables.rows("unseen", grid="cells")
    pairs = unseen.pivot(index="run", columns="learner", values="unseen_success")
    for net in (CELL_PPO, CELL_DQN):
        n_ahead = pairs[net].gt(pairs[CELL_TILES]).sum()
        claim(n_ahead == 15, f"{net} beats tile coding in unseen places in all 15 pairs")
    nets = tables.values("contrasts", "verdict", grid="cells", x=[CELL_PPO, CELL_DQN], y=CELL_TILES)
    claim(nets == {"slower"}, "given only cells, both nets need more steps than tile coding")
    two = tables.values("contrasts", "verdict", grid="two", point=MANY, x=CELL_TILES, y=TABLE)
    claim(two == {"undecided"}, "with 1,024 places, tile coding of cells is undecided")
    cells = tables.values("contrasts", "verdict", grid="cells", x=CELL_TILES, y=TABLE)
    claim(cells == {"faster"}, "with 128 places, tile coding of cells is faster")
    shuffled = tables.values("cells", "success", grid="code", learner=CELLS)
    claim(len(shuffled) == 1, "the table is not affected by permuted coordinates")


def _check_exact(tables: Tables) -> None:
    nearest = tables.row("ceilings", grid="strangers", observation="nearest")
    tables.claim(nearest["success"] > 0.999, "with strangers, the nearest offset is enough for success")
    states = tables.rows("ceilings", observation="index").set_index("grid")["states"].drop("one")
    n_places = [n / 600 for n in states]
    is_said = n_places == [5830, 1083, 1969]
    tables.claim(is_said, "strangers have 5,830 places, two who talk 1,083 and three 1,969")
