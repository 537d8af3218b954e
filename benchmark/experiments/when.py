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

    def places(x: str, y: str, verdict: str) -> str:
        return tables.names("contrasts", "places", grid="places", x=x, y=y, verdict=verdict)

    def twice(learner: str, places: int) -> str:
        row = tables.row("cells", grid="places", learner=learner, places=places)
        return f"{min(2 * row['steps'], 80_000):,.0f}"

    def learned(learner: str, grid: str, point: str) -> str:
        where = {"grid": grid, "learner": learner, "point": point}
        return f"{tables.number('cells', 'n_solved', '', **where)} of {tables.row('cells', **where)['n']}"

    contrasts = tables.rows("contrasts", x=NETS, y=TILINGS)
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
        "n_crossed": tables.rows("crossings", x=[PPO, DQN], y=TILES)["x_later"].sum(),
    }


def _check_places(tables: Tables) -> None:
    claim = tables.claim
    ppo = tables.rows("contrasts", grid="places", x=PPO, y=TABLE).set_index("places")["verdict"]
    is_later = ppo[ppo.eq("faster")].index.min() > ppo[ppo.ne("faster")].index.max()
    claim(is_later, "PPO is faster than the table from some number of places on")
    at_64 = tables.rows("contrasts", grid="places", places=64).set_index(["x", "y"])
    wrong_pings, steps = at_64["wrong_pings_verdict"].to_dict(), at_64["verdict"].to_dict()
    for net in (PPO, DQN):
        has_fewer = wrong_pings[net, TABLE] == "faster" and wrong_pings[net, TILES] == "slower"
        claim(has_fewer, f"{net} makes fewer wrong PINGs than the table, not than tile coding")
    claim(steps[DQN, TABLE] == "undecided", "with 64 places, DQN against the table is undecided in steps")
    tiles = tables.rows("contrasts", grid="places", x=TILES, y=TABLE)
    is_faster = tiles[tiles["places"].ge(4)]["verdict"].eq("faster").all()
    claim(is_faster, "tile coding needs fewer steps than the table with 4 or more places")
    claim(tables.values("cells", "budget") == {80_000}, "all learners have 80,000 steps")
    for x, y in zip(NETS, [TILES, TILES, OFFSET_TILES, OFFSET_TILES], strict=True):
        verdicts = tables.values("contrasts", "verdict", grid="places", x=x, y=y)
        claim(verdicts == {"slower"}, f"{x} needs more steps than {y} with every number of places")
    medians = tables.rows("cells", grid="places", places=64).set_index("learner")["steps"].to_dict()
    is_less = max(medians[OFFSET_TABLE], medians[OFFSET_TILES]) < medians[TILES]
    claim(is_less, "with 64 places, the offset helps a table more than sharing")
    helps = [medians[OFFSET_DQN] < medians[DQN], medians[OFFSET_PPO] < medians[PPO]]
    claim(helps == [True, False], "with 64 places, the offset helps DQN, but not PPO")


def _check_all_points(tables: Tables) -> None:
    claim, contrasts = tables.claim, tables.rows("contrasts", x=NETS, y=TILINGS)
    undecided = contrasts[contrasts["verdict"] == "undecided"]
    verdicts = {*contrasts["verdict"]}
    claim(verdicts == {"slower", "undecided"}, "nets are slower than tile coding, or undecided")
    n_others = undecided["grid"].ne("noise").sum()
    claim(n_others == 1, "all undecided contrasts of nets but one are about noise")
    levels = tables.rows("levels")
    claim(levels["reversed"].sum() == 0, "no verdict is reversed at other levels")
    claim(levels["at_all_levels"].sum() < levels["decided"].sum(), "some verdicts do not hold at all levels")


def _check_settings(tables: Tables) -> None:
    claim = tables.claim
    for net in (PPO, DQN):
        crossed = tables.row("crossings", x=net, y=TILES)
        is_known = crossed["combinations"] == 9 == crossed["y_always"] + crossed["x_later"]
        claim(is_known, f"of 9 combinations, {net} is slower in all until many places")
    third = tables.rows("cells", grid="places", learner="ppo_third, coordinates")
    third = third[third["places"].le(48)]
    is_rare = third["n_solved"].max() == 3 and third["n"].eq(6).all()
    claim(is_rare, "with its third-best settings, PPO learns in at most 3 of 6 runs")
    second = tables.row("cells", grid="places", learner=SECOND_TILES, places=111)
    is_half = second["n_solved"] * 2 == second["n"]
    claim(is_half, "second-best tile coding learns 111 places in half of the runs")


def _check_unseen(tables: Tables) -> None:
    claim, offsets = tables.claim, [OFFSET_TILES, OFFSET_PPO, OFFSET_DQN]
    with_offsets = tables.rows("cells", grid="places", places=64, learner=offsets)["unseen_success"].min()
    claim(with_offsets > 0.99, "given offsets, 0.99 of unseen episodes succeed")
    after_4 = tables.rows("cells", grid="places", places=4).set_index("learner")
    success = after_4["unseen_success"].to_dict()
    is_between = success[PPO] > success[TILES] > success[DQN]
    claim(is_between, "after 4 places, PPO beats tile coding in unseen ones, not DQN")
    for net, places, n_pairs in [(PPO, 4, 14), (PPO, 16, 15), (DQN, 16, 15), (PPO, 64, 15), (DQN, 64, 15)]:
        rows = tables.rows("unseen", grid="unseen", point=f"places {places}")
        pairs = rows.pivot(index="run", columns="learner", values="unseen_success").head(15)
        n_ahead = pairs[net].gt(pairs[TILES]).sum()
        claim(n_ahead == n_pairs, f"{net} beats tile coding in {n_pairs} pairs after {places} places")
    shuffled = tables.values("cells", "solved", grid="code", point="permuted 100", learner=[PPO, DQN])
    claim(shuffled == {0}, "no run of a net learns with permuted coordinates")
    steps = tables.values("cells", "steps", grid="code", learner=TABLE)
    claim(len(steps) == 1, "permuted coordinates do not affect the table")
    noisy = tables.rows("cells", grid="noise", point=NOISIEST, observation=["coordinates", "index"])
    claim(noisy["solved"].max() < 0.5, "with most noise, no learner of cells mostly learns")
