"""What an equivalence found, in sentences from its published table; judging words follow from its numbers."""

from collections.abc import Iterable
from typing import Final

import numpy as np
import pandas as pd
from scipy import stats

from benchmark.analysis.intervals import combined
from benchmark.drawing.tables import link, show
from benchmark.reports.equivalence.tables import VERDICTS
from benchmark.reports.published import Published

_TABLE: Final = "equivalence"


def headline(published: Published) -> str:
    """Counts the verdicts, and names the largest difference."""
    pairs = published.frame(_TABLE)
    arms, checks = (_listed_names(pairs[key].unique()) for key in ("algorithm", "check"))
    equivalent, different, undecided = (
        _number(pairs[pairs["success_verdict"] == verdict]) for verdict in VERDICTS
    )
    widest = _widest(pairs, "success")
    return (
        f"Agents of {arms} against those of {checks}: in {len(pairs)} pairs of populations, success is "
        f"equivalent within a margin of {pairs['success_margin'].iloc[0]:g} in {equivalent}, different in "
        f"{different} and undecided in {undecided}. The largest difference is "
        f"{_difference(widest, 'success')}, of {_name(widest)}."
    )


def sentences(published: Published) -> list[str]:
    """Names the pairs that differ or are undecided, and says what the numbers do not show."""
    pairs = published.frame(_TABLE)
    found = [
        _listed("Different in success", pairs[pairs["success_verdict"] == "different"], "success"),
        _listed("Undecided", pairs[pairs["success_verdict"] == "undecided"], "success"),
        _listed(
            "Equivalent, but with a difference whose 95 % interval excludes 0",
            _shown(pairs[pairs["success_verdict"] == "equivalent"], "success"),
            "success",
        ),
        _failing(pairs[pairs["success_verdict"] == "equivalent"]),
        _resolution(pairs),
        _scores(pairs),
        _distributions(pairs),
        _chance(pairs),
    ]
    return [text for text in found if text]


def _failing(equivalent: pd.DataFrame) -> str:
    """Says how many pairs are equivalent since nothing succeeds; empty if none is."""
    failing = equivalent[(equivalent["success"] == 0) & (equivalent["check_success"] == 0)]
    return (
        f"In {_number(failing)} of the equivalent pairs no run of either side succeeds."
        if len(failing)
        else ""
    )


def _resolution(pairs: pd.DataFrame) -> str:
    """Says which differences the runs can show or exclude where half of them succeed."""
    n, check_n, margin = (
        int(pairs["n"].min()),
        int(pairs["check_n"].min()),
        float(pairs["success_margin"].iloc[0]),
    )
    reach_90, reach_95 = (combined([1, -1], [0.5, 0.5], [n, check_n], level)[1] for level in (0.90, 0.95))
    limit = margin - reach_90
    text = (
        f"With {link(str(n), _TABLE, pairs)} runs of an arm and {link(str(check_n), _TABLE, pairs)} of its "
        f"check, half of which succeed, the 90 % interval of the difference extends {reach_90:.2f} to either "
        "side. Such a pair "
    )
    if limit <= 0:
        return f"{text}cannot be `equivalent`, and is `different` only above about {reach_95:.2f}."
    text += (
        f"is `equivalent` only if the observed difference is below about {limit:.2f}, and `different` only "
        f"if it is above about {reach_95:.2f}"
    )
    # The observed difference if both probabilities are one half, by the normal approximation.
    difference = stats.norm(scale=np.sqrt(1 / n + 1 / check_n) / 2)
    if difference.cdf(reach_95) - difference.cdf(limit) > difference.cdf(limit) - 0.5:
        text += "; even with equal probabilities of success it is more often undecided than equivalent"
    return f"{text}."


def _scores(pairs: pd.DataFrame) -> str:
    """Says how far scores are apart."""
    widest = _widest(pairs, "score")
    return (
        f"The largest difference in score is {_difference(widest, 'score')}, of {_name(widest)}. The "
        f"95 % interval of this difference excludes 0 in {_number(_shown(pairs, 'score'))} of {len(pairs)} "
        "pairs."
    )


def _distributions(pairs: pd.DataFrame) -> str:
    """Says how many distributions of scores differ."""
    differing = pairs[pairs["ks_p"] < 0.05]
    return (
        "By the two-sample Kolmogorov-Smirnov test, the distribution of the scores of runs differs "
        f"significantly at the 5 % level in {_number(differing)} of {len(pairs)} pairs."
    )


def _chance(pairs: pd.DataFrame) -> str:
    """Says how probable a chance finding is."""
    return (
        "Neither intervals nor tests are corrected for their number: if no pair differed, at least one of "
        f"{len(pairs)} independent 95 % intervals would exclude 0 with a probability of about "
        f"{1 - 0.95 ** len(pairs):.2f}."
    )


def _widest(pairs: pd.DataFrame, measure: str) -> pd.Series:
    """Returns the pair with the largest difference."""
    return pairs.iloc[int(pairs[f"{measure}_difference"].abs().argmax())]


def _shown(pairs: pd.DataFrame, measure: str) -> pd.DataFrame:
    """Returns the pairs with a 95 % interval of the difference that excludes 0."""
    low, high = pairs[f"{measure}_difference_low"], pairs[f"{measure}_difference_high"]
    return pairs[(low > 0) | (high < 0)]


def _listed(what: str, pairs: pd.DataFrame, measure: str) -> str:
    """Returns a sentence that names pairs with their differences; empty if there are none."""
    texts = [f"{_name(row)}: {_difference(row, measure)}" for _, row in pairs.iterrows()]
    return f"{what}: {'; '.join(texts)}." if texts else ""


def _listed_names(names: Iterable[str]) -> str:
    """Returns names as a list in a sentence: `a`, `b` and `c`."""
    *others, last = (f"`{name}`" for name in names)
    return f"{', '.join(others)} and {last}" if others else last


def _number(pairs: pd.DataFrame) -> str:
    """Returns how many pairs there are."""
    return link(str(len(pairs)), _TABLE, pairs) if len(pairs) else "none"


def _name(row: pd.Series) -> str:
    """Returns an arm with its check."""
    return f"`{row['algorithm']}, {row['observation']}` against `{row['check']}` in {row['scenario']}"


def _difference(row: pd.Series, measure: str) -> str:
    """Returns a difference with its 95 % interval."""
    key = f"{measure}_difference"
    return f"{link(show(row[key]), _TABLE, row)} [{show(row[f'{key}_low'])}, {show(row[f'{key}_high'])}]"
