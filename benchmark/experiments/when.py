"""What `when` has shown: what one must know for tile coding to do."""

from collections.abc import Mapping
from typing import Any

from benchmark.map import needed

APART, ALIKE, RELATIVE, TOLD = (
    "agent with each person",
    "people are alike",
    "relative positions",
    "who counts",
)
# Verdicts on DQN, by steps: the rung, numbers of onlookers, and what the text says
EXPECTED = [(ALIKE, (8, 16), "faster"), (RELATIVE, (0, 2, 8), "slower"), (TOLD, (0,), "slower")]
TABLE, TILES, DQN = "replay_table, index", "tile_coding, coordinates", "dqn, coordinates"
OFFSET_TILES, OFFSET_DQN = "tile_coding, offset_coordinates", "dqn, offset_tiles"


def finding(tables: Mapping[str, Any]) -> str:
    """Checks every claim of the text, and returns the text, from data frames by name."""
    cells = tables["cells"].set_index(["grid", "point", "learner"]).sort_index()
    contrasts = tables["contrasts"]
    rungs = tables["rungs"].set_index(["rung", "net", "point"]).sort_index()
    chance = rungs.loc["chance"].iloc[0]["net_unseen_success"]

    assert rungs["tiles_n"].dropna().ge(20).all(), "tile coding has 20 runs or more"
    for rung, numbers, verdict in EXPECTED:
        for k in numbers:
            found = rungs.loc[(rung, "DQN", f"onlookers {k}"), "steps_verdict"]
            assert found == verdict, f"{rung}, {k} onlookers: DQN is {verdict}"
    for k in (2, 8):
        nothing = rungs.loc[("nothing", "DQN", f"onlookers {k}")]
        assert nothing["net_n_solved"] == 0, f"told nothing, DQN never learns among {k}"
        assert nothing["tiles_n_solved"] <= 10, f"told nothing, most tiles never learn among {k}"
    of_nets = contrasts[contrasts["y"].isin([TILES, OFFSET_TILES])]
    for grid in ("places", "groups"):
        verdicts = of_nets[of_nets["grid"] == grid]["steps_verdict"]
        assert "faster" not in {*verdicts}, f"{grid}: no net is faster than tile coding"

    def steps(rung: str, k: int, side: str, net: str = "DQN") -> str:
        row = rungs.loc[(rung, net, f"onlookers {k}")]
        names = {f"{side}_{name}": name for name in ("n", "n_solved", "steps")}
        return needed(row.rename(names))

    def new(rung: str, k: int, side: str) -> str:
        row = rungs.loc[(rung, "DQN", f"onlookers {k}")]
        places, ways = (row[f"{side}_{name}_success"] for name in ("unseen", "new_way"))
        return f"{places:.2f} and {ways:.2f}"

    many, why = cells.loc["places", "places 64"], cells.loc["why", "places 64"]
    two = cells.loc["groups", "people 2"]
    in_places = of_nets[of_nets["grid"] == "places"]["steps_verdict"]
    return f"""\
Told only that people are alike, DQN needs fewer steps than tile coding among 8 onlookers
({steps(ALIKE, 8, "net")} against {steps(ALIKE, 8, "tiles")}, medians) and 16; among 2, they need
{steps(ALIKE, 2, "net")} and {steps(ALIKE, 2, "tiles")}. Told where everybody is relative to the
agent, tile coding needs fewer: {steps(RELATIVE, 8, "tiles")} against {steps(RELATIVE, 8, "net")}
among 8. So a net pays where people are alike, many, and seen in a room, and nobody can say what
matters. This is about DQN; PPO was not tried with one net over all people.

**Told less or more.** Told nothing, neither plain DQN nor, mostly, tile coding of everything learns
among onlookers. Tiles of the agent with each person, apart, need {steps(APART, 2, "tiles", "none")}
among 2. Told who counts, tile coding needs {steps(TOLD, 0, "tiles")} and DQN
{steps(TOLD, 0, "net")}, however many onlookers there are: it does not see them.

**New places and ways.** Told that people are alike, after as many steps, among 8 onlookers, success
in new places and among onlookers in new ways is {new(ALIKE, 8, "net")} with DQN and
{new(ALIKE, 8, "tiles")} with tile coding; told relative positions, {new(RELATIVE, 8, "net")} and
{new(RELATIVE, 8, "tiles")}. The random policy has {chance:.2f}. Only 512 combinations of a place
and a way are trained: tiles of everything can nearly memorise them, so success there says little.

**Places.** Without onlookers, in 64 places, given cells, a table with a backward pass needs
{needed(many.loc[TABLE])} steps, tile coding {needed(many.loc[TILES])}, DQN
{needed(many.loc[DQN])}; given offsets, {needed(many.loc[OFFSET_TILES])} (tile coding) and
{needed(many.loc[OFFSET_DQN])} (DQN). With 1 to 64 places, nets are slower than tile coding in
{in_places.eq("slower").sum()} of {len(in_places)} contrasts, and never faster.

**Why.** Given offsets, DQN needs {needed(why.loc["dqn, offset_coordinates"])} steps from
coordinates and {needed(why.loc["dqn, offset_factored"])} from one-hot rows and columns; without
hidden layers, {needed(why.loc["linear_dqn, offset_factored"])}. In Atari games, Liang et al.
([arXiv 1512.01563](https://arxiv.org/abs/1512.01563)) found that linear learners with suitable
features come close to DQN.

**Groups.** To join two people who talk, given their offsets, tile coding needs
{needed(two.loc[OFFSET_TILES])} steps and DQN {needed(two.loc["dqn, offset_factored"])}.

**Caveats.** The net over all people is that of Zaheer et al. (2017, *Deep sets*) in
Stable-Baselines3; tiles are those of Miller and Glanz (1996). Offsets leave onlookers out, so they
tell who counts. Settings are the best of as many trials for each searched learner, but the net over
people is not searched: other settings may change the order (Patterson et al. 2024, *Empirical
design in reinforcement learning*)."""
