"""The compiled model against the paper's text, every state and action."""

import pickle

import pytest

from envs import compile_scenario, load_scenario


@pytest.mark.parametrize(
    ("name", "feedback"),
    [
        ("S1", {"kind": "none"}),
        ("S2", {"kind": "uniform", "low": -1, "high": 1}),
        ("S3", {"kind": "distance"}),
    ],
)
def test_tables_are_those_of_the_paper(name: str, feedback: dict[str, object]) -> None:
    """`test_dynamics` compares models with the tables, `test_regions` zones with the paper."""
    scenario = load_scenario(name)
    assert (scenario.grid.size, scenario.grid.start, scenario.issuer.position) == (
        (10, 12),
        (0, 0),
        (6, 8),
    )
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


def test_models_are_shared_read_only_and_pickle_and_print_small() -> None:
    model = compile_scenario(load_scenario("S1"))
    assert repr(model) == "<Model of S1>"
    assert compile_scenario(load_scenario("S1")) is model
    with pytest.raises(ValueError, match="read-only"):
        model.grid_reward[0, 0] = 1.0
    assert len(pickle.dumps(model)) < 5000
    assert pickle.loads(pickle.dumps(model)) is model
