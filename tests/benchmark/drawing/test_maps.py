"""Maps and the gallery drawn by matplotlib, against scenes and scenarios."""

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
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, PathPatch, Polygon

from benchmark.drawing.maps import heat, shipped, triangles
from benchmark.drawing.style import svg
from benchmark.publish.page.build import SCENES
from envs import compile_scenario, load_scenario, scenario_names
from envs.scene import COLOURS, scene_of
from tests.support import ROOT


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
    assert mesh.get_coordinates()[[0, -1], [0, -1]].tolist() == [[-0.5, -0.5], [11.5, 9.5]]
    corners = [patch.get_path().vertices.tolist() for patch in drawn(axis.patches, PathPatch)]
    assert [vertices[:5] for vertices in corners] == [  # squares of 5 and 3 cells around the issuer, closed
        [[5.5, 3.5], [10.5, 3.5], [10.5, 8.5], [5.5, 8.5], [5.5, 3.5]],
        [[6.5, 4.5], [9.5, 4.5], [9.5, 7.5], [6.5, 7.5], [6.5, 4.5]],
    ]
    assert [line.get_xydata().tolist() for line in drawn(axis.lines, Line2D)] == [[[8, 6]], [[0, 0]]]


def test_triangles_are_on_the_side_to_which_the_moves_lead() -> None:
    moves = ["UP", "DOWN", "LEFT", "RIGHT"]
    frame = pd.DataFrame({"row": 3, "column": 5, "action": moves, "mean": [1.0, 2.0, 3.0, 4.0]})
    axis = Figure().subplots()
    triangles(axis, SCENE, frame, NORM)
    (polygons,) = drawn(axis.collections, PolyCollection)
    assert np.ravel(polygons.get_array()).tolist() == [1, 2, 3, 4]
    middles = np.array([path.vertices[:3].mean(axis=0) for path in polygons.get_paths()])
    assert 3 * (middles - [5, 3]) == pytest.approx(np.array([(0, -1), (0, 1), (-1, 0), (1, 0)]))


def test_gallery_shows_zones_walls_and_starts() -> None:
    axes = {axis.get_title("left"): axis for axis in shipped().axes}
    egg, any_start, walls = axes["Egg"], axes["AnyStart"], axes["Walls"]
    assert len(drawn(egg.patches, Polygon)) == 1  # a nose
    scene = scene_of(compile_scenario(load_scenario("Egg")))
    filled = [patch for patch in drawn(egg.patches, PathPatch) if patch.get_fill()]
    for (row, column), zone in zip(scene.position, scene.zone, strict=True):
        covering = [patch for patch in filled if patch.get_path().contains_point((column, row))]
        (*_, colour) = [egg.get_facecolor(), *(patch.get_facecolor() for patch in covering)]
        assert np.array(colour[:3]) * 255 == pytest.approx(COLOURS[zone])
    assert [len(np.asarray(line.get_xydata())) for line in any_start.lines] == [95, 1]
    path = next(patch for patch in drawn(walls.patches, PathPatch) if patch.get_hatch()).get_path()
    inside = [path.contains_point((column, row)) for row, column in SCENE.position]  # as large
    assert inside == load_scenario("Walls").grid.is_wall.tolist()


def test_groups_and_bystanders_are_told_apart() -> None:
    changes = {"issuer.position": [[3, 4], [3, 8]], "others": [{"position": [8, 1]}]}
    axis, scene = Figure().subplots(), scene_of(compile_scenario(load_scenario("TwoTalking", changes)))
    heat(axis, scene, np.zeros(scene.n_cells), NORM)
    (circle,) = drawn(axis.patches, Circle)
    assert (circle.center, circle.radius) == ((6, 3), 2)
    markers = {tuple(np.ravel(line.get_xydata()).tolist()): line.get_marker() for line in axis.lines}
    assert markers == {(4, 3): "*", (8, 3): "*", (1, 8): "o", (0, 0): "s"}


def test_published_picture_has_all_shipped_scenarios_legibly() -> None:
    figure = shipped()
    assert svg(figure) == (ROOT / "results" / SCENES).read_text(encoding="utf-8")
    pixels = 96  # per inch, in browsers
    assert figure.get_size_inches()[0] * pixels <= 760
    axes = [axis for axis in figure.axes if axis.axison]
    titles = [axis.get_title("left").replace("\n", " ") for axis in axes]
    assert sorted(", ".join(filter(None, titles)).split(", ")) == scenario_names()
    texts = [text for axis in axes for text in (*axis.texts, axis._left_title) if text.get_text()]  # type: ignore[attr-defined]
    (legend,) = figure.legends
    assert min(text.get_size() for text in (*texts, *legend.get_texts())) / 72 * pixels >= 11
    boxes = [text.get_window_extent() for text in (*texts, legend)]
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    assert not any(box.overlaps(axis.bbox) for box in boxes for axis in axes)
