"""What `when` has shown: what one must know for tile coding to do."""

from collections.abc import Mapping
from typing import Any, Final

from benchmark.map import needed

ALIKE, RELATIVE, TOLD = "people are alike", "relative positions", "who counts"
# Verdicts on DQN by steps: the rung, and the number of onlookers
BY_STEPS: Final = [
    (ALIKE, 2, "undecided"),
    (ALIKE, 8, "undecided"),
    (RELATIVE, 0, "slower"),
    (RELATIVE, 2, "slower"),
    (RELATIVE, 8, "undecided"),
    (TOLD, 0, "slower"),
]
PEOPLE = "people_dqn, coordinates", "people_tiles_alike, coordinates"
TABLE, TILES, DQN = "replay_table, index", "tile_coding, coordinates", "dqn, coordinates"
OFFSET_TABLE, OFFSET_TILES = "replay_table, offset", "tile_coding, offset_coordinates"
OFFSET_DQN = "dqn, offset_tiles"
NETS: Final = (DQN, "ppo, centred", OFFSET_DQN, "ppo, offset_factored", "dqn, offset_factored")


def finding(tables: Mapping[str, Any]) -> str:
    """Checks every claim of the text, and returns the text, from data frames by name."""
    cells = tables["cells"].set_index(["grid", "point", "learner"]).sort_index()
    rungs = tables["rungs"].set_index(["rung", "net", "point"]).sort_index()
    contrasts = tables["contrasts"].set_index(["grid", "x", "y", "point"]).sort_index()
    for rung, k, verdict in BY_STEPS:
        found = rungs.loc[(rung, "DQN", f"onlookers {k}"), "steps_verdict"]
        assert found == verdict, f"{rung}, {k} onlookers: DQN is {verdict}"
    for grid, k in (("alone", 0), ("ladder", 2), ("ladder", 8)):
        found = contrasts.loc[(grid, *PEOPLE, f"onlookers {k}"), "unseen_verdict"]
        assert found == "better", f"told that people are alike, DQN is better in new places at {k}"
    assert not rungs.loc["nothing"][["tiles_n_solved", "net_n_solved"]].to_numpy().any(), (
        "told nothing, nobody learns among onlookers"
    )
    by_steps = contrasts["steps_verdict"]
    for grid, point, tiles in (
        *(("places", f"places {n}", tiles) for n in (1, 16, 64) for tiles in (TILES, OFFSET_TILES)),
        *(("groups", f"people {n}", OFFSET_TILES) for n in (2, 3)),
    ):
        pairs = [(grid, net, tiles, point) for net in NETS]
        found = {*by_steps[[pair for pair in pairs if pair in by_steps.index]]}
        assert found <= {"slower", "undecided"}, "no net is faster than tile coding"
    assert by_steps["places", DQN, TABLE, "places 64"] == "faster", "DQN is faster than a table"

    def row(rung: str, k: int, side: str) -> Any:
        columns = ("n", "n_solved", "steps", "unseen_success")
        names = {f"{side}_{name}": name for name in columns}
        return rungs.loc[(rung, "DQN", f"onlookers {k}")].rename(names)

    def steps(rung: str, k: int, side: str) -> str:
        return needed(row(rung, k, side))

    def learned(side: str) -> str:
        own = row(ALIKE, 8, side)
        return f"{own['n_solved']:.0f} of {own['n']:.0f} runs"

    def new(rung: str, k: int, side: str) -> str:
        return f"{row(rung, k, side)['unseen_success']:.2f}"

    def at(grid: str, point: str, learner: str) -> str:
        return needed(cells.loc[(grid, point, learner)])

    many, why, two = ("places", "places 64"), ("why", "places 64"), ("groups", "people 2")
    return f"""\
Told only that people are alike, DQN does better than tile coding where the person never stood in
training: it succeeds with a probability of {new(ALIKE, 8, "net")} against {new(ALIKE, 8, "tiles")}
among 8 onlookers. Which learns in fewer steps is undecided: among 8, {learned("net")} of DQN and
{learned("tiles")} of tile coding learn; among 2, they need {steps(ALIKE, 2, "net")} and
{steps(ALIKE, 2, "tiles")} steps. Told where people are relative to the agent, both succeed there,
and tile coding needs fewer steps among up to 2 ({steps(RELATIVE, 2, "tiles")} against
{steps(RELATIVE, 2, "net")}).

**The ladder.** One person, who wears a badge, counts; nobody says so, and the order of people is
drawn. On each rung, tile coding and nets are told the same. Told nothing, neither learns among
onlookers. So here a net earns its keep where people are many and alike, and nobody can say that
relative positions are enough. This is about DQN with one net over all people, whose outputs are
added (Zaheer et al. 2017, *Deep sets*).

**Places.** Without onlookers, no net is faster than tile coding. In 64 places, given cells, tile
coding needs {at(*many, TILES)} steps, DQN {at(*many, DQN)} and a table with a backward pass
{at(*many, TABLE)}: DQN is faster than this table. Given offsets, they need
{at(*many, OFFSET_TILES)}, {at(*many, OFFSET_DQN)} and {at(*many, OFFSET_TABLE)}.

**Why.** Given offsets, DQN needs {at(*why, "dqn, offset_factored")} steps from one-hot rows and
columns, and {at(*why, "linear_dqn, offset_factored")} without hidden layers: features do most of
the work, as on Atari ([Liang et al. 2016](https://arxiv.org/abs/1512.01563)).

**Groups.** To join two people who talk, given offsets, tile coding needs
{at(*two, OFFSET_TILES)} steps, a table with a backward pass {at(*two, OFFSET_TABLE)} and DQN
{at(*two, "dqn, offset_factored")}. Among two or three, no net is faster than tile coding.

**Caveats.** Settings decide as much as methods (Patterson et al. 2024, *Empirical design in
reinforcement learning*); tile coding is that of Miller and Glanz (1996). A learner that is first in
14 of 16 pairs is still undecided among {len(contrasts)} contrasts."""
