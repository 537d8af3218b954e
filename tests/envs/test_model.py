"""The compiled model against the paper's text, every state and action."""

import pickle

import numpy as np
import pytest

from envs import ACTIONS, EVENTS, compile_scenario, load_scenario


@pytest.mark.parametrize(
    ("name", "feedback"),
    [
        ("S1", {"kind": "none"}),
        ("S2", {"kind": "uniform", "low": -1, "high": 1}),
        ("S3", {"kind": "distance"}),
    ],
)
def test_tables_are_those_of_the_paper(name: str, feedback: dict[str, object]) -> None:
    """`test_dynamics` compares the models with the tables, `test_regions` the zones with the paper."""
    scenario = load_scenario(name)
    assert (scenario.grid.size, scenario.grid.start, scenario.issuer.position) == ((10, 12), (0, 0), (6, 8))
    assert (scenario.ping_limit, scenario.issuer.feedback.model_dump()) == (5, feedback)
    assert scenario.rewards.model_dump() == {
        "issuer_reached": -1.0,
        "target_ping": 1.0,
        "last_wrong_ping": -1.0,
        "wrong_ping": -0.4,
        "wrong_ping_uncomfortable": -0.4,
        "uncomfortable": -0.8,
        "other": -0.1,
    }


def test_fresh_states_have_no_wrong_ping_and_states_that_are_over_absorb() -> None:
    model = compile_scenario(load_scenario("S1", {"grid.rows": 12, "grid.columns": 13, "ping_limit": 3}))
    assert (model.observation[model.fresh_state] == np.arange(12 * 13)).all()
    wrong = model.event[model.fresh_state, ACTIONS.index("PING")] == EVENTS.index("wrong_ping")
    assert (model.wrong_pings[model.fresh_state, ACTIONS.index("PING")][wrong] == 1).all()
    assert wrong.sum() == 12 * 13 - 16 - 1  # every cell but the target region's and the issuer's
    stays = model.next_state[:, :, 0] == np.arange(len(model.next_state))[:, None]
    assert (model.is_over == (stays & model.terminated).all(axis=1)).all()


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
