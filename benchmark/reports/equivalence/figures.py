"""The figure of an equivalence: a data frame becomes a picture, and nothing is computed."""

import pandas as pd
from matplotlib.figure import Figure

from benchmark.drawing.differences import differences


def equivalence(pairs: pd.DataFrame) -> Figure:
    """Draws the differences of arms and their checks, with the margin and the verdicts.

    Args:
      pairs: `benchmark.reports.equivalence.tables.equivalence`.
    """
    names = [
        f"{row.scenario}: {row.algorithm} − {row.check}, {row.observation}" for row in pairs.itertuples()
    ]
    return differences(pairs, names, {"success": "success probability", "score": "score, clipped to [0, 1]"})
