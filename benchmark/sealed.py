"""The old home of sealed JSON."""

from benchmark.folder import SEAL as SEAL
from benchmark.folder import sealed as sealed
from benchmark.folder import unsealed as unsealed
