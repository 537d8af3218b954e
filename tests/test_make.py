"""Every target of make, and every command's help."""

import re
import shutil
from pathlib import Path

import pandas as pd
import pytest

from benchmark.__main__ import main
from tests.support import ROOT, make, mistyped_columns


def run_make(target: str, tmp_path: Path) -> str:
    """Runs a target in miniature."""
    if target == "clean":  # in a copy, since it removes what other tests use
        ignored = shutil.ignore_patterns(".*", "__pycache__")
        shutil.copytree(ROOT, tmp_path / "copy", ignore=ignored)
        (tmp_path / "copy" / "envs" / "__pycache__").mkdir()
        (tmp_path / "copy" / "results" / "runs.db").touch()
        own = [tmp_path / "copy" / "results" / f"mine_{end}" for end in ("smoke", "partial", "seeds_0-9")]
        for folder in own:
            folder.mkdir()
        done = make("clean", cwd=tmp_path / "copy")
        assert not (tmp_path / "copy" / "envs" / "__pycache__").exists()
        assert not (tmp_path / "copy" / "results" / "runs.db").exists()
        assert not any(folder.exists() for folder in own)
        assert (tmp_path / "copy" / "results" / "reproduce" / "claims.csv").exists()
    else:
        if target == "report":
            shutil.copytree(ROOT / "results" / "reproduce", tmp_path / "reproduce")
        miniature = {
            "help": [],
            "report": [f"RESULTS={tmp_path}"],
            "test": ["TESTS=tests/test_layering.py"],
            "check": ["CHECKED=envs/inputs.py"],
            "chaos": ["CHAOS=--kills 3"],
            "fuzz": ["FUZZ=--inputs 40"],
            "speed": ["SPEED=--smoke", f"RESULTS={tmp_path}"],
            "growth": ["GROWTH=--smoke", f"RESULTS={tmp_path}"],
        }
        done = make(target, *miniature[target])
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


TARGETS = re.findall(r"^([a-z-]+):.*##", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)


# Other tests use what these make: tests/test_pipeline.py and tests/benchmark/reports.
@pytest.mark.parametrize("target", sorted({*TARGETS} - {"reproduce", "compare-deep", "beyond"}))
def test_every_other_target(target: str, tmp_path: Path) -> None:
    output = run_make(target, tmp_path)
    if target == "help":
        assert all(f"make {name}" in output for name in TARGETS)
    if target == "speed":
        assert mistyped_columns(tmp_path / "speed_smoke" / "speed.csv") == []
        speed = pd.read_csv(tmp_path / "speed_smoke" / "speed.csv")
        assert list(speed)[:4] == ["name", "per_second", "baseline", "ratio"]
        assert {"q_learning_kernel", "vector_env_1000", "evaluate", "sb3_dqn"} <= set(speed["name"])
    if target == "growth":
        assert [path.name for path in tmp_path.iterdir()] == ["growth_smoke"]
        files = [tmp_path / "growth_smoke" / f"{name}.csv" for name in ("growth", "workers", "overhead")]
        assert [mistyped_columns(path) for path in files] == [[], [], []]
        growth, workers, overhead = map(pd.read_csv, files)
        assert list(growth)[:4] == ["curve", "size", "unit", "seconds"]
        assert set(growth["curve"]) == {
            "agents_tables", "agents_nets", "cells_compile", "cells_solve", "cells_evaluate", "cells_train",
            "runs_list", "runs_resume", "runs_report",
        }  # fmt: skip
        assert list(workers["workers"]) == ["1 processes", "1 dask"]
        assert overhead["share"].between(0, 1).all()
    if target == "chaos":
        assert "disk full" in output
        assert "processes killed or interrupted: 3; runs lost, repeated or different: 0" in output
    if target == "report":
        assert {path.name for path in tmp_path.iterdir()} == {"README.md", "index.html", "reproduce"}


@pytest.mark.parametrize("target", ["reproduce", "compare-deep", "beyond"])
def test_seeds_are_passed_on_or_refused(target: str) -> None:
    shown = make("--dry-run", target, "SEEDS=30", "EXPERIMENT=mine").stdout
    assert shown.split()[-3:] == ["--seeds", "0-29", "mine"]
    refused = make("--dry-run", target, "SEEDS=many")
    assert refused.returncode == 2
    assert "SEEDS=many: accepted: a whole number, 2 or more" in refused.stderr


def test_every_command_explains_itself(capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("list", "run", "report", "verify", "watch", "assess", "doctor", "speed", "growth"):
        with pytest.raises(SystemExit) as ended:
            main([name, "--help"])
        assert ended.value.code == 0
        assert "--results" in capsys.readouterr().out
