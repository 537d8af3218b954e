"""What tests of several rooms call: the project's commands, as users run them."""

import subprocess
import sys
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]


def command(*arguments: str | Path, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Runs `python -m benchmark`."""
    return subprocess.run(
        [sys.executable, "-m", "benchmark", *map(str, arguments)], cwd=cwd, capture_output=True, text=True
    )


def make(*arguments: str, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Runs make with this Python, which has all it needs, instead of one that make installs."""
    settings = [f"PY={sys.executable}", "BASE=", "DEEP=", "DEV="]
    return subprocess.run(
        ["make", "--no-print-directory", *arguments, *settings], cwd=cwd, capture_output=True, text=True
    )
