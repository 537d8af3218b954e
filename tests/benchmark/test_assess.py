"""Assessing an agent: how it is read, against hand-made policies and episodes."""

import math
import re
from itertools import count
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from matplotlib.collections import PolyCollection, QuadMesh
from numpy.typing import NDArray

from agents.dynamic_programming import solve
from benchmark.__main__ import main
from benchmark.assess import Act, assess, draw_map
from envs import EVENTS, InputError, compile_scenario, load_scenario

UP, DOWN, LEFT, RIGHT, PING = range(5)


def optimal(scenario: str) -> Act:
    """An optimal policy over the numbers of observations, if nothing that matters is hidden."""
    model = compile_scenario(load_scenario(scenario))
    best = solve(model, 1.0, 200, issuer_rewards=False).q.argmax(axis=1)[model.fresh_state]
    action = dict(zip(model.observation[model.fresh_state].tolist(), best, strict=True))
    return lambda o: action.get(o, 0)


# Exact numbers


def test_scores_of_the_optimal_the_random_and_a_worse_policy() -> None:
    best = assess(optimal("S3"), scenario="S3", observation="index")
    # Row 4, column 6 is the nearest cell of the target region: ten moves and a PING.
    assert (best.score, best.success, best.evaluation.steps) == pytest.approx((1, 1, 11))
    random = assess(lambda _: np.full(5, 0.2), scenario="Moody", observation="one_hot")
    gives_up = assess(lambda _: PING, scenario="Moody", observation="one_hot")
    assert random.unbounded_score < gives_up.unbounded_score == pytest.approx(0, abs=1e-9)
    worse = assess(lambda _: UP, scenario="S1", observation="index")
    assert worse.unbounded_score < worse.score == 0
    one = {"ping_limit": 1}
    once = assess(lambda _: PING, scenario="S1", observation="index", overrides=one)
    assert float(once.evaluation.steps) == 1


def test_episodes_of_the_environment_agree() -> None:
    """A second method: episodes of an agent that draws its actions, played in the environment."""
    env = gymnasium.make("envs:Proxemic/Moody-v0", observation="coordinates")

    def act(o: Any) -> list[float]:
        assert env.observation_space.contains(o)
        near = o[0] + o[1] > 0.5
        o[:] = 7  # as a function may
        return [0, 0.35, 0, 0.45, 0.2] if near else [0, 0.5, 0, 0.5, 0]

    assessment = assess(act, scenario="Moody", observation="coordinates")
    rng, n, successes, steps = np.random.default_rng(0), 400, 0, 0
    for episode in range(n):
        observation, _ = env.reset(seed=episode)
        ended = False
        while not ended:
            action = int(rng.choice(5, p=act(observation)))
            observation, _, terminated, truncated, info = env.step(action)
            ended, steps = terminated or truncated, steps + 1
        successes += EVENTS[info["event"]] == "target_ping"
    assert 0.1 < assessment.success < 0.9
    assert successes / n == pytest.approx(assessment.success, abs=4 * 0.5 / math.sqrt(n))
    assert steps / n == pytest.approx(float(assessment.evaluation.steps), rel=0.1)


# Functions


@pytest.mark.parametrize(
    "answer", [4, np.int64(4), np.array(4), (0, 0, 0, 0, 1), np.eye(5)[4], (np.array(4), None)]
)
def test_answers_that_mean_ping(answer: object) -> None:
    policy = assess(lambda _: answer, scenario="S1", observation="index").policy
    assert policy.tolist() == [[0, 0, 0, 0, 1]] * 120


SUMS = [0.2, 0.2, 0.2, 0.2, 0.3], [1.1, -0.1, 0, 0, 0], [math.nan] * 5


@pytest.mark.parametrize("answer", [5, 2.0, True, None, "UP", [0.5, 0.5], (3, 1), [[1], []], *SUMS])
def test_other_answers_are_refused_in_one_sentence(answer: object) -> None:
    shown = re.escape(" ".join(repr(answer).split()))
    with pytest.raises(InputError, match=f"^act: returned {shown} for observation 14; "):
        assess(lambda o: answer if o == 14 else 0, scenario="S1", observation="index")


def test_functions_with_memory_are_refused() -> None:
    calls, rng = count(), np.random.default_rng(0)
    for act in (lambda _: next(calls) % 5, lambda _: rng.integers(5)):
        with pytest.raises(InputError, match="another answer for the same observation"):
            assess(act, scenario="S1", observation="index")


# Map and command


def test_map_shows_the_likeliest_actions_where_something_can_be_done() -> None:
    def act(o: NDArray[np.float32]) -> list[float]:
        row = round(float(o[0]) * 9)
        return [0, 0.3, 0, 0.3, 0.4] if row == 6 else [0, 0.5, 0, 0.5, 0]

    axis = draw_map(assess(act, scenario="S1", observation="coordinates")).axes[0]
    (mesh,) = [artist for artist in axis.collections if isinstance(artist, QuadMesh)]
    shown = np.ma.filled(np.ma.asarray(mesh.get_array()).astype(float), np.nan).reshape(10, 12)
    expected = np.zeros((10, 12))
    expected[6] = 0.4
    expected[6, 8] = np.nan  # the issuer's cell
    assert np.array_equal(shown, expected, equal_nan=True)
    (heads,) = [artist for artist in axis.collections if type(artist) is PolyCollection]
    assert len(heads.get_paths()) == 2 * 9 * 12  # down and right, in nine rows
    dots = next(line for line in axis.lines if line.get_marker() == "o")
    cells = np.asarray(dots.get_xydata())
    assert sorted(cells.tolist()) == [[c, 6] for c in range(12) if c != 8]


def test_the_command_assesses_a_function_of_any_module_and_draws_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code = "def act(o):\n    return 1 if o[0] * 9 < 3.5 else 3 if o[1] * 11 < 5.5 else 4\n"
    (tmp_path / "agent_of_mine.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    command = ["assess", "--agent", "agent_of_mine:act", "--observation", "coordinates"]
    for name in ("one.svg", "other.SVG"):
        assert main([*command, "--save", name]) == 0
    text = capsys.readouterr().out
    assert "  score                1 " in text
    assert "  steps                11\n" in text
    assert text.count("  uncomfortable steps  0\n") == 2
    assert Path("one.svg").read_bytes() == Path("other.SVG").read_bytes()
