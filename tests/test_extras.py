"""What has to be installed for what, the core or extras, and what distributions have."""

import os
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterable
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from benchmark import __version__
from envs.packages import extras, package_of
from tests.support import PROJECT, ROOT, copy_compiled, copy_sources
from tests.test_layering import imported

LAYERS = ("agents", "benchmark", "envs")


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a source distribution, and what a wheel of it installs, in `core`.

    Both are built without a network, from sources among which commands have left their files.
    """
    directory = tmp_path_factory.mktemp("built")
    copy_sources(source := directory / "source")
    for name in ("results/runs.db", "results/index.html", "results/a_smoke/a.csv", "envs/a.pyc"):
        (source / name).parent.mkdir(exist_ok=True)
        (source / name).touch()
    build = f"from setuptools import build_meta; build_meta.build_sdist({str(directory)!r})"
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check"]
    wheel_of = ["-m", "pip", "wheel", *options, "--wheel-dir", str(directory)]
    for command in (
        ["-c", build],
        [*wheel_of, str(directory / f"proxemic_benchmark-{__version__}.tar.gz")],
    ):
        done = subprocess.run(
            [sys.executable, *command], cwd=source, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr
    (wheel,) = directory.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(directory / "core")
    copy_compiled(directory / "core")
    return directory


def requirements(extra: str | None) -> set[str]:
    """Returns the packages that an extra adds to others, or those of the core."""
    lines = PROJECT["dependencies"] if extra is None else PROJECT["optional-dependencies"][extra]
    names: set[str] = {canonicalize_name(Requirement(line).name) for line in lines}
    return names - {PROJECT["name"]}


def python(
    built: Path, code: str, *arguments: str, cwd: Path, without: Iterable[str] = ()
) -> subprocess.CompletedProcess[str]:
    """Runs Python with the wheel of this project, and without some packages."""
    absent = {module for module in packages_distributions() if package_of(module) in {*without}}
    code = f"import sys; sys.modules.update(dict.fromkeys({absent}))\n{code}"
    environment = os.environ | {"PYTHONPATH": str(built / "core")}
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True)


COMMAND = "from benchmark.__main__ import main; sys.exit(main())"


def test_distributions_have_every_file(built: Path) -> None:
    """The wheel those of the packages, and the source distribution those of the repository."""
    in_repository = copy_sources(None)
    paths = (path for package in LAYERS for path in (built / "core" / package).rglob("*"))
    names = {str(path.relative_to(built / "core")) for path in paths if path.is_file()}
    in_wheel = {name for name in names if "__pycache__" not in name}
    assert in_wheel == {name for name in in_repository if name.startswith(LAYERS)}
    name = f"proxemic_benchmark-{__version__}"
    with tarfile.open(built / f"{name}.tar.gz") as archive:
        files = {member.name.removeprefix(f"{name}/") for member in archive if member.isfile()}
    made = {file for file in files if ".egg-info/" in file} | {"PKG-INFO", "setup.cfg"}
    assert files - made == in_repository


def test_version_is_the_same_everywhere(built: Path, tmp_path: Path) -> None:
    shown = f"proxemic-benchmark {__version__}\n"
    assert python(built, COMMAND, "--version", cwd=tmp_path).stdout == shown
    assert f"\nversion: {__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_environments_need_only_the_core(built: Path, tmp_path: Path) -> None:
    code = """
import gymnasium, numpy
env = gymnasium.make("envs:Proxemic/S1-v0", observation="coordinates", render_mode="ansi")
env.reset(seed=0)
print(env.step(1)[1], "I" in env.render())
envs = gymnasium.make_vec("Proxemic/S1-v0", num_envs=3)
envs.reset(seed=0)
print(envs.step(numpy.array([1, 1, 1]))[1].tolist())
image = gymnasium.make("envs:Proxemic/Walls-v0", render_mode="rgb_array")
image.reset(seed=0)
print(image.render().dtype)
import envs
print(envs.__file__)
"""
    done = python(
        built, code, cwd=tmp_path, without=set().union(*extras().values()) - requirements(None)
    )
    assert done.stderr == ""
    *said, file = done.stdout.splitlines()
    assert said == ["-0.1 True", "[-0.1, -0.1, -0.1]", "uint8"]
    assert file == str(built / "core" / "envs" / "__init__.py")


def test_commands_name_their_extra(built: Path, tmp_path: Path) -> None:
    command = "run", "compare_deep", "--report"
    done = python(built, COMMAND, *command, cwd=tmp_path, without=["rliable"])
    needs = "its report needs the package rliable, which is not installed; "
    assert done.stderr.startswith(f"error: compare_deep: {needs}")
    assert "[deep]" in done.stderr
    assert done.returncode == 2


@pytest.mark.slow
def test_experiment_is_run_and_reported_where_it_is_installed(built: Path, tmp_path: Path) -> None:
    arguments = ["run", "reproduce", "--smoke", "--report", "--results", "out"]
    done = python(built, COMMAND, *arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    names = {path.name for path in (tmp_path / "out" / "reproduce_smoke").iterdir()}
    assert {"README.md", "claims.csv", "figure.svg", "manifest.json", "index.html"} <= names


# Declarations


def test_extras_are_those_of_pyproject() -> None:
    declared = {extra: requirements(extra) for extra in PROJECT["optional-dependencies"]}
    assert {extra: {*extras()[extra]} for extra in declared} == declared


def third_party(layers: Iterable[str]) -> set[str]:
    """Returns the modules of other packages that layers import, wherever the import stands."""
    names = (imported(path) for layer in layers for path in (ROOT / layer).rglob("*.py"))
    return set().union(*names) - sys.stdlib_module_names - {*LAYERS}


def test_what_is_imported_is_declared() -> None:
    """All that is declared is imported, too, except what others import."""
    core = {*requirements(None), "pydantic-core"}  # pydantic's own
    assert {*map(package_of, third_party(["envs"]))} == core
    used = {name for extra in ("reproduce", "deep", "cluster") for name in extras()[extra]}
    # Of other packages, and by name
    used -= {"arch", "imageio-ffmpeg", "moviepy", "pillow", "rich", "sb3-contrib", "tabulate"}
    used -= {"tensorboard", "tqdm"}
    assert {*map(package_of, third_party(LAYERS))} - {*extras()["render"]} == core | used
