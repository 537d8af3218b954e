"""Colours and markers of variants, and texts in figures."""

import re
from pathlib import Path

import pytest
from matplotlib.colors import to_rgba

from benchmark.drawing.style import figure_of, save_figure, variant_style


def test_no_two_variants_look_alike() -> None:
    styles = [variant_style(place) for place in range(300)]
    assert len({(to_rgba(style["color"]), style["marker"]) for style in styles}) == 300


@pytest.mark.parametrize("text", ["$x^2$", r"$\frac$", "a_b, 5 $", r"\$x$"])
def test_texts_are_no_mathematics_but_ticks_of_a_logarithmic_axis_are(text: str, tmp_path: Path) -> None:
    with figure_of(1, 1, (4.0, 3.0)) as (figure, axes):
        axes[0, 0].plot([1, 1000], [0, 1], label=text)
        axes[0, 0].set(title=text, xscale="log")
        figure.legend()
    save_figure(figure, tmp_path / "f.svg")
    svg = (tmp_path / "f.svg").read_text(encoding="utf-8")

    def glyphs(shown: str) -> list[int]:
        """Returns of how many outlines each drawing of a text consists."""
        drawn = re.findall(rf"<!-- {re.escape(shown)} -->(.*?)\n    </g>", svg, re.DOTALL)
        return [len(re.findall("<use ", each)) for each in drawn]

    assert glyphs(text) == [len(text)] * 2  # title and legend
    assert glyphs(r"$\mathdefault{10^{0}}$") == [3]  # 1, 0 and a small 0
