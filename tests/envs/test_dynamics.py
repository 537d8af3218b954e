"""The model of any scenario against a second implementation, and the envs against the model."""

import math
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from envs import (
    ACTIONS,
    EVENTS,
    ZONES,
    InputError,
    Model,
    ProxemicEnv,
    Scenario,
    compile_scenario,
    load_scenario,
    scenario_names,
)
from envs.inputs import override, read_toml
from envs.observations import observation_ones, observation_table
from envs.scenario import SCENARIO_DIRECTORY
from tests.envs.reference import Reference, Tables

MAX_STATES = 600  # of a shipped scenario that a test compares: all of S1 to S3
REWARDS = read_toml(SCENARIO_DIRECTORY / "S1.toml")["rewards"] | {"wrong_ping_uncomfortable": -0.6}
FACTS = "grid_reward", "issuer_noise", "terminated", "event", "wrong_pings"
heading = st.sampled_from(["up", "down", "left", "right"])
feedback = st.one_of(
    st.fixed_dictionaries({"kind": st.sampled_from(["none", "distance", "delayed"])}),
    st.fixed_dictionaries(
        {"kind": st.sampled_from(["uniform", "binary"]), "low": st.just(-1.5), "high": st.just(1)}
    ),
)


def shape(lengths: list[float]) -> st.SearchStrategy[Tables]:
    length = st.sampled_from(lengths)
    return st.one_of(
        st.fixed_dictionaries({"kind": st.sampled_from(["square", "circle"]), "radius": length}),
        st.fixed_dictionaries({"kind": st.just("egg"), "front": length}),
    )


def cells(rows: int, columns: int) -> st.SearchStrategy[list[int]]:
    return st.tuples(st.integers(0, rows - 1), st.integers(0, columns - 1)).map(list)


@st.composite
def regions(draw: st.DrawFn) -> Tables:
    if draw(st.booleans()):
        radius = draw(st.integers(0, 1))
        return {"uncomfortable_radius": radius, "target_radius": radius + 1}
    shapes = {"uncomfortable": draw(shape([0.5, 1, 1.2])), "target": draw(shape([1, 1.5, 2.5]))}
    return shapes | ({"unit": "metres"} if draw(st.booleans()) else {})


@st.composite
def walk(draw: st.DrawFn, size: tuple[int, int], position: list[int]) -> Tables:
    (row, column) = position
    to_row = (row + draw(st.integers(1, size[0] - 1))) % size[0]
    to_column = (column + draw(st.integers(1, size[1] - 1))) % size[1]
    corners = [[row, to_column], [to_row, to_column], [to_row, column]]
    n_corners = draw(st.sampled_from([1, 3]))
    return {"walk": {"corners": corners[:n_corners], "steps": draw(st.integers(1, 2))}}


@st.composite
def changes(
    draw: st.DrawFn, kind: str, size: tuple[int, int], position: Any
) -> tuple[Tables, Tables]:
    """Draws what is added to the issuer's table, and to the scenario's: a walk, or phases."""
    if kind in ("none", "others walk"):
        return {}, {}
    if kind == "walk":
        return draw(walk(size, position)), {}
    optional: dict[str, st.SearchStrategy[Any]] = {"heading": heading, "regions": regions()}
    optional |= {"position": cells(*size)} if isinstance(position[0], int) else {}
    phases = draw(st.lists(st.fixed_dictionaries({}, optional=optional), min_size=1, max_size=3))
    for name, phase in zip("abc", phases, strict=False):
        others = [other for other in "abc"[: len(phases)] if other != name]
        phase["name"] = name
        if kind == "schedule":
            phase["steps"] = draw(st.integers(1, 2))
        else:
            chance = st.sampled_from([0.1, 0.25, 0.5])
            phase["next"] = draw(st.dictionaries(st.sampled_from(others), chance)) if others else {}
    return {}, {"phases": phases, "first_phase": draw(st.sampled_from(["first", "any"]))}


@st.composite
def scenarios(draw: st.DrawFn) -> Tables:
    rows, columns = draw(st.integers(3, 5)), draw(st.integers(3, 5))
    cell = cells(rows, columns)
    place = st.one_of(cell, st.lists(cell, min_size=1, max_size=3), st.just("anywhere"))
    walls = draw(
        st.lists(st.sampled_from("......#"), min_size=rows * columns, max_size=rows * columns)
    )
    lines = ["".join(walls[i : i + columns]) for i in range(0, rows * columns, columns)]
    kind = draw(st.sampled_from(["none", "walk", "others walk", "schedule", "chain"]))
    is_group = kind != "walk" and draw(st.booleans())
    position = draw(cell if kind == "walk" else st.just("anywhere") if is_group else place)
    of_issuer, of_scenario = draw(changes(kind, (rows, columns), position))
    other = st.fixed_dictionaries(
        {"position": cell, "feedback": feedback, "regions": regions()},
        optional={"heading": heading},
    )
    bystander: st.SearchStrategy[Tables] = st.fixed_dictionaries({"position": cell})
    do_walk = kind == "others walk"
    others: list[Tables] = draw(st.lists(bystander | other, min_size=int(do_walk), max_size=2))
    for person in others if do_walk or kind == "walk" else []:
        person |= draw(walk((rows, columns), person["position"]))
    of_group, around = {}, draw(regions())
    if is_group:
        apart = draw(st.sampled_from([[1, 1.7], [0, 2], [1.5, 2.3]]))
        of_group = {"group": {"people": draw(st.sampled_from([2, 2, 3])), "apart": apart}}
        later = [phase["regions"] for phase in of_scenario.get("phases", []) if "regions" in phase]
        for its in [each for each in (around, *later) if "target" in each and draw(st.booleans())]:
            its["target"] = {"kind": "ring", "width": draw(st.sampled_from([0.8, 1, 1.6]))}
    return {
        "name": "drawn",
        "description": "",
        "grid": {
            "rows": rows,
            "columns": columns,
            "start": draw(
                st.just("anywhere") if is_group else st.one_of(st.just("anywhere"), place)
            ),
            "walls": "\n".join(lines) if not do_walk and draw(st.integers(0, 2)) == 0 else "",
            "metres_per_cell": 0.8,
        },
        "issuer": {"position": position, "feedback": draw(feedback), "heading": draw(heading)}
        | of_issuer,
        "regions": around,
        "ping_limit": draw(st.integers(1, 3)),
        "rewards": REWARDS,
        "observe": [
            "agent",
            *sorted(draw(st.sets(st.sampled_from(["issuer", "phase", "wrong_pings"])))),
        ],
        "others": others,
    } | (of_scenario | of_group)


def assert_follows_the_tables(scenario: Scenario, tables: Tables, n_steps: int) -> None:
    """Compares states, with all actions and observations, with the second implementation."""
    model = compile_scenario(scenario)
    assert_env_agrees(model, n_steps)
    reference = Reference(tables, scenario.layout.places)
    assert list(scenario.layout.places) == reference.places
    phases, n_pings, n_cells = (
        range(len(reference.phases)),
        tables["ping_limit"],
        len(reference.cells),
    )
    shape = len(reference.places), len(reference.clock), 1 + reference.is_delayed, n_pings, n_cells
    assert len(model.observation) == math.prod(shape)
    stands = {
        (j, p): tuple(
            tuple(person["position"]) for person in reference.people(place, p)[: len(place)]
        )
        for j, place in enumerate(reference.places)
        for p in phases
    }
    values = sorted({*stands.values()})
    cells = sorted({cell for place in values for cell in place})
    blocks, coordinates = (
        observation_ones(model, "one_hot")[0],
        observation_table(model, "coordinates"),
    )
    one_hot = observation_table(model, "one_hot")

    def index(state: tuple[Any, ...]) -> int:
        *rest, (row, column) = state
        return int(np.ravel_multi_index((*rest, row * tables["grid"]["columns"] + column), shape))

    def scaled(cell: Any) -> list[float]:
        sizes = tables["grid"]["rows"], tables["grid"]["columns"]
        return [n / max(size - 1, 1) for n, size in zip(cell, sizes, strict=True)]

    assert model.starts.tolist() == [index(state) for state in reference.starts]
    some = 60 if scenario.name == "drawn" else MAX_STATES
    for at in sorted(np.random.default_rng(0).permutation(len(model.observation))[:some].tolist()):
        j, tick, late, pings, c = map(int, np.unravel_index(at, shape))
        agent, phase = reference.cells[c], reference.clock[tick]
        zone = reference.zone(reference.places[j], phase, agent)
        assert ZONES[model.zone[at]] == zone
        is_over = zone == "issuer" or agent in reference.walls
        assert model.is_over[at] == is_over
        for action in range(len(ACTIONS)):
            following, chances = model.next_state[at, action], model.probability[at, action]
            assert chances.min() >= 0
            found = np.bincount(following, chances, len(model.observation))
            if is_over:
                expected, facts = {at: 1.0}, (0.0, 0.0, 0.0, True, "none", pings)
            else:
                states, facts = reference.step((j, tick, bool(late), pings, agent), action)
                expected = {index(state): p for state, p in states.items()}
            found[[*expected]] -= np.array([*expected.values()])
            assert np.abs(found).max() < 1e-12
            reward, mean, noise, ends, event, after = facts
            assert abs(model.issuer_reward[at, action] - mean) < 1e-12
            found_facts = [getattr(model, name)[at, action] for name in FACTS]
            assert found_facts == [reward, noise, ends, EVENTS.index(event), after]

        # What is observed: value, number of values, columns of the one-hot block, its width, and
        # coordinates
        group, n_phases = stands[j, phase], len(phases)
        spots, shown = (
            [cells.index(cell) for cell in group],
            [n for cell in group for n in scaled(cell)],
        )
        known: dict[str, tuple[int, int, list[int], int, list[float]]] = {
            "agent": (c, n_cells, [c], n_cells, scaled(agent)),
            "issuer": (values.index(group), len(values), spots, len(cells), shown),
            "phase": (phase, n_phases, [phase], n_phases, [phase / max(n_phases - 1, 1)]),
            "wrong_pings": (pings, n_pings, [pings], n_pings, [pings / max(n_pings - 1, 1)]),
        }
        number, size, width, columns, coordinate = 0, 1, 0, [], []
        for part in tables["observe"]:
            value, n_values, ones, its_width, numbers = known[part]
            number, size = number + size * value, size * n_values
            columns += [width + one for one in ones]
            width += its_width
            coordinate += numbers
        assert (model.n_observations, model.observation[at]) == (size, number)
        assert blocks[number].tolist() == np.flatnonzero(one_hot[number]).tolist() == columns
        assert one_hot.shape[1] == width
        assert np.abs(coordinates[number] - coordinate).max() < 1e-6


def assert_env_agrees(model: Model, n_steps: int) -> None:
    """Walks through the env, and compares it with the arrays."""
    env, terminated = ProxemicEnv(model.scenario), True
    actions = np.random.default_rng(4)
    for step in range(n_steps):
        if terminated:
            observation, info = env.reset(seed=3 if step == 0 else None)
            assert env.s in model.starts
            assert (observation, info["zone"]) == (model.observation[env.s], ZONES.index("outside"))
        at = env.s, int(actions.integers(len(ACTIONS)))
        observation, reward, terminated, _, info = env.step(at[1])
        assert env.s in model.next_state[at][model.probability[at] > 0]
        assert (observation, info["zone"]) == (model.observation[env.s], model.zone[env.s])
        assert abs(info["issuer_reward"] - model.issuer_reward[at]) <= model.issuer_noise[at]
        assert reward == model.grid_reward[at] + info["issuer_reward"]
        assert (terminated, info["event"]) == (model.terminated[at], model.event[at])
        assert info["wrong_pings"] == model.wrong_pings[at]


@settings(max_examples=100, suppress_health_check=[HealthCheck.too_slow])
@given(scenarios())
def test_any_scenario_follows_its_tables_or_is_refused_in_a_sentence(tables: Tables) -> None:
    refusal = ""
    try:
        scenario = load_scenario(tables)
    except InputError as error:
        refusal = str(error)
    if refusal:
        assert re.fullmatch(r"(drawn: .*[^.]\.(\n|$))+", refusal)  # a line for each mistake
        return
    assert_follows_the_tables(scenario, tables, 40)


@pytest.mark.parametrize(
    "name", [name for name in scenario_names() if name not in ("Crowd", "Badges")]
)
def test_shipped_scenarios_follow_their_tables(name: str) -> None:
    tables = {"name": name, "observe": ["agent"]} | read_toml(SCENARIO_DIRECTORY / f"{name}.toml")
    if "group" in tables:  # five ways to stand in a small room
        tables = override(tables, {"grid.rows": 7, "grid.columns": 8, "issuer.places": 5}, name)
    elif tables["issuer"]["position"] == "anywhere":
        tables = override(tables, {"issuer.places": 10}, name)
    assert_follows_the_tables(load_scenario(tables), tables, 300)
