"""What `when` has shown: what one must know for tile coding to do."""

from collections.abc import Mapping
from math import inf
from typing import Any, Final

from benchmark.map import needed

ALIKE, RELATIVE, TOLD = "people are alike", "relative positions", "who counts"
RUNGS: Final = ("nothing", "agent with each person", ALIKE, RELATIVE, TOLD)
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


def finding(tables: Mapping[str, Any]) -> str:
    """Checks every claim of the text, and returns the text, from data frames by name."""
    cells = tables["cells"].set_index(["grid", "point", "learner"]).sort_index()
    rungs = tables["rungs"].set_index(["rung", "net", "point"]).sort_index()
    contrasts = tables["contrasts"].set_index(["grid", "x", "y", "point"]).sort_index()
    _check(rungs, contrasts)

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
Among onlookers, one person counts, who wears a badge; nobody says so. Told only that people are
alike, DQN does better than tile coding where this person never stood in training: among 8
onlookers, it succeeds there with a probability of {new(ALIKE, 8, "net")} against
{new(ALIKE, 8, "tiles")}. Which learns in fewer steps is undecided: among 8, {learned("net")} of DQN
and {learned("tiles")} of tile coding learn; among 2, they need {steps(ALIKE, 2, "net")} and
{steps(ALIKE, 2, "tiles")} steps. Told where people are relative to the agent, both succeed in new
places, and tile coding needs fewer steps among 2 ({steps(RELATIVE, 2, "tiles")} against
{steps(RELATIVE, 2, "net")}); who needs fewer among 8 is undecided.

| told | steps, 0 onlookers | 2 | 8 | DQN first | new places |
|---|---|---|---|---|---|
{_table(rungs)}

*Tile coding; DQN. Medians of steps (in brackets: runs that learn), how often DQN takes fewer, with
an interval, and success in new places, both among 8.*

**The ladder.** The order of people is drawn, too. So here a net earns its keep where people are
many and alike, and nobody can say that relative positions are enough. This is about DQN with one
net over all people, whose outputs are added (Zaheer et al. 2017, *Deep sets*).

**Places.** Without onlookers, no net is faster than tile coding. In 64 places, given cells, tile
coding needs {at(*many, TILES)} steps, DQN {at(*many, DQN)} and a table with a backward pass
{at(*many, TABLE)}: DQN is faster than this table. Given offsets, they need
{at(*many, OFFSET_TILES)}, {at(*many, OFFSET_DQN)} and {at(*many, OFFSET_TABLE)}.

**Why.** Given offsets, DQN needs {at(*why, "dqn, offset_factored")} steps from one-hot rows and
columns, and {at(*why, "linear_dqn, offset_factored")} without hidden layers: features do most of
the work, as on Atari ([Liang et al. 2016](https://arxiv.org/abs/1512.01563)).

**Groups.** To join two people who talk, they need {at(*two, OFFSET_TILES)},
{at(*two, "dqn, offset_factored")} and {at(*two, OFFSET_TABLE)} steps, given offsets.

**Caveats.** Tile coding is that of Miller and Glanz (1996). Settings decide as much as methods
(Patterson et al. 2024). A learner that is first in 14 of 16 pairs is still undecided among
{len(contrasts)} contrasts."""


def _check(rungs: Any, contrasts: Any) -> None:
    """Raises an AssertionError, which says what, if the tables do not show a claim."""
    by_steps = contrasts["steps_verdict"]
    for rung, k, verdict in BY_STEPS:
        found = rungs.loc[(rung, "DQN", f"onlookers {k}"), "steps_verdict"]
        assert found == verdict, f"{rung}, {k} onlookers: DQN is {verdict}"
    for grid, k in (("alone", 0), ("ladder", 2), ("ladder", 8)):
        found = contrasts.loc[(grid, *PEOPLE, f"onlookers {k}"), "unseen_verdict"]
        assert found == "better", f"among {k} onlookers, DQN is better in new places"
    for grid, tiles in (("places", TILES), ("places", OFFSET_TILES), ("groups", OFFSET_TILES)):
        verdicts = {*by_steps.loc[grid].xs(tiles, level="y")}
        assert verdicts <= {"slower", "undecided"}, "no net is faster than tile coding"
    assert by_steps["places", DQN, TABLE, "places 64"] == "faster", "DQN is faster than a table"


def _table(rungs: Any) -> str:
    """Returns a table in Markdown with a row for each rung, and one for chance."""
    known = {(rung, k): own for (rung, net, k), own in rungs.iterrows() if net in ("DQN", "none")}
    lines = []
    for rung in RUNGS:
        steps = [_steps(known.get((rung, f"onlookers {k}"))) for k in (0, 2, 8)]
        last = known.get((rung, "onlookers 8"), known.get((rung, "onlookers 0")))
        ends = [last[f"net_wins{end}"] for end in ("", "_low", "_high")]
        wins = "{:.2f} [{:.2f}, {:.2f}]".format(*ends) if ends[0] >= 0 else "-"
        new = [last[f"{side}_unseen_success"] for side in ("tiles", "net")]
        texts = [rung, *steps, wins, "; ".join(f"{share:.2f}" for share in new if share >= 0)]
        lines.append(f"| {' | '.join(texts)} |")
    chance = rungs.loc["chance"].iloc[0]["net_unseen_success"]
    return "\n".join([*lines, f"| chance | | | | | {chance:.2f} |"])


def _steps(row: Any) -> str:
    """Returns medians of tile coding and DQN, with how many runs learn; "-" if nothing ran."""
    texts = []
    for side in ("tiles", "net") if row is not None else ():
        n, learned, steps = (row[f"{side}_{name}"] for name in ("n", "n_solved", "steps"))
        if n > 0:
            median = f"{steps:,.0f}" if steps < inf else "never"
            texts.append(f"{median} ({learned:.0f}/{n:.0f})")
    return "; ".join(texts) or "-"
