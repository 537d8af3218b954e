"""Packages of others that hide ours, or of users that cannot be imported: every command says which."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support import ROOT

NET = """
description = "A net that Stable-Baselines3 trains."
scenarios = ["S1"]
horizon = 50
evaluation_every = 200
map_every = 200
settings = { budget = 200 }
algorithms.dqn = { algorithm = "sb3_dqn", observations = ["one_hot"], seeds = 1 }
"""


def benchmark(folder: Path, package: str, content: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    (folder / package).mkdir()
    (folder / package / "__init__.py").write_text(content, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])}
    command = [sys.executable, "-m", "benchmark", *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


def hides(folder: Path) -> str:
    advice = "rename it, start Python elsewhere, or, if pip installed it, use another environment"
    return f"{folder} is found in place of this project's package {folder.name}; {advice}.\n"


@pytest.mark.parametrize("package", ["agents", "envs"])
def test_commands_name_a_package_that_hides_ours(tmp_path: Path, package: str) -> None:
    done = benchmark(tmp_path, package, "raise SystemError('planted')", "doctor")
    assert (done.stderr, done.returncode) == (f"error: {hides(tmp_path / package)}", 2)


@pytest.mark.parametrize("content", ["from agents.agent import Agent\n", None])
def test_import_names_a_package_that_was_installed_over_ours(tmp_path: Path, content: str | None) -> None:
    """Or one that was, until it was uninstalled."""
    for package in ("agents", "benchmark", "envs"):
        (tmp_path / package).mkdir()
        shutil.copy(ROOT / package / "__init__.py", tmp_path / package)
    file = tmp_path / "agents" / "__init__.py"
    file.unlink() if content is None else file.write_text(content, encoding="utf-8")
    command = [sys.executable, "-P", "-c", "import benchmark"]
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.stderr.endswith(f"\nImportError: {hides(tmp_path / 'agents')}")


def test_packages_of_users_are_not_explained(tmp_path: Path) -> None:
    """Nothing that pip finds under their names would mend them."""
    (tmp_path / "net.toml").write_text(NET.replace("sb3_dqn", "mylab:X"), encoding="utf-8")
    done = benchmark(tmp_path, "mylab", "import numpy; numpy.planted", "run", "net.toml")
    assert done.stderr.startswith("error: net.toml: "), done.stderr
    assert "algorithms.dqn" in done.stderr
    assert "planted" in done.stderr
    assert "pip install" not in done.stderr
    assert done.returncode == 2
