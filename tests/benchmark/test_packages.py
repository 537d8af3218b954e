"""Packages that are not installed, or hide ours: commands say which."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support import ROOT

ABSENT = "error: the package numpy is not installed; pip install numpy installs it"


@pytest.mark.parametrize("package", ["agents", "envs", "numpy"])
def test_commands_name_a_package_that_hides_ours_or_is_not_installed(tmp_path: Path, package: str) -> None:
    (file := tmp_path / package / "__init__.py").parent.mkdir()
    file.write_text('raise ModuleNotFoundError("planted", name="numpy")', encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    command = [sys.executable, "-m", "benchmark", "list"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    hidden = f"ImportError: {file} is found in place of this project's package {package}; rename it."
    assert done.stderr.splitlines()[-1].startswith(ABSENT if package == "numpy" else hidden)
    assert done.returncode == (2 if package == "numpy" else 1)
