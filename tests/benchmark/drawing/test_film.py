"""Images of an agent, pixel by pixel, against the values, the policy and the scene."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image, ImageDraw

from benchmark.drawing.film import Film, Moment, end_of, film_of, learning, picture, write
from benchmark.drawing.text import to_text
from envs import ACTIONS, compile_scenario, load_scenario
from envs.model import PING
from envs.regions import outlines
from envs.scene import COLOURS, Outline, scene_of
from tests.benchmark.populations import population

RIGHT = ACTIONS.index("RIGHT")


def pixel(image: Image.Image, row: int, column: int, down: float, right: float, side: int = 30) -> Any:
    """Returns the colour beside a cell's centre; offsets are in cells of so many pixels."""
    y = int(1.5 * side + (row + 0.5 + down) * side)
    return image.getpixel((int((column + 0.5 + right) * side), y))


def cividis(value: float, low: float, high: float) -> Any:
    """Returns the colour of a value on a scale."""
    share = np.clip((value - low) / (high - low), 0, 1)
    return pytest.approx(np.array(mpl.colormaps["cividis"](share)[:3]) * 255, abs=4)


def test_values_are_on_the_side_to_which_the_moves_lead(film: Film) -> None:
    image = picture(film, Moment(25, (0,)), has_marks=False)
    low, high = np.percentile(film.values, [1, 99])
    for action, (down, right) in enumerate([(-0.3, 0.1), (0.3, 0.1), (0.1, -0.3), (0.1, 0.3)]):
        for row, column in ((2, 3), (3, 8), (7, 2), (9, 6)):
            value = film.values[25, row * 12 + column, action]
            assert pixel(image, row, column, down, right) == cividis(value, low, high)


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


def test_borders_of_any_shape_lie_on_the_cells_inside(film: Film) -> None:
    inside = np.random.default_rng(0).random((10, 12)) < 0.6  # with holes, and touching the edges
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


def test_large_rooms_get_smaller_cells(film: Film) -> None:
    scene = scene_of(compile_scenario(load_scenario("S1", {"grid.rows": 10, "grid.columns": 900})))
    values, greedy = np.zeros((1, 9000, 5)), np.full((1, 9000), 31, dtype=np.uint8)
    made = Film("", scene, [0], values, greedy, np.zeros(1), film.walks[:1])
    assert picture(made, Moment(0, (0,)), 30).width == 900 * 8  # at most 8,000 pixels


def test_films_side_by_side_show_every_step_of_any(film: Film) -> None:
    assert [film.place_at(step) for step in (0, 399, 400, 9_999, 10_000, 50_000)] == [0, 0, 1, 24, 25, 25]
    few = replace(film, steps=[0, 200, 400], values=film.values[:3])
    frames = learning([[few, replace(few, steps=[0, 100, 400])], [few]], 10)
    assert len(frames) == 4  # 0, 100, 200 and 400
    assert len({frame.size for frame in frames}) == 1


def test_animation_has_as_many_films_as_fit_into_a_file(film: Film, tmp_path: Path) -> None:
    few = replace(film, steps=[0], values=film.values[:1], title="a title of some length " * 4)
    write(learning([[few] * 60], 10), tmp_path / "learning.webp")
    with Image.open(tmp_path / "learning.webp") as image:
        assert 8_000 < image.width <= 16_383


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
    values[25, 2 * 12 + 3] = np.nan  # an agent that diverged
    image = picture(replace(film, values=values, greedy=greedy), Moment(25, (0,)))
    assert pixel(image, 9, 3, 0, 0) != (250, 250, 250)
    assert pixel(image, 2, 3, -0.3, 0.1) == pytest.approx((250, 250, 250), abs=2)


def test_films_of_a_row_share_the_colour_scale_below_them(
    film: Film, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[str] = []
    write_text = ImageDraw.ImageDraw.text

    def noting(self: ImageDraw.ImageDraw, at: Any, text: str, *rest: Any, **more: Any) -> None:
        written.append(text)
        write_text(self, at, text, *rest, **more)

    monkeypatch.setattr(ImageDraw.ImageDraw, "text", noting)
    of_last: dict[str, Any] = {
        "greedy": film.greedy[25:],
        "scores": film.scores[25:],
        "walks": film.walks[25:],
    }
    row = [
        replace(film, title="", steps=[0], values=values.reshape(1, 120, 5), **of_last)
        for values in (np.linspace(-1, 0, 600), np.linspace(0, 3, 600))
    ]
    low, high = -0.98, 2.94  # without 12 of 1,200 values at each end
    (frame,) = learning([row], 40)
    assert {"value", "≤ −0.98", "0", "≥ 2.9"} < set(written)

    def on_bar(value: float) -> Any:
        share = (value - low) / (high - low)
        return frame.getpixel((int(frame.width * (0.25 + share / 2)), frame.height - 65))

    for value in (-0.9, -0.5, 1.0, 2.0, 2.9):
        assert on_bar(value) == cividis(value, low, high)
    assert min(on_bar(0)) > 150  # a white line
    for row_, column in ((2, 3), (7, 2), (9, 6)):
        value = row[0].values[0, row_ * 12 + column, 0]
        assert pixel(frame, row_, column, -0.3, 0.1, side=40) == cividis(value, low, high)


@pytest.mark.parametrize("name", ["film.webp", "film.GIF"])
def test_films_are_written_with_a_frame_per_moment(film: Film, tmp_path: Path, name: str) -> None:
    write([picture(film, end_of(film, place)) for place in (0, 12, 25)], tmp_path / name)
    with Image.open(tmp_path / name) as image:
        assert getattr(image, "n_frames", 1) == 3
        image.seek(1)
        image.load()
        assert image.info["duration"] == 350


def test_walls_and_noses_are_painted(film: Film) -> None:
    scene, (issuer, start) = film.scene, film.scene.glyphs
    is_wall = np.arange(120) == 2 * 12 + 3
    scene = replace(scene, is_wall=is_wall, glyphs=(replace(issuer, heading=(0, -1)), start))
    image = picture(replace(film, scene=scene), Moment(25, (0,)), 60, has_marks=False)
    assert pixel(image, 2, 3, 0.45, 0.45, side=60) == pytest.approx(COLOURS["wall"], abs=2)
    assert pixel(image, 2, 3, -0.25, -0.25, side=60) == pytest.approx(COLOURS["line"], abs=60)  # a stroke
    assert min(pixel(image, 6, 8, 0, -0.6, side=60)) > 220  # the nose, left of the star
    assert max(pixel(image, 6, 8, 0, 0.6, side=60)) < 220


def test_text_shows_the_greedy_actions_the_agent_and_walls(film: Film) -> None:
    end = end_of(film, 25)
    text = to_text(film, end).plain.splitlines()
    assert text[1] == "step 10,000, score 1.00  success"
    rows = text[2:12]
    assert {len(row) for row in rows} == {36}
    agent = end.cells[-1]
    assert rows[agent // 12][agent % 12 * 3 + 1] == "@"
    assert rows[6][8 * 3 + 1] == "*"
    assert rows[4][6 * 3] == "["
    assert rows[5][7 * 3] == "{"
    signs = {1 << action: sign for action, sign in enumerate("↑↓←→P")}
    for cell in (13, 40, 50, 111):
        assert rows[cell // 12][cell % 12 * 3 + 1] == (signs | {31: "."}).get(int(film.greedy[-1, cell]), "+")
    walls = scene_of(compile_scenario(load_scenario("Walls")))
    lines = to_text(replace(film, scene=walls), Moment(25, (0,))).plain.splitlines()
    found = [line[3 * column + 1] == "#" for line in lines[2:12] for column in range(12)]
    assert found == walls.is_wall.tolist()
    assert lines[-1].endswith("# wall")


def test_text_has_the_colours_of_the_largest_values(film: Film) -> None:
    values = np.zeros_like(film.values)
    values[25, :, 2] = np.repeat([0.0, 1.0], 60)
    values[25, :60, 3] = -1e-9
    values[25, 7] = 0.5
    values[25, 5] = np.nan
    greedy = film.greedy.copy()
    greedy[25, 7] = 31  # all alike: the agent has not been there
    text = to_text(replace(film, values=values, greedy=greedy), Moment(25, (0,)))
    styles = [str(span.style) for span in text.spans][:120]
    assert styles[1].endswith("rgb(255,255,255) on rgb(0,34,77)")  # the ends of cividis
    assert styles[119].endswith("rgb(0,0,0) on rgb(253,231,55)") or styles[119].endswith("on rgb(254,232,56)")
    assert styles[7].endswith("rgb(0,0,0) on rgb(250,250,250)")
    assert styles[5].endswith("rgb(0,0,0) on rgb(250,250,250)")


def test_film_of_an_agent_that_sees_the_offset_is_around_the_issuer() -> None:
    greedy = np.full((1, 4, 19 * 23), 1 << RIGHT, dtype=np.uint8)
    target = 9 * 23 + 11 + 2  # the issuer two columns to the right of the agent
    greedy[:, :, target] = 1 << PING
    values = np.zeros((1, 4, 19 * 23, 5), dtype=np.float32)
    values[:, :, target, PING] = 1
    film = film_of("", population("Anywhere", 1, observation="offset", greedy=greedy, values=values))
    shown = film.seen(end_of(film, 0))
    # At the first start, the issuer is three columns to the right.
    assert shown.walks[0].cells == (9 * 23 + 11 - 3, 9 * 23 + 11 - 2, 9 * 23 + 11 - 2)
    assert np.argwhere(shown.values[0] == 1).tolist() == [[9 * 23 + 11 - 2, PING]]
    assert np.flatnonzero(shown.greedy[0] == 1 << PING).tolist() == [9 * 23 + 11 - 2]
    assert shown.scene.cells_of("issuer") == [9 * 23 + 11]
