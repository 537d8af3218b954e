"""Packages that cannot be imported, or hide ours: every command says which, and what repairs that."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support import ROOT, small_experiment, variant

NET = small_experiment(algorithms={"dqn": variant("sb3_dqn", "one_hot", seeds=1)})


def sentence(package: str, reason: str) -> str:
    advice = f"if it is broken, pip install --force-reinstall {package} repairs it"
    constraints = "(in a checkout: with -c constraints.txt)"
    return f"the package {package} cannot be imported ({reason}); {advice} {constraints}."


def benchmark(folder: Path, package: str, content: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    (folder / package).mkdir()
    (folder / package / "__init__.py").write_text(content, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])}
    command = [sys.executable, "-m", "benchmark", *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


@pytest.mark.parametrize(
    ("package", "content", "reason", "command"),
    [
        ("numba", "import ctypes; ctypes.CDLL('/no.so')", "OSError: /no.so: cannot open", "run reproduce"),
        ("numpy", "raise ImportError('planted')", "ImportError: planted", "--help"),
    ],
)
def test_commands_name_a_broken_package(
    tmp_path: Path, package: str, content: str, reason: str, command: str
) -> None:
    done = benchmark(tmp_path, package, content, *command.split())
    before, after = sentence(package, reason).split("); ")
    assert done.stderr.startswith(f"error: {before}"), done.stderr
    assert done.stderr.endswith(f"); {after}\n")
    assert done.stderr.count("\n") == 1
    assert done.returncode == 2


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


def test_run_names_the_package_that_a_worker_cannot_import(tmp_path: Path) -> None:
    (tmp_path / "net.toml").write_text(NET, encoding="utf-8")
    done = benchmark(tmp_path, "torch", "raise RuntimeError('planted')", "run", "net.toml")
    assert sentence("torch", "RuntimeError: planted") in done.stderr
    assert "Traceback" not in done.stderr
    assert done.returncode == 1


def test_packages_of_users_are_not_explained(tmp_path: Path) -> None:
    """Nothing that pip finds under their names would mend them."""
    (tmp_path / "net.toml").write_text(NET.replace("sb3_dqn", "mylab:X"), encoding="utf-8")
    done = benchmark(tmp_path, "mylab", "import numpy; numpy.planted", "run", "net.toml")
    assert done.stderr.startswith("error: net.toml: "), done.stderr
    assert "algorithms.dqn" in done.stderr
    assert "planted" in done.stderr
    assert "pip install" not in done.stderr
    assert done.returncode == 2
