"""Types of arrays, whose names say what functions take; comments beside them give the axes."""

from collections.abc import Callable
from dataclasses import is_dataclass
from functools import cached_property, wraps
from typing import Any, TypeVar

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

T = TypeVar("T")


def read_only(value: T) -> T:
    """Makes arrays read-only: one, or those in a tuple or a dataclass; returns the value."""
    if isinstance(value, np.ndarray):
        value.flags.writeable = False
        read_only(value.base)  # whose memory it may share
    elif isinstance(value, tuple):
        for each in value:
            read_only(each)
    elif is_dataclass(value):
        read_only(tuple(vars(value).values()))
    return value


def read_only_property(function: Callable[[Any], T]) -> cached_property[T]:
    """Decorates a method: its result is computed once, and its arrays are read-only."""
    return cached_property(wraps(function)(lambda owner: read_only(function(owner))))
