"""The cores that this process may use, and file locks."""

import fcntl
import os
import sys


def usable_cores() -> int:
    """Returns how many cores this process may keep busy, at least 1."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def lock(descriptor: int, waiting: str) -> None:
    """Locks an open file or folder; says that it is waiting if another process has locked it."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        print(waiting, file=sys.stderr)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
