"""Settings for all tests."""

import os
import signal

# A test trains nets in as many processes as it needs; threads of torch would only wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Commands that tests start need not compile the project's modules each time.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# A shell that runs the tests in the background ignores interrupts, and so would all commands that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)
