"""Tables of an equivalence: every arm against its check, and the verdict on them.

Success and score, clipped to [0, 1], have the intervals of `benchmark.analysis.intervals`. None is corrected
for their number.
"""

from dataclasses import asdict
from typing import Final

import numpy as np
import pandas as pd
from scipy import stats

from benchmark.analysis.contrasts import EQUIVALENT, UNDECIDED, Side, contrast
from benchmark.analysis.intervals import proportion_interval
from benchmark.drawing.differences import DIFFERENT
from benchmark.reports.equivalence.data import Data
from benchmark.reports.item import Frames

# How far apart the successes of an arm and its check may be. It was chosen for the precision of 100 runs of
# each: where half of them succeed, the 90 % interval of the difference extends 0.12 to either side, so that
# no margin below that could be met. It is not the smallest difference that matters.
MARGIN: Final = 0.15
VERDICTS: Final = (EQUIVALENT, DIFFERENT, UNDECIDED)


def verdict(ends_90: tuple[float, float], ends_95: tuple[float, float]) -> str:
    """Decides whether an arm and its check are equivalent in success.

    They are *equivalent* if the 90 % interval of the difference lies inside (-MARGIN, MARGIN). This amounts
    to two one-sided tests at the 5 % level (Schuirmann 1987), approximately, since the intervals are. They
    are so even if the 95 % interval excludes 0: a difference is then shown, but one smaller than the margin.
    Otherwise they are *different* if the 95 % interval excludes 0, and else *undecided*.

    Args:
      ends_90: Of the 90 % interval of the difference.
      ends_95: Of its 95 % interval.
    """
    if ends_90[0] > -MARGIN and ends_90[1] < MARGIN:
        return EQUIVALENT
    return DIFFERENT if ends_95[0] > 0 or ends_95[1] < 0 else UNDECIDED


def equivalence(data: Data, _: Frames) -> pd.DataFrame:
    """Tabulates every arm and its check after training, and the verdict on their success.

    Differences are the arm's mean minus that of its check. `ks` is the largest distance between the
    distribution functions of the scores, and `ks_p` its p-value by the two-sample Kolmogorov-Smirnov test.
    """
    rows = []
    for name, check_name in data.pairs:
        arm, check = data.runs[name], data.runs[check_name]
        n, check_n = len(arm.seeds), len(check.seeds)
        row = name._asdict() | {"check": check_name.algorithm, "n": n, "check_n": check_n}
        for key, values, check_values in (
            ("success", arm.success, check.success),
            ("score", np.clip(arm.scores, 0, 1), np.clip(check.scores, 0, 1)),
        ):
            mean, check_mean = float(values[:, -1].mean()), float(check_values[:, -1].mean())
            found = asdict(contrast(Side([mean], [n]), Side([check_mean], [check_n]), MARGIN))
            row |= {key: mean, f"check_{key}": check_mean, f"{key}_difference": found["difference"]}
            ends = {end: found[end] for end in ("low", "high", "low_90", "high_90")}
            row |= {f"{key}_difference_{end}": value for end, value in ends.items()}
            row[f"{key}_margin"] = MARGIN
            row[f"{key}_verdict"] = verdict((ends["low_90"], ends["high_90"]), (ends["low"], ends["high"]))
        same_scores = stats.ks_2samp(arm.scores[:, -1], check.scores[:, -1])
        rows.append(row | {"ks": same_scores.statistic, "ks_p": same_scores.pvalue})
    return pd.DataFrame(rows)


def curves(data: Data, _: Frames) -> pd.DataFrame:
    """Tabulates learning, one row per population and evaluation step."""
    frames = []
    for name, runs in data.runs.items():
        n = len(runs.seeds)
        columns = {**name._asdict(), "step": runs.steps, "n": n}
        for key, values in (("success", runs.success), ("score", np.clip(runs.scores, 0, 1))):
            mean = values.mean(axis=0)
            low, high = proportion_interval(mean, n)
            columns |= {key: mean, f"{key}_low": low, f"{key}_high": high}
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def scores(data: Data, _: Frames) -> pd.DataFrame:
    """Tabulates every run after training."""
    return pd.concat(
        [
            pd.DataFrame(
                {
                    **name._asdict(),
                    "seed": runs.seeds,
                    "success": runs.success[:, -1],
                    "unbounded_score": runs.scores[:, -1],
                }
            )
            for name, runs in data.runs.items()
        ],
        ignore_index=True,
    )
