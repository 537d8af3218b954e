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
from benchmark.drawing.film import CIRCLE, HORIZON, Film, film_of, frames, mulberry32, walk, write
from envs import ACTIONS, compile_scenario, load_scenario
from envs.scene import scene_of
from tests.benchmark.populations import population

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


# Frames


def shown(film: Film) -> Axes:
    """Shows the last map of a film."""
    *_, figure = frames(film)
    return figure.axes[0]


def hatched(axis: Axes) -> list[bool]:
    """Returns in which cells nothing is known."""
    paths = [patch.get_path() for patch in axis.patches if patch.get_hatch() == "//"]
    points = SCENE.position[:, ::-1]
    return [any(path.contains_point(point) for path in paths) for point in points]


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
    *_, discs, heads = axis.collections
    assert len(heads.get_paths()) == sum(int(mask).bit_count() for mask in greedy & 15)
    is_known = ~np.array(hatched(axis)) & ~SCENE.is_over
    assert np.asarray(discs.get_array()).tolist() == film.values[25, is_known, -1].tolist()


def test_cells_without_experience_are_hatched(film: Film) -> None:
    values, greedy = film.values.copy(), film.greedy.copy()
    expected = (np.ptp(values[25], axis=1) == 0) & (greedy[25] == 31) & ~SCENE.is_over
    assert 10 < expected.sum() < 110
    values[25, 111], greedy[25, 111] = 0.25, 1  # equal but for rounding: a net has been there
    values[25, 2 * 12 + 3] = np.nan  # an agent that diverged
    expected[[111, 2 * 12 + 3]] = False, True
    axis = shown(replace(film, values=values, greedy=greedy))
    assert hatched(axis) == expected.tolist()
    assert "diverged" in axis.get_title("left")


def test_titles_say_step_score_and_ending(film: Film) -> None:
    axis = shown(replace(film, title="word and $x^2$ " * 9))
    *title, state, ending = axis.get_title("left").splitlines()
    assert " ".join(title) == ("word and $x^2$ " * 9).strip()
    assert (state, ending) == ("step 10,000   score 1.00", "success")


def test_moves_and_pings_share_a_colour_scale(film: Film) -> None:
    values = np.linspace(-1, 3, 600).reshape(1, 120, 5)
    axis = shown(replace(film, steps=[0], greedy=film.greedy[25:], values=values))
    triangles, discs = axis.collections[:2]
    limits = -0.96, 2.96  # without 6 of 600 values at each end
    assert triangles.get_clim() == discs.get_clim() == pytest.approx(limits, abs=0.01)
    is_on = ~SCENE.is_over
    assert np.asarray(triangles.get_array()).ravel().tolist() == values[0, is_on, :-1].ravel().tolist()


def test_large_films_fit_into_a_file(film: Film) -> None:
    model = compile_scenario(load_scenario("S1", {"grid.rows": 10, "grid.columns": 900}))
    values, greedy = np.zeros((1, 9000, 5)), np.full((1, 9000), 31, dtype=np.uint8)
    made = Film("", model, [0], values, greedy, np.zeros(1), film.walks[:1])
    (figure,) = frames(made)
    assert 20 < figure.get_figwidth() < 22


@pytest.mark.parametrize("name", ["film.webp", "film.GIF"])
def test_films_are_written_with_a_frame_per_map(film: Film, tmp_path: Path, name: str) -> None:
    write(replace(film, steps=film.steps[:3]), tmp_path / name)
    with Image.open(tmp_path / name) as image:
        assert getattr(image, "n_frames", 1) == 3
        image.seek(1)
        image.load()
        assert image.info["duration"] == 350
    steps = [figure.axes[0].get_title("left").split("\n")[1] for figure in frames(film)]
    assert [step.split("   ")[0] for step in steps] == [f"step {step:,}" for step in film.steps]


def test_film_of_an_agent_that_sees_the_offset_shows_the_room() -> None:
    greedy = np.full((1, 4, 19 * 23), RIGHT, dtype=np.uint8)
    target = 9 * 23 + 11 + 2  # the issuer two columns to the right of the agent
    greedy[:, :, target] = PING
    values = np.zeros((1, 4, 19 * 23, 5), dtype=np.float32)
    values[:, :, target, -1] = 1
    film = film_of("", population("Anywhere", 1, observation="offset", greedy=greedy, values=values))
    cells = film.walks[0].cells
    assert np.diff(cells).tolist() == [1, 0]
    axis = shown(film)
    issuer, _, _, _, agent = [np.asarray(line.get_xydata()).tolist() for line in axis.lines]
    assert agent == [[cells[-1] % 12, cells[-1] // 12]]
    assert issuer == [[agent[0][0] + 2, agent[0][1]]]
