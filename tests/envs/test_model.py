"""The compiled model against the paper's text, every state and action."""

import pickle

import numpy as np
import pytest

from envs import Model, Scenario, compile_scenario, load_scenario
from envs.model import _compile


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


def model_of(scenario: Scenario) -> Model:
    """Compiles a scenario anew."""
    model: Model = _compile.__wrapped__(scenario)
    return model


def assert_same_arrays(ours: Model, theirs: Model) -> None:
    for our, their in ((ours, theirs), *zip(ours.components, theirs.components, strict=True)):
        for name, values in vars(our).items():
            if isinstance(values, np.ndarray):
                assert values.dtype == getattr(their, name).dtype
                np.testing.assert_array_equal(values, getattr(their, name), name)


def test_compiling_in_chunks_makes_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    others = [{"position": [0, 1], "walk": {"corners": [[0, 3]]}}]
    changes = {
        "issuer.places": 7,
        "issuer.feedback": {"kind": "uniform", "low": -1, "high": 0},
        "others": others,
    }
    scenario = load_scenario("TwoTalking", changes)
    whole = model_of(scenario)
    assert len(whole.observation) == 7 * 4 * 5 * 120
    for n_states in (5000, 1):  # two places at once, and one
        monkeypatch.setattr("envs.model._STATES_AT_ONCE", n_states)
        assert_same_arrays(model_of(scenario), whole)
        large = compile_scenario(scenario)
        assert compile_scenario(scenario) is large
        assert_same_arrays(large, whole)
