"""Settings for all tests."""

import os

# A test trains nets in as many processes as it needs; threads of torch would only wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")
