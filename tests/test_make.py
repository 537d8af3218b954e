"""Every target of make, in miniature."""

import re
import shutil
from pathlib import Path

import pytest

from tests.support import ROOT, make

MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
TARGETS = re.findall(r"^([\w-]+):.*##", MAKEFILE, flags=re.MULTILINE)
SMOKE = ["SMOKE=1"], ["open "]
# Of each target: what makes it a miniature, what it says, and what it makes.
MINIATURES: dict[str, tuple[list[str], list[str], set[str]]] = {
    "help": ([], [f"make {name} " for name in TARGETS], set()),
    "test": (["TESTS=envs/inputs.py"], ["passed"], set()),
    "test-slow": (["TESTS=tests/benchmark/test_export.py"], ["1 passed"], set()),
    "check": (["CHECKED=tests/__init__.py"], ["no issues found in 1 source file"], set()),
    "report": ([], [], {"README.md", "index.html"}),
    "when": (*SMOKE, {"runs.db", "when_smoke/ladder.svg"}),
    "compare-deep": (*SMOKE, {"runs.db", "compare_deep_smoke/curves.svg"}),
    "bench": (
        ["ALGO=sb3_contrib:TRPO", "SETTINGS=gamma=0.95", "STOCHASTIC=1", "SMOKE=1"],
        ["| TRPO"],
        {"runs.db", "bench_TRPO", "bench_TRPO_smoke/suite.svg"},
    ),
    "speed": (["SPEED=--smoke"], [], {"speed_smoke/README.md"}),
}
# Other tests use what these make; `suite` differs from `when` in its experiment alone.
TESTED_ELSEWHERE = {"clean", "reproduce", "suite", "tune"}


@pytest.mark.slow
@pytest.mark.parametrize("target", sorted({*TARGETS} - TESTED_ELSEWHERE))
def test_every_other_target(target: str, tmp_path: Path) -> None:
    if target == "report":
        shutil.copytree(ROOT / "results" / "reproduce", tmp_path / "reproduce")
    settings, expected, made = MINIATURES[target]
    done = make(target, *settings, f"RESULTS={tmp_path}")
    assert done.returncode == 0, done.stdout + done.stderr
    assert [text for text in expected if text not in done.stdout] == []
    assert [name for name in made if not (tmp_path / name).exists()] == []
    assert made or not [*tmp_path.iterdir()]


def test_clean_leaves_sources_and_published_results(tmp_path: Path) -> None:
    kept = {f"{name}/mine.py" for name in ("agents", "benchmark", "envs", "tests")}
    kept |= {"results/reproduce/claims.csv"}
    removed = {
        "envs/__pycache__/a.pyc",
        "results/runs.db",
        "results/index.html",
        "build/index.html",
    }
    removed |= {f"results/mine_{kind}/claims.csv" for kind in ("smoke", "seeds_0-9")}
    for path in (tmp_path / name for name in kept | removed):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    done = make("--file", str(ROOT / "Makefile"), "clean", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    left = (path for path in tmp_path.rglob("*") if path.is_file())
    assert {str(path.relative_to(tmp_path)) for path in left} == kept


@pytest.mark.parametrize("target", ["reproduce", "compare-deep", "suite"])
def test_seeds_are_passed_on_or_refused(target: str) -> None:
    shown = make("--dry-run", target, "SEEDS=30", "SMOKE=1", "EXPERIMENT=mine").stdout
    assert shown.split()[-4:] == ["--smoke", "--seeds", "0-29", "mine"]
    refused = make("--dry-run", target, "SEEDS=many")
    assert refused.returncode == 2
    assert "SEEDS=many: accepted: a whole number, 2 or more" in refused.stderr
