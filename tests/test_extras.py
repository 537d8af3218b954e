"""What has to be installed for what: the core for the environments, extras for the rest."""

import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from envs.inputs import EXTRAS, PACKAGES, InputError, imported, needed_by
from tests.support import PROJECT, ROOT, install, requirements

LAYERS = ("agents", "benchmark", "envs")
BOUNDED = {"pandas"}  # which reproduce brings, and deep only gives a bound


def installed(packages: Iterable[str], folder: Path) -> Path:
    """Returns a folder with some packages, all they need, and this project."""
    install(packages, folder)
    for layer in LAYERS:
        (folder / layer).symlink_to(ROOT / layer)
    return folder


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `pip install .` installs."""
    return installed(requirements(None), tmp_path_factory.mktemp("core"))


@pytest.fixture(scope="module")
def reproduce(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `pip install '.[reproduce]'` installs."""
    return installed(requirements(None) | requirements("reproduce"), tmp_path_factory.mktemp("reproduce"))


def python(folder: Path, *arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Runs Python with the packages of a folder alone: -S leaves out those that are installed."""
    environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
    environment["PYTHONPATH"] = str(folder)
    return subprocess.run(
        [sys.executable, "-S", *arguments], cwd=cwd, env=environment, capture_output=True, text=True
    )


def needs(what: str, package: str, extra: str, mark: str) -> str:
    """Returns a pattern of the message that a package is missing."""
    return (
        rf"{what} needs the package {package}, which is not installed; "
        rf"pip install 'proxemic-benchmark\[{extra}\]' installs it \(in a checkout: make \.venv/{mark}\)\.\n"
    )


def test_environments_need_only_the_core(core: Path, tmp_path: Path) -> None:
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
    compile_scenario(load_scenario(name))
    print(name, end=" ")
print()
image = gymnasium.make("envs:Proxemic/Walls-v0", render_mode="rgb_array")
image.reset(seed=0)
print(image.render().dtype)
"""
    done = python(core, "-c", code, cwd=tmp_path)
    assert done.stderr == ""
    names = "".join(f"{path.stem} " for path in sorted((ROOT / "envs" / "scenarios").glob("*.toml")))
    assert done.stdout.splitlines() == ["-0.1 True", "[-0.1, -0.1, -0.1]", names, "uint8"]


def test_window_names_its_extra(core: Path, tmp_path: Path) -> None:
    code = "import gymnasium; gymnasium.make('envs:Proxemic/S1-v0', render_mode='human').reset()"
    done = python(core, "-c", code, cwd=tmp_path)
    expected = needs(
        r'render_mode = "human" \(unlike "ansi" and "rgb_array"\)', "pygame-ce", "render", r"\.render"
    )
    assert re.search(expected, done.stderr)


def test_algorithms_name_their_extra(core: Path, tmp_path: Path) -> None:
    code = """
import agents
try: agents.load_algorithm("sarsa")
except agents.InputError as error: print(error)
"""
    done = python(core, "-c", code, cwd=tmp_path)
    assert "cannot be imported: No module named 'numba'; pip install 'proxemic-benchmark[rep" in done.stdout


def test_assessment_names_its_extra(core: Path, tmp_path: Path) -> None:
    code = "try: import benchmark.assessment\nexcept ImportError as error: print(error)"
    done = python(core, "-c", code, cwd=tmp_path)
    expected = needs("benchmark.assessment", r"\w+", "reproduce", r"\.base")
    assert re.fullmatch(expected, done.stdout), done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        "list",
        "run reproduce",
        "report",
        "watch",
        "assess --observation index --agent mine:act",
        "speed",
        "growth",
        "doctor",
    ],
)
def test_commands_name_their_extra(arguments: str, core: Path, tmp_path: Path) -> None:
    done = python(core, "-m", "benchmark", *arguments.split(), cwd=tmp_path)
    expected = needs(r"error: (agents|benchmark(\.| )\w+)", r"\w+", "reproduce", r"\.base")
    assert re.fullmatch(expected, done.stderr), done.stderr
    assert (done.returncode, done.stdout) == (2, "")


def test_help_needs_only_the_core(core: Path, tmp_path: Path) -> None:
    assert python(core, "-m", "benchmark", "run", "--help", cwd=tmp_path).returncode == 0


@pytest.mark.parametrize(
    ("arguments", "what", "package", "extra"),
    [
        ("run compare_deep", "dqn", "stable_baselines3", "deep"),
        ("run compare_deep --report", "compare_deep: its report", "rliable", "deep"),
        ("run compare_deep --tensorboard logs", "--tensorboard", "tensorboard", "tensorboard"),
        ("assess --observation index --model a.zip --algorithm a:B", "a.zip: a saved model", r"\w+", "deep"),
        ("speed", "benchmark speed", "torch", "deep"),
        ("growth", "benchmark growth", "distributed", "cluster"),
    ],
)
def test_commands_that_need_more_name_its_extra(
    arguments: str, what: str, package: str, extra: str, reproduce: Path, tmp_path: Path
) -> None:
    done = python(reproduce, "-m", "benchmark", *arguments.split(), cwd=tmp_path)
    last = done.stderr.splitlines(keepends=True)[-1]  # a line on progress may come before
    assert re.fullmatch(needs(f"error: {what}", package, extra, rf"\.{extra}"), last), done.stderr
    assert done.returncode == 2


def test_doctor_says_what_an_experiment_lacks(reproduce: Path, tmp_path: Path) -> None:
    done = python(reproduce, "-m", "benchmark", "doctor", "compare_deep", cwd=tmp_path)
    needed = needs("dqn", "stable_baselines3", "deep", r"\.deep").removesuffix(r"\.\n")
    assert re.search(rf"^problem +runs +{needed}$", done.stdout, re.MULTILINE), done.stderr
    assert re.search(r"^note +packages +the extra deep needs", done.stdout, re.MULTILINE)
    assert re.search(r"^ok +packages +complete extras: reproduce$", done.stdout, re.MULTILINE)
    assert (done.returncode, done.stderr) == (1, "")


@pytest.mark.parametrize("name", ["no_such_module", "pandas.no_such_module"])
def test_other_missing_modules_are_not_explained(name: str) -> None:
    """Neither somebody else's module, nor one that another version of an installed package has."""
    with pytest.raises(ModuleNotFoundError, match=f"^No module named '{name}'$"), needed_by("a test"):
        __import__(name)


def test_messages_of_names_say_what_installs_their_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "asks_for_torch.py").write_text("import torch.nn", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "torch.nn", raising=False)
    with pytest.raises(InputError) as refusal:
        imported("asks_for_torch:Net", "mine.toml", "algorithm")
    assert "; pip install 'proxemic-benchmark[deep]' installs it (in a" in str(refusal.value)
    assert len(str(refusal.value)) <= 300
    with pytest.raises(InputError, match="no_such_module'; if no_such_module is in a package, install that"):
        imported("no_such_module:Net", "mine.toml", "algorithm")


# Declarations


def test_extras_are_those_of_pyproject() -> None:
    assert {*EXTRAS} == {*PROJECT["optional-dependencies"]} - {"dev"}
    for extra, modules in EXTRAS.items():
        packages = {canonicalize_name(PACKAGES.get(module, module)) for module in modules}
        assert packages == requirements(extra) - (BOUNDED if extra == "deep" else set()), extra


def test_dev_brings_everything() -> None:
    """As an extra brings others: dev brings deep, and deep brings reproduce."""
    brought, todo = set(), {"dev"}
    while todo:
        extra = todo.pop()
        brought.add(extra)
        for line in map(Requirement, PROJECT["optional-dependencies"][extra]):
            todo |= (line.extras if line.name == PROJECT["name"] else set()) - brought
    assert brought == {*PROJECT["optional-dependencies"]}


def third_party(layers: Iterable[str]) -> set[str]:
    """Returns the modules of other packages that layers import, wherever the import stands."""
    names: set[str] = set()
    for path in (path for layer in layers for path in (ROOT / layer).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names.add(str(node.module).partition(".")[0])
    return names - sys.stdlib_module_names - {*LAYERS}


CORE = {*requirements(None), "pydantic_core"}  # pydantic's own, which its documentation says to import


def test_environments_import_what_is_declared() -> None:
    assert third_party(["envs"]) == CORE | {*EXTRAS["render"]}


def test_agents_and_benchmark_import_what_is_declared() -> None:
    """All that is declared is imported, too; rliable imports arch, and sb3_contrib is imported by name."""
    used = EXTRAS["reproduce"] + EXTRAS["deep"] + EXTRAS["cluster"]
    declared = CORE | {*used} - {"arch", "sb3_contrib"}
    assert third_party(LAYERS) - {*EXTRAS["render"]} == declared


def test_contributing_names_the_extra_of_every_dependency() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = text.partition("| package | extra | why |\n|---|---|---|\n")[2].splitlines()
    told: dict[str | None, set[str]] = {}
    for packages, extra, _ in (row.strip("|").split("|") for row in rows):
        told.setdefault(extra.strip(" `") or None, set()).update(packages.strip().split(", "))
    declared = {extra: requirements(extra) for extra in (None, *PROJECT["optional-dependencies"])}
    declared["deep"] -= BOUNDED
    assert told == declared
