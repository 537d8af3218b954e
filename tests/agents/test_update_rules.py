"""Update rules: by hand, and against the values that they converge to; see also `test_tabular`."""

from typing import Any, Final

import numpy as np
import pytest
from numpy.random import SeedSequence
from numpy.typing import NDArray

from agents import Schedule, load_algorithm
from envs import Model, compile_scenario, load_scenario
from tests.agents import Changes

# A room of 25 cells that the agent enters anywhere, and an issuer whose mood changes at random.
# Since the first wrong PING ends the episode, and cell and mood are seen, the agent knows its
# state.


def learned(name: str, model: Model, settings: Changes) -> NDArray[np.float64]:
    """Returns the action values (O, A) of an agent that is trained by an algorithm."""
    algorithm, budget = load_algorithm(name), settings["budget"]
    values: Any = algorithm.settings.model_validate({"record_every": budget} | settings)
    training = algorithm.train(model, values, "index", [SeedSequence([3, 0])], Schedule(budget))
    return np.asarray(training.q[0])


# Three cells in a column below the issuer. UP, the first action, leads on, and to the issuer from
# the last, which ends the episode with a reward of 1.
REWARDS: Final = dict.fromkeys(load_scenario("S1").rewards.model_dump(), 0.0) | {
    "issuer_reached": 1.0
}
COLUMN: Final[Changes] = {
    "grid": {"rows": 4, "columns": 1, "start": [3, 0]},
    "issuer.position": [0, 0],
    "regions": {"uncomfortable_radius": 0, "target_radius": 1},
    "rewards": REWARDS,
}
GREEDY: Final[Changes] = {"epsilon": 0.0, "ties": "lowest", "learning_rate": 0.5, "discount": 0.9}


@pytest.mark.parametrize(
    ("name", "changes", "first", "second"),
    [
        # Two episodes of three steps. Errors: 0, 0, 1; then 0, 0.9 * 0.5 = 0.45, 0.5.
        ("q_learning", {}, [0, 0, 0.5], [0, 0.225, 0.75]),
        ("sarsa", {}, [0, 0, 0.5], [0, 0.225, 0.75]),
        # Traces: 0.9 * 0.5 = 0.45 and its square, 0.2025. First episode: the error of 1 moves all
        # three. Second: errors 0.9 * 0.225 - 0.10125 = 0.10125; 0.9 * 0.5 - 0.225 = 0.225; 1 - 0.5
        # = 0.5.
        (
            "watkins_q_lambda",
            {"trace_decay": 0.5},
            [0.10125, 0.225, 0.5],
            [0.10125 + 0.050625 + 0.050625 + 0.050625, 0.225 + 0.1125 + 0.1125, 0.75],
        ),
        # Once the goal is found, a backward pass gives every step of the episode its discounted
        # reward.
        (
            "watkins_q_lambda",
            {"trace_decay": 0.0, "learning_rate": 1.0, "backward_passes": 1, "time_limit": 9},
            [0.81, 0.9, 1],
            [0.81, 0.9, 1],
        ),
        # An update takes the mean of value and target. From last to first: 0.5, 0, 0 after three
        # steps; 0.75, 0.3375, 0.151875 after the first pass; 0.875, 0.5625, 0.3290625 after the
        # second. Second episode: 0.9375, 0.675, 0.41765625; 0.96875, 0.7734375, 0.556875; 0.984375,
        # 0.8296875, 0.651796875.
        (
            "watkins_q_lambda",
            {"trace_decay": 0.0, "backward_passes": 2, "time_limit": 9},
            [0.3290625, 0.5625, 0.875],
            [0.651796875, 0.8296875, 0.984375],
        ),
    ],
)
def test_two_episodes_by_hand(
    name: str, changes: Changes, first: list[float], second: list[float]
) -> None:
    model = compile_scenario(load_scenario("S1", COLUMN))
    for budget, q in ((3, first), (6, second)):
        values = learned(name, model, GREEDY | changes | {"budget": budget})
        assert values[[3, 2, 1], 0] == pytest.approx(q, abs=1e-12)
