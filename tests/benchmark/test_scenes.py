"""Maps drawn by matplotlib, against scenes and scenarios."""

from collections.abc import Iterable
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.artist import Artist
from matplotlib.collections import PolyCollection, QuadMesh
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Polygon

from benchmark.scenes import heat, shipped, triangles
from envs import compile_scenario, load_scenario, scenario_names
from envs.scene import COLOURS, scene_of

SCENE = scene_of(compile_scenario(load_scenario("S1")))
NORM = Normalize(0, 1)


def drawn(artists: Iterable[Artist], kind: type[Artist]) -> list[Any]:
    """Returns the artists of a kind."""
    return [artist for artist in artists if isinstance(artist, kind)]


def test_heat_has_a_value_per_cell_and_the_scene_on_top() -> None:
    axis = Figure().subplots()
    values = np.arange(120.0)
    heat(axis, SCENE, values, NORM)
    (mesh,) = drawn(axis.collections, QuadMesh)
    assert np.ravel(mesh.get_array()).tolist() == values.tolist()
    # Cell (row, column) is centred at x = column, y = row.
    corners = mesh.get_coordinates()[[0, -1], [0, -1]].tolist()
    assert corners == [[-0.5, -0.5], [11.5, 9.5]]
    borders = [patch.get_path().vertices.tolist() for patch in drawn(axis.patches, PathPatch)]
    assert [vertices[:5] for vertices in borders] == [  # squares around the issuer, closed
        [[5.5, 3.5], [10.5, 3.5], [10.5, 8.5], [5.5, 8.5], [5.5, 3.5]],
        [[6.5, 4.5], [9.5, 4.5], [9.5, 7.5], [6.5, 7.5], [6.5, 4.5]],
    ]
    points = [np.asarray(line.get_xydata()).tolist() for line in axis.lines]
    assert points == [[[8, 6]], [[0, 0]]]


def test_triangles_are_on_the_side_to_which_the_moves_lead() -> None:
    moves = ["UP", "DOWN", "LEFT", "RIGHT"]
    frame = pd.DataFrame({"row": 3, "column": 5, "action": moves, "mean": [1.0, 2.0, 3.0, 4.0]})
    axis = Figure().subplots()
    triangles(axis, SCENE, frame, NORM)
    (polygons,) = drawn(axis.collections, PolyCollection)
    assert np.ravel(polygons.get_array()).tolist() == [1, 2, 3, 4]
    middles = np.array([path.vertices[:3].mean(axis=0) for path in polygons.get_paths()])
    sides = np.array([(0, -1), (0, 1), (-1, 0), (1, 0)])
    assert 3 * (middles - [5, 3]) == pytest.approx(sides)


def test_gallery_shows_all_shipped_scenarios_legibly() -> None:
    figure = shipped()
    axes = {axis.get_title("left"): axis for axis in figure.axes if axis.axison}
    assert [*axes] == scenario_names()
    scene = scene_of(compile_scenario(load_scenario("Egg")))
    (mesh,) = drawn(axes["Egg"].collections, QuadMesh)
    colours = mesh.to_rgba(mesh.get_array()).reshape(-1, 4)[:, :3] * 255
    assert colours == pytest.approx(np.array([COLOURS[zone] for zone in scene.zone]))
    noses = [patch for patch in drawn(axes["Egg"].patches, Polygon) if len(patch.get_xy()) > 1]
    assert len(noses) == 1
    starts = [np.asarray(line.get_xydata()) for line in axes["AnyStart"].lines]
    assert max(map(len, starts)) == 95
    walls = next(patch for patch in axes["Walls"].patches if patch.get_hatch()).get_path()
    inside = [walls.contains_point((column, row)) for row, column in SCENE.position]  # as large
    assert inside == load_scenario("Walls").grid.is_wall.tolist()
    (legend,) = figure.legends
    boxes = [legend.get_window_extent(), *(axis.bbox for axis in axes.values())]
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
