"""A wheel has all that is needed: it works outside the repository, by itself."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.support import ROOT, install, requirements

PACKAGES = ("agents", "benchmark", "envs")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel of a copy of the sources, built without a network."""
    directory = tmp_path_factory.mktemp("wheel")
    source = directory / "source"
    for package in PACKAGES:
        shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check"]
    command = [sys.executable, "-m", "pip", "wheel", *options, "--wheel-dir", str(directory), str(source)]
    done = subprocess.run(command, cwd=directory, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    (path,) = directory.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def unpacked(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel's content in a folder, with what the extra `reproduce` brings and no other package."""
    directory = tmp_path_factory.mktemp("unpacked")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(directory)
    install(requirements(None) | requirements("reproduce"), directory)
    return directory


def python(unpacked: Path, *arguments: str, cwd: Path) -> str:
    """Runs Python with the wheel and its packages alone: -S leaves out those that are installed."""
    environment = os.environ | {"PYTHONPATH": str(unpacked), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-S", *arguments]
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_wheel_has_every_file_of_the_packages(wheel: Path) -> None:
    sources = {
        str(path.relative_to(ROOT))
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert names == sources


def test_environments_of_a_wheel_can_be_made(unpacked: Path, tmp_path: Path) -> None:
    code = """
import gymnasium
env = gymnasium.make("envs:Proxemic/S1-v0")
env.reset(seed=0)
print(env.step(1)[1])

import agents, benchmark, envs
print(*(package.__file__ for package in (agents, benchmark, envs)), sep="\\n")
"""
    reward, *files = python(unpacked, "-c", code, cwd=tmp_path).splitlines()
    assert reward == "-0.1"
    assert files == [str(unpacked / package / "__init__.py") for package in PACKAGES]


def test_wheel_runs_an_experiment_and_reports_it(unpacked: Path, tmp_path: Path) -> None:
    # The wheel lies in a repository of something else, whose commit is not that of the code.
    git = ["git", "-C", str(unpacked), "-c", "user.name=A", "-c", "user.email=a@example.org"]
    subprocess.run([*git, "init", "--quiet"], check=True)
    subprocess.run([*git, "commit", "--quiet", "--allow-empty", "-m", "Else"], check=True)
    arguments = ["run", "reproduce_smoke", "--report", "--jobs", "1", "--results", "out"]
    output = python(unpacked, "-m", "benchmark", *arguments, cwd=tmp_path)
    assert "156 runs done, 0 were done already" in output
    folder = tmp_path / "out" / "reproduce_smoke"
    names = {path.name for path in folder.iterdir()}
    assert {"README.md", "figure.svg", "claims.csv", "manifest.json", "index.html"} <= names
    assert json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["commits"] == [None]
