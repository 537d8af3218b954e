"""Maps drawn by matplotlib, against the scene."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.artist import Artist
from matplotlib.collections import PolyCollection, QuadMesh
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon, Rectangle
from matplotlib.quiver import Quiver

from benchmark.drawing.maps import actions, heat, region_legend, triangles
from envs import compile_scenario, load_scenario
from envs.regions import outlines
from envs.scene import Outline, scene_of


def drawn(artists: Iterable[Artist], kind: type[Artist]) -> list[Any]:
    """Returns the artists of a kind."""
    return [artist for artist in artists if isinstance(artist, kind)]


SCENE = scene_of(compile_scenario(load_scenario("S1")))
NORM = Normalize(0, 1)


def test_heat_has_a_value_per_cell_and_the_scene_on_top() -> None:
    axis = Figure().subplots()
    values = np.arange(120.0)
    heat(axis, SCENE, values, NORM)
    (mesh,) = drawn(axis.collections, QuadMesh)
    assert np.ravel(mesh.get_array()).tolist() == values.tolist()
    # Cell (row, column) is centred at x = column, y = row.
    assert mesh.get_coordinates()[0, 0].tolist() == [-0.5, -0.5]
    assert mesh.get_coordinates()[-1, -1].tolist() == [11.5, 9.5]
    corners = [patch.get_xy().tolist() for patch in drawn(axis.patches, Polygon)]
    assert corners == [  # squares of 5 and 3 cells around the issuer, closed
        [[5.5, 3.5], [10.5, 3.5], [10.5, 8.5], [5.5, 8.5], [5.5, 3.5]],
        [[6.5, 4.5], [9.5, 4.5], [9.5, 7.5], [6.5, 7.5], [6.5, 4.5]],
    ]
    assert [line.get_xydata().tolist() for line in drawn(axis.lines, Line2D)] == [
        [[8, 6]],
        [[0, 0]],
    ]  # issuer, start


def test_borders_have_any_shape() -> None:
    ring = np.ones((3, 3), dtype=bool)
    ring[1, 1] = False
    border = Outline("target", "", is_dashed=False, loops=outlines(ring))
    axis = Figure().subplots()
    heat(axis, replace(SCENE, outlines=(border,)), np.zeros(120), NORM)
    corners = [{(x, y) for x, y in patch.get_xy()} for patch in drawn(axis.patches, Polygon)]
    assert corners == [
        {(-0.5, -0.5), (2.5, -0.5), (2.5, 2.5), (-0.5, 2.5)},
        {(0.5, 0.5), (1.5, 0.5), (1.5, 1.5), (0.5, 1.5)},
    ]


def test_triangles_are_on_the_side_to_which_the_moves_lead() -> None:
    frame = pd.DataFrame(
        {"row": 3, "column": 5, "action": ["UP", "DOWN", "LEFT", "RIGHT"], "value": [1.0, 2.0, 3.0, 4.0]}
    )
    axis = Figure().subplots()
    triangles(axis, SCENE, frame, NORM, "value")
    (polygons,) = drawn(axis.collections, PolyCollection)
    assert np.ravel(polygons.get_array()).tolist() == [1, 2, 3, 4]
    middles = [path.vertices[:3].mean(axis=0).tolist() for path in polygons.get_paths()]
    third = 1 / 3
    for middle, (x, y) in zip(middles, [(0, -third), (0, third), (-third, 0), (third, 0)], strict=True):
        assert middle == pytest.approx([5 + x, 3 + y])


def test_actions_are_drawn_where_something_can_be_done() -> None:
    chosen = pd.DataFrame(
        {"row": [6, 6, 2, 2], "column": [8, 8, 1, 4], "action": ["UP", "PING", "LEFT", "PING"]}
    )
    axis = Figure().subplots()
    actions(axis, SCENE, chosen)
    (arrows,) = drawn(axis.collections, Quiver)
    assert arrows.XY.tolist() == [[1, 2]]
    assert (arrows.U.tolist(), arrows.V.tolist()) == ([-1], [0])
    assert drawn(axis.lines, Line2D)[0].get_xydata().tolist() == [[4, 2]]


def test_legend_names_the_borders_of_the_scene() -> None:
    figure = Figure()
    region_legend(figure)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["issuer", *(outline.label for outline in SCENE.outlines), "start"]


def test_walls_and_noses_are_drawn() -> None:
    walls = scene_of(compile_scenario(load_scenario("Walls")))
    axis = Figure().subplots()
    heat(axis, walls, np.zeros(120), NORM)
    squares = [patch.get_xy() for patch in drawn(axis.patches, Rectangle)]
    assert [(row + 0.5) * 12 + column + 0.5 for column, row in squares] == np.flatnonzero(
        walls.is_wall
    ).tolist()
    egg = scene_of(compile_scenario(load_scenario("Egg")))
    axis = Figure().subplots()
    heat(axis, egg, np.zeros(182), NORM)
    nose = drawn(axis.patches, Polygon)[-1].get_xy()
    assert nose[0] == pytest.approx([7, 6 - 0.75])  # the person in row 6, column 7 looks up
    two = scene_of(compile_scenario(load_scenario("TwoPeople")))
    axis = Figure().subplots()
    heat(axis, two, np.zeros(120), NORM)
    stars = [line.get_xydata().tolist() for line in drawn(axis.lines, Line2D)]
    assert stars == [[[8, 6]], [[10, 2]], [[0, 0]]]  # both people, start
