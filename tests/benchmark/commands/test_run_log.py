"""`run --log`: SB3's logs and curves of all learners, without a bit of difference in what is learned."""

from pathlib import Path

import pandas as pd
import pytest

from benchmark.__main__ import main
from benchmark.commands.verify import difference_of
from benchmark.execution import driver
from benchmark.execution.executors import Threads
from benchmark.execution.store import Store
from benchmark.experiments import all_specifications, load_experiment

EXPERIMENT = """
description = "A table, a compiled net, and nets of Stable-Baselines3."
scenarios = ["S1"]
horizon = 50
evaluation_every = 50
map_every = 100
settings = { budget = 200, time_limit = 20 }
[algorithms.table]
algorithm = "q_learning"
observations = ["index"]
seeds = 2
[algorithms.ppo]
algorithm = "compiled_ppo"
observations = ["one_hot"]
seeds = 1
settings = { n_steps = 100, batch_size = 50, n_epochs = 1 }
[algorithms.sb3_ppo]
reference_for = "ppo"
algorithm = "sb3_ppo"
seeds = 1
[algorithms.sb3_dqn]
algorithm = "sb3_dqn"
observations = ["one_hot"]
seeds = 1
settings = { learning_starts = 50 }
"""


def test_logs_change_nothing_and_have_every_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, log = tmp_path / "mine.toml", tmp_path / "log"
    file.write_text(EXPERIMENT, encoding="utf-8")
    run = ["run", str(file), "--jobs", "1", "--results"]
    (tmp_path / "file").touch()
    assert main([*run, str(tmp_path / "a"), "--log", str(tmp_path / "file")]) == 2
    assert main([*run, "x", "--log", str(log), "--cluster", "tcp://localhost:1"]) == 2
    assert [line[:7] for line in capsys.readouterr().err.splitlines()] == ["error: "] * 2
    assert not (tmp_path / "a").exists()

    assert main([*run, str(tmp_path / "a"), "--log", str(log)]) == 0
    with Store(tmp_path / "a" / "runs.db") as logged, Store(tmp_path / "b" / "runs.db") as plain:
        runs = all_specifications(load_experiment(file))
        assert driver.run(runs, plain, 1, executor=Threads(1)) == []  # in this process, without logs
        digests = sorted(logged.ended())
        assert len(digests) == 5
        assert digests == sorted(plain.ended())
        for one, other in zip(logged.get(digests), plain.get(digests), strict=True):
            assert difference_of(one, other) == ""

    scene = log / "mine" / "S1"
    for folder, trained in (("sb3_ppo_one_hot", "train/entropy_loss"), ("sb3_dqn_one_hot", "train/loss")):
        progress = pd.read_csv(scene / folder / "seed_0" / "progress.csv")
        assert progress["time/total_timesteps"].max() == 200
        assert progress[trained].notna().any()
        assert progress["rollout/ep_rew_mean"].notna().any()
    main([*run, str(tmp_path / "b"), "--log", str(tmp_path / "again")])  # of runs that were done already
    for table in (scene / "table_index", tmp_path / "again" / "mine" / "S1" / "table_index"):
        curve = pd.read_csv(table / "seed_1" / "eval" / "progress.csv")
        assert curve["time/total_timesteps"].tolist() == [0, 50, 100, 150, 200]
        assert curve["eval/success"].between(0, 1).all()
    assert len([*(tmp_path / "again").rglob("progress.csv")]) == 5
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    for path, name in ((".", "train/loss"), ("eval", "eval/success")):
        events = accumulator.EventAccumulator(str(scene / "sb3_dqn_one_hot" / "seed_0" / path))
        events.Reload()
        assert events.Scalars(name)[-1].step == 200
