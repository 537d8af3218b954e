"""Looks of learners, and figures as SVG."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest

from benchmark.experiment import experiment_names, load_experiment
from benchmark.scenes import shipped
from benchmark.style import WIDTH, figure_of, ink_on, look, name_lines, save, svg

LOOKS = {
    name: {key: look(each, learners.values()) for key, each in learners.items()}
    for name in experiment_names()
    for learners in [load_experiment(name).learners]
}
PERSONAL: Any = {  # what people set
    "axes.grid": True,
    "font.family": "fantasy",
    "hatch.color": "red",
    "image.cmap": "jet",
    "lines.linewidth": 9,
    "path.sketch": (1, 100, 2),
    "savefig.bbox": "tight",
    "svg.fonttype": "path",
    "svg.hashsalt": "mine",
}


@pytest.mark.parametrize("name", LOOKS)
def test_no_two_learners_of_an_experiment_look_alike(name: str) -> None:
    assert len({*map(str, LOOKS[name].values())}) == len(LOOKS[name])


def test_a_reference_implementation_is_hollow_and_has_its_learners_colour() -> None:
    found = LOOKS["compare_deep"]
    net, reference = found["dqn, one_hot"], found["sb3_dqn, one_hot"]
    assert reference == net | {"mfc": "white", "ls": (0, (1, 1))}
    assert LOOKS["sb3"]["sb3_dqn, one_hot"] == reference  # where there is nothing that it refers to


def test_unknown_learners_differ_whoever_is_asked_first() -> None:
    known = load_experiment("compare_deep").learners["dqn, one_hot"]
    others = [replace(known, variant=f"mine_{i}") for i in range(40)]
    looks = [look(each, others) for each in others]
    assert len({(each["color"], each["marker"]) for each in looks}) == 40
    assert [look(each, others[::-1]) for each in others] == looks
    taken = {(each["color"], each["marker"]) for found in LOOKS.values() for each in found.values()}
    assert taken.isdisjoint((each["color"], each["marker"]) for each in looks)


def test_names_of_lines_are_in_their_order_and_within_the_figure() -> None:
    ends = {"learner on coordinates, the lowest": 0.1, "highest": 0.9, "middle": 0.5}
    with figure_of(1, 1, (WIDTH, 2.6)) as (figure, axes):
        style = LOOKS["sb3"]["sb3_ppo, one_hot"]
        name_lines(axes[0, 0], {name: (end, style) for name, end in ends.items()})
        axes[0, 0].plot([0, 1])
    figure.draw_without_rendering()
    legend = axes[0, 0].get_legend()
    texts = [text.get_text().replace("\n", " ") for text in legend.get_texts()]
    assert texts == ["highest", "middle", "learner on coordinates, the lowest"]
    box = legend.get_window_extent()
    assert axes[0, 0].bbox.x1 <= box.x0
    assert box.x1 <= figure.bbox.x1


def test_svg_does_not_depend_on_the_last_digits_of_a_machine() -> None:
    drawn = []
    for i in range(2):
        with figure_of(1, 1, (4.0, 3.0)) as (figure, axes):
            x = np.linspace(0, 1, 50) + i * 1e-13
            axes[0, 0].plot(x, x**2, label='0.123456 x="0.123456"')
            figure.legend()
        drawn.append(svg(figure))
    assert drawn[0] == drawn[1]
    assert ElementTree.fromstring(drawn[0]).tag.endswith("svg")
    assert not re.findall(r'<[^>]* (?:x|d|transform)="[^"]*\.\d{3,}', drawn[0])
    assert '>0.123456 x="0.123456"<' in drawn[0]  # texts are not rounded
    assert "date" not in drawn[0]


def test_figures_do_not_depend_on_the_users_settings() -> None:
    plain = svg(shipped())
    with mpl.rc_context(PERSONAL):
        assert svg(shipped()) == plain
