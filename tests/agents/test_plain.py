"""Q-learning in plain Python: by hand, and against the compiled learner."""

from typing import Any

import numpy as np
import pytest
from numpy.random import SeedSequence
from scipy import stats

from agents import Schedule, load_algorithm
from agents.dynamic_programming import evaluate
from agents.policy import mask_policy
from envs import compile_scenario, load_scenario
from envs.inputs import InputError, parse
from tests.agents.plain import Q_LEARNING, PlainSettings
from tests.agents.test_tabular import MOVES

N = 60
STEPS = (0, 750, 1500)


@pytest.mark.parametrize(
    ("scenario", "overrides", "changes"), [("S1", MOVES, {}), ("S2", {}, {"initial_value": -0.5})]
)
def test_it_learns_as_the_compiled_learner_does(
    scenario: str, overrides: dict[str, Any], changes: dict[str, Any]
) -> None:
    model = compile_scenario(load_scenario(scenario, overrides))
    defaults = {"budget": STEPS[-1], "time_limit": 200, "record_every": STEPS[-1], "epsilon": 0.3}
    values: dict[str, Any] = defaults | changes
    schedule = Schedule(STEPS[-1], STEPS, (0, STEPS[-1]))
    trained = {}
    for name in ("q_learning", "tests.agents.plain:Q_LEARNING"):
        algorithm = load_algorithm(name)
        seeds = [SeedSequence([len(name), i]) for i in range(N)]
        trained[name] = algorithm.train(model, algorithm.settings(**values), "index", seeds, schedule)
    compiled, plain = trained["q_learning"], trained["tests.agents.plain:Q_LEARNING"]
    for quantity in (
        lambda training: training.q.mean(axis=(1, 2)),
        lambda training: training.disagreements[:, -1],
        lambda training: evaluate(model, mask_policy(training.greedy[:, -1]), 200).grid_return,
    ):
        # Other random numbers, the same distribution: so large a difference comes up once in 10,000.
        assert stats.ks_2samp(quantity(compiled), quantity(plain), method="asymp").pvalue > 1e-4
    assert (plain.values[:, 0] == changes.get("initial_value", 0)).all()
    assert np.array_equal(plain.values[:, -1], plain.q.astype(np.float32))
    assert (np.diff(plain.cpu_time_s) > 0).all()
    assert set(plain.updates) == {STEPS[-1]}


def test_first_updates_by_hand() -> None:
    """Lowest ties and no exploration: UP at the wall of the start cell, whose value falls, then DOWN."""
    model = compile_scenario(load_scenario("S1"))
    settings = PlainSettings(budget=2, epsilon=0.0, ties="lowest", learning_rate=0.5, discount=0.9)
    training = Q_LEARNING.train(model, settings, "index", [SeedSequence(0)], Schedule(2, (0, 1, 2)))
    assert training.q[0, 0].tolist() == pytest.approx([-0.05, -0.05, 0, 0, 0])
    assert training.greedy[0, :, 0].tolist() == [1, 2, 4]
    assert training.values.shape[1] == 0


def test_budget_in_episodes_is_refused() -> None:
    with pytest.raises(InputError, match="budget_unit"):
        parse(PlainSettings, {"budget_unit": "episodes"}, "mine.toml")
