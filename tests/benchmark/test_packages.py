"""Packages that are not installed, or hide ours: every command says which, and what repairs that."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support import ROOT


def hides(folder: Path) -> str:
    advice = "rename it, start Python elsewhere, or, if pip installed it, use another environment"
    return f"{folder} is found in place of this project's package {folder.name}; {advice}.\n"


@pytest.mark.parametrize("package", ["agents", "envs", "numpy"])
def test_commands_name_a_package_that_hides_ours_or_is_not_installed(tmp_path: Path, package: str) -> None:
    (tmp_path / package).mkdir()
    content = 'raise ModuleNotFoundError("planted", name="numpy")'
    (tmp_path / package / "__init__.py").write_text(content, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    command = [sys.executable, "-m", "benchmark", "doctor"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    absent = (
        "the package numpy is not installed; pip install numpy installs it (in a checkout: make .venv/.base)"
    )
    expected = f"{absent}.\n" if package == "numpy" else hides(tmp_path / package)
    assert (done.stderr, done.returncode) == (f"error: {expected}", 2)


@pytest.mark.parametrize("content", ["from agents.agent import Agent\n", None])
def test_import_names_a_package_that_was_installed_over_ours(tmp_path: Path, content: str | None) -> None:
    """The package may have been uninstalled since."""
    for package in ("agents", "benchmark", "envs"):
        (tmp_path / package).mkdir()
        shutil.copy(ROOT / package / "__init__.py", tmp_path / package)
    file = tmp_path / "agents" / "__init__.py"
    file.unlink() if content is None else file.write_text(content, encoding="utf-8")
    command = [sys.executable, "-P", "-c", "import benchmark"]
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.stderr.endswith(f"\nImportError: {hides(tmp_path / 'agents')}")
