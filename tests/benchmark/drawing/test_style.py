"""Colours and marks of learners, and figures as SVG."""

import re
from itertools import pairwise
from pathlib import Path
from typing import Any, get_args
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from benchmark.drawing.maps import shipped
from benchmark.drawing.style import (
    INK,
    PALETTE,
    WIDTH,
    figure_of,
    learner_style,
    name_lines,
    save_figure,
    svg,
)
from benchmark.experiments.schema import Colour

PERSONAL: Any = {  # what people set
    "axes.grid": True,
    "font.family": "fantasy",
    "font.size": 30,
    "hatch.color": "red",
    "image.cmap": "jet",
    "lines.linewidth": 9,
    "lines.marker": "o",
    "path.sketch": (1, 100, 2),
    "savefig.bbox": "tight",
    "svg.fonttype": "path",
    "svg.hashsalt": "mine",
}


def brightness(colour: Any) -> float:
    return float(np.dot(to_rgb(colour), [0.3, 0.59, 0.11]))


def test_no_two_learners_look_alike_in_grey_either() -> None:
    named = {name: learner_style(name, "index", {name: name}) for name in PALETTE}
    assert {*PALETTE} == {*get_args(Colour)}
    for x, y in (("blue", "navy"), ("orange", "brown"), ("violet", "navy"), ("black", "grey")):
        assert abs(brightness(named[x]["color"]) - brightness(named[y]["color"])) > 0.15, (x, y)
    # Other variants are told apart whatever colours are named between them.
    colours = {"named": "blue"} | dict.fromkeys(map(str, range(120)))
    for family, n in (("", 120), ("linear", 6)):
        styles = [learner_style(str(i), "index", colours, family) for i in range(n)]
        assert len({(style["color"], style["marker"]) for style in styles}) == n
    for key in ("color", "marker"):
        assert {style[key] for style in styles}.isdisjoint(style[key] for style in named.values())
    assert abs(brightness(styles[0]["color"]) - brightness(styles[1]["color"])) > 0.15
    looks = [
        learner_style("named", form, colours) for form in ("one_hot", "coordinates", "offset_coordinates")
    ]
    assert len({str(look["ls"]) for look in looks}) == len({look["color"] for look in looks}) == 3


@pytest.mark.parametrize("ends", [[0.0] * 6, [1.0] * 6, [0.5] * 6, [0, 0.9, 0.2, 0.91, 0.05, 1]], ids=str)
def test_names_of_lines_do_not_overlap_and_are_in_order(ends: list[float]) -> None:
    titles = [f"learner {i} on coordinates" for i in range(len(ends))]
    with figure_of(1, 1, (WIDTH, 2.6)) as (figure, axes):
        axes[0, 0].set_ylim(0, 1)
        style = learner_style("dqn", "index", {"dqn": "blue"})
        name_lines(axes[0, 0], {title: (end, style) for title, end in zip(titles, ends, strict=True)})
    figure.draw_without_rendering()
    texts = sorted(axes[0, 0].texts, key=lambda text: text.get_window_extent().y0)
    boxes = [text.get_window_extent() for text in texts]
    assert [text.get_text().replace("\n", " ") for text in texts] == [
        titles[i] for i in np.argsort(ends, kind="stable")
    ]
    assert all(below.y1 <= above.y0 for below, above in pairwise(boxes))
    assert all(box.x0 > axes[0, 0].bbox.x1 and box.x1 < figure.bbox.x1 for box in boxes)
    assert boxes[0].y0 > 0
    assert boxes[-1].y1 < figure.bbox.y1


@pytest.mark.parametrize("text", ["$x^2$", r"$\frac$"])
def test_texts_are_no_mathematics_but_ticks_of_a_logarithmic_axis_are(text: str, tmp_path: Path) -> None:
    with figure_of(1, 1, (4.0, 3.0)) as (figure, axes):
        axes[0, 0].plot([1, 1000], [0, 1], label=text)
        axes[0, 0].set(title=text, xscale="log")
        figure.legend()
    save_figure(figure, tmp_path / "f.svg")
    svg = (tmp_path / "f.svg").read_text(encoding="utf-8")
    assert svg.count(f">{text}<") == 2  # title and legend
    ticks = [re.findall(r">(\d)</tspan>", tick) for tick in re.findall("<text>(.*?)</text>", svg, re.DOTALL)]
    assert ["1", "0", "0"] in ticks  # and a small 0


def test_svg_is_small_the_same_and_readable_in_the_dark(tmp_path: Path) -> None:
    for i in range(2):
        with figure_of(1, 1, (4.0, 3.0)) as (figure, axes):
            # Two machines may differ in a last digit.
            x = np.linspace(0, 1, 50) + i * 1e-13
            axes[0, 0].plot(x, x**2, label="0.123456", **learner_style("dqn", "one_hot", {"dqn": "navy"}))
            axes[0, 0].text(0.5, 0.5, "on a colour", color=INK[0])
            figure.legend()
        save_figure(figure, tmp_path / f"{i}.svg")
    svg, again = ((tmp_path / f"{i}.svg").read_text(encoding="utf-8") for i in range(2))
    assert svg == again
    assert ElementTree.fromstring(svg).tag.endswith("svg")
    assert len(svg) < 8000
    assert not re.findall(r'[ "]-?\d+\.\d{3,}', svg.partition("</style>")[2])
    assert ">0.123456<" in svg  # texts are not rounded
    plain, dark = svg.partition("</style>")[0].split("@media (prefers-color-scheme:dark)")
    rules = [dict(re.findall(r"\.(c\d+)\{([^}]*)\}", part)) for part in (plain, dark)]

    def of(colour: str) -> set[str]:
        return {name for name, style in rules[0].items() if colour in style}

    assert of("#16206b")
    assert of("#16206b") <= {*rules[1]}  # navy is lighter in the dark
    assert "fill:#14171a" in rules[1][of("fill:#ffffff").pop()]
    assert "#e6e9ec" in dark
    assert of(INK[0])
    assert not of(INK[0]) & {*rules[1]}
    (navy,) = re.findall("fill:(#[0-9a-f]{6});stroke", rules[1][max(of("#16206b") & of("fill:#16206b"))])
    assert brightness(navy) > 0.4


def test_figures_do_not_depend_on_the_users_settings() -> None:
    plain = svg(shipped())
    with mpl.rc_context(PERSONAL):
        assert svg(shipped()) == plain
