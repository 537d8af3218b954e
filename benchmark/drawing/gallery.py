"""Draws scenarios side by side: what their maps look like, and what an agent observes of them."""

from collections.abc import Sequence
from textwrap import wrap
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, PathPatch, Polygon
from matplotlib.path import Path

from benchmark.drawing.style import figure_of
from envs import Model
from envs.regions import Loop, outlines
from envs.scene import COLOURS, Scene, scene_of

_COLUMNS: Final = 6
_CHARACTERS: Final = 30  # of a line of text below one map
_MOST_MAPS: Final = 4  # of a scenario; of those with more places or phases, three are shown
_RGB: Final = {kind: (red / 255, green / 255, blue / 255) for kind, (red, green, blue) in COLOURS.items()}
_START: Final[dict[str, Any]] = {"ls": "", "marker": "s", "mfc": _RGB["agent"], "mec": "none"}
_DASHES: Final = (0, (2, 1))
_HIDDEN: Final = {"wrong_pings": "wrong PINGs"}  # in words, where they differ
# Heights in inches: of a map, of a line of text, and of the legend.
_MAP, _LINE, _LEGEND = 1.36, 0.125, 0.42
_GAP: Final = 0.07  # inches between maps


def gallery(models: Sequence[Model]) -> Figure:
    """Draws the maps of scenarios, with their names above, and cells, observations and what is hidden below.

    Scenarios that differ only in what is observed share their maps. Of a scenario in which the issuer may
    stand in several places, or which has several phases, up to four maps are shown.

    Args:
      models: The scenarios, in the order in which they are shown; a group of maps goes to the first row that
        has room for it.
    """
    rows: list[list[list[Model]]] = []
    for group in _groups(models):
        n_maps = len(_shown(group[0]))
        row = next((r for r in rows if sum(len(_shown(g[0])) for g in r) + n_maps <= _COLUMNS), None)
        if row is None:
            rows.append(row := [])
        row.append(group)
    texts = [[_text(group) for group in row] for row in rows]
    maps = [_MAP * max(_ratio(group[0]) for group in row) for row in rows]  # inches
    heights = [
        high + _LINE * (3.4 + max(len(lines) for lines in row)) for high, row in zip(maps, texts, strict=True)
    ]
    width, height = _COLUMNS * (_MAP + _GAP) + _GAP, sum(heights) + _LEGEND
    with figure_of(len(rows), _COLUMNS, (width, height)) as (figure, axes):
        figure.set_layout_engine("none")
        for axis in axes.flat:
            axis.set_axis_off()

        def write(x: float, y: float, text: str, **style: Any) -> None:
            figure.text(x / width, y / height, text, **style)

        top = height
        for i, row in enumerate(rows):
            upper, place = top - 1.5 * _LINE, 0
            for group, lines in zip(row, texts[i], strict=True):
                x = _GAP + place * (_MAP + _GAP)
                write(
                    x, upper + 0.04, ", ".join(model.scenario.name for model in group), weight="bold", size=8
                )
                y = upper - maps[i] - 0.05
                for context in _shown(group[0]):
                    left = _GAP + place * (_MAP + _GAP)
                    size = _MAP / width, maps[i] / height
                    axes[i, place].set_position((left / width, upper / height - size[1], *size))
                    _map(axes[i, place], group[0], context)
                    write(left, y, _label(group[0], context), size=6.5, va="top", style="italic")
                    place += 1
                y -= _LINE * (len(_shown(group[0])) > 1)
                write(x, y, "\n".join(lines), size=6.5, va="top", linespacing=1.25)
            top -= heights[i]
        _legend(figure)
    return figure


def _ratio(model: Model) -> float:
    """Returns the height of a map relative to its width; at most 1, as maps are at most squares."""
    rows, columns = model.scenario.grid.size
    return min(rows / columns, 1.0)


def _groups(models: Sequence[Model]) -> list[list[Model]]:
    """Returns scenarios in groups that differ only in what is observed."""
    groups: dict[object, list[Model]] = {}
    for model in models:
        same = {"name": "", "description": "", "observe": ("agent",)}
        groups.setdefault(model.scenario.model_copy(update=same), []).append(model)
    return list(groups.values())


def _shown(model: Model) -> list[int]:
    """Returns which places and phases of a scenario are shown, see `Model.context`."""
    n_contexts = model.n_places * len(model.scenario.stages)
    n_shown = n_contexts if n_contexts <= _MOST_MAPS else 3
    return [i * n_contexts // n_shown for i in range(n_shown)]


def _label(model: Model, context: int) -> str:
    """Returns what is said of one of several maps of a scenario."""
    place, phase = divmod(context, len(model.scenario.stages))
    parts = [f"place {place + 1} of {model.n_places}"] if model.n_places > 1 else []
    if n_phases := len(model.scenario.stages) - 1:
        name = model.scenario.stages[phase].name
        parts.append(f"phase {name} of {n_phases + 1}" if name.isdecimal() else name)
    return ", ".join(parts)


def _text(group: Sequence[Model]) -> list[str]:
    """Returns the lines below the maps of scenarios."""
    first = group[0].scenario
    feedback = sorted({first.issuer.feedback.label, *(person.feedback.label for person in first.others)})
    about = [f"{first.grid.rows * first.grid.columns} cells, {' and '.join(feedback)}"]
    for model in group:
        hidden = ", ".join(_HIDDEN.get(part, part) for part in model.scenario.hidden) or "nothing"
        seen = f"{model.n_observations:,} observations"
        if len(group) > 1:
            about.append(f"{model.scenario.name}: {seen}; hidden: {hidden}")
        else:
            about += [seen, f"hidden: {hidden}"]
    width = _CHARACTERS * len(_shown(group[0]))
    return [line for sentence in about for line in wrap(sentence, width)]


def _map(axis: Axes, model: Model, context: int) -> None:
    """Draws one map; x is the column and y the row of a corner, as in `envs.scene`."""
    scene = scene_of(model, context)
    for outline in scene.outlines:
        _fill(axis, outline.loops, fc=_RGB[outline.region], zorder=1)
        style: dict[str, Any] = {"ls": _DASHES} if outline.is_dashed else {}
        _fill(axis, outline.loops, fill=False, ec=_RGB["ink"], lw=0.8, zorder=3, **style)
    _fill(axis, outlines(scene.is_wall.reshape(scene.rows, scene.columns)), fc=_RGB["wall"], zorder=1)
    lines: dict[str, Any] = {"color": _RGB["line"], "lw": 0.25, "zorder": 2}
    axis.vlines(np.arange(1, scene.columns), 0, scene.rows, **lines)
    axis.hlines(np.arange(1, scene.rows), 0, scene.columns, **lines)
    _people(axis, scene)
    _starts_and_way(axis, model, scene, context)
    axis.set(xlim=(0, scene.columns), ylim=(scene.rows, 0), aspect="equal", anchor="NW")
    axis.set_axis_on()
    axis.spines[:].set_visible(True)
    axis.set(xticks=[], yticks=[])


def _fill(axis: Axes, loops: Sequence[Loop], **style: Any) -> None:
    """Draws a set of cells, given its border; holes in it stay free."""
    corners = [np.array([*loop, loop[0]])[:, ::-1] for loop in loops]
    if corners:
        path = Path.make_compound_path(*(Path(points, closed=True) for points in corners))
        axis.add_patch(PathPatch(path, **({"lw": 0} | style)))


def _people(axis: Axes, scene: Scene) -> None:
    """Draws people as rings, with a nose where they look if that matters."""
    for glyph in scene.glyphs_of("issuer"):
        row, column = scene.centre(glyph.cell)
        if glyph.heading is not None:
            nose = np.array([row, column]) + 1.8 * glyph.nose
            axis.add_patch(Polygon(nose[:, ::-1].tolist(), closed=True, fc=_RGB["person"], lw=0, zorder=4))
        axis.add_patch(Circle((column, row), 0.42, fc="white", ec=_RGB["person"], lw=1.3, zorder=4))


def _starts_and_way(axis: Axes, model: Model, scene: Scene, context: int) -> None:
    """Draws where the agent may start, and the way of an issuer who moves."""
    n_phases = len(model.scenario.stages)
    is_here = model.context[model.starts] // n_phases == context // n_phases
    for cell in np.unique(model.cell[model.starts[is_here]]).tolist():
        row, column = scene.centre(cell)
        is_single = cell in scene.cells_of("start")
        axis.plot(column, row, **_START, ms=4 if is_single else 1.6)
    if model.scenario.moves:
        way = np.array([people[0].cell for people in model.scenario.people[context // n_phases]]) + 0.5
        axis.plot(*np.vstack([way, way[:1]])[:, ::-1].T, color=_RGB["person"], lw=0.9, ls=":", zorder=3)


def _legend(figure: Figure) -> None:
    """Draws a legend of what the maps show."""
    ink = _RGB["ink"]
    handles = [
        Line2D(
            [],
            [],
            ls="",
            marker="o",
            mfc="white",
            mec=_RGB["person"],
            mew=1.3,
            ms=6,
            label="person (nose: heading)",
        ),
        Patch(fc=_RGB["uncomfortable"], ec=ink, ls=_DASHES, lw=0.8, label="uncomfortable region"),
        Patch(fc=_RGB["target"], ec=ink, lw=0.8, label="target region"),
        Patch(fc=_RGB["wall"], label="wall"),
        Line2D([], [], **_START, ms=5, label="start"),
        Line2D([], [], **_START, ms=2, label="one of many starts"),
        Line2D([], [], color=_RGB["person"], lw=0.9, ls=":", label="way of the issuer"),
    ]
    figure.legend(
        handles=handles, loc="lower center", ncols=len(handles), frameon=False, fontsize=7, columnspacing=1.2
    )
