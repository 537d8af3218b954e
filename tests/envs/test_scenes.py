"""Scenes beyond the paper, by hand: walls, phases, walks, several people, feedback and starts."""

from typing import Any

import pytest

from agents.dynamic_programming import largest_success
from envs import EVENTS, ZONES, ProxemicEnv, compile_scenario, load_scenario, scenario_names
from envs.model import PING, Model
from tests.support import few_places

UP, DOWN, LEFT, RIGHT = range(4)


def compiled(overrides: dict[str, Any], name: str = "S1") -> Model:
    return compile_scenario(load_scenario(name, overrides))


def cell(row: int, column: int) -> int:
    return row * 12 + column


def test_scenes_have_the_rewards_of_the_paper_and_are_small() -> None:
    assert len({load_scenario(name).rewards for name in scenario_names()}) == 1
    for name in set(scenario_names()) - {"Anywhere", "AnywhereHidden", "Crowd"}:
        assert len(compile_scenario(load_scenario(name, few_places(name))).observation) <= 40_000


def test_walls_stop_the_agent() -> None:
    model = compile_scenario(load_scenario("Walls"))
    assert model.next_state[cell(6, 3), RIGHT, 0] == cell(6, 3)
    assert model.next_state[cell(7, 3), RIGHT, 0] == cell(7, 4)  # the door
    assert model.next_state[cell(1, 10), DOWN, 0] == cell(2, 10)  # the other door
    assert model.scenario.grid.is_wall.sum() == 9 + 6  # ten cells less the door, and seven less the door


def test_the_walker_waits_for_the_agent_and_bumps_into_nobody() -> None:
    model = compile_scenario(load_scenario("Walking"))
    ahead = 1 * 600 + cell(3, 5)  # second tick: the issuer in [3, 4] is about to enter the agent's cell
    assert ZONES[model.zone[ahead]] == "uncomfortable"
    for action in (UP, DOWN, RIGHT):  # the agent makes way
        state = int(model.next_state[ahead, action, 0])
        assert model.context[state] == 1
    state = int(model.next_state[ahead, PING, 0])  # it stays, so the issuer waits
    assert (state, model.context[state]) == (ahead + 120, 0)
    assert EVENTS[model.event[ahead, LEFT]] == "issuer_reached"
    # Nobody but the agent ends an episode: a move that goes on never ends in a person's cell.
    following = model.next_state[~model.terminated]
    assert (model.zone[following] != ZONES.index("issuer")).all()


def test_a_way_that_is_open_at_times_is_a_way() -> None:
    walls = "\n".join(["...#........"] * 6 + ["............"] + ["...#........"] * 3)
    guard = {"position": [6, 3], "walk": {"corners": [[6, 5]]}}  # in the door, and two cells behind
    assert largest_success(compiled({"grid.walls": walls, "others": [guard]}), 200) == 1.0


def test_feedback_is_relative_to_the_farthest_start_of_the_same_place() -> None:
    model = compiled({"grid.start": [[0, 0], [9, 0]], "issuer.position": [[6, 8], [2, 3]]}, "S3")
    per_place = model.issuer_reward.reshape(2, 5, 120, 5)[:, 0, :, PING]
    assert per_place[0, cell(6, 6)] == pytest.approx(-2 / 14)  # [0, 0] is 14 away, [9, 0] 11
    assert per_place[1, cell(2, 5)] == pytest.approx(-2 / 10)  # [9, 0] is 10 away, [0, 0] 5
    # The agent starts where the issuer stands in the first phase, but only in the second: 14 cells away.
    phases = [{"name": "a", "steps": 1, "position": [0, 0]}, {"name": "b", "steps": 1, "position": [6, 8]}]
    moving = compiled({"phases": phases, "first_phase": "any"}, "S3")
    assert moving.issuer_reward[600 + cell(6, 6), PING] == pytest.approx(-2 / 14)


def test_text_shows_agent_walls_people_and_phase() -> None:
    def text(name: str, state: int = 0) -> list[str]:
        env = ProxemicEnv(name, render_mode="ansi")
        env.s = state
        return str(env.render()).splitlines()

    walls = text("Walls")
    assert (walls[0], walls[2]) == ("A . . . # . . . . . . .", ". . . . # # # # # # . #")
    assert len(walls) == 11  # there is a single phase
    assert text("TwoPeople")[2] == ". . . . . . . + x x I x"
    expected = {"calm": "+ x I x + .", "tense": "x x I x x +", "cheerful": ". + I + . ."}
    for phase, (name, line) in enumerate(expected.items()):
        lines = text("Moody", phase * 600)
        assert lines[-2:] == [f"phase: {name}", "event: none"]
        assert lines[6].endswith(line)
