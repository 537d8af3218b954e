"""The compiled model against the paper's text, every state and action."""

import pickle
from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from agents.process import process_of
from envs import Model, Scenario, compile_scenario, load_scenario
from envs.model import _compile
from envs.scene import scene_of
from envs.tiles import tiles_of
from tests.support import few_places


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


def arrays_of(value: Any, seen: set[int]) -> Iterator[NDArray[Any]]:
    """Yields all arrays that can be reached from a model, those kept with it included."""
    if id(value) in seen or isinstance(value, str):
        return
    seen.add(id(value))
    if isinstance(value, np.ndarray):
        yield value
        return
    within: list[Any] = [*value.values()] if isinstance(value, dict) else []
    if isinstance(value, tuple | list):
        within = [*value]
    elif type(value).__module__.startswith("envs."):
        of_class = [item for cls in type(value).__mro__ for item in vars(cls).items()]
        kept = [name for name, item in of_class if isinstance(item, cached_property)]
        within = [getattr(value, name) for name in {*vars(value), *kept}]
    for each in within:
        yield from arrays_of(each, seen)


@pytest.mark.parametrize("name", ["S1", "Moody", "TwoStrangers", "TwoTalking"])
def test_nobody_can_change_a_model_that_others_share(name: str) -> None:
    model = compile_scenario(load_scenario(name, few_places(name)))
    tiles_of(model, 2, 3), scene_of(model), process_of(model)
    arrays = [*arrays_of(model, set())]
    assert len(arrays) > 40
    assert not any(array.flags.writeable for array in arrays)
