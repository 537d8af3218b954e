"""Looks of learners, and figures as SVG."""

import re
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest

from benchmark.scenes import shipped
from benchmark.style import WIDTH, Look, figure_of, look, name_lines, svg
from tests.support import made, small_experiment, variant

EXPERIMENT = small_experiment(
    algorithms={
        "q_learning": variant(),
        "dqn": variant("compiled_dqn", "one_hot", "coordinates", "offset_tiles"),
        "sb3_dqn": variant("sb3_dqn", "one_hot"),
        "sb3_ppo": variant("sb3_ppo", "one_hot"),
        **{f"mine_{i}": variant(title=f"mine {i}") for i in range(40)},
    }
)


@pytest.fixture(scope="module")
def looks(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Look]:
    """The looks of learners in an experiment."""
    learners = made(tmp_path_factory.mktemp("looks") / "mine.toml", EXPERIMENT).learners
    return {name: look(each, learners.values()) for name, each in learners.items()}


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


def test_no_two_learners_of_an_experiment_look_alike(looks: dict[str, Look]) -> None:
    assert len({*map(str, looks.values())}) == len(looks)
    mine = {(own["color"], own["marker"]) for name, own in looks.items() if "mine" in name}
    assert len(mine) == 40


def test_a_reference_implementation_is_hollow_and_has_its_learners_colour(
    looks: dict[str, Look],
) -> None:
    assert looks["sb3_dqn, one_hot"] == looks["dqn, one_hot"] | {"mfc": "white"}
    assert looks["sb3_ppo, one_hot"]["mfc"] == "white"  # where there is nothing that it refers to


def test_names_of_lines_are_in_their_order_and_within_the_figure(looks: dict[str, Look]) -> None:
    ends = {"learner on coordinates, the lowest": 0.1, "highest": 0.9, "middle": 0.5}
    with figure_of(1, 1, (WIDTH, 2.6)) as (figure, axes):
        style = looks["sb3_ppo, one_hot"]
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
