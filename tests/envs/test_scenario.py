"""Scenarios: what is accepted, and the messages for what is not."""

from pathlib import Path
from typing import Any

import pytest

from envs import InputError, load_scenario
from envs.inputs import read_toml
from envs.scenario import SCENARIO_DIRECTORY
from tests.envs import Changes

S1 = read_toml(SCENARIO_DIRECTORY / "S1.toml") | {"name": "S1"}
WALL = "\n".join(["...#........"] * 10)
CIRCLE = {"kind": "circle", "radius": 1}


def shapes(uncomfortable: Changes, target: Changes) -> Changes:
    return {"uncomfortable": uncomfortable, "target": target}


def phase(name: str = "a", **more: Any) -> Changes:
    return {"name": name, **more}


ANYWHERE = {"issuer.position": "anywhere"}
# 120 cells, 50 phases, in each of which the issuer is elsewhere, 16 wrong PINGs: more observations
# than the 96,000 states.
OBSERVING: Changes = {
    "ping_limit": 16,
    "phases": [phase(f"{i}", steps=1, position=[3 + i // 8, 4 + i % 8]) for i in range(50)],
    "observe": ["agent", "issuer", "phase", "wrong_pings"],
}
NAMES = [f"{i}" for i in range(21)]
PAIR: Changes = ANYWHERE | {"group.people": 2, "group.apart": [2, 4]}
RING = {"kind": "ring", "width": 1}


def bystander(position: list[int], *corners: list[int], steps: int = 1) -> Changes:
    walk = {"walk": {"corners": [*corners], "steps": steps}} if corners else {}
    return {"position": position} | walk


# Changes of S1, and what the message names.
MISTAKES: list[tuple[Changes, str]] = [
    ({"grid.start": [5, 7]}, "grid.start = [5, 7]: accepted: a cell outside every region"),
    ({"issuer.position": [6, 12]}, "issuer.position = [6, 12] is off the grid"),
    (
        {"grid.depth": 3},
        "[grid]: unknown key depth; accepted: columns, metres_per_cell, rows, start, walls.",
    ),
    ({"issuer.feedback": {"kind": "loud"}}, "accepted: a table whose kind is none, uniform,"),
    ({"observe": ["phase", "agent"]}, "observe = ['phase', 'agent']"),
    # Walls
    (
        {"grid.walls": WALL, "grid.start": [[0, 11], [0, 0]]},
        "grid.start = [0, 0]: accepted: a cell outside",
    ),
    # Regions
    ({"regions.target_radius": 1}, "target_radius = 1"),
    ({"regions": shapes(CIRCLE, RING)}, 'target.kind = "ring": accepted: a ring around a [group]'),
    # Phases and walks
    ({"phases": [phase(stepps=3)]}, "[phases.0]: unknown key stepps (did you mean steps?)"),
    ({"issuer.walk": {"corners": [[3, 3]]}}, "issuer.walk.corners: from [6, 8] to [3, 3]"),
    # Rounds of 2 * 71 and 2 * 73 steps: 2 * 71 * 73 together.
    (
        {"others": [bystander([0, 1], [0, 2], steps=71), bystander([1, 1], [1, 2], steps=73)]},
        "others.0, others.1: it takes 10,366 steps until everybody is back: accepted: at most",
    ),
    # Other people. After two steps, both walkers are in [2, 4].
    (
        {"others": [bystander([2, 2], [2, 6]), bystander([0, 4], [4, 4])]},
        "two people at once in [2, 4]",
    ),
    (
        {"others": [bystander([2, 2]) | {"feedback": {"kind": "none"}}]},
        "both, or neither (a bystander)",
    ),
    # Groups and onlookers
    (
        ANYWHERE | {"issuer.places": 100, "issuer.unseen": 12},
        "issuer.places = 100 with issuer.unseen = 12",
    ),
    (PAIR | {"group.apart": [15, 16]}, "group: nowhere do 2 people stand [15.0, 16.0] apart"),
    # At most 4 + 1/2 cells from the centre, the ring lies within the circles.
    (
        PAIR | {"regions": shapes(CIRCLE | {"radius": 5}, RING)},
        "grid.start = [0, 0]: accepted: a cell",
    ),
    # Sizes
    ({"grid.rows": 1000, "grid.columns": 1000}, "rows x columns = 1000 x 1000"),
    (OBSERVING, "4800000 observations"),
    (
        PAIR | {"group.people": 6, "group.apart": [0, 20]},
        "of the 6 people of the group can stand in",
    ),
    # 120 cells x 5 wrong PINGs x 21 phases x 20 positions = 252,000 states.
    (
        {
            "issuer.position": [[r, c] for r in (3, 5, 7, 9) for c in (3, 5, 7, 9, 11)],
            "phases": [phase(n, next={o: 0.05 for o in NAMES if o != n}) for n in NAMES],
        },
        " x phases that may follow = 5292000 states",
    ),
]


@pytest.mark.parametrize(("changes", "expected"), MISTAKES)
def test_mistakes_get_one_sentence(changes: Changes, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        load_scenario("S1", changes)
    message = str(caught.value)
    assert expected in message
    assert "S1.toml" in message
    assert all(line.isprintable() for line in message.split("\n"))


SHIPPED = (SCENARIO_DIRECTORY / "S1.toml").read_text()


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("nothing.toml", None, "No such file"),
        ("broken.toml", "grid = [", "not valid TOML"),
        ("mine.toml", SHIPPED.replace("ping_limit = 5", ""), "ping_limit is missing"),
        ("my scene.toml", SHIPPED, "named after the file"),
    ],
)
def test_files_that_cannot_be_used_get_one_sentence(
    tmp_path: Path, name: str, text: str | None, expected: str
) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=rf"{name}: .*{expected}"):
        load_scenario(tmp_path / name)


def test_mapping_and_file_are_accepted_and_checked(tmp_path: Path) -> None:
    (tmp_path / "corridor.toml").write_text(SHIPPED.replace("rows = 10", "rows = 20"))
    corridor = load_scenario(tmp_path / "corridor.toml")
    assert corridor == load_scenario(S1 | {"name": "corridor"}, {"grid.rows": 20})
    scenario = load_scenario("S2", {"ping_limit": 3})
    assert load_scenario(scenario.model_dump()) == scenario
    assert load_scenario(S1, {"grid.rows": 20}) == load_scenario("S1", {"grid.rows": 20})
    with pytest.raises(InputError, match=r"^S1: grid.rows = 0"):
        load_scenario(S1, {"grid.rows": 0})
    with pytest.raises(InputError, match="unknown scenario s1"):
        load_scenario("s1")
