"""The command `run`."""

from pathlib import Path
from typing import Any

import pytest

from benchmark.__main__ import main
from benchmark.execution import driver
from benchmark.execution.store import Record, Store

LOGGED = """
description = "A table, and two nets that write logs."
scenarios = ["S2"]
horizon = 50
evaluation_every = 100
map_every = 100
settings = { budget = 200, time_limit = 50 }
algorithms.q_learning = { algorithm = "q_learning", observations = ["index"], seeds = 1 }
algorithms.dqn = { algorithm = "dqn", observations = ["one_hot"], seeds = 1 }
algorithms.ppo = { algorithm = "ppo", observations = ["coordinates"], seeds = 1, settings.n_steps = 100 }
"""


def test_logs_that_no_algorithm_writes_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(["run", "reproduce", "--results", str(tmp_path), "--tensorboard", str(tmp_path / "logs")])
    assert code == 2
    assert "--tensorboard: no algorithm of reproduce writes logs" in capsys.readouterr().err
    assert not (tmp_path / "runs.db").exists()


def test_logs_come_from_worker_processes_and_change_nothing(tmp_path: Path) -> None:
    experiment = tmp_path / "logged.toml"
    experiment.write_text(LOGGED, encoding="utf-8")
    logs = tmp_path / "logs"
    for results, more in (("a", ["--tensorboard", str(logs)]), ("b", [])):
        arguments = ["run", str(experiment), "--seeds", "0", "--results", str(tmp_path / results)]
        assert main([*arguments, *more]) == 0
    written = {str(path.parent.relative_to(logs)) for path in logs.rglob("events*")}
    assert len(written) == 2
    assert "logged/S2/ppo_coordinates/seed_0" in written
    with Store(tmp_path / "a" / "runs.db") as logged, Store(tmp_path / "b" / "runs.db") as plain:
        digests = sorted(logged.ended())
        assert digests == sorted(plain.ended())
        for x, y in zip(logged.get(digests), plain.get(digests), strict=True):
            assert all(x.arrays[name].tobytes() == y.arrays[name].tobytes() for name in x.arrays)


def test_runs_that_are_lost_meanwhile_are_not_said_to_be_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = tmp_path / "tables.toml"
    text = "\n".join(
        line for line in LOGGED.splitlines() if not line.startswith(("algorithms.d", "algorithms.p"))
    )
    experiment.write_text(text.replace('["S2"]', '["S1", "S2", "S3"]'), encoding="utf-8")
    arguments = ["run", str(experiment), "--jobs", "1", "--results", str(tmp_path / "results")]
    run = driver.run

    def run_and_remove(runs: Any, store: Store, jobs: int, on_progress: Any, **options: Any) -> list[str]:
        def remove(records: list[Record]) -> None:
            if not removed:
                (tmp_path / "results" / "runs.db").unlink()
            removed.append(True)
            on_progress(records)

        removed: list[bool] = []
        return run(runs, store, jobs, remove, **options)

    with monkeypatch.context() as patch:
        patch.setattr(driver, "run", run_and_remove)
        assert main(arguments) == 1
    lost = "error: runs that were stored but are no longer there: 1; the same command repeats them.\n"
    assert capsys.readouterr().err.endswith(lost)
    assert main(arguments) == 0
    assert "tables: 1 runs done, 2 were done already." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("stem", "arm"), [("..", "one"), ("speed", "one"), ("mine", "../../x"), ("mine", "$x$"), ("mine", "a|b")]
)
def test_nothing_is_written_where_a_name_leads_elsewhere(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], stem: str, arm: str
) -> None:
    experiment = tmp_path / f"{stem}.toml"
    experiment.write_text(LOGGED.replace("algorithms.ppo", f'algorithms."{arm}"'), encoding="utf-8")
    arguments = ["run", str(experiment), "--results", str(tmp_path / "results"), "--report"]
    assert main([*arguments, "--tensorboard", str(tmp_path / "logs")]) == 2
    message = capsys.readouterr().err
    assert message.startswith(f"error: {experiment}: ")
    assert "accepted: " in message
    assert message.count("\n") == 1
    assert list(tmp_path.iterdir()) == [experiment]


def test_experiments_that_the_report_refuses_are_not_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    experiment = tmp_path / "mine.toml"
    changes = '"sweep.rate.low.settings" = { learning_rate = 0.2 }'
    experiment.write_text(f'extends = "reproduce_smoke"\ndescription = ""\n[changes]\n{changes}\n')
    assert main(["run", str(experiment), "--results", str(tmp_path)]) == 2
    assert "sweep" in capsys.readouterr().err
    assert not (tmp_path / "runs.db").exists()
