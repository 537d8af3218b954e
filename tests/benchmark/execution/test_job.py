"""What a record holds of what was trained."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from benchmark.execution.job import recorded

VALUES = st.floats(-8000, 8000, width=32) | st.floats(-1, 1, width=32) | st.just(np.nan)


@given(arrays(np.float32, (1, 2, 3, 5), elements=VALUES))
def test_recorded_values_have_the_decimals_that_are_published(values: NDArray[np.float32]) -> None:
    made = recorded({"values": values, "stochastic": np.empty((1, 0, 3, 5))})["values"]
    assert made.dtype == np.float32
    published = np.round(values.astype(np.float64), 3)
    assert np.round(made.astype(np.float64), 3).tobytes() == published.tobytes()
    assert np.array_equal(made, published.astype(np.float32), equal_nan=True)


def test_recorded_probabilities_are_those_after_training() -> None:
    values = np.zeros((2, 1, 3, 5), dtype=np.float32)
    stochastic = np.random.default_rng(0).dirichlet(np.ones(5), (2, 4, 3))
    made = recorded({"values": values, "stochastic": stochastic, "updates": np.arange(2)})
    assert np.array_equal(made["stochastic"], stochastic[:, 3:])
    assert made["updates"].tolist() == [0, 1]
    assert recorded({"values": values, "stochastic": stochastic[:, :0]})["stochastic"].shape == (2, 0, 3, 5)
