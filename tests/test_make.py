"""Every target of make."""

import re
import shutil
from pathlib import Path

import pandas as pd
import pytest

from tests.support import ROOT, make, mistyped_columns

TARGETS = re.findall(r"^([\w-]+):.*##", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)
# Of each target: what makes it a miniature, what it says, and what it makes.
MINIATURES: dict[str, tuple[list[str], list[str], set[str]]] = {
    "help": ([], [f"make {name} " for name in TARGETS], set()),
    "test": (["TESTS=envs/inputs.py"], ["passed"], set()),
    "test-slow": (["TESTS=tests/benchmark/commands/test_export.py"], ["1 passed"], set()),
    "check": (["CHECKED=tests/__init__.py"], ["no issues found in 1 source file"], set()),
    "report": ([], [], {"README.md", "index.html"}),
    "when": (["SMOKE=1"], ["the page is"], {"runs.db", "when_smoke/map.svg"}),
    "sb3": (["SMOKE=1"], ["the page is"], {"runs.db", "sb3_smoke/curves.svg"}),
    "speed": (["SPEED=--smoke"], [], {"speed_smoke/README.md"}),
}


# Other tests use what these make; `groups` differs from `when` in their experiment alone.
TESTED_ELSEWHERE = {"clean", "reproduce", "compare-deep", "tune", "groups"}


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
    if not made:
        assert [*tmp_path.iterdir()] == []
    if target == "speed":
        table = tmp_path / "speed_smoke" / "speed.csv"
        assert mistyped_columns(table) == []
        rows = {"q_learning_kernel", "net_ppo_one_hot"}
        assert rows <= set(pd.read_csv(table)["name"])


def test_clean_leaves_sources_and_published_results(tmp_path: Path) -> None:
    kept = {f"{name}/mine.py" for name in ("agents", "benchmark", "envs", "tests")}
    kept |= {"results/reproduce/claims.csv"}
    removed = {"envs/__pycache__/mine.pyc", "results/runs.db", "results/index.html", "build/lib/index.html"}
    removed |= {f"results/mine_{kind}/claims.csv" for kind in ("smoke", "seeds_0-9")}
    for path in (tmp_path / name for name in kept | removed):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    done = make("--file", str(ROOT / "Makefile"), "clean", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()} == kept


@pytest.mark.parametrize("target", ["reproduce", "compare-deep", "groups"])
def test_seeds_are_passed_on_or_refused(target: str) -> None:
    shown = make("--dry-run", target, "SEEDS=30", "SMOKE=1", "EXPERIMENT=mine").stdout
    assert shown.split()[-4:] == ["--smoke", "--seeds", "0-29", "mine"]
    refused = make("--dry-run", target, "SEEDS=many")
    assert refused.returncode == 2
    assert "SEEDS=many: accepted: a whole number, 2 or more" in refused.stderr
