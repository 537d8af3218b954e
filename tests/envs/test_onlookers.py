"""People who are seen and do not matter: where they stand, what shows, what stays the same."""

import hashlib
import json
from typing import Any

import numpy as np
import pytest

from envs import compile_scenario, load_scenario
from envs.layout import NEW_WAY, SEEN
from envs.observations import compile_seen, observation_table
from envs.tiles import Parts, tiles_of
from tests.envs import Changes

# Twelve cells, of which the person has one of four.
ROOM: Changes = {"grid.rows": 3, "grid.columns": 4, "grid.start": "anywhere"}
ROOM |= {
    "regions.uncomfortable_radius": 0,
    "regions.target_radius": 1,
    "issuer.places": 4,
    "issuer.unseen": 3,
}
CROWD: Changes = ROOM | {"onlookers": {"people": 3, "ways": 10}}
ARRAYS = ("grid_reward", "issuer_reward", "terminated", "event", "wrong_pings", "cell", "zone")


def model_of(changes: Changes, **more: Any) -> Any:
    return compile_scenario(load_scenario("Anywhere", changes | more))


def orders_by_hand(n: int, size: int, *names: object) -> list[list[int]]:
    """Sorts the numbers below a size by the words of a stream, row by row."""
    key = int.from_bytes(hashlib.sha256(json.dumps(names).encode()).digest()[:16], "little")
    words = iter(np.random.Philox(key=key).random_raw(n * size).tolist())
    rows = [[next(words) for _ in range(size)] for _ in range(n)]
    return [sorted(range(size), key=row.__getitem__) for row in rows]


def test_onlookers_stand_in_the_first_free_cells_of_each_way() -> None:
    model = model_of(CROWD, draw=5)
    layout = model.scenario.layout
    for kind, starts in enumerate((model.starts, model.unseen_starts, model.new_way_starts)):
        assert {*model.context[starts]} == {*np.flatnonzero(layout.novelty == kind)}
    orders = orders_by_hand(14, 12, "onlookers", 5)
    every = load_scenario("Anywhere", ROOM | {"draw": 5}).layout
    assert len(layout.ways) == 10 + 3 + 4
    for place, kind in enumerate(every.novelty.tolist()):
        person = int(every.ways[place, 0])
        rows = np.flatnonzero((layout.ways == every.ways[place]).all(axis=1))
        nth = [*np.flatnonzero(every.novelty == kind)].index(place)
        # Ten ways take turns with four places; unseen places have one of them each, in turn.
        ways = [(nth + 4 * n) % 10 for n in range(len(rows))]
        novelty = [kind] * len(rows)
        if kind == SEEN:
            ways[-1], novelty[-1] = 10 + nth, NEW_WAY
        assert layout.novelty[rows].tolist() == novelty
        firsts = [[cell for cell in orders[way] if cell != person][:3] for way in ways]
        assert layout.onlookers[rows].tolist() == firsts


@pytest.mark.parametrize("more", [{}, {"badge": True}])
def test_onlookers_change_nothing_but_what_is_seen(more: Changes) -> None:
    """In each place, the model is that without onlookers."""
    crowd, alone = model_of(CROWD | {"onlookers": {"people": 3, "ways": 8} | more}), model_of(ROOM)
    block = 12 * alone.scenario.ping_limit
    crowded, places = (model.scenario.layout.ways.tolist() for model in (crowd, alone))
    place_of = [places.index(way) for way in crowded]
    for name in ARRAYS:
        theirs = getattr(alone, name).reshape(7, block, -1)[place_of]
        assert (getattr(crowd, name).reshape(theirs.shape) == theirs).all(), name
    ours, theirs = (
        model.next_state.reshape(-1, block, 5) - block * np.arange(model.n_places)[:, None, None]
        for model in (crowd, alone)
    )
    assert (ours == theirs[place_of]).all()


def test_what_is_seen_by_hand() -> None:
    """Cells of agent, person and onlookers; with badges, people are in random order."""
    model = model_of(CROWD)
    layout, table = model.scenario.layout, observation_table(model, "coordinates")
    for state in range(0, len(model.observation), 7):
        place = model.context[state]
        cells = [
            int(model.cell[state]),
            int(layout.ways[place, 0]),
            *layout.onlookers[place].tolist(),
        ]
        expected = [number for cell in cells for number in (cell // 4 / 2, cell % 4 / 3)]
        assert table[model.observation[state]] == pytest.approx(expected)
    ones = observation_table(model, "one_hot")
    assert ones.shape[1] == 12 * 5
    assert (ones.sum(axis=1) == 5).all()

    badged = model_of(CROWD | {"onlookers": {"people": 3, "ways": 10, "badge": True}})
    numbers = badged.components[1].numbers.reshape(-1, 4, 3)
    orders = orders_by_hand(17, 4, "badges", 0)
    for place, order in enumerate(orders):
        cells = [int(layout.ways[place, 0]), *layout.onlookers[place].tolist()]
        expected = [[*divmod(cells[i], 4), int(i == 0)] for i in order]
        assert numbers[place].tolist() == expected
    assert (observation_table(badged, "one_hot").sum(axis=1) == 5).all()

    # Relative to the agent, only the person who counts is given.
    offset = compile_seen(load_scenario("Anywhere", CROWD), "offset")
    assert offset.n_observations == 5 * 7


def test_everybody_relative_to_the_agent_by_hand() -> None:
    """Of three rows and four columns, offsets are from -2 to 2 and from -3 to 3."""
    badged = {"onlookers": {"people": 2, "ways": 6, "badge": True}}
    cells = model_of(CROWD | badged)
    relative = compile_seen(cells.scenario, "relative_coordinates")
    agent, people = (part.numbers[value] for part, value in cells.parts)
    table = observation_table(relative, "relative_coordinates")
    seen = set()
    for state, o in enumerate(cells.observation.tolist()):
        row, column = agent[o].tolist()
        expected = [
            number
            for r, c, badge in people[o].reshape(3, 3).tolist()
            for number in ((r - row + 2) / 4, (c - column + 3) / 6, badge)
        ]
        assert table[relative.observation[state]] == pytest.approx(expected)
        seen.add(tuple(expected))
    assert relative.n_observations == len(seen) <= relative.scenario.n_observations


@pytest.mark.parametrize("parts", ["agent_pairs", "shared_pairs"])
@pytest.mark.parametrize("badge", [False, True])
@pytest.mark.parametrize("form", ["coordinates", "relative_coordinates"])
def test_tiles_of_each_person_equal_a_plain_loop(form: str, badge: bool, parts: Parts) -> None:
    changes = CROWD | {"onlookers": {"people": 2, "ways": 6, "badge": badge}}
    changes |= {"observe": ["agent", "issuer", "wrong_pings"]}
    model = compile_seen(load_scenario("Anywhere", changes), form)
    found, n_tilings, width = tiles_of(model, 3, 2, parts), 3, 2
    seen = [part.numbers[value] for part, value in model.parts]
    *agent, people, pings = (numbers.tolist() for numbers in seen)
    n = 3 if badge else 2
    tiles: dict[Any, int] = {}
    for o in range(model.n_observations):
        for person in range(3):
            row, column, *its_badge = people[o][person * n : (person + 1) * n]
            places = [*(agent[0][o] if agent else ()), row, column]
            for t in range(n_tilings):
                # In thirds of a cell; tiling t is displaced by t times odd numbers of thirds of a
                # width.
                key = [
                    (3 * x + t * odd % 3 * width) // (3 * width)
                    for x, odd in zip(places, (1, 3, 5, 7), strict=False)
                ]
                key += [t, *its_badge, *pings[o], *[person] * (parts == "agent_pairs")]
                tile = int(found.tiles[found.rows[o, person], t])
                assert tiles.setdefault(tuple(key), tile) == tile
    assert sorted(tiles.values()) == [*range(int(found.tiles.max()) + 1)]
