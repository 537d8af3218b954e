"""Images of an agent, pixel by pixel, against the values, the policy and the scene."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image, ImageDraw

from agents.dynamic_programming import evaluate
from agents.policy import mask_policy
from benchmark.drawing.film import Film, Moment, end_of, film_of, learning, picture, write
from benchmark.drawing.text import to_text
from envs import InputError, compile_scenario, load_scenario
from envs.model import PING
from envs.regions import outlines
from envs.scene import COLOURS, Outline, scene_of
from tests.benchmark.populations import population


def pixel(image: Image.Image, row: int, column: int, down: float, right: float, side: int = 30) -> Any:
    """Returns the colour beside a cell's centre; offsets are in cells of so many pixels."""
    y = int(1.5 * side + (row + 0.5 + down) * side)
    return image.getpixel((int((column + 0.5 + right) * side), y))


def test_walks_are_as_long_as_exact_evaluation_says(film: Film) -> None:
    model = compile_scenario(load_scenario("S1"))
    exact = evaluate(model, mask_policy(film.greedy[-1]), 200)
    assert exact.success == pytest.approx(1)
    end = end_of(film, 25)
    assert end.ending == "target_ping"
    assert end.cells[0] == 0
    assert len(end.cells) - 1 == pytest.approx(float(exact.steps))
    assert end.cells[-1] == end.cells[-2]  # a PING does not move


def test_walks_end_at_the_horizon_of_the_experiment() -> None:
    masks = np.full((2, 4, 120), 0b00101, dtype=np.uint8)  # UP or LEFT: bumps the walls of the start for ever
    made = film_of("", population(n=2, greedy=masks))
    assert [len(walk.actions) for walk in made.walks] == [200] * 4
    assert end_of(made, 3).ending == "horizon"


def test_the_last_map_that_is_not_later_is_shown(film: Film) -> None:
    assert [film.place_at(step) for step in (0, 399, 400, 9_999, 10_000, 50_000)] == [0, 0, 1, 24, 25, 25]


@pytest.mark.parametrize(
    ("action", "down", "right"), [(0, -0.3, 0.1), (1, 0.3, 0.1), (2, 0.1, -0.3), (3, 0.1, 0.3)]
)
def test_values_are_on_the_side_to_which_the_moves_lead(
    film: Film, action: int, down: float, right: float
) -> None:
    image = picture(film, Moment(25, (0,)), has_marks=False)
    low, high = np.percentile(film.values, [1, 99])
    for row, column in ((2, 3), (3, 8), (7, 2), (9, 6)):
        value = film.values[25, row * 12 + column, action]
        expected = np.array(mpl.colormaps["cividis"](np.clip((value - low) / (high - low), 0, 1))[:3]) * 255
        assert pixel(image, row, column, down, right) == pytest.approx(expected, abs=3)


def test_agent_issuer_and_greedy_pings_are_marked(film: Film) -> None:
    cells = (0, 12, 3 * 12 + 4)
    image = picture(film, Moment(25, cells), has_marks=False)
    assert pixel(image, 3, 4, 0, 0) == (213, 94, 0)
    assert pixel(image, 6, 8, 0, 0) == (255, 255, 255)
    only_ping = np.flatnonzero(film.greedy[25] == 1 << PING)
    others = np.flatnonzero(film.greedy[25] != 1 << PING)
    assert len(only_ping) > 2
    for cell in only_ping:
        assert min(pixel(image, *divmod(int(cell), 12), 0, 0)) > 230
    unmarked = [cell for cell in others if cell not in (*cells, 6 * 12 + 8) and film.greedy[25, cell] != 31]
    assert not any(min(pixel(image, *divmod(int(cell), 12), 0, 0)) > 230 for cell in unmarked)


@pytest.mark.parametrize("seed", range(3))
def test_borders_of_any_shape_lie_on_the_cells_inside(film: Film, seed: int) -> None:
    inside = np.random.default_rng(seed).random((10, 12)) < 0.6  # with holes, and touching the edges
    border = Outline("target", "", is_dashed=False, loops=outlines(inside))
    scene, greedy = replace(film.scene, outlines=(border,)), np.ones_like(film.greedy)  # visited everywhere
    image = picture(replace(film, scene=scene, greedy=greedy), Moment(25, (0,)), 60)
    padded = np.pad(inside, 1)
    for row, column in np.ndindex(inside.shape):
        for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            is_border = inside[row, column] and not padded[row + 1 + down, column + 1 + right]
            # Near the cell's edge, but not in its middle, where the arrow is.
            at = 0.417 * down + 0.2 * right, 0.417 * right + 0.2 * down
            assert (min(pixel(image, row, column, *at, side=60)) > 220) == is_border


def test_dashes_have_gaps(film: Film) -> None:
    (border,) = [outline for outline in film.scene.outlines if outline.is_dashed]
    scene = replace(film.scene, outlines=(border,))
    image = picture(replace(film, scene=scene), Moment(25, (0,)), 40, has_marks=False)
    top = np.asarray(image)[60 + 5 * 40 + 3, 7 * 40 + 5 : 10 * 40 - 5].min(axis=1)
    assert top.min() < 35  # black
    assert top.max() > 220  # white
    assert 0.3 < (top > 128).mean() < 0.7


def test_a_diverged_agent_has_no_colours(film: Film) -> None:
    values = film.values.copy()
    values[25] = np.nan
    image = picture(replace(film, values=values), Moment(25, (0,)), has_marks=False)
    assert pixel(image, 2, 3, -0.3, 0.1) == pytest.approx((250, 250, 250), abs=2)


def test_large_rooms_get_smaller_cells(film: Film) -> None:
    made = Film(
        title="",
        scene=scene_of(compile_scenario(load_scenario("S1", {"grid.rows": 100, "grid.columns": 200}))),
        steps=[0],
        values=np.zeros((1, 20_000, 5)),
        greedy=np.full((1, 20_000), 31, dtype=np.uint8),
        scores=np.zeros(1),
        walks=film.walks[:1],
    )
    image = picture(made, Moment(0, (0,)), 30)
    assert image.width == 200 * 8  # at most 1.5 million pixels, of which each of 20,000 cells has 8 x 8


def test_films_side_by_side_show_every_step_of_any(film: Film) -> None:
    shorter = replace(film, title="shorter", steps=[0, 100, 400], values=film.values[:3])
    frames = learning([[film, shorter], [shorter]], 10)
    assert len(frames) == 27  # 0, 400, ... 10,000, and 100
    assert len({frame.size for frame in frames}) == 1


def test_cells_without_experience_are_hatched(film: Film) -> None:
    unvisited = film.greedy[25] == 31
    assert 10 < unvisited.sum() < 110
    equal = (np.ptp(film.values[25], axis=1) == 0) & unvisited
    image = picture(film, Moment(25, (0,)))
    for cell in range(120):
        row, column = divmod(cell, 12)
        if not film.scene.is_over[cell] and (row, column) != (0, 0):
            centre = pixel(image, row, column, 0, 0)
            assert (centre == (250, 250, 250)) == equal[cell], cell
    values, greedy = film.values.copy(), film.greedy.copy()
    values[25, 111], greedy[25, 111] = 0.25, 1  # equal but for rounding: a net has been there
    image = picture(replace(film, values=values, greedy=greedy), Moment(25, (0,)))
    assert pixel(image, 9, 3, 0, 0) != (250, 250, 250)


def test_films_of_a_row_share_the_colour_scale_below_them(
    film: Film, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[str] = []
    write_text = ImageDraw.ImageDraw.text

    def noting(self: ImageDraw.ImageDraw, at: Any, text: str, *rest: Any, **more: Any) -> None:
        written.append(text)
        write_text(self, at, text, *rest, **more)

    monkeypatch.setattr(ImageDraw.ImageDraw, "text", noting)
    row = [
        Film(
            "",
            film.scene,
            [0],
            values.reshape(1, 120, 5),
            film.greedy[25:],
            film.scores[25:],
            film.walks[25:],
        )
        for values in (np.linspace(-1, 0, 600), np.linspace(0, 3, 600))
    ]
    low, high = -0.98, 2.94  # without 12 of 1,200 values at each end
    (frame,) = learning([row], 40)
    assert {"value", "≤ −0.98", "0", "≥ 2.9"} < set(written)

    def colour(value: float) -> Any:
        return pytest.approx(
            np.array(mpl.colormaps["cividis"]((value - low) / (high - low))[:3]) * 255, abs=4
        )

    def on_bar(value: float) -> Any:
        share = (value - low) / (high - low)
        return frame.getpixel((int(frame.width * (0.25 + share / 2)), frame.height - 65))

    for value in (-0.9, -0.5, 1.0, 2.0, 2.9):
        assert on_bar(value) == colour(value)
    assert min(on_bar(0)) > 150  # a white line
    for row_, column in ((2, 3), (7, 2), (9, 6)):
        value = row[0].values[0, row_ * 12 + column, 0]
        assert pixel(frame, row_, column, -0.3, 0.1, side=40) == colour(value)


@pytest.mark.parametrize("name", ["film.webp", "film.GIF"])
def test_films_are_written_with_a_frame_per_moment(film: Film, tmp_path: Path, name: str) -> None:
    write([picture(film, end_of(film, place)) for place in (0, 12, 25)], tmp_path / name)
    with Image.open(tmp_path / name) as image:
        assert getattr(image, "n_frames", 1) == 3
        image.seek(1)
        image.load()
        assert image.info["duration"] == 350


def test_other_forms_of_film_are_refused(film: Film, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"film\.mp4: accepted: a name that ends in \.webp or \.gif\."):
        write([picture(film, end_of(film, 0))], tmp_path / "film.mp4")


def test_walls_and_noses_are_painted(film: Film) -> None:
    floor = [["."] * 12 for _ in range(10)]
    floor[2][3] = "#"
    walls = {"grid.walls": "\n".join(map("".join, floor))}
    looking = {"regions.target_radius": None, "regions.uncomfortable_radius": None, "issuer.heading": "left"}
    shapes = {
        f"regions.{name}": {"kind": "egg", "front": f} for name, f in (("uncomfortable", 1.5), ("target", 3))
    }
    scene = scene_of(compile_scenario(load_scenario("S1", walls | looking | shapes)))
    image = picture(replace(film, scene=scene), Moment(25, (0,)), 60, has_marks=False)
    assert pixel(image, 2, 3, 0.45, 0.45, side=60) == pytest.approx(COLOURS["wall"], abs=2)
    assert pixel(image, 2, 3, -0.25, -0.25, side=60) == pytest.approx(COLOURS["line"], abs=60)  # a stroke
    assert min(pixel(image, 6, 8, 0, -0.6, side=60)) > 220  # the nose, left of the star
    assert max(pixel(image, 6, 8, 0, 0.6, side=60)) < 220


def test_text_shows_walls(film: Film) -> None:
    walls = scene_of(compile_scenario(load_scenario("Walls")))
    assert "# wall" in to_text(replace(film, scene=walls), Moment(25, (0,))).plain
    lines = to_text(replace(film, scene=walls), Moment(25, (0,))).plain.splitlines()[2:12]
    found = [(r, c) for r, line in enumerate(lines) for c in range(12) if line[3 * c + 1] == "#"]
    assert [r * 12 + c for r, c in found] == np.flatnonzero(walls.is_wall).tolist()
    assert "# wall" not in to_text(film, Moment(25, (0,))).plain
