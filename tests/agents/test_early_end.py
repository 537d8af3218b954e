"""Training that may end early: what comes before is the same, and what follows is as it was then."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence
from numpy.typing import NDArray

from agents import Schedule, load_algorithm
from envs import load_scenario
from envs.inputs import parse
from envs.observations import compile_seen

STEPS = (0, 100, 200, 300, 400, 500, 700, 1000)


@pytest.mark.parametrize("algorithm", ["compiled_dqn", "compiled_ppo", "dqn", "ppo"])
def test_an_early_end(algorithm: str) -> None:
    method = load_algorithm(algorithm)
    own = {"n_steps": 100, "batch_size": 50, "n_epochs": 2} if "ppo" in algorithm else {"learning_starts": 50}
    settings = parse(method.settings, own | {"budget": 1000, "policy_kwargs": {"net_arch": [8]}}, "test")
    model = compile_seen(load_scenario("S1"), "coordinates")
    schedule = Schedule(1000, STEPS)
    asked: list[NDArray[np.float64]] = []

    def may_end(i: int, table: NDArray[np.float64]) -> bool:
        assert i == len(asked)
        asked.append(table)
        return STEPS[i] == 400

    whole, ended = (
        method.train(model, settings, "coordinates", [SeedSequence(3)], each)
        for each in (schedule, replace(schedule, may_end=may_end))
    )
    n = STEPS.index(400) + 1
    assert len(asked) == n
    np.testing.assert_array_equal([1 << table.argmax(axis=1) for table in asked], ended.greedy[0, :n])
    np.testing.assert_array_equal(ended.greedy[:, :n], whole.greedy[:, :n])
    np.testing.assert_array_equal(ended.disagreements[:, :n], whole.disagreements[:, :n])
    assert (ended.greedy[:, n:] == ended.greedy[:, n - 1 : n]).all()
    assert (ended.disagreements[:, n:] == ended.disagreements[:, n - 1 : n]).all()
    assert ended.updates[0] < whole.updates[0]
    assert (whole.weights != ended.weights).any()  # type: ignore[attr-defined]
