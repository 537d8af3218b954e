"""Scenarios: what is accepted, and the messages for what is not."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs import ACTIONS, ZONES, InputError, compile_scenario, load_scenario, scenario_names
from envs.inputs import override, parse, read_toml
from envs.scenario import SCENARIO_DIRECTORY, Scenario

S1 = read_toml(SCENARIO_DIRECTORY / "S1.toml") | {"name": "S1"}
FLOOR = "\n".join(["............"] * 10)
CIRCLE = {"kind": "circle", "radius": 1}


def shapes(uncomfortable: dict[str, Any], target: dict[str, Any]) -> dict[str, Any]:
    return {"uncomfortable": uncomfortable, "target": target}


def mask(cells: str) -> dict[str, Any]:
    return {"kind": "mask", "cells": cells}


def person(position: list[int]) -> dict[str, Any]:
    regions = {"uncomfortable_radius": 0, "target_radius": 1}
    return {"position": position, "feedback": {"kind": "none"}, "regions": regions}


def test_paper_scenarios_are_shipped() -> None:
    assert {"S1", "S2", "S3"} <= set(scenario_names())


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"grid.start": [5, 7]}, "grid.start = [5, 7] lies inside a region"),
        ({"grid.start": [6, 8]}, "grid.start = [6, 8] lies inside a region"),
        ({"grid.start": [10, 0]}, "grid.start = [10, 0] is off the grid; accepted: rows 0 to 9"),
        ({"issuer.position": [6, 12]}, "issuer.position = [6, 12] is off the grid; accepted: rows 0 to 9"),
        ({"issuer.position": [-1, 3]}, "issuer.position = [-1, 3] is off the grid"),
        ({"regions.uncomfortable_radius": -1}, "regions.uncomfortable_radius = -1"),
        ({"regions.target_radius": 1}, "target_radius = 1 must be larger than uncomfortable_radius = 1"),
        ({"grid.rows": 0}, "grid.rows = 0: input should be greater than or equal to 1"),
        ({"grid.rows": 9.5}, "grid.rows = 9.5"),
        ({"grid.rows": True}, "grid.rows = true"),
        (
            {"grid.depth": 3},
            "[grid]: unknown key depth; accepted: columns, metres_per_cell, rows, start, walls.",
        ),
        ({"grid.colums": 3}, "unknown key colums (did you mean columns?)"),
        ({"rewards.target_ping": "much"}, 'rewards.target_ping = "much"'),
        ({"rewards.target_ping": float("nan")}, "rewards.target_ping"),
        ({"issuer.feedback": {"kind": "loud"}}, "issuer.feedback"),
        ({"issuer.feedback": {"kind": "uniform", "low": 1.0, "high": 1.0}}, "must be less than high"),
        ({"issuer.feedback.volume": 1.0}, "[issuer.feedback.none]: unknown key volume; accepted: kind."),
        ({"issuer.feedback": "none"}, 'issuer.feedback = "none": accepted: a table'),
        ({"issuer.feedback": {}}, "accepted: a table with a key kind"),
        (
            {"grid.start": [0, 0, 0]},
            'grid.start = [0, 0, 0]: accepted: a cell [ROW, COLUMN], a list of cells, or "anywhere"',
        ),
        ({"rewards.other": -1e308}, "rewards.other = -1e+308"),
        ({"ping_limit": 0}, "ping_limit = 0"),
        ({"ping_limit": 10**6}, "120000000 states; accepted: at most 100000"),
        # 120 cells, two cells of the issuer (phases b and c share one), three phases, 140 wrong PINGs: more
        # observations than the 50,400 states.
        (
            {
                "ping_limit": 140,
                "phases": [
                    {"name": "a", "steps": 1},
                    {"name": "b", "steps": 1, "position": [6, 7]},
                    {"name": "c", "steps": 1, "position": [6, 7]},
                ],
                "observe": ["agent", "issuer", "phase", "wrong_pings"],
            },
            "'wrong_pings']: 100800 observations; accepted: at most 100000",
        ),
        ({"ping_limit.deep": 1}, "ping_limit is a value, not a table"),
        ({"name": "other"}, "unknown key name"),
        # Walls
        ({"grid.walls": "#.#"}, 'walls: accepted: 10 lines of 12 characters, "#" a wall, "." floor'),
        ({"grid.walls": FLOOR.replace(".", "x")}, "walls: accepted: 10 lines of 12 characters"),
        ({"grid.walls": "#" + FLOOR[1:]}, "grid.start = [0, 0] is a wall; accepted: another cell"),
        ({"grid.walls": "#" * 131}, "walls: accepted: 10 lines"),
        # Places
        ({"grid.start": []}, "grid.start = []: accepted: at least one cell"),
        ({"grid.start": "nowhere"}, 'grid.start = "nowhere": accepted: a cell [ROW, COLUMN]'),
        (
            {"grid.start": [[0, 0], [5, 8]]},
            "grid.start = [5, 8] lies inside a region of the issuer at [6, 8];",
        ),
        (
            {"issuer.position": [[6, 8], [1, 1]]},
            "issuer.position = [1, 1] leaves no start outside every region",
        ),
        (
            {"issuer.position": "anywhere", "regions.target_radius": 11},
            'grid.start = [0, 0] lies inside a region of the issuer at "anywhere"; accepted: a cell outside',
        ),
        (
            {"issuer.position": "anywhere", "grid.start": "anywhere", "regions.target_radius": 11},
            'issuer.position = "anywhere" leaves no start outside every region; accepted: smaller regions',
        ),
        # Regions
        ({"regions": {}}, "accepted: the keys uncomfortable_radius and target_radius, or the tables"),
        (
            {"regions.target": CIRCLE},
            "accepted: the keys uncomfortable_radius and target_radius, or the tables",
        ),
        (
            {"regions": {"uncomfortable_radius": 1}},
            "accepted: the keys uncomfortable_radius and target_radius",
        ),
        ({"regions": {"uncomfortable": CIRCLE}}, "accepted: the keys uncomfortable_radius and target_radius"),
        (
            {"regions": shapes(CIRCLE, CIRCLE)},
            "with the issuer at [6, 8], the target region has no cell that",
        ),
        ({"regions": shapes(CIRCLE, {"kind": "round"})}, "regions.target = "),
        ({"regions": shapes(CIRCLE, {"kind": "circle"})}, "the key regions.target.circle.radius is missing"),
        (
            {"regions": shapes(CIRCLE, CIRCLE | {"width": 1})},
            "[regions.target.circle]: unknown key width; accepted: kind, radius.",
        ),
        ({"regions": shapes(CIRCLE, {"kind": "egg", "front": 0})}, "regions.target.egg.front = 0"),
        ({"regions": shapes(mask("#.\nI"), CIRCLE)}, "cells: accepted: lines of equal length"),
        ({"regions": shapes(mask("II"), CIRCLE)}, 'cells: accepted: exactly one "I", the person'),
        ({"regions": shapes(mask("I?"), CIRCLE)}, 'of the characters "I", "#" and "."'),
        (
            {"regions": shapes(CIRCLE, mask("###I")) | {"unit": "metres"}},
            'unit = "metres": accepted: "cells", since a mask is drawn in cells',
        ),
        ({"regions.unit": "metres"}, 'unit = "metres": accepted: "cells", since radii are in cells'),
        (
            {"regions": shapes(CIRCLE, CIRCLE | {"radius": 2}) | {"unit": "metres"}},
            'regions.unit = "metres": needs grid.metres_per_cell',
        ),
        # Observation
        ({"observe": ["issuer"]}, "observe = ['issuer']: accepted: \"agent\", and other parts once each"),
        ({"observe": ["agent", "agent"]}, 'accepted: "agent", and other parts once each'),
        ({"observe": ["phase", "agent"]}, "accepted: in this order, ['agent', 'phase']"),
        ({"observe": ["agent", "zone"]}, 'observe.1 = "zone": input should be'),
        # Phases
        ({"phases": [{"name": "a"}]}, "phases.0 (a): accepted: steps in every phase, or next in every phase"),
        ({"phases": [{"name": "a", "steps": 1, "next": {}}]}, "phases.0 (a): accepted: steps in every phase"),
        (
            {"phases": [{"name": "a", "steps": 1}, {"name": "b", "next": {"a": 0.5}}]},
            "phases.1 (b): accepted: steps in every phase, or next in every phase",
        ),
        ({"phases": [{"name": "a", "steps": 1}] * 2}, "phases.0.name = a: accepted: another name"),
        ({"phases": [{"name": "a", "steps": 0}]}, "phases.0.steps = 0"),
        ({"phases": [{"name": "a", "stepps": 3}]}, "[phases.0]: unknown key stepps (did you mean steps?)"),
        (
            {"phases": [{"name": "a", "next": {"c": 0.5}}, {"name": "b", "next": {}}]},
            "phases.0.next: c is not another phase; accepted: b",
        ),
        ({"phases": [{"name": "a", "next": {"a": 0.5}}]}, "phases.0.next: a is not another phase"),
        ({"phases": [{"name": "a", "next": {"a": 0.0}}]}, "phases.0.next.a = 0.0"),
        (
            {"phases": [{"name": name, "next": {o: 0.6 for o in "abc" if o != name}} for name in "abc"]},
            "phases.0.next: the probabilities sum to more than 1; accepted: at most 1",
        ),
        ({"phases": [{"name": "a", "steps": 1, "position": [20, 0]}]}, "phases.0.position = [20, 0] is off"),
        ({"first_phase": "last"}, 'first_phase = "last"'),
        (
            {"issuer.position": "anywhere", "phases": [{"name": "a", "steps": 1, "position": [6, 8]}]},
            'phases with positions and issuer.position = "anywhere": accepted: a cell',
        ),
        # Walks
        ({"issuer.walk": {"corners": []}}, "issuer.walk.corners = []: accepted: at least 1 items"),
        ({"issuer.walk": {"corners": [[3, 3]]}}, "issuer.walk.corners: from [6, 8] to [3, 3]: accepted"),
        (
            {"issuer.walk": {"corners": [[6, 3], [4, 3]]}},
            "from [4, 3] to [6, 8]: accepted: another cell of the",
        ),
        ({"issuer.walk": {"corners": [[6, 30]]}}, "issuer.walk.corners = [6, 30] is off the grid"),
        (
            {"issuer.walk": {"corners": [[6, 3]]}, "phases": [{"name": "a", "steps": 1}]},
            "issuer.walk and phases: accepted: one of them",
        ),
        (
            {"issuer.walk": {"corners": [[6, 3]]}, "issuer.position": [[6, 8], [6, 7]]},
            "issuer.walk with issuer.position = [[6, 8], [6, 7]]: accepted: a cell",
        ),
        (
            {"issuer.walk": {"corners": [[6, 3]]}, "issuer.feedback": {"kind": "delayed"}},
            'feedback.kind = "delayed" with an issuer that moves: accepted: any other kind',
        ),
        ({"issuer.walk": {"corners": [[6, 3]]}, "others": [person([6, 5])]}, "corners = [6, 5] is taken by"),
        # Other people
        ({"others": [person([6, 8])]}, "issuer.position = [6, 8] is taken by another person"),
        ({"others": [person([2, 8])] * 2}, "others.0.position = [2, 8] is taken by another person"),
        (
            {"others": [person([2, 8])] * 2, "issuer.position": "anywhere"},
            "others.0.position = [2, 8] is taken",
        ),
        ({"others": [person([0, 0])]}, "grid.start = [0, 0] is taken by another person"),
        (
            {"others": [person([0, 1])]},
            "of the issuer at [6, 8] or of another person; accepted: a cell outside",
        ),
        ({"others": [person([2, 20])]}, "others.0.position = [2, 20] is off the grid"),
        ({"others": [{"position": [2, 8]}]}, "the key others.0.feedback is missing"),
        (
            {"others": [person([2, 8]) | {"walk": {}}]},
            "[others.0]: unknown key walk; accepted: feedback, heading, position, regions.",
        ),
        (
            {"ping_limit": 50, "issuer.position": "anywhere", "issuer.feedback": {"kind": "delayed"}},
            "120 cells (grid.rows x grid.columns) x 50 wrong PINGs (ping_limit) x 120 cells for the issuer "
            "(issuer.position) x 2 cases, with and without pending feedback (issuer.feedback) = 1440000 "
            "states",
        ),
    ],
)
def test_mistakes_get_one_sentence(changes: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError) as caught:
        load_scenario("S1", changes)
    message = str(caught.value)
    assert expected in message
    assert "S1.toml" in message
    assert "\n" not in message


def test_missing_key_is_named(tmp_path: Path) -> None:
    text = (SCENARIO_DIRECTORY / "S1.toml").read_text().replace("ping_limit = 5", "")
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(InputError, match=r"mine\.toml: the key ping_limit is missing"):
        load_scenario(tmp_path / "mine.toml")


def test_unreadable_files_get_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read: No such file"):
        load_scenario(tmp_path / "nothing.toml")
    (tmp_path / "broken.toml").write_text("grid = [")
    with pytest.raises(InputError, match="not valid TOML"):
        load_scenario(tmp_path / "broken.toml")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="not UTF-8"):
        load_scenario(tmp_path / "bytes.toml")


def test_misnamed_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "my scene.toml"
    path.write_text((SCENARIO_DIRECTORY / "S1.toml").read_text())
    with pytest.raises(
        InputError, match=r"my scene\.toml: .* named after the file; .* letters, digits, _ and -"
    ):
        load_scenario(path)


@pytest.mark.parametrize("name", ["my scene", "a.b", "..", "_x", "é", "a/b", "1", "NA", "x" * 61, ""])
def test_a_mapping_is_named_by_the_same_rule(name: str) -> None:
    with pytest.raises(InputError, match=r"name = .*: accepted: a name of at most 60 letters"):
        load_scenario(S1 | {"name": name})
    assert load_scenario(S1 | {"name": "my-scene_2"}).name == "my-scene_2"


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (
            {"description": "\x1b]0;x"},
            'description = "\\u001b]0;x": accepted: text without control characters',
        ),
        ({"\x1b": 1}, 'the key "\\u001b": accepted: text without control characters'),
        (
            {"phases": [{"name": "a\nb", "steps": 1}]},
            'phases.0.name = "a\\nb": accepted: text in one line, without tabs',
        ),
        (
            {"phases": [{"name": "a\x07b", "steps": 1}]},
            'phases.0.name = "a\\u0007b": accepted: text without control',
        ),
    ],
)
def test_texts_cannot_take_over_a_terminal(changes: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError) as caught:
        load_scenario("S1", changes)
    assert expected in str(caught.value)
    assert str(caught.value).isprintable()


def test_mapping_is_accepted_and_checked() -> None:
    scenario = load_scenario("S2", {"ping_limit": 3})
    assert load_scenario(scenario.model_dump()) == scenario
    assert load_scenario(S1, {"grid.rows": 20}) == load_scenario("S1", {"grid.rows": 20})
    with pytest.raises(InputError, match=r"^S1: grid.rows = 0"):
        load_scenario(S1, {"grid.rows": 0})
    with pytest.raises(InputError, match=r"^scenario: the key name is missing"):
        load_scenario({key: value for key, value in S1.items() if key != "name"})


def test_unknown_scenario_names_the_nearest() -> None:
    with pytest.raises(InputError, match="unknown scenario s1"):
        load_scenario("s1")


def test_another_file_is_accepted(tmp_path: Path) -> None:
    path = tmp_path / "corridor.toml"
    path.write_text((SCENARIO_DIRECTORY / "S1.toml").read_text().replace("rows = 10", "rows = 20"))
    scenario = load_scenario(path)
    assert scenario.name == "corridor"
    assert scenario.grid.rows == 20


feedback = st.one_of(
    st.just({"kind": "none"}),
    st.just({"kind": "distance"}),
    st.tuples(st.integers(-3, 3), st.integers(-3, 3)).map(
        lambda bounds: {"kind": "uniform", "low": bounds[0], "high": bounds[1]}
    ),
)
coordinate = st.integers(-2, 9)


@given(
    rows=st.integers(-1, 8),
    columns=st.integers(-1, 8),
    start=st.tuples(coordinate, coordinate).map(list),
    issuer=st.tuples(coordinate, coordinate).map(list),
    radii=st.tuples(st.integers(-1, 3), st.integers(-1, 4)),
    ping_limit=st.integers(-1, 4),
    feedback=feedback,
)
def test_any_scenario_compiles_or_is_refused_in_a_sentence(
    rows: int,
    columns: int,
    start: list[int],
    issuer: list[int],
    radii: tuple[int, int],
    ping_limit: int,
    feedback: dict[str, Any],
) -> None:
    data = override(
        S1,
        {
            "grid.rows": rows,
            "grid.columns": columns,
            "grid.start": start,
            "issuer.position": issuer,
            "issuer.feedback": feedback,
            "regions.uncomfortable_radius": radii[0],
            "regions.target_radius": radii[1],
            "ping_limit": ping_limit,
        },
        "drawn",
    )
    inside = 0 <= start[0] < rows and 0 <= start[1] < columns and 0 <= issuer[0] < rows
    distance = max(abs(start[0] - issuer[0]), abs(start[1] - issuer[1]))
    sound = (
        inside
        and 0 <= issuer[1] < columns
        and 0 <= radii[0] < radii[1] < distance
        and ping_limit >= 1
        and (feedback["kind"] != "uniform" or feedback["low"] < feedback["high"])
    )
    if not sound:
        with pytest.raises(InputError, match=r"^drawn: [^\n]*\.$"):
            parse(Scenario, data, "drawn")
        return
    model = compile_scenario(parse(Scenario, data, "drawn"))
    n_states = rows * columns * ping_limit
    assert model.next_state.shape == (n_states, len(ACTIONS), 1)
    assert model.next_state.min() >= 0
    assert model.next_state.max() < n_states
    assert np.isfinite(model.grid_reward + model.issuer_reward).all()
    assert (model.zone_of_cell == ZONES.index("issuer")).sum() == 1
    assert (model.zone_of_cell == ZONES.index("target")).any()
    assert ZONES[model.zone[model.start]] == "outside"
    # No wall is crossed and no step is longer than one: rows and columns change by at most one, together.
    row, column = np.divmod(model.observation, columns)
    next_row, next_column = (x[model.next_state[:, :, 0]] for x in (row, column))
    assert (abs(next_row - row[:, None]) + abs(next_column - column[:, None])).max() <= 1
    # Wrong PINGs never fall, and rise by at most one.
    pings = np.arange(n_states) // (rows * columns)
    assert np.isin(pings[model.next_state[:, :, 0]] - pings[:, None], [0, 1]).all()
