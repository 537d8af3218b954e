"""What tests of the reports share."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="session")
def miniature(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of results with the comparison in miniature, as the command makes it."""
    folder = tmp_path_factory.mktemp("miniature")
    arguments = ["run", "compare_deep_smoke", "--report", "--results", str(folder)]
    done = subprocess.run(
        [sys.executable, "-m", "benchmark", *arguments], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return folder
