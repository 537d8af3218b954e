"""What `when` has shown: what one must know for tile coding to do."""

from collections.abc import Mapping
from math import inf
from typing import Any

from benchmark.map import needed

ALIKE, RELATIVE, TOLD = "people are alike", "relative positions", "who counts"
RUNGS = ("nothing", "agent with each person", ALIKE, RELATIVE, TOLD)
# Verdicts on DQN by steps: the rung, and the number of onlookers
BY_STEPS = [
    (ALIKE, 2, "undecided"),
    (ALIKE, 8, "undecided"),
    (RELATIVE, 0, "slower"),
    (RELATIVE, 2, "slower"),
    (RELATIVE, 8, "undecided"),
    (TOLD, 0, "slower"),
]
PEOPLE = "people_dqn, coordinates", "people_tiles_alike, coordinates"
AGAIN = "people_dqn_again, coordinates", "people_tiles_again, coordinates"
TABLE, TILES, DQN = "replay_table, index", "tile_coding, coordinates", "dqn, coordinates"
OFFSET_TABLE, OFFSET_TILES = "replay_table, offset", "tile_coding, offset_coordinates"


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

    def new(rung: str, k: int, side: str) -> str:
        return f"{row(rung, k, side)['unseen_success']:.2f}"

    def at(grid: str, point: str, learner: str) -> str:
        return needed(cells.loc[(grid, point, learner)])

    many, why, two = ("places", "places 64"), ("why", "places 64"), ("groups", "people 2")
    fresh = contrasts.loc[("again", *AGAIN, "onlookers 8")]
    again = [f"{cells.loc[('again', 'onlookers 8', each), 'unseen_success']:.2f}" for each in AGAIN]
    return f"""\
Among onlookers, only a person with a badge matters, and learners must find this out. Told only that
people are alike, DQN does better than tile coding in new places, where this person never stood in
training. Among 8 onlookers, it succeeds with a probability of {new(ALIKE, 8, "net")} against
{new(ALIKE, 8, "tiles")} (fresh runs: {again[0]} against {again[1]}). Of 24 fresh runs each,
{fresh["learned_x"]} of DQN and {fresh["learned_y"]} of tile coding learn within 60,000 steps, some
at the last evaluation, so there is no verdict on steps. Among 2 onlookers, they need
{steps(ALIKE, 2, "net")} and {steps(ALIKE, 2, "tiles")} steps (*undecided*). Told where people are
relative to the agent, both succeed in new places, and tile coding needs fewer steps among 2
({steps(RELATIVE, 2, "tiles")} against {steps(RELATIVE, 2, "net")}).

| told | steps, 0 onlookers | 2 | 8 | DQN first | new places |
|---|---|---|---|---|---|
{_table(rungs)}

*Tile coding; DQN. Medians of steps (runs that learn), how often DQN takes fewer, and success in new
places, both among 8. "Who counts" is the same with any onlookers.*

**The ladder.** A net pays here where nobody can say more than that people are alike: it generalizes
to new places. This is about DQN with one net over all people, whose outputs are added (Zaheer et
al. 2017, *Deep sets*).

**Places.** Without onlookers, no net is faster than tile coding. In 64 places, given cells, tile
coding needs {at(*many, TILES)} steps, DQN {at(*many, DQN)} and a table with a backward pass
{at(*many, TABLE)}: DQN is faster than this table.

**Why.** Given offsets as one-hot rows and columns, DQN needs {at(*why, "dqn, offset_factored")}
steps, and {at(*why, "linear_dqn, offset_factored")} without hidden layers: no gain by them is shown
(Liang et al. 2016, [arXiv 1512.01563](https://arxiv.org/abs/1512.01563), found the like on Atari).

**Groups.** To join two people who talk, tile coding needs
{at(*two, OFFSET_TILES)} steps, DQN {at(*two, "dqn, offset_factored")} and the table with a backward
pass {at(*two, OFFSET_TABLE)}.

Tile coding is that of Miller and Glanz (1996). Settings decide as much as methods (Patterson et al.
2024)."""


def _check(rungs: Any, contrasts: Any) -> None:
    """Raises an AssertionError, which says what, if the tables do not show a claim."""
    by_steps = contrasts["steps_verdict"]
    for rung, k, verdict in BY_STEPS:
        found = rungs.loc[(rung, "DQN", f"onlookers {k}"), "steps_verdict"]
        assert found == verdict, f"{rung}, {k} onlookers: DQN is {verdict}"
    for grid, k in (("alone", 0), ("ladder", 2), ("ladder", 8)):
        found = contrasts.loc[(grid, *PEOPLE, f"onlookers {k}"), "unseen_verdict"]
        assert found == "better", f"among {k} onlookers, DQN is better in new places"
    fresh = contrasts.loc[("again", *AGAIN, "onlookers 8")]
    verdicts = [fresh[f"{unit}_verdict"] for unit in ("steps", "unseen", "new_way")]
    assert verdicts == ["no verdict", "better", "better"], (
        "fresh runs of DQN are better in new places"
    )
    assert fresh["n"] == 24, "there are 24 fresh runs"
    for grid, tiles in (("places", TILES), ("places", OFFSET_TILES), ("groups", OFFSET_TILES)):
        of_nets = {*by_steps.loc[grid].xs(tiles, level="y")}
        assert of_nets <= {"slower", "undecided"}, "no net is faster than tile coding"
    assert by_steps["places", DQN, TABLE, "places 64"] == "faster", "DQN is faster than a table"


def _table(rungs: Any) -> str:
    """Returns a table in Markdown with a row for each rung, and one for chance."""
    known = {(rung, k): own for (rung, net, k), own in rungs.iterrows() if net in ("DQN", "none")}
    lines = []
    for rung in RUNGS:
        steps = [_steps(known.get((rung, f"onlookers {k}"))) for k in (0, 2, 8)]
        last = known[rung, "onlookers 0" if rung == TOLD else "onlookers 8"]
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
