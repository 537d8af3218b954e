"""Types of arrays, whose names say what functions take; comments beside them give the axes."""

import numpy as np
from numpy.typing import NDArray

Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Codes = NDArray[np.int8]
Floats = NDArray[np.float64]
Indices = NDArray[np.int32]
Ints = NDArray[np.int64]
Unsigned = NDArray[np.uint32]
Records = NDArray[np.void]
Singles = NDArray[np.float32]
Words = NDArray[np.uint64]
