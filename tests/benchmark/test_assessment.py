"""Assessing an agent: how it is read, against hand-made policies, and how it is ranked, by hand."""

import gzip
import math
import re
from itertools import count
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pandas as pd
import pytest
from matplotlib.collections import PolyCollection, QuadMesh
from numpy.typing import NDArray

from agents.dynamic_programming import evaluate, solve
from agents.policy import uniform_policy
from benchmark.assessment import Act, assess, draw_map, standing_of
from benchmark.folder import write_manifest
from envs import EVENTS, InputError, compile_scenario, load_scenario
from envs.model import PING
from envs.observations import observation_table

S1 = compile_scenario(load_scenario("S1"))
UP, DOWN, LEFT, RIGHT = range(4)


def optimal(scenario: str) -> Act:
    """An optimal policy over the numbers of observations, if nothing that matters is hidden."""
    model = compile_scenario(load_scenario(scenario))
    best = solve(model, 1.0, 200, issuer_rewards=False).q.argmax(axis=1)
    action = dict(zip(model.observation[model.fresh_state].tolist(), best[model.fresh_state], strict=True))
    return lambda o: action.get(o, 0)


# Exact numbers


def test_scores_of_the_optimal_the_random_and_a_worse_policy() -> None:
    assessment = assess(optimal("S3"), scenario="S3", observation="index")
    # Row 4, column 6 is the nearest cell of the target region: ten moves and a PING.
    assert (assessment.score, assessment.success) == pytest.approx((1, 1))
    assert float(assessment.evaluation.steps) == pytest.approx(11)
    worse = assess(
        lambda o: 3 if o[1] < 0.4 else 1 if o[0] < 0.9 else 0, scenario="S1", observation="coordinates"
    )
    assert repr(worse) == str(worse)  # what a notebook shows
    text = str(worse).splitlines()
    assert text[1].startswith("  success ")
    assert "is below a random policy's, -" in text[3]
    assessment = assess(lambda _: np.full(5, 0.2, dtype=np.float32), scenario="Moody", observation="one_hot")
    model = compile_scenario(load_scenario("Moody"))
    assert assessment.unbounded_score == pytest.approx(0, abs=1e-9)
    assert assessment.success == pytest.approx(float(evaluate(model, uniform_policy(model), 200).success))


def test_episodes_of_the_environment_agree() -> None:
    """A second method: episodes of an agent that draws its actions, played in the environment."""

    def act(o: NDArray[np.float32]) -> list[float]:
        return [0, 0.35, 0, 0.45, 0.2] if o[0] + o[1] > 0.5 else [0, 0.5, 0, 0.5, 0]

    assessment = assess(act, scenario="Moody", observation="coordinates")
    env = gymnasium.make("envs:Proxemic/Moody-v0", observation="coordinates")
    rng = np.random.default_rng(0)
    n, successes, steps = 400, 0, 0
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


def test_steps_of_a_walk_around_the_person_by_hand(tmp_path: Path) -> None:
    """8 steps to the right, 5 down, 2 around the person, 1 into them: 3 end beside the person."""
    # The person is in row 6, column 8.
    turns = {5 * 12 + 8: LEFT, 5 * 12 + 7: DOWN, 6 * 12 + 7: RIGHT}

    def act(cell: int) -> int:
        return turns.get(cell, RIGHT if cell < 8 else DOWN)

    assessment = assess(act, scenario="S1", observation="index", results=tmp_path)
    numbers = dict(re.findall(r"^  (\D+?)  +(\S+)", str(assessment), re.MULTILINE))
    assert (numbers["steps"], numbers["uncomfortable steps"]) == ("16", "3")


# Functions


@pytest.mark.parametrize(
    "answer", [4, np.int64(4), np.array(4), (0, 0, 0, 0, 1), np.eye(5)[4], (np.array(4), None)]
)
def test_answers_that_mean_ping(answer: object) -> None:
    policy = assess(lambda _: answer, scenario="S1", observation="index").policy
    assert policy.tolist() == [[0, 0, 0, 0, 1]] * 120


@pytest.mark.parametrize(
    "answer",
    [
        5, -1, 2.0, True, None, "UP", [1], [0.5, 0.5], [0.2, 0.2, 0.2, 0.2, 0.3], [1.1, -0.1, 0, 0, 0],
        [math.nan] * 5, [math.inf, 0, 0, 0, 0], (3, 1), (None, None), np.array([4]), {}, [[1], [2, 3]],
    ],
)  # fmt: skip
def test_other_answers_are_refused_in_one_sentence(answer: object) -> None:
    shown = re.escape(" ".join(repr(answer).split()))
    with pytest.raises(InputError, match=f"^act: returned {shown} for observation 14; "):
        assess(lambda o: answer if o == 14 else 0, scenario="S1", observation="index")


@pytest.mark.parametrize("observation", ["index", "one_hot", "coordinates"])
def test_observations_are_those_of_the_environment(observation: str) -> None:
    env = gymnasium.make("envs:Proxemic/Moody-v0", observation=observation)
    given: list[NDArray[np.float32]] = []

    def act(o: Any) -> int:
        assert env.observation_space.contains(o)
        given.append(np.array(o))
        if observation != "index":
            o[:] = 7  # as a function may
        return 0

    assess(act, scenario="Moody", observation=observation)
    table = observation_table(compile_scenario(load_scenario("Moody")), observation)
    assert np.array_equal(given[: len(table)], table)


def test_functions_with_memory_are_refused() -> None:
    calls, rng = count(), np.random.default_rng(0)
    for act in (lambda _: next(calls) % 5, lambda _: rng.integers(5)):
        with pytest.raises(InputError, match="another answer for the same observation"):
            assess(act, scenario="S1", observation="index")


@pytest.mark.parametrize(
    ("agent", "options", "expected"),
    [
        (3, {}, "agent = 3"),
        ("model.zip", {}, "model.zip"),
        (lambda _: 0, {"algorithm": "stable_baselines3:PPO"}, "algorithm"),
        (lambda _: 0, {"stochastic": True}, "stochastic"),
        (lambda _: 0, {"observation": "cell"}, "cell"),
        (lambda _: 0, {"scenario": "S4"}, "S4"),
    ],
)
def test_mistakes_get_one_sentence(agent: Any, options: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        assess(agent, **{"scenario": "S1", "observation": "index", **options})


def test_tables_that_are_too_large_are_refused_before_anything_is_compiled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("envs.observations.compile_scenario", lambda _: pytest.fail("compiled"))
    monkeypatch.setattr("envs.observations.MAX_TABLE", 50_000_000)
    with pytest.raises(InputError, match="one_hot: 236,280 observations of 236 numbers"):
        assess(lambda _: 0, scenario="ThreeTalking", observation="one_hot")


def towards(offset: int) -> int:
    """Walks to a cell at Chebyshev distance 2 from the issuer, columns first, and PINGs there."""
    row, column = divmod(offset, 23)
    row, column = row - 9, column - 11
    if max(abs(row), abs(column)) == 2:
        return PING
    if abs(column) > 2:
        return RIGHT if column > 0 else LEFT
    return DOWN if row > 0 else UP


def test_offset_is_enough_for_the_optimum_where_the_issuer_is_seen() -> None:
    by_number = assess(towards, scenario="Anywhere", observation="offset")
    assert by_number.unbounded_score == 1

    def by_coordinates(o: NDArray[np.float32]) -> int:
        return towards(round(float(o[0]) * 18) * 23 + round(float(o[1]) * 22))

    other = assess(by_coordinates, scenario="Anywhere", observation="offset_coordinates")
    assert (other.policy == by_number.policy).all()


# Rank


def runs(success: float = 1.0, **scores: list[float]) -> pd.DataFrame:
    rows = [("e", learner, success, score) for learner, values in scores.items() for score in values]
    return pd.DataFrame(rows, columns=["experiment", "learner", "success", "score"])


def test_standing_by_hand() -> None:
    published = runs(a=[1.0, 1.0], b=[0.5, 0.5, 0.2], c=[0.0, 0.8], d=[0.0, 0.1])
    standing = standing_of(1.0, 0.4, published)  # as the means of b and c
    assert (standing.rank, standing.tied) == (2, 2)
    learners = standing.learners.set_index("learner")
    assert learners["score"].is_monotonic_decreasing
    learners = learners.loc[["a", "b", "c", "d"]]
    assert learners["runs"].tolist() == [2, 3, 2, 2]
    assert learners["score"].tolist() == pytest.approx([1, 0.4, 0.4, 0.05])
    assert learners["lower"].tolist() == pytest.approx([0, 1 / 3, 0.5, 1])
    assert learners["equal"].tolist() == [0, 0, 0, 0]
    assert learners["higher"].tolist() == pytest.approx([1, 2 / 3, 0.5, 0])
    # Scores within the rounding of files are equal.
    third = 0.978097834
    standing = standing_of(1.0, third, runs(a=[float(f"{third:.6g}")], b=[0.97809], c=[0.97811]))
    assert (standing.rank, standing.tied) == (2, 1)
    # Success counts first, whatever the score.
    low, high = runs(0.1, a=[0.9, 0.9]), runs(0.3, b=[0.0], c=[0.8])
    standing = standing_of(0.3, 0.5, pd.concat([low, high]))
    assert (standing.rank, standing.tied, [*standing.learners["learner"]]) == (2, 0, ["c", "b", "a"])


def publish(folder: Path, scores: str, **changes: Any) -> None:
    """Writes a folder of results like a published one."""
    manifest = {
        "experiment": folder.name,
        "report": {"kind": "comparison"},
        "horizon": 200,
        "partial": "",
        "scenarios": {"S1": load_scenario("S1").model_dump(mode="json")},
        "algorithms": {
            variant: {"reference_for": of, "family": family, "title": title, "settings": dict.fromkeys(forms)}
            for variant, of, family, title, *forms in (
                ("table", "", "tabular", "Q-learning table", "index"),
                ("net", "", "deep", "", "one_hot", "coordinates"),
                ("same", "net", "deep", "", "one_hot"),
            )
        },
    }
    folder.mkdir()
    (folder / "scores.csv.gz").write_bytes(gzip.compress(scores.encode()))
    write_manifest(folder, manifest | changes)


SCORES = """scenario,variant,observation,success,score
S1,table,index,1.0,1.0
S1,table,index,0.0,0.0
S1,net,one_hot,0.0,0.25
S1,net,coordinates,0.0,0.0
S1,same,one_hot,1.0,1.0
S2,table,index,1.0,1.0
"""


def test_published_learners_are_those_that_can_be_compared(tmp_path: Path) -> None:
    def standing(scenario: str = "S1") -> Any:
        return assess(lambda _: 0, scenario=scenario, observation="index", results=tmp_path).standing

    assert standing() is None
    publish(tmp_path / "sb3", SCORES)
    expected = [
        ["Q-learning table", 2, 0.5],
        ["net on one-hot cells", 1, 0.25],
        ["net on coordinates", 1, 0.0],
    ]
    assert standing().learners[["learner", "runs", "score"]].to_numpy().tolist() == expected
    publish(tmp_path / "sb3_seeds_0-9", SCORES, experiment="sb3")
    publish(tmp_path / "sb3_smoke", SCORES)
    publish(tmp_path / "mine", SCORES)  # an experiment that is not the project's
    publish(tmp_path / "equivalence", SCORES, partial="Partial: a run is missing.")
    publish(tmp_path / "when", SCORES, horizon=201)
    publish(tmp_path / "tuning", SCORES.replace("score", "area"))
    changed = load_scenario("S1", {"rewards.other": -0.2}).model_dump(mode="json")
    publish(tmp_path / "compare_deep_long", SCORES, scenarios={"S1": changed})
    assert set(standing().learners["experiment"]) == {"sb3"}
    publish(tmp_path / "reproduce", SCORES)
    assert (len(standing().learners), standing().rank, standing().tied) == (6, 5, 2)
    assert standing("S2") is None
    whole = (tmp_path / "sb3" / "scores.csv.gz").read_bytes()
    for content in (gzip.compress(b"variant,success,score\ntable,1.0,1.0\n"), whole[:-12]):
        (tmp_path / "sb3" / "scores.csv.gz").write_bytes(content)
        with pytest.raises(InputError, match=r"scores\.csv\.gz: damaged"):
            standing()


# Map


def test_map_shows_the_likeliest_actions_where_something_can_be_done() -> None:
    def act(o: NDArray[np.float32]) -> list[float]:
        row = round(float(o[0]) * 9)
        return [0, 0.3, 0, 0.3, 0.4] if row == 6 else [0, 0.5, 0, 0.5, 0]

    figure = draw_map(assess(act, scenario="S1", observation="coordinates"))
    axis = figure.axes[0]
    (mesh,) = [artist for artist in axis.collections if isinstance(artist, QuadMesh)]
    shown = np.ma.filled(np.ma.asarray(mesh.get_array()).astype(float), np.nan).reshape(10, 12)
    expected = np.zeros((10, 12))
    expected[6] = 0.4
    expected[6, 8] = np.nan  # the issuer's cell
    assert np.array_equal(shown, expected, equal_nan=True)
    heads = [len(artist.get_paths()) for artist in axis.collections if type(artist) is PolyCollection]
    assert heads == [0, 108, 0, 108]  # up, down, left, right; nine rows of twelve cells
    dots = [line for line in axis.lines if line.get_marker() == "o"]
    cells = np.asarray(dots[0].get_xydata())
    assert sorted(cells.tolist()) == [[c, 6] for c in range(12) if c != 8]


def test_maps_are_written_with_equal_bytes(tmp_path: Path) -> None:
    assessment = assess(lambda _: PING, scenario="S1", observation="index")
    for name in ("one.svg", "other.SVG"):
        assessment.draw(tmp_path / name)
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "other.SVG").read_bytes()
    for name in ("map.pdf", "nowhere/map.png"):
        with pytest.raises(InputError, match=name):
            assessment.draw(tmp_path / name)
