"""What has to be installed for what, the core or extras, and what distributions have."""

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterable
from importlib.metadata import distribution
from pathlib import Path
from typing import Final

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from benchmark import __version__
from envs.packages import extras, needed_by, package_of
from tests.support import PROJECT, ROOT, copy_compiled, git
from tests.test_layering import imported

LAYERS: Final = ("agents", "benchmark", "envs")


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what `pip install .` installs, and one beside it with what the extra `reproduce` adds.

    This project is there as a wheel, built without a network from a source distribution of a copy of the
    sources, and unpacked.
    """
    directory = tmp_path_factory.mktemp("installed")
    source = directory / "source"
    for name in sources():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    made_later = "results/runs.db", "results/index.html", "results/a_smoke/a.csv", "envs/a.pyc"
    for name in made_later:
        (source / name).parent.mkdir(exist_ok=True)
        (source / name).touch()
    build = f"from setuptools import build_meta; build_meta.build_sdist({str(directory)!r})"
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check"]
    wheel_of = ["-m", "pip", "wheel", *options, "--wheel-dir", str(directory)]
    for command in (["-c", build], [*wheel_of, str(directory / f"proxemic_benchmark-{__version__}.tar.gz")]):
        done = subprocess.run([sys.executable, *command], cwd=source, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
    (wheel,) = directory.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(directory / "core")
    copy_compiled(directory / "core")
    install(requirements(None), directory / "core")
    (directory / "reproduce").mkdir()
    install(requirements(None) | requirements("reproduce"), directory / "reproduce")
    return directory


def sources() -> set[str]:
    """Returns the files of this repository, new ones, too."""
    listed = ["ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    return {name for name in git(ROOT, *listed).split("\0") if name and (ROOT / name).is_file()}


def requirements(extra: str | None) -> set[str]:
    """Returns the packages that an extra adds to others, or those of the core."""
    lines = PROJECT["dependencies"] if extra is None else PROJECT["optional-dependencies"][extra]
    names: set[str] = {canonicalize_name(Requirement(line).name) for line in lines}
    return names - {PROJECT["name"]}


def install(packages: Iterable[str], folder: Path) -> None:
    """Links packages and all they need into a folder, as if pip had installed only these there."""
    found: set[str] = set()
    todo = [*packages]
    while todo:
        package = canonicalize_name(todo.pop())
        if package in found:
            continue
        found.add(package)
        needed = map(Requirement, distribution(package).requires or ())
        todo += [each.name for each in needed if not each.marker or each.marker.evaluate({"extra": ""})]
        for file in distribution(package).files or ():
            link = folder / file.parts[0]
            if file.parts[0] not in ("..", "__pycache__") and not link.exists():
                link.symlink_to(distribution(package).locate_file(file.parts[0]))  # type: ignore[arg-type]


def python(
    installed: Path, *arguments: str, cwd: Path, extras: bool = False
) -> subprocess.CompletedProcess[str]:
    """Runs Python with what is installed there alone: -S leaves out other packages."""
    environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
    folders = [installed / "core", *([installed / "reproduce"] if extras else [])]
    environment["PYTHONPATH"] = os.pathsep.join(map(str, folders))
    command = [sys.executable, "-S", *arguments]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True)


def needs(what: str, package: str, extra: str, mark: str) -> str:
    return (
        rf"{what} needs the package {package}, which is not installed; in a checkout of this project, "
        rf"make \.venv/{mark} installs it, and pip install 'CHECKOUT\[{extra}\]' elsewhere, "
        r"where CHECKOUT is its path\.\n"
    )


def test_distributions_have_every_file(installed: Path) -> None:
    """The wheel those of the packages, and the source distribution those of the repository."""
    paths = (path for package in LAYERS for path in (installed / "core" / package).rglob("*"))
    names = {str(path.relative_to(installed / "core")) for path in paths if path.is_file()}
    in_wheel = {name for name in names if "__pycache__" not in name}
    assert in_wheel == {name for name in sources() if name.startswith(LAYERS)}
    name = f"proxemic_benchmark-{__version__}"
    with tarfile.open(installed / f"{name}.tar.gz") as archive:
        files = {member.name.removeprefix(f"{name}/") for member in archive if member.isfile()}
    made = {file for file in files if ".egg-info/" in file} | {"PKG-INFO", "setup.cfg"}
    assert files - made == sources()


def test_version_is_the_same_everywhere(installed: Path, tmp_path: Path) -> None:
    (entry,) = (installed / "core").glob("proxemic_benchmark-*.dist-info/entry_points.txt")
    module, _, name = entry.read_text(encoding="utf-8").split(" = ")[1].strip().partition(":")
    code = f"import sys; from {module} import {name}; sys.exit({name}())"
    shown = f"proxemic-benchmark {__version__}\n"
    assert python(installed, "-c", code, "--version", cwd=tmp_path).stdout == shown
    assert f"\nversion: {__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


@pytest.mark.slow
def test_an_agent_of_the_current_folder_is_scored_and_told_where_ranks_are(
    installed: Path, tmp_path: Path
) -> None:
    (tmp_path / "ten.py").write_text("act = lambda observation: 3\n", encoding="utf-8")
    code = "import sys; from benchmark.__main__ import main, script\nscript(); main(sys.argv[1:] + RANKS)"
    code = code.replace("RANKS", f"{['--results', str(ROOT / 'results')]}")
    arguments = ["assess", "--agent", "ten:act", "--observation", "index"]
    done = python(installed, "-c", code, *arguments, cwd=tmp_path, extras=True)
    said = r"\nno rank: .*\n\(all are in the folder results of a checkout: results=PATH, or --results"
    assert re.search(rf"{said}(.|\n)*ranks ", done.stdout), done.stderr


def test_environments_need_only_the_core(installed: Path, tmp_path: Path) -> None:
    code = """
import gymnasium, numpy
env = gymnasium.make("envs:Proxemic/S1-v0", observation="coordinates", render_mode="ansi")
env.reset(seed=0)
print(env.step(1)[1], "I" in env.render())
envs = gymnasium.make_vec("Proxemic/S1-v0", num_envs=3)
envs.reset(seed=0)
print(envs.step(numpy.array([1, 1, 1]))[1].tolist())
from envs import compile_scenario, load_scenario, scenario_names
for name in sorted(scenario_names()):
    scenario = load_scenario(name)
    compile_scenario(load_scenario(scenario, {"issuer.places": 6}) if scenario.group else scenario)
    print(name, end=" ")
print()
image = gymnasium.make("envs:Proxemic/Walls-v0", render_mode="rgb_array")
image.reset(seed=0)
print(image.render().dtype)

import agents, benchmark, envs
print(*(package.__file__ for package in (agents, benchmark, envs)))
for what in ("agents.load_algorithm('sarsa')", "__import__('benchmark.assessment')"):
    try: eval(what)
    except ImportError as error: print(error)
    except agents.InputError as error: print(error)
"""
    done = python(installed, "-c", code, cwd=tmp_path)
    assert done.stderr == ""
    names = "".join(f"{path.stem} " for path in sorted((ROOT / "envs" / "scenarios").glob("*.toml")))
    *said, files, algorithm, assessment = done.stdout.splitlines(keepends=True)
    assert [line.rstrip("\n") for line in said] == ["-0.1 True", "[-0.1, -0.1, -0.1]", names, "uint8"]
    assert files.split() == [str(installed / "core" / package / "__init__.py") for package in LAYERS]
    assert "No module named 'numba'; in a checkout of this project, make .venv/.base installs it" in algorithm
    assert re.fullmatch(needs("benchmark.assessment", r"\w+", "reproduce", r"\.base"), assessment)
    assert python(installed, "-m", "benchmark", "--help", cwd=tmp_path).returncode == 0


@pytest.mark.slow
def test_experiment_is_run_and_reported(installed: Path, tmp_path: Path) -> None:
    # It is installed in a repository of something else, whose commit is not that of the code.
    git = ["git", "-C", str(installed), "-c", "user.name=A", "-c", "user.email=a@example.org"]
    subprocess.run([*git, "init", "--quiet"], check=True)
    subprocess.run([*git, "commit", "--quiet", "--allow-empty", "-m", "Else"], check=True)
    arguments = ["run", "reproduce", "--smoke", "--report", "--seeds", "0-1", "--results", "out"]
    done = python(installed, "-m", "benchmark", *arguments, cwd=tmp_path, extras=True)
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "out" / "reproduce_smoke_seeds_0-1"
    names = {path.name for path in folder.iterdir()}
    assert {"README.md", "claims.csv", "figure.svg", "manifest.json", "index.html"} <= names
    for name in ("README.md", "index.html"):
        assert "very learner has the seeds 0 to 1 instead of" in (folder / name).read_text(encoding="utf-8")
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["command"] == "python -m benchmark run reproduce --smoke --seeds 0-1 --report"
    assert manifest["commits"] == [None]


@pytest.mark.parametrize(
    ("arguments", "what", "package", "extra", "mark"),
    [
        ("list", "benchmark list", r"\w+", "reproduce", "base"),
        pytest.param(
            "run compare_deep --report", "compare_deep: its report", "rliable", "deep", "deep",
            marks=pytest.mark.slow,
        ),
    ],
)  # fmt: skip
def test_commands_name_their_extra(
    arguments: str, what: str, package: str, extra: str, mark: str, installed: Path, tmp_path: Path
) -> None:
    has_extras = extra != "reproduce"
    done = python(installed, "-m", "benchmark", *arguments.split(), cwd=tmp_path, extras=has_extras)
    last = done.stderr.splitlines(keepends=True)[-1]  # a line on progress may come before
    assert re.fullmatch(needs(f"error: {what}", package, extra, rf"\.{mark}"), last), done.stderr
    assert done.returncode == 2


@pytest.mark.parametrize("name", ["no_such_module", "pandas.no_such_module"])
def test_other_missing_modules_are_not_explained(name: str) -> None:
    """Neither somebody else's module, nor one that another version of an installed package has."""
    with pytest.raises(ModuleNotFoundError, match=f"^No module named '{name}'$"), needed_by("a test"):
        __import__(name)


# Declarations


def test_extras_are_those_of_pyproject() -> None:
    declared = {extra: requirements(extra) for extra in PROJECT["optional-dependencies"]}
    assert {extra: {*extras()[extra]} for extra in declared} == declared


def third_party(layers: Iterable[str]) -> set[str]:
    """Returns the modules of other packages that layers import, wherever the import stands."""
    names = (imported(path) for layer in layers for path in (ROOT / layer).rglob("*.py"))
    return set().union(*names) - sys.stdlib_module_names - {*LAYERS}


def test_what_is_imported_is_declared() -> None:
    """All that is declared is imported, too, except what others import, as Gymnasium does pygame."""
    core = {*requirements(None), "pydantic-core"}  # pydantic's own, which its documentation says to import
    assert {*map(package_of, third_party(["envs"]))} == core
    used = {name for extra in ("reproduce", "deep", "cluster") for name in extras()[extra]}
    # Of other packages, and by name
    used -= {"arch", "imageio-ffmpeg", "moviepy", "sb3-contrib", "tensorboard", "tqdm"}
    assert {*map(package_of, third_party(LAYERS))} - {*extras()["render"]} == core | used
