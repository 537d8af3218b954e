"""The command `run`."""

from pathlib import Path

import pytest

from benchmark.__main__ import main
from benchmark.execution import driver


def test_what_runs_cannot_show_is_said_before_they_start(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def begin(*_: object) -> list[str]:
        assert capsys.readouterr().err.startswith("beyond_smoke: With 2 runs and 30 contrasts, ")
        raise KeyboardInterrupt

    monkeypatch.setattr(driver, "run", begin)
    assert main(["run", "beyond_smoke", "--results", str(tmp_path)]) == 130
