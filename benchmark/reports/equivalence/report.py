"""The equivalence as a report: its items and what they are called."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import pandas as pd

from benchmark.drawing.tables import with_intervals
from benchmark.reports.equivalence import findings, tables
from benchmark.reports.equivalence.data import Name, check, load
from benchmark.reports.item import Frames, Item, Report, Section
from benchmark.reports.published import Published
from benchmark.reports.view import Columns

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_KEYS: Final = (*Name._fields, "success_verdict")
_NUMBERS: Final = {
    "success": "success",
    "check_success": "check's success",
    "success_difference": "difference",
    "success_difference_low_90": "90 %, from",
    "success_difference_high_90": "to",
    "score": "score",
    "check_score": "check's score",
    "score_difference": "difference",
}


def _display(frame: pd.DataFrame) -> pd.DataFrame:
    shown = with_intervals(frame, ["success_difference", "score_difference"])
    return shown[[*_KEYS, "n", "check_n", *_NUMBERS, "ks_p"]]


def _draw_equivalence(frames: Frames, _: None) -> "Figure":
    from benchmark.reports.equivalence import figures

    return figures.equivalence(frames["equivalence"])


def _words(published: Published) -> Sequence[tuple[str, str]]:
    """Explains the terms of the tables."""
    return [
        (
            "margin",
            "how far apart the success probabilities of a pair may be: "
            f"{published.frame('equivalence')['success_margin'].iloc[0]:g}. It was chosen for the precision "
            "of 100 runs, not as the smallest difference that matters.",
        ),
        (
            "success",
            "the probability, evaluated exactly, that an episode of the greedy policy ends with a PING in "
            "the target region; a mean over runs.",
        ),
        (
            "score",
            "undiscounted return by the grid's rewards, scaled between the exact random policy (0) and the "
            f"exact optimum (1), both under a limit of {published.manifest['horizon']} steps, and clipped to "
            "[0, 1] in every run. `unbounded_score` is not clipped.",
        ),
        (
            "intervals",
            "95 % intervals in brackets. Those of means are exact binomial ones (Clopper and Pearson), which "
            "are conservative for numbers in [0, 1]; those of differences follow from them (Zou and Donner "
            "2008). They are not corrected for their number.",
        ),
        (
            "ks, ks_p",
            "largest distance between the distribution functions of both sides' scores without bounds, and "
            "its p-value by the two-sample Kolmogorov-Smirnov test. Ties make the test conservative.",
        ),
    ]


ITEMS: Final = (
    Item(
        name="equivalence",
        description="each arm and its check: success, score, their differences, and the verdict",
        compute=tables.equivalence,
        display=_display,
        draw=_draw_equivalence,
        caption="Differences of arms and their checks, with their intervals, the margin and the verdicts.",
        view=Columns(
            file="equivalence.csv",
            caption="Each arm and its check after training",
            keys=_KEYS,
            numbers=_NUMBERS,
        ),
    ),
    Item(
        name="curves",
        description="success and score over training, with their 95 % intervals",
        compute=tables.curves,
    ),
    Item(name="scores", description="every run after training: success and score", compute=tables.scores),
)

REPORT: Final = Report(
    name="equivalence",
    question="Do compiled agents succeed as often as those of Stable-Baselines3?",
    check=check,
    load=load,
    items=ITEMS,
    sections=(
        Section(
            key="equivalence",
            heading="Equivalence",
            text=(
                "A check is an arm with the settings of another arm, trained by another implementation, from "
                "the same observations and with its own random streams. A pair is a population of the arm "
                "and that of its check; a difference is the mean of the arm minus that of its check. A pair "
                "is `equivalent` if the 90 % interval of its difference in success after training lies "
                "within the margin to either side of 0. This amounts to two one-sided tests at about the 5 % "
                "level, since the intervals are approximate. Otherwise it is `different` if the 95 % "
                "interval excludes 0, and else `undecided`. `equivalent` means that a difference as large as "
                "the margin is rejected at the 5 % level. It does not mean that successes are equal, and it "
                "says nothing about scores or earlier steps."
            ),
        ),
    ),
    headline=findings.headline,
    sentences=findings.sentences,
    words=_words,
)
