"""Walks of greedy policies, against exact evaluation, hand-made policies and the generator's reference."""

from itertools import islice

import numpy as np
import pytest
from numpy.typing import NDArray

from agents.dynamic_programming import evaluate, solve
from agents.policy import contains, greedy_masks, mask_policy
from benchmark.analysis.walk import CIRCLE, HORIZON, mulberry32, walk
from envs import ACTIONS, compile_scenario, load_scenario

UP, DOWN, LEFT, RIGHT, PING = (1 << action for action in range(len(ACTIONS)))
S1 = compile_scenario(load_scenario("S1"))


def everywhere(mask: int) -> NDArray[np.uint8]:
    """The policy that has the same greedy actions in all cells of S1."""
    return np.full(S1.n_observations, mask, dtype=np.uint8)


@pytest.mark.parametrize("scenario", ["S1", "S2"])
def test_walks_of_deterministic_policies_are_as_long_as_exact_evaluation_says(scenario: str) -> None:
    model = compile_scenario(load_scenario(scenario))
    rng = np.random.default_rng(0)
    best = greedy_masks(solve(model, 0.9).q[model.fresh_state])
    optimal = (1 << np.argmax(contains(best), axis=1)).astype(np.uint8)
    endings = set()
    for share in np.repeat([0.0, 0.05, 0.2, 1.0], 25):
        noise = (1 << rng.integers(5, size=len(optimal))).astype(np.uint8)
        greedy = np.where(rng.random(len(optimal)) < share, noise, optimal)
        walked = walk(model, greedy, 200)
        exact = evaluate(model, mask_policy(greedy), 200)
        endings.add(walked.ending)
        assert (walked.ending == "target_ping") == bool(exact.success == 1)
        # A policy that goes in circles never ends its episode.
        assert (200 if walked.ending == CIRCLE else len(walked.actions)) == exact.steps
        rewards = model.grid_reward[walked.states[:-1], walked.actions].sum()
        assert walked.ending == CIRCLE or rewards == pytest.approx(float(exact.grid_return))
    assert endings == {"target_ping", "last_wrong_ping", CIRCLE}


def test_circles_end_where_they_close() -> None:
    greedy = everywhere(RIGHT)
    greedy[[1, 13]] = DOWN, LEFT  # right, down, left, up again, round four cells
    greedy[12] = UP
    walked = walk(S1, greedy, 200)
    assert walked.ending == CIRCLE
    assert walked.cells == (0, 1, 13, 12, 0)


def test_with_a_choice_the_walk_goes_on_to_the_horizon() -> None:
    walked = walk(S1, everywhere(UP | LEFT), 30)  # both bump a wall in the start cell
    assert walked.ending == HORIZON
    assert walked.cells == (0,) * 31
    # Above or below one half of 2**32, see the numbers of seed 2021 below.
    assert walked.actions[:6] == (2, 0, 2, 2, 2, 2)


def test_ending_takes_precedence_over_the_horizon() -> None:
    assert walk(S1, everywhere(PING), S1.scenario.ping_limit).ending == "last_wrong_ping"
    assert walk(S1, everywhere(UP), 1).ending == CIRCLE
    assert walk(S1, everywhere(RIGHT), 1).ending == HORIZON
    model = compile_scenario(load_scenario("S1", {"grid.start": [6, 5]}))  # the issuer's row
    walked = walk(model, everywhere(RIGHT), 3)
    assert (walked.cells, walked.ending) == ((77, 78, 79, 80), "issuer_reached")


def test_generator_gives_the_numbers_of_its_reference() -> None:
    # Printed by Tommy Ettinger's C code, and by the page's script in Node.
    assert list(islice(mulberry32(0), 4)) == [1144304738, 1416247, 958946056, 627933444]
    expected = [3330711924, 1013586841, 3849122242, 3043720034, 2559647987, 3994298338]
    assert list(islice(mulberry32(2021), 6)) == expected
