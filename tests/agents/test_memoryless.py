"""The search for memoryless policies: its gradient against differences, its result against all policies."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.random import SeedSequence
from scipy.special import softmax

from agents import Schedule, check_training, load_algorithm
from agents.dynamic_programming import evaluate, from_starts, solve
from agents.memoryless import MemorylessSettings, Search, gradient
from agents.policy import uniform_policy
from envs import Model, compile_scenario, load_scenario
from tests.agents import MOODS

SMALL: dict[str, Any] = {"grid.rows": 5, "grid.columns": 6, "issuer.position": [4, 5], "ping_limit": 2}
SCENES: dict[str, dict[str, Any]] = {
    "as in the paper": SMALL,
    "a hidden mood": SMALL | {"phases": MOODS},
    "a hidden issuer": SMALL | {"issuer.position": [[4, 5], [1, 5], [4, 1]]},
}


def model_of(changes: dict[str, Any]) -> Model:
    return compile_scenario(load_scenario("S1", changes))


@pytest.mark.parametrize("name", SCENES)
def test_gradient_is_that_of_exact_evaluation(name: str) -> None:
    model, horizon, step = model_of(SCENES[name]), 25, 1e-5
    logits = np.random.default_rng(1).standard_normal((model.n_observations, 5))
    policy = softmax(logits, axis=1)
    value, advantage = gradient(model, policy, horizon)
    assert value == pytest.approx(float(evaluate(model, policy, horizon).grid_return), abs=1e-9)
    # The derivative by a logit is the action's probability, times its advantage, times the expected visits:
    # the last cancel in ratios of two actions' derivatives in one observation.
    for o in (0, 7, 13):
        derivative = []
        for action in range(5):
            ends = []
            for sign in (1, -1):
                moved = logits.copy()
                moved[o, action] += sign * step
                ends.append(float(evaluate(model, softmax(moved, axis=1), horizon).grid_return))
            derivative.append((ends[0] - ends[1]) / (2 * step))
        expected = np.array(derivative) / policy[o]
        largest = abs(expected).argmax()
        assert advantage[o] * expected[largest] / advantage[o, largest] == pytest.approx(expected, abs=1e-5)
        assert np.sign(advantage[o, largest]) == np.sign(expected[largest])


def test_search_finds_the_optimum_where_it_needs_nothing_hidden() -> None:
    model = model_of({})
    search = Search(model, np.zeros((120, 5)), 200)
    search.climb(60)
    optimum = float(from_starts(model) @ solve(model, 1.0, 200, issuer_rewards=False).value)
    assert search.expected_return == pytest.approx(optimum, abs=1e-6)


def test_search_does_at_least_as_well_as_every_deterministic_policy() -> None:
    """A corridor whose issuer stands at one of its ends, and nobody sees at which."""
    model = model_of(
        {
            "grid": {"rows": 1, "columns": 9, "start": [0, 4]},
            "issuer.position": [[0, 0], [0, 8]],
            "regions": {"uncomfortable_radius": 1, "target_radius": 2},
            "ping_limit": 3,
        }
    )
    # Beyond the target regions there is nothing to be gained, so all policies stop there by PING.
    masks = np.full((3**5, 9), 1 << 4, dtype=np.int64)
    masks[:, 2:7] = 1 << np.array(list(product((2, 3, 4), repeat=5)))
    policies = (masks[..., None] >> np.arange(5) & 1).astype(float)
    best = float(evaluate(model, policies, 50).grid_return.max())
    found = []
    for seed in range(5):
        search = Search(model, np.random.default_rng(seed).standard_normal((9, 5)), 50)
        search.climb(200)
        found.append(search.expected_return)
        assert search.expected_return == pytest.approx(
            float(evaluate(model, search.policy, 50).grid_return), abs=1e-8
        )
    assert max(found) >= best - 1e-6
    knowing = float(from_starts(model) @ solve(model, 1.0, 50, issuer_rewards=False).value)
    assert max(found) < knowing - 0.1  # what is hidden costs something


def test_it_never_gets_worse_and_keeps_the_contract() -> None:
    model = model_of(SCENES["a hidden mood"])
    algorithm = load_algorithm("memoryless")
    schedule = Schedule(12, (0, 4, 8, 12), (0, 12))
    seeds = [SeedSequence(1), SeedSequence(2), SeedSequence(1)]
    training = algorithm.train(model, MemorylessSettings(budget=12), "index", seeds, schedule)
    check_training(training, model, 3, schedule)
    returns = evaluate(model, training.stochastic, 200).grid_return
    assert (np.diff(returns, axis=1) >= -1e-9).all()
    assert returns[0, -1] > float(evaluate(model, uniform_policy(model), 200).grid_return)
    assert (training.stochastic[0] == training.stochastic[2]).all()  # equal seeds, equal searches
    assert (training.stochastic[0] != training.stochastic[1]).any()
