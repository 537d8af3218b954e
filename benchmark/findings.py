"""Says in ten plain sentences what a comparison found; every word that judges follows from a number."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from benchmark.comparison import REACHED, Grid, Learner

Frames = Mapping[str, pd.DataFrame]  # the tables of `benchmark.comparison`, by name


def sentences(grid: Grid, frames: Frames) -> list[str]:
    """Returns ten sentences, each with its figures."""
    return ["to do"]
