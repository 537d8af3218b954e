"""Types of arrays, in whose names kernels say what they take; comments beside them give the axes."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Indices = NDArray[np.int32]
Words = NDArray[np.uint64]
Bools = NDArray[np.bool_]
