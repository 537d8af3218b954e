"""The gallery, against the scenarios."""

import numpy as np
import pytest
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, PathPatch, Polygon

from benchmark.drawing.gallery import gallery
from envs import compile_scenario, load_scenario, scenario_names
from envs.regions import ZONES


@pytest.fixture(scope="module")
def texts() -> list[str]:
    figure = gallery([compile_scenario(load_scenario(name)) for name in scenario_names()])
    assert figure.get_figwidth() * 160 == pytest.approx(1400, abs=20)  # pixels, as figures are written
    return [text.get_text() for text in figure.texts]


def test_every_scenario_is_named_with_what_is_hidden(texts: list[str]) -> None:
    titles = [name for text in texts for name in text.split(", ") if name in scenario_names()]
    assert sorted(titles) == scenario_names()
    assert "480 cells, no feedback\n480 observations\nhidden: wrong PINGs" in texts
    assert any("MoodyHidden: 120 observations; hidden: phase, wrong PINGs" in text for text in texts)
    assert any("Counted: 600 observations;\nhidden: nothing" in text for text in texts)
    for phase in ("calm", "tense", "cheerful", "looks down", "phase 6 of 16", "place 38 of 111"):
        assert texts.count(phase) == 1


def test_maps_show_regions_people_starts_and_the_way() -> None:
    figure = gallery([compile_scenario(load_scenario("Walking")), compile_scenario(load_scenario("Egg"))])
    shown = [axis for axis in figure.axes if axis.axison]
    assert len(shown) == 4  # three of 16 phases, and the egg
    for axis, (row, column) in zip(shown, [(3, 4), (4, 8), (7, 6)], strict=False):
        (person,) = [patch for patch in axis.patches if isinstance(patch, Circle)]
        assert person.center == (column + 0.5, row + 0.5)
        start, way = [line for line in axis.lines if isinstance(line, Line2D)]
        assert np.ravel(start.get_xydata()).tolist() == [0.5, 0.5]
        assert len(np.asarray(way.get_xydata())) == 17  # the cells of the walk, and back
    noses = [[patch for patch in axis.patches if isinstance(patch, Polygon)] for axis in shown]
    assert [len(found) for found in noses] == [0, 0, 0, 1]
    zone = load_scenario("Egg").zone[0, 0].reshape(13, 14)
    filled = [
        patch for patch in shown[3].patches if isinstance(patch, PathPatch) and patch.get_linewidth() == 0
    ]
    for patch, least in zip(filled, ("target", "uncomfortable"), strict=True):
        path = patch.get_path()
        inside = [[path.contains_point((c + 0.5, r + 0.5)) for c in range(14)] for r in range(13)]
        assert (np.array(inside) == (zone >= ZONES.index(least))).all()


def test_many_starts_are_dots_and_walls_are_filled() -> None:
    figure = gallery([compile_scenario(load_scenario("AnyStart")), compile_scenario(load_scenario("Walls"))])
    any_start, walls = [axis for axis in figure.axes if axis.axison]
    assert len(any_start.lines) == 95
    assert len(walls.lines) == 1
    path = [patch for patch in walls.patches if isinstance(patch, PathPatch) and patch.get_linewidth() == 0][
        -1
    ]
    cells = [
        (r, c) for r in range(10) for c in range(12) if path.get_path().contains_point((c + 0.5, r + 0.5))
    ]
    is_wall = load_scenario("Walls").grid.is_wall
    assert [r * 12 + c for r, c in cells] == np.flatnonzero(is_wall).tolist()
