"""Films: walks against exact evaluation and by hand, and frames, by their artists, against what they show."""

from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from numpy.typing import NDArray
from PIL import Image

from agents.dynamic_programming import evaluate, solve
from agents.policy import contains, greedy_masks, mask_policy
from benchmark.drawing.film import CIRCLE, HORIZON, Film, frames, mulberry32, walk, write
from envs import ACTIONS, compile_scenario, load_scenario
from envs.scene import scene_of

UP, DOWN, LEFT, RIGHT, PING = (1 << action for action in range(len(ACTIONS)))
S1 = compile_scenario(load_scenario("S1"))
SCENE = scene_of(S1)  # of the film

# Walks


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


def test_with_a_choice_the_walk_goes_on_to_the_horizon() -> None:
    walked = walk(S1, everywhere(UP | LEFT), 30)  # both bump a wall in the start cell
    assert (walked.cells, walked.ending) == ((0,) * 31, HORIZON)
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


# Frames


def shown(film: Film) -> Axes:
    """Shows the last map of a film."""
    *_, figure = frames(film)
    return figure.axes[0]


def test_agent_issuer_and_greedy_actions_are_marked(film: Film) -> None:
    cells = (0, 12, 3 * 12 + 4)
    walks = [*film.walks[:-1], replace(film.walks[-1], cells=cells)]
    axis = shown(replace(film, walks=walks))
    greedy = film.greedy[25] * (film.greedy[25] != 31) * ~SCENE.is_over
    greedy[cells[-1]] = 0
    lines = [np.asarray(line.get_xydata()).astype(int) for line in axis.lines]
    issuer, start, pings, path, agent = [(points @ [1, 12]).tolist() for points in lines]
    assert (issuer, start, path, agent) == ([6 * 12 + 8], [0], [*cells], [cells[-1]])
    assert pings == np.flatnonzero(greedy & PING).tolist()
    assert len(pings) > 2
    values, heads = axis.collections
    assert len(heads.get_paths()) == sum(int(mask).bit_count() for mask in greedy & 15)
    best = np.ravel(np.asarray(values.get_array()))[~SCENE.is_over]
    assert best.tolist() == film.values[25, ~SCENE.is_over].max(axis=1).tolist()
    assert axis.get_title("left").splitlines()[1] == "step 10,000, score 1.00: success"


@pytest.mark.parametrize("name", ["film.webp", "film.GIF"])
def test_films_are_written_with_a_frame_per_map(film: Film, tmp_path: Path, name: str) -> None:
    write(replace(film, steps=film.steps[:3]), tmp_path / name)
    with Image.open(tmp_path / name) as image:
        assert getattr(image, "n_frames", 1) == 3
        image.seek(1)
        image.load()
        assert image.info["duration"] == 350
