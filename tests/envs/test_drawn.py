"""Scenarios that draw places and codes."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from envs import compile_scenario, load_scenario
from envs.observations import observation_table
from tests.envs import Changes

RADII = {"regions.uncomfortable_radius": 0, "regions.target_radius": 1}
ROOM = {"grid.rows": 5, "grid.columns": 6, "grid.start": "anywhere"} | RADII
PAIR: Changes = ROOM | {"group": {"people": 2, "apart": [2, 3]}}


@pytest.mark.parametrize(
    ("changes", "n_every"),
    [
        ({}, 111),
        # Rows and columns aside: 0 and 2, 0 and 3, 2 and 0, 3 and 0; 1 and 2, 2 and 1, 2 and 2 in
        # two directions.
        (PAIR, 5 * 4 + 5 * 3 + 3 * 6 + 2 * 6 + 2 * (4 * 4 + 3 * 5 + 3 * 4)),
    ],
)
def test_places_are_nested_and_differ_by_draw(changes: Changes, n_every: int) -> None:
    every = load_scenario("Anywhere", changes)
    assert len(every.layout.places) == n_every
    assert every.drawn(3) == every
    drawn: dict[int, list[set[Any]]] = {}
    for draw in (0, 1):
        few = [
            load_scenario("Anywhere", changes | {"issuer.places": n, "draw": draw})
            for n in (2, 9, 40)
        ]
        drawn[draw] = [{*each.layout.places} for each in few]
        assert [len(places) for places in drawn[draw]] == [2, 9, 40]
        assert all(
            small < large for small, large in pairwise([*drawn[draw], {*every.layout.places}])
        )
    assert drawn[0][1] != drawn[1][1]
    # No episode starts in an unseen place.
    unseen = {"issuer.places": 9, "issuer.unseen": 31, "draw": 1}
    scenario = load_scenario("Anywhere", changes | unseen)
    model, places, (_, seen, all_drawn) = (
        compile_scenario(scenario),
        scenario.layout.places,
        drawn[1],
    )
    assert {*places} == all_drawn
    for starts, expected in ((model.starts, seen), (model.unseen_starts, all_drawn - seen)):
        assert {places[place] for place in model.context[starts]} == expected  # a single phase


def test_permuting_changes_coordinates_of_the_issuer_alone() -> None:
    drawn = {"issuer.places": 16, "draw": 5}
    theirs = compile_scenario(load_scenario("Anywhere", drawn))
    for share, n_changed in ((0.25, 4), (0.5, 8), (1.0, 16)):
        ours = compile_scenario(load_scenario("Anywhere", drawn | {"issuer.permuted": share}))
        for name in ("observation", "next_state"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
        ours_seen, theirs_seen = (observation_table(model, "one_hot") for model in (ours, theirs))
        np.testing.assert_array_equal(ours_seen, theirs_seen)
        (agent, issuer), (own_agent, own_issuer) = (
            [part.numbers / part.largest for part in model.components] for model in (ours, theirs)
        )
        np.testing.assert_array_equal(agent, own_agent)
        assert (issuer != own_issuer).any(axis=1).sum() == n_changed
        assert sorted(map(tuple, issuer)) == sorted(map(tuple, own_issuer))


def test_what_walls_cut_off_is_not_drawn() -> None:
    for door, changes, n_places, n_starts in (
        # A room of 3 x 5 cells, a wall, and a column of 3. The regions span 2 x 2 cells in a
        # corner, 2 x 3 beside a wall, and 3 x 3 elsewhere. At the ends of the column, they leave
        # the other end.
        ("#", {"grid.start": [0, 0]}, 15 - 4, 11),
        (".", {"grid.start": [0, 0]}, 15 - 4 + 1 + 3, 15),
        ("#", {"grid.start": "anywhere"}, 15 + 2, 15 * 15 - 4 * 4 - 8 * 6 - 3 * 9 + 2),
        ("#", {"grid.start": [0, 0], "group": {"people": 2, "apart": [1, 1]}}, 8 + 6, 14),
    ):
        room = {"grid.rows": 3, "grid.columns": 7, "grid.walls": f".....#.\n.....{door}.\n.....#."}
        model = compile_scenario(load_scenario("Anywhere", room | RADII | changes))
        assert (model.n_places, len(model.starts)) == (n_places, n_starts)
