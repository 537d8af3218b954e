"""Imports go one way: envs, agents, benchmark."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from tests.support import ROOT

LAYERS = ("envs", "agents", "benchmark", "tests")


@cache
def imported(path: Path) -> set[str]:
    """Returns the top-level names a file imports, wherever in it the import stands."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(str(node.module).split(".")[0])
    return names


@pytest.mark.parametrize("layer", LAYERS)
def test_no_arrow_points_backwards(layer: str) -> None:
    above = set(LAYERS[LAYERS.index(layer) + 1 :])
    files = sorted((ROOT / layer).rglob("*.py"))
    assert files
    for path in files:
        assert not imported(path) & above, path


ROOMS = ("experiments", "execution", "analysis", "drawing", "studies", "publish", "commands")


@pytest.mark.parametrize("room", ROOMS)
def test_no_arrow_points_backwards_inside_benchmark(room: str) -> None:
    """A function may still import from a later room when it is called: `load_study`, say."""
    above = {f"benchmark.{later}" for later in ROOMS[ROOMS.index(room) + 1 :]}
    for path in sorted((ROOT / "benchmark" / room).rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom):
                package = ".".join(str(node.module).split(".")[:2])
                assert package not in above, f"{path} imports {node.module}"


def test_only_the_deep_learners_load_torch() -> None:
    loading = {
        str(path.relative_to(ROOT))
        for layer in LAYERS[:3]
        for path in (ROOT / layer).rglob("*.py")
        if imported(path) & {"torch", "stable_baselines3"}
    }
    assert loading == {f"agents/sb3/{name}.py" for name in ("tables", "training", "vec_env", "wrappers")}


def test_torch_is_loaded_only_when_somebody_trains_a_net() -> None:
    code = (
        "import sys; from benchmark.experiments import *; "
        "from benchmark.execution import driver; from benchmark.publish import draw\n"
        "all_specifications(load_experiment('compare_deep'))\n"
        "assert not {'torch', 'stable_baselines3', 'rliable'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_only_the_store_knows_how_results_are_kept() -> None:
    for layer in LAYERS[:3]:
        for path in (ROOT / layer).rglob("*.py"):
            assert ("sqlite3" in imported(path)) == (path.name == "store.py"), path
