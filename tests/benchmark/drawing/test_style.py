"""Colours and markers of arms."""

import seaborn as sns
from matplotlib.colors import to_rgba

from benchmark.drawing.style import arm_style


def test_first_eight_arms_look_as_published() -> None:
    palette = sns.color_palette("colorblind")
    colours = ["black", "0.5", *(palette[i] for i in (0, 2, 3, 9, 1, 4))]
    expected = [
        {"color": colour, "marker": marker} for colour, marker in zip(colours, "osD^vPXh", strict=True)
    ]
    assert [arm_style(place) for place in range(8)] == expected


def test_no_two_arms_look_alike() -> None:
    styles = [arm_style(place) for place in range(300)]
    looks = {(to_rgba(style["color"]), style["marker"]) for style in styles}
    assert len(looks) == 300
