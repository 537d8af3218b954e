"""The command `run`."""

from pathlib import Path

import pytest

from benchmark.__main__ import main
from benchmark.execution import driver
from benchmark.execution.progress import Display
from benchmark.execution.store import Record, Store
from tests.benchmark.execution.test_processes import arrays_of

LOGGED = """
description = "A table, and nets that write logs."
scenarios = ["S2"]
horizon = 50
evaluation_every = 100
map_every = 100
settings = { budget = 200, time_limit = 50 }
algorithms.q_learning = { algorithm = "q_learning", observations = ["index"], seeds = 1 }
algorithms.ppo = { algorithm = "ppo", observations = ["coordinates"], seeds = 1, settings.n_steps = 100 }
algorithms.dqn = { algorithm = "dqn", observations = ["one_hot"], seeds = 1, settings.learning_starts = 50 }
"""


def test_logs_come_from_worker_processes_and_change_nothing(tmp_path: Path) -> None:
    experiment, logs = tmp_path / "logged.toml", tmp_path / "logs"
    experiment.write_text(LOGGED, encoding="utf-8")
    arrays = []
    for name, options in (("plain", []), ("logged", ["--tensorboard", str(logs)])):
        arguments = ["run", str(experiment), "--jobs", "1", "--results", str(tmp_path / name), *options]
        assert main(arguments) == 0
        with Store(tmp_path / name / "runs.db") as store:
            arrays.append(arrays_of(store.get(sorted(store.ended()))))
    written = {str(path.parent.relative_to(logs)) for path in logs.rglob("events*")}
    assert written == {"logged/S2/ppo_coordinates/seed_0", "logged/S2/dqn_one_hot/seed_0"}
    assert len(arrays[0]) == 3
    assert arrays[0] == arrays[1]


def test_runs_that_are_lost_meanwhile_are_not_said_to_be_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = tmp_path / "tables.toml"
    text = "\n".join(line for line in LOGGED.splitlines() if "one_hot" not in line and "ppo" not in line)
    experiment.write_text(text.replace('["S2"]', '["S1", "S2", "S3"]'), encoding="utf-8")
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
