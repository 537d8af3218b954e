"""Tables of an equivalence: every arm against its check, and the verdict on them.

Intervals of successes are score intervals, those of scores bootstrap intervals over runs, and seeded, see
`benchmark.analysis.intervals`. None is corrected for their number.
"""

from typing import Final

import pandas as pd
from scipy import stats

from benchmark.analysis.intervals import mean_with_interval, newcombe, resample, wilson
from benchmark.reports.equivalence.data import Data
from benchmark.reports.item import Frames

# How far apart the successes of an arm and its check may be. It was chosen for the precision of 100 runs of
# each: where half of them succeed, the 90 % interval of the difference extends 0.11 to either side, so that
# no margin below that could be met. It is not the smallest difference that matters.
MARGIN: Final = 0.15
VERDICTS: Final = ("equivalent", "different", "undecided")


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
        return "equivalent"
    return "different" if ends_95[0] > 0 or ends_95[1] < 0 else "undecided"


def equivalence(data: Data, _: Frames) -> pd.DataFrame:
    """Tabulates every arm and its check after training, and the verdict on their success.

    Differences are the arm's mean minus that of its check. `ks` is the largest distance between the
    distribution functions of the scores, and `ks_p` its p-value by the two-sample Kolmogorov-Smirnov test.
    """
    rows = []
    for name, check_name in data.pairs:
        arm, check = data.runs[name], data.runs[check_name]
        n, check_n = len(arm.seeds), len(check.seeds)
        success, check_success = arm.success[:, -1].mean(), check.success[:, -1].mean()
        ends_90, ends_95 = (newcombe(success, n, check_success, check_n, level) for level in (0.90, 0.95))
        scores, check_scores = arm.scores[:, -1], check.scores[:, -1]
        weights = resample(n, name.scenario), resample(check_n, f"check in {name.scenario}")
        resampled = weights[0] @ scores / n - weights[1] @ check_scores / check_n
        same_scores = stats.ks_2samp(scores, check_scores)
        rows.append(
            name._asdict()
            | {"check": check_name.algorithm, "n": n, "check_n": check_n}
            | {
                "success": success,
                "check_success": check_success,
                "success_difference": success - check_success,
            }
            | dict(zip(("success_difference_low", "success_difference_high"), ends_95, strict=True))
            | dict(zip(("success_difference_low_90", "success_difference_high_90"), ends_90, strict=True))
            | {"margin": MARGIN, "verdict": verdict(ends_90, ends_95)}
            | {"score_mean": scores.mean(), "check_score_mean": check_scores.mean()}
            | mean_with_interval("score_difference", resampled)
            | {"ks": same_scores.statistic, "ks_p": same_scores.pvalue}
        )
    return pd.DataFrame(rows)


def curves(data: Data, _: Frames) -> pd.DataFrame:
    """Tabulates learning, one row per population and evaluation step."""
    frames = []
    for name, runs in data.runs.items():
        n = len(runs.seeds)
        success = runs.success.mean(axis=0)
        low, high = wilson(success, n, 0.95)
        columns = {**name._asdict(), "step": runs.steps, "n": n}
        columns |= {"success": success, "success_low": low, "success_high": high}
        columns |= mean_with_interval("score_mean", resample(n, name.scenario) @ runs.scores / n)
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
                    "score": runs.scores[:, -1],
                }
            )
            for name, runs in data.runs.items()
        ],
        ignore_index=True,
    )
