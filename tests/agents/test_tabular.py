"""The kernel against the textbook's loop with the same draws."""

from typing import Any

import numpy as np
import pytest

from agents import load_algorithm
from agents.process import draw_word
from envs import compile_scenario, load_scenario
from tests.agents import Changes
from tests.agents.words import equal_to_textbook, xoshiro


def test_generator_gives_the_published_numbers() -> None:
    # First outputs from the state 1, 2, 3, 4, as in the test vectors of the rand_xoshiro crate.
    published = [
        41943041, 58720359, 3588806011781223, 3591011842654386, 9228616714210784205,
        9973669472204895162, 14011001112246962877, 12406186145184390807,
        15849039046786891736, 10450023813501588000,
    ]  # fmt: skip
    stream = xoshiro([1, 2, 3, 4])
    assert [next(stream) for _ in published] == published
    state = tuple(map(np.uint64, (1, 2, 3, 4)))
    for expected in published:
        word, following = draw_word(state)
        state = tuple(map(np.uint64, following))
        assert word == expected


# Two phases that follow each other at random, and an issuer that moves with them; several starts.
MOVES = {
    "grid.start": [[0, 0], [9, 11], [0, 11]],
    "phases": [
        {"name": "near", "next": {"far": 0.2}},
        {"name": "far", "position": [3, 4], "next": {"near": 0.1, "gone": 0.05}},
        {"name": "gone", "position": [2, 8], "next": {"near": 0.3}},
    ],
    "observe": ["agent", "phase"],
}
RULES = ("q_learning", "sarsa", "expected_sarsa", "double_q_learning", "watkins_q_lambda")
CASES: dict[str, tuple[str, Changes, Changes]] = {
    "S2": ("S2", {}, {}),
    "S3": ("S3", {}, {"epsilon": 0.4}),
    "time limit": ("S1", {}, {"time_limit": 15, "initial_value": -0.7, "halved_after": 400}),
    "all at once": ("S2", {"issuer.position": [8, 6], "rewards.wrong_ping_uncomfortable": -0.8},
                    {"epsilon": 0.15, "ties": "lowest", "budget": 120, "budget_unit": "episodes",
                     "time_limit": 25, "record_every": 7, "learning_rate": 0.3, "discount": 1.0}),
    "one pass": ("S2", MOVES, {"time_limit": 50, "backward_passes": 1, "halved_after": 400}),
    "two passes": ("S2", {}, {"epsilon": 0.2, "ties": "lowest", "budget": 60,
                   "budget_unit": "episodes", "time_limit": 40, "learning_rate": 0.3,
                   "backward_passes": 2, "initial_value": 0.1}),
}  # fmt: skip


@pytest.mark.parametrize(
    ("rule", "case"),
    [
        (rule, case)
        for rule in RULES
        for case in CASES
        if rule == "watkins_q_lambda" or "pass" not in case
    ],
)
def test_kernel_equals_the_textbooks_loop(rule: str, case: str) -> None:
    name, overrides, changes = CASES[case]
    declared: Changes = {"budget": 2000, "record_every": 3} | changes
    settings: Any = load_algorithm(rule).settings(**declared)
    points = 0, 1, settings.budget // 3, settings.budget
    model = compile_scenario(load_scenario(name, overrides))
    training = equal_to_textbook(rule, model, settings, "index", points)
    assert (training.q[0] != training.q[1]).any()
    assert training.episodes_ended.min() > 5
