"""What is observed of several people: by hand, and against its definition in plain Python."""

import re
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from envs import OBSERVATIONS, InputError, ProxemicEnv, compile_scenario, load_scenario
from envs.observations import compile_seen, observation_table, seen_as
from envs.scenario import SCENARIO_DIRECTORY
from tests.envs import Changes
from tests.support import few_places

# Five rows and six columns, so that offsets have 9 x 11 values: the number of (r, c) is (r + 4) *
# 11 + c + 5, and as coordinates it is (r + 4) / 8 and (c + 5) / 10.
ROOM: Changes = {"grid.rows": 5, "grid.columns": 6, "grid.start": "anywhere"}
ROOM |= {"regions.uncomfortable_radius": 0, "regions.target_radius": 1, "ping_limit": 1}
WALL = "......\n.#....\n......\n......\n......"
PAIR, THREE = ({"group": {"people": n, "apart": [2, 4]}} | ROOM for n in (2, 3))


def seen(changes: Changes, agent: tuple[int, int], *people: tuple[int, int]) -> Any:
    """Returns what is observed in a cell with people: columns that are 1, and coordinates."""
    model = compile_seen(load_scenario("Anywhere", changes), "offset")
    is_here = model.cell == agent[0] * 6 + agent[1]
    is_there = model.context == model.scenario.layout.places.index(people)
    (o,) = {*model.observation[is_here & is_there].tolist()}
    ones, coordinates = (
        observation_table(model, f"offset_{form}")[o] for form in ("one_hot", "coordinates")
    )
    return np.flatnonzero(ones).tolist(), coordinates.tolist()


def test_offsets_of_two_people_by_hand() -> None:
    # the second is nearer: 2 rows up, the other 3 columns right
    agent, first, last = (2, 2), (2, 5), (0, 2)
    up, right = 2 * 11 + 5, 4 * 11 + 8
    columns, coordinates = seen(PAIR, agent, last, first)
    assert columns == [up, 99 + right]
    assert coordinates == pytest.approx([2 / 8, 5 / 10, 4 / 8, 8 / 10])


def test_of_equally_near_people_the_upper_and_then_the_left_one_comes_first() -> None:
    up, left, right, down = (2 * 11 + 5, 4 * 11 + 3, 4 * 11 + 7, 6 * 11 + 5)  # each two cells away
    assert seen(PAIR, (2, 2), (2, 0), (2, 4))[0] == [left, 99 + right]
    assert seen(THREE, (2, 2), (0, 2), (2, 0), (4, 2))[0] == [up, 99 + left, 198 + down]
    # Distances are Euclidean: 2 and 1 cells aside (2.24) are nearer than 3 (3), though both are 3
    # steps.
    assert seen(PAIR, (0, 0), (0, 3), (2, 1))[0] == [6 * 11 + 6, 99 + 4 * 11 + 8]


@pytest.mark.parametrize("changes", [ROOM, PAIR])
def test_without_onlookers_relative_forms_are_those_of_offsets(changes: Changes) -> None:
    scenario = load_scenario("Anywhere", changes)
    offset, relative = (
        compile_seen(scenario, f"{seen}_centred") for seen in ("offset", "relative")
    )
    assert (offset.observation == relative.observation).all()
    tables = (
        observation_table(offset, "offset_centred"),
        observation_table(relative, "relative_centred"),
    )
    assert np.array_equal(*tables)


def test_further_encodings_of_a_pair_of_cells_by_hand() -> None:
    # The agent is in row 3, column 1 of five and six, the person in row 0, column 4.
    model = compile_scenario(load_scenario("Anywhere", ROOM))
    is_there = model.context == model.scenario.layout.places.index(((0, 4),))
    (o,) = {*model.observation[(model.cell == 3 * 6 + 1) & is_there].tolist()}
    factored = observation_table(model, "factored")
    assert factored.shape[1] == 5 + 6 + 5 + 6
    assert np.flatnonzero(factored[o]).tolist() == [3, 5 + 1, 11 + 0, 16 + 4]
    expected = [-2 + 4 * 3 / 4, -2 + 4 * 1 / 5, -2 + 4 * 0 / 4, -2 + 4 * 4 / 5]
    assert observation_table(model, "centred")[o].tolist() == pytest.approx(expected)
    offsets = compile_seen(model.scenario, "offset_factored")
    (o,) = {*offsets.observation[(offsets.cell == 3 * 6 + 1) & is_there].tolist()}
    assert np.flatnonzero(observation_table(offsets, "offset_factored")[o]).tolist() == [
        -3 + 4,
        9 + 3 + 5,
    ]
    assert observation_table(offsets, "offset_centred")[o].tolist() == pytest.approx([-1.5, 1.2])


@pytest.mark.parametrize("badge", [False, True])
def test_planes_by_hand(badge: bool) -> None:
    onlookers = {"people": 2, "ways": 40, "badge": badge}
    changes = PAIR | {"ping_limit": 3, "grid.walls": WALL, "onlookers": onlookers}
    changes |= {"observe": ["agent", "issuer", "wrong_pings"]}
    model = compile_seen(load_scenario("Anywhere", changes), "planes")
    assert not model.scenario.issuer.permuted  # so people are shown where they stand
    table, layout = observation_table(model, "planes"), model.scenario.layout
    assert table.shape[1:] == (5, 5, 6)
    assert table.dtype == np.uint8
    cell = model.position.tolist()
    wrong_pings = np.arange(len(model.observation)) // 30 % 3
    for s in range(0, len(model.observation), 97):
        planes, place = table[model.observation[s]], model.context[s]
        people, others = layout.standing[place, 0], layout.onlookers[place]
        shown = [
            [cell[c] for c in sorted(cells)]
            for cells in ([model.cell[s]], people, others, [1 * 6 + 1])
        ]
        assert np.isin(planes[:4], (0, 255)).all()
        assert [np.argwhere(plane).tolist() for plane in planes[:4]] == shown
        assert (planes[4] == [0, 128, 255][wrong_pings[s]]).all()  # 255 / 2, rounded to even
    assert len(np.unique(table.reshape(len(table), -1), axis=0)) == len(table)


@pytest.mark.parametrize(
    ("name", "changes", "expected"),
    [
        ("Anywhere", {"observe": ["offset"]}, r'Anywhere .* \["offset"\]; accepted: cells, so "ag'),
        ("TwoStrangers", {}, "699,600 observations of 480 numbers each; accepted: at most"),
    ],
)  # fmt: skip
def test_what_planes_cannot_show_is_refused(name: str, changes: Changes, expected: str) -> None:
    with pytest.raises(InputError, match=rf"observation planes: .*{expected}") as refusal:
        ProxemicEnv(name, "planes", changes)
    assert len(refusal.value.args) == 1


@pytest.mark.parametrize("scenario", ["S1", "Anywhere", "Turning", "ThreeTalking"])
@pytest.mark.parametrize("form", OBSERVATIONS)
def test_sizes_are_known_before_a_scenario_is_compiled(scenario: str, form: str) -> None:
    overrides = few_places(scenario)
    declared = seen_as(load_scenario(scenario, overrides), form)
    model = compile_seen(declared, form)
    assert declared.n_observations >= model.n_observations
    if declared.n_people == 1:
        assert declared.n_observations == model.n_observations


def test_the_guide_has_the_width_of_every_form() -> None:
    guide = (SCENARIO_DIRECTORY / "README.md").read_text(encoding="utf-8")
    said = re.findall(r"`(\w+)` \|(?:[^|`]* \|)? (?:1 of )?([\d,]+)(?: values)? \|", guide)
    widths = dict[str, str]()
    for form in OBSERVATIONS:
        space = ProxemicEnv("Anywhere", form).observation_space
        widths[form] = f"{spaces.flatdim(space):,}"
    assert dict(said) == widths
