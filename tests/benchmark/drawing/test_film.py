"""Frames of films, by their artists, against the values, the policy and the scene."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from PIL import Image

from benchmark.drawing.film import Film, Screen, film_of, learning, write
from envs import ACTIONS, compile_scenario, load_scenario
from envs.model import PING
from envs.scene import scene_of
from tests.benchmark.populations import population

RIGHT = ACTIONS.index("RIGHT")
SCENE = scene_of(compile_scenario(load_scenario("S1")))  # of the film


def shown(film: Film) -> Axes:
    """Shows the last map of a film."""
    screen = Screen(film)
    screen.show(film.steps[-1])
    return screen.figure.axes[0]


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
    assert pings == np.flatnonzero(greedy & 1 << PING).tolist()
    assert len(pings) > 2
    *_, discs, heads = axis.collections
    assert len(heads.get_paths()) == sum(int(mask).bit_count() for mask in greedy & 15)
    is_known = ~np.array(hatched(axis)) & ~SCENE.is_over
    assert np.asarray(discs.get_array()).tolist() == film.values[25, is_known, PING].tolist()


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


def test_a_film_shows_the_last_map_before_a_step(film: Film) -> None:
    screen = Screen(film)
    for step, last in ((0, 0), (399, 0), (400, 400), (9_999, 9_600), (50_000, 10_000)):
        screen.show(step)
        assert f"\nstep {last:,} " in screen.figure.axes[0].get_title("left")


def test_large_films_fit_into_a_file(film: Film) -> None:
    model = compile_scenario(load_scenario("S1", {"grid.rows": 10, "grid.columns": 900}))
    values, greedy = np.zeros((1, 9000, 5)), np.full((1, 9000), 31, dtype=np.uint8)
    made = Film("", model, [0], values, greedy, np.zeros(1), film.walks[:1])
    assert 2_000 < learning(made)[0].width < 2_200


def test_moves_and_pings_share_a_colour_scale(film: Film) -> None:
    values = np.linspace(-1, 3, 600).reshape(1, 120, 5)
    axis = shown(replace(film, steps=[0], greedy=film.greedy[25:], values=values))
    triangles, discs = axis.collections[:2]
    limits = -0.96, 2.96  # without 6 of 600 values at each end
    assert triangles.get_clim() == discs.get_clim() == pytest.approx(limits, abs=0.01)
    is_on = ~SCENE.is_over
    assert np.asarray(triangles.get_array()).ravel().tolist() == values[0, is_on, :PING].ravel().tolist()


@pytest.mark.parametrize("name", ["film.webp", "film.GIF"])
def test_films_are_written_with_a_frame_per_map(film: Film, tmp_path: Path, name: str) -> None:
    write(learning(replace(film, steps=film.steps[:3])), tmp_path / name)
    with Image.open(tmp_path / name) as image:
        assert getattr(image, "n_frames", 1) == 3
        image.seek(1)
        image.load()
        assert image.info["duration"] == 350


def test_film_of_an_agent_that_sees_the_offset_shows_the_room() -> None:
    greedy = np.full((1, 4, 19 * 23), 1 << RIGHT, dtype=np.uint8)
    target = 9 * 23 + 11 + 2  # the issuer two columns to the right of the agent
    greedy[:, :, target] = 1 << PING
    values = np.zeros((1, 4, 19 * 23, 5), dtype=np.float32)
    values[:, :, target, PING] = 1
    film = film_of("", population("Anywhere", 1, observation="offset", greedy=greedy, values=values))
    cells = film.walks[0].cells
    assert np.diff(cells).tolist() == [1, 0]
    axis = shown(film)
    issuer, _, _, _, agent = [np.asarray(line.get_xydata()).tolist() for line in axis.lines]
    assert agent == [[cells[-1] % 12, cells[-1] // 12]]
    assert issuer == [[agent[0][0] + 2, agent[0][1]]]
