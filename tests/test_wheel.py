"""A wheel has all that is needed: it works outside the repository, by itself."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("agents", "benchmark", "envs")
# The wheel alone is used: an editable install of the repository would come after PYTHONPATH.
PREAMBLE = """
import pathlib, sys
import agents, benchmark, envs
unpacked = pathlib.Path(sys.argv.pop(1))
for package in (agents, benchmark, envs):
    assert pathlib.Path(package.__file__).is_relative_to(unpacked), package.__file__
"""


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
    """The wheel's content, in a folder."""
    directory = tmp_path_factory.mktemp("unpacked")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(directory)
    return directory


def run(unpacked: Path, code: str, *arguments: str, cwd: Path) -> str:
    """Runs code that imports the wheel's packages, and returns its output."""
    environment = {"PYTHONPATH": str(unpacked), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", PREAMBLE + code, str(unpacked), *arguments],
        cwd=cwd,
        env=os.environ | environment,
        capture_output=True,
        text=True,
    )
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
"""
    assert run(unpacked, code, cwd=tmp_path) == "-0.1\n"


def test_wheel_runs_an_experiment_and_reports_it(unpacked: Path, tmp_path: Path) -> None:
    # A repository of something else around the working folder must not pass for the code's own.
    subprocess.run(["git", "init", "--quiet", str(unpacked)], check=True)
    code = "from benchmark.__main__ import main\nsys.exit(main(sys.argv[1:]))\n"
    arguments = ["run", "reproduce_smoke", "--report", "--results", "out"]
    output = run(unpacked, code, *arguments, cwd=tmp_path)
    assert "138 runs done, 0 were done already" in output
    folder = tmp_path / "out" / "reproduce_smoke"
    assert {"README.md", "figure.svg", "claims.csv", "manifest.json"} <= {
        path.name for path in folder.iterdir()
    }
    assert '"commits": [\n    null\n  ]' in (folder / "manifest.json").read_text(encoding="utf-8")
    assert (tmp_path / "out" / "index.html").exists()
