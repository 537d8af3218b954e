"""The cores that this process may use, by its control groups (version 2), and file locks."""

import fcntl
import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path


def usable_cores() -> int:
    """Returns how many cores this process may keep busy, at least 1."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    quotas = []
    for text in _control_files("cpu.max"):  # "200000 100000" or "max 100000": microseconds, of a period
        quota, _, period = text.partition(" ")
        if quota != "max":
            quotas.append(int(quota) / int(period))
    return max(1, int(min([cores, *quotas])))


def lock(descriptor: int, waiting: str) -> None:
    """Locks an open file or folder; says that it is waiting if another process has locked it."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        print(waiting, file=sys.stderr)
        fcntl.flock(descriptor, fcntl.LOCK_EX)


def _control_files(name: str) -> Iterator[str]:
    """Yields the content of a file in each control group that this process is in, except the root."""
    root = Path("/sys/fs/cgroup")
    with suppress(OSError):
        groups = Path("/proc/self/cgroup").read_text(encoding="utf-8").splitlines()
        own = next((line[3:] for line in groups if line.startswith("0::")), "/")  # version 2
        folder = root / own.strip("/")
        for group in (folder, *folder.parents):
            if group.is_relative_to(root):  # a container's own group is mounted as the root
                with suppress(OSError):
                    yield (group / name).read_text(encoding="ascii").strip()
