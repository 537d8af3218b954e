"""The compiled model against the paper's text, every state and action."""

import pickle

import numpy as np
import pytest

from envs import ACTIONS, EVENTS, ZONES, compile_scenario, load_scenario

SCENARIOS = ("S1", "S2", "S3")
STEP = {"UP": (-1, 0), "DOWN": (1, 0), "LEFT": (0, -1), "RIGHT": (0, 1)}


def paper_zone(row: int, column: int) -> str:
    distance = max(abs(row - 6), abs(column - 8))
    return {0: "issuer", 1: "uncomfortable", 2: "target"}.get(distance, "outside")


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_state_and_action_follows_the_reward_table(name: str) -> None:
    model = compile_scenario(load_scenario(name))
    assert len(model.observation) == 600
    assert model.start == 0
    for pings in range(5):
        for row in range(10):
            for column in range(12):
                state = pings * 120 + row * 12 + column
                zone = paper_zone(row, column)
                assert ZONES[model.zone[state]] == zone
                assert model.observation[state] == row * 12 + column
                if zone == "issuer":  # the episode is over: absorbing, worth nothing
                    assert (model.next_state[state] == state).all()
                    assert not model.grid_reward[state].any()
                    assert not model.issuer_reward[state].any()
                    assert model.terminated[state].all()
                    continue
                for action, name_of_action in enumerate(ACTIONS):
                    cell, reward, over, event, wrong = (row, column), 0.0, False, "", 0
                    if name_of_action == "PING":
                        if zone == "target":
                            reward, over, event = 1.0, True, "target_ping"
                        elif pings == 4:
                            reward, over, event, wrong = -1.0, True, "last_wrong_ping", 1
                        else:
                            reward, event, wrong = -0.4, "wrong_ping", 1
                    else:
                        moved = row + STEP[name_of_action][0], column + STEP[name_of_action][1]
                        if 0 <= moved[0] < 10 and 0 <= moved[1] < 12:
                            cell = moved
                        entered = paper_zone(*cell)
                        if entered == "issuer":
                            reward, over, event = -1.0, True, "issuer_reached"
                        elif entered == "uncomfortable":
                            reward, event = -0.8, "uncomfortable"
                        else:
                            reward, event = -0.1, "move"
                    assert model.grid_reward[state, action] == reward
                    assert model.terminated[state, action] == over
                    assert EVENTS[model.event[state, action]] == event
                    assert model.wrong_pings[state, action] == pings + wrong
                    following = model.next_state[state, action, 0]
                    assert following == min(pings + wrong, 4) * 120 + cell[0] * 12 + cell[1]
                    is_ping = name_of_action == "PING"
                    distance = abs(row - 6) + abs(column - 8)
                    mean = -distance / 14 if name == "S3" and is_ping else 0.0
                    assert model.issuer_reward[state, action] == pytest.approx(mean, abs=1e-15)
                    assert model.issuer_noise[state, action] == (1.0 if name == "S2" and is_ping else 0.0)


def test_fresh_states_have_no_wrong_ping_and_states_that_are_over_absorb() -> None:
    model = compile_scenario(load_scenario("S1", {"grid.rows": 12, "grid.columns": 13, "ping_limit": 3}))
    assert (model.observation[model.fresh_state] == np.arange(12 * 13)).all()
    wrong = model.event[model.fresh_state, ACTIONS.index("PING")] == EVENTS.index("wrong_ping")
    assert (model.wrong_pings[model.fresh_state, ACTIONS.index("PING")][wrong] == 1).all()
    assert wrong.sum() == 12 * 13 - 16 - 1  # every cell but the target region's and the issuer's
    row, column = model.position.T
    assert (row * 13 + column == np.arange(12 * 13)).all()
    stays = model.next_state[:, :, 0] == np.arange(len(model.next_state))[:, None]
    assert (model.is_over == (stays & model.terminated).all(axis=1)).all()


def test_reading_of_the_origin_cuts_the_target_region() -> None:
    model = compile_scenario(load_scenario("S1", {"issuer.position": [8, 6]}))
    assert (model.zone_of_cell == ZONES.index("target")).sum() == 11  # 16 less the row that is off the grid


def test_mirrored_scenario_gives_the_mirrored_model() -> None:
    model = compile_scenario(load_scenario("S3"))
    mirrored = compile_scenario(load_scenario("S3", {"grid.start": [0, 11], "issuer.position": [6, 3]}))
    pings, cell = np.divmod(np.arange(600), 120)
    row, column = np.divmod(cell, 12)
    image = pings * 120 + row * 12 + (11 - column)
    swap = [0, 1, 3, 2, 4]  # LEFT for RIGHT
    assert (mirrored.next_state[image][:, swap] == image[model.next_state]).all()
    for array in ("grid_reward", "issuer_reward", "issuer_noise", "terminated", "event"):
        assert (getattr(mirrored, array)[image][:, swap] == getattr(model, array)).all()


def test_transition_table_has_the_rewards_of_the_model() -> None:
    model = compile_scenario(load_scenario("S3"))
    for state, actions in model.P.items():
        for action, ((chance, following, reward, terminated),) in actions.items():
            assert (chance, following) == (1.0, model.next_state[state, action, 0])
            assert reward == model.grid_reward[state, action] + model.issuer_reward[state, action]
            assert terminated == model.terminated[state, action]


def test_models_are_shared_read_only_and_pickle_small() -> None:
    model = compile_scenario(load_scenario("S1"))
    assert compile_scenario(load_scenario("S1")) is model
    with pytest.raises(ValueError, match="read-only"):
        model.grid_reward[0, 0] = 1.0
    assert len(pickle.dumps(model)) < 5000
    assert pickle.loads(pickle.dumps(model)) is model
