"""The command `run`."""

from pathlib import Path

import pytest

from benchmark.__main__ import main
from benchmark.execution import driver
from benchmark.execution.progress import Display
from benchmark.execution.store import Record

TABLES = """
description = "Tables."
scenarios = ["S1", "S2", "S3"]
horizon = 50
evaluation_every = 100
map_every = 100
settings = { budget = 200, time_limit = 50 }
algorithms.q_learning = { algorithm = "q_learning", observations = ["index"], seeds = 1 }
"""


def test_runs_that_are_lost_meanwhile_are_not_said_to_be_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = tmp_path / "tables.toml"
    experiment.write_text(TABLES, encoding="utf-8")
    arguments = ["run", str(experiment), "--jobs", "1", "--results", str(tmp_path / "results")]
    advance, removed = Display.advance, list[Record]()

    def remove_first(display: Display, records: list[Record]) -> None:
        if not removed:
            (tmp_path / "results" / "runs.db").unlink()
        removed.extend(records)
        advance(display, records)

    with monkeypatch.context() as patch:
        patch.setattr(Display, "advance", remove_first)
        assert main(arguments) == 1
    assert capsys.readouterr().err.splitlines()[-1].startswith("error: runs that were stored")
    assert main(arguments) == 0
    assert "tables: 1 runs done, 2 were done already." in capsys.readouterr().out


def test_what_runs_cannot_show_is_said_before_they_start(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def begin(*_: object) -> list[str]:
        assert capsys.readouterr().err.startswith("beyond_smoke: With 2 runs and 30 contrasts, ")
        raise KeyboardInterrupt

    monkeypatch.setattr(driver, "run", begin)
    assert main(["run", "beyond_smoke", "--results", str(tmp_path)]) == 130
