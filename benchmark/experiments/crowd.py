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
# Verdicts with each number of onlookers, by their first letters: faster, slower, undecided, neither learns
_EXPECTED = {
    (PPO, TILES, "verdict"): "s f f f u n",
    (PPO, PAIRS, "verdict"): "s s u u u n",
    (PPO, AGENT_PAIRS, "verdict"): "s s s s s s",
    (PPO, TILES, "failures_verdict"): "f f f u u u",
    (PPO, PAIRS, "failures_verdict"): "f f f u u u",
    (PPO, AGENT_PAIRS, "failures_verdict"): "f f f u u u",
    (PPO, TILES, "wrong_pings_verdict"): "s u f f u n",
    (PPO, PAIRS, "wrong_pings_verdict"): "s s s u u n",
    (PPO, AGENT_PAIRS, "wrong_pings_verdict"): "s s s s s s",
    (DQN, TILES, "failures_verdict"): "f f f u u s",
    (DQN, PAIRS, "failures_verdict"): "f u u u s s",
    (DQN, AGENT_PAIRS, "failures_verdict"): "f f u u s s",
}


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, steps = tables.claim, steps_of(tables)
    cells = tables.rows("cells", grid="crowd")
    claim(cells["budget"].eq(100_000).all(), "all runs have 100,000 steps")
    claim(cells[cells["learner"].isin(_COMPARED)]["n"].eq(16).all(), "compared learners have 16 runs")

    def found(x: str, y: str, column: str) -> dict[int, object]:
        """Returns what a column of a contrast has with each number of onlookers."""
        values = tables.rows("contrasts", grid="crowd", x=x, y=y).set_index("point")[column].to_dict()
        return {n: values[f"onlookers {n}"] for n in _NUMBERS}

    for (x, y, column), expected in _EXPECTED.items():
        verdicts = " ".join(str(verdict)[0] for verdict in found(x, y, column).values())
        claim(verdicts == expected, f"{column} of {x} against {y} is {expected}")
    for y, n_faster in ((TILES, {1: 4, 2: 4, 4: 4}), (PAIRS, {2: 1, 4: 3, 8: 4})):
        for n, n_picks in n_faster.items():
            n_found = found(PPO, y, "picks_faster")[n]
            claim(n_found == n_picks, f"PPO is faster than {y} with {n_picks} picks")
    claim("faster" not in tables.values("contrasts", "verdict", x=DQN), "DQN is never faster")
    n_learned = cells.set_index(["learner", "point"])["n_solved"]
    claim(n_learned[PPO]["onlookers 16"] == 0, "no run of PPO learns among 16")
    claim(n_learned[AGENT_PAIRS].eq(16).all(), "all runs of tile coding of agent with each person learn")
    claim(not n_learned[DQN][[f"onlookers {n}" for n in (4, 8, 16)]].any(), "no run of DQN learns among four")
    claim(n_learned[TABLE].drop("onlookers 0").sum() == 0, "no table learns among onlookers")
    claim(tables.rows("levels")["reversed"].sum() == 0, "no verdict is reversed at other levels")
    for picked, earlier in ((PICKED_TILES, TILES), (PICKED_PAIRS, PAIRS), (PICKED_AGENT_PAIRS, AGENT_PAIRS)):
        medians = cells.set_index(["learner", "point"])["steps"]
        has_learned = medians[earlier] < float("inf")
        more = (medians[picked] > medians[earlier])[has_learned].all()
        claim(more, f"where {earlier} learns, picks need more steps")
    four = tables.rows("cells", learner=[TOLD, CONTROL_TILES, CONTROL_PPO, PICKED_AGENT_PAIRS])["n"]
    claim(four.eq(4).all(), "others have four runs")

    def at(x: str, y: str, verdict: str, column: str = "verdict") -> str:
        """Returns with which numbers of onlookers a contrast has a verdict."""
        return listed(n for n, value in found(x, y, column).items() if value == verdict)

    return {
        "at": at,
        "learned": lambda learner, n: tables.number(
            "cells", "n_solved", "", grid="crowd", learner=learner, point=f"onlookers {n}"
        ),
        "n_levels": str(tables.rows("levels")["decided"].sum()),
        "steps": lambda learner, n: steps(learner, "crowd", f"onlookers {n}"),
        "control": lambda learner, grid: steps(learner, grid, _CONTROLS[grid]),
        "unseen": lambda learner, n: tables.number(
            "cells", "unseen_budget", ".2f", grid="crowd", learner=learner, point=f"onlookers {n}"
        ),
        "cpu": tables.numbers("cpu", "cpu_time_s", "learner point", "time", grid="crowd"),
        "wrong_pings": tables.numbers("cells", "disagreements", "learner point", grid="crowd"),
    }
