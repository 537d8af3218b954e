"""The command `run`."""

from pathlib import Path

import pytest

from benchmark.__main__ import main
from benchmark.execution import driver

TABLES = """
description = "Tables."
scenarios = ["S1", "S2", "S3"]
horizon = 50
evaluation_every = 100
map_every = 100
settings = { budget = 200, time_limit = 50 }
algorithms.q_learning = { algorithm = "q_learning", observations = ["index"], seeds = 1 }
"""


def test_what_runs_cannot_show_is_said_before_they_start(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def begin(*_: object) -> list[str]:
        assert capsys.readouterr().err.startswith("beyond_smoke: With 2 runs and 30 contrasts, ")
        raise KeyboardInterrupt

    monkeypatch.setattr(driver, "run", begin)
    assert main(["run", "beyond_smoke", "--results", str(tmp_path)]) == 130
