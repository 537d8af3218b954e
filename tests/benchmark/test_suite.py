"""The suite: what its tables and figure say of given runs, one's own algorithm, the callback."""

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text
from scipy.stats import gmean, trim_mean

from benchmark import suite
from benchmark.__main__ import main
from benchmark.experiment import load_experiment
from benchmark.study import Data
from envs import InputError
from envs.proxemic_env import ProxemicEnv
from tests.benchmark.populations import with_tables
from tests.support import ROOT, made, small_experiment, variant

STEPS = (0, 100, 200, 400)
# Of each learner and scene, the success of three runs at these steps
Curves = Mapping[tuple[str, str], list[list[float]]]
TILES = "tile_coding, coordinates"
PUBLISHED: Curves = {
    (TILES, "S1"): [[0, 1, 1, 1], [0, 0.9, 1, 1], [0, 0, 1, 1]],  # 100, 100, 200
    (TILES, "S2"): [[0, 0, 0, 0.89], [0, 0, 0, 1], [0, 0, 0, 0]],  # never, 400, never
    (TILES, "S3"): [[0, 1, 1, 1]] * 3,  # 100
}
OWN: Curves = {
    ("table, index", "S1"): [[0, 0, 1, 1], [0, 1, 0, 1], [0, 0, 0, 0]],  # 200, 400, never
    ("table, index", "S2"): [[0, 1, 1, 1]] * 3,  # 100
    ("table, index", "S3"): [[0, 0, 1, 1]] * 3,  # 200
}


def data_of(path: Path, curves: Curves, algorithm: str, form: str) -> Data:
    """Returns an experiment of the suite's kind, whose runs have these curves."""
    name = next(iter(curves))[0].partition(",")[0]
    text = small_experiment(
        scenarios=["S1", "S2", "S3"],
        report={"kind": "suite"},
        solved={"success": 0.9},
        settings={"budget": 400},
        algorithms={name: variant(algorithm, form, seeds=3, title=name)},
    )
    rows = [
        {"learner": learner, "scenario": scene, "seed": seed, "step": step, "success": value}
        for (learner, scene), runs in curves.items()
        for seed, curve in enumerate(runs)
        for step, value in zip(STEPS, curve, strict=True)
    ]
    runs = pd.DataFrame({"budget": [400]})
    return Data(made(path, text), None, runs, pd.DataFrame(rows))


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Data:
    """A user's table beside published tile coding, with tables."""
    others = data_of(tmp_path / "other.toml", PUBLISHED, "linear_q_lambda", "coordinates")
    monkeypatch.setattr(suite, "published", lambda: others)
    data = data_of(tmp_path / "mine.toml", OWN, "q_learning", "index")
    return with_tables(data, suite.TABLES)


def test_summary_has_medians_and_shares_of_runs(data: Data) -> None:
    cells = data.tables["summary"].set_index(["learner", "scenario"])
    assert [*dict.fromkeys(data.tables["summary"]["learner"])] == ["table, index", TILES]
    assert cells["steps"].tolist() == [400, 100, 200, 100, np.inf, 100]
    assert cells["n_learned"].tolist() == [2, 3, 3, 3, 1, 3]
    assert (cells["n"] == 3).all()
    assert cells["success"].tolist() == pytest.approx([2 / 3, 1, 1, 1, 1.89 / 3, 1])
    assert ((cells["random_success"] > 0) & (cells["random_success"] < 0.2)).all()


def test_learners_are_related_to_tile_coding_where_both_learn(data: Data) -> None:
    found = data.tables["learners"].set_index("learner")
    assert found["scenes_learned"].to_dict() == {"table, index": 3, TILES: 2}
    assert found["common_scenes"].to_dict() == {"table, index": 2, TILES: 2}
    ratios = {"table, index": gmean([400 / 100, 200 / 100]), TILES: 1}
    assert found["relative_steps"].to_dict() == pytest.approx(ratios)
    ends = [curve[-1] for curve in OWN["table, index", "S1"]] + [1.0] * 6
    assert found.loc["table, index", "iqm"] == pytest.approx(trim_mean(ends, 0.25))
    assert found.loc["table, index", "mean"] == pytest.approx(np.mean(ends))


def test_figure_and_row_say_the_same(data: Data) -> None:
    head, _, row = suite.rows_to_paste(data).splitlines()
    assert head.split(" | ")[-3:] == ["S1", "S2", "S3 |"]
    texts = ["3", "3 of 3", "2.8 (2)", "1.00", "400", "100", "200 |"]
    assert row.split(" | ") == ["| table", *texts]
    drawn = {each.get_text() for each in suite.draw(data).findobj(Text)}
    assert {"400", "1 of 3", "2.8 (2)", "2 of 3", "S1"} <= drawn
    assert suite.rows_to_paste(data) in suite.headline(data)


REFUSED = {
    "nix": "algorithm",
    "nix.py:Nix": "nix.py:Nix: there is no file nix.py.",
    "nix:Nix": "nix",
    "stable_baselines3:PPOO": "PPOO",
    "stable_baselines3:PPO --settings lr=1": "lr",
    "stable_baselines3:PPO --settings gamma=2.0": "gamma",
    "stable_baselines3:PPO --settings n_steps=7": "or other n_steps",
    "stable_baselines3:DQN --settings batch_size=0": "batch_size",
    "stable_baselines3:PPO --settings gamma": "--settings gamma: accepted: KEY=VALUE",
    "stable_baselines3:PPO --settings gamma=a": "--settings gamma=a: accepted: KEY=VALUE",
    "stable_baselines3:PPO --settings budget=9": "accepted: other settings than budget",
    "stable_baselines3:PPO --observation index": "observation",
    "stable_baselines3:DQN --stochastic": "unknown policy of stable_baselines3:DQN stochastic",
    "nix.toml --stochastic": "not accepted with a file",
    "nix.toml": "nix.toml",
    "small.toml": 'accepted: an experiment with extends = "suite"',
}


@pytest.mark.parametrize("arguments", REFUSED)
def test_mistakes_are_told_before_any_run(
    arguments: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("small.toml").write_text(small_experiment(), encoding="utf-8")
    assert main(["bench", *arguments.split()]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert REFUSED[arguments] in line
    assert not (tmp_path / "results" / "runs.db").exists()


MINE = """\
from stable_baselines3 import A2C


class Mine(A2C):
    pass
"""


@pytest.mark.slow
def test_a_class_in_a_file_runs_in_all_scenes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.py").write_text(MINE, encoding="utf-8")
    results = ["--results", str(tmp_path / "results")]
    given = ["--settings", "n_steps=10", "policy_kwargs.net_arch=[16]", "--stochastic", "--smoke"]
    command = ["bench", str(tmp_path / "mine.py") + ":Mine", *given, *results]
    assert main(command) == 0
    folder = tmp_path / "results" / "bench_Mine_smoke"
    (row,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("| Mine"))
    assert row in (folder / "README.md").read_text(encoding="utf-8")
    assert (folder / "suite.svg").is_file()
    runs: Any = load_experiment(tmp_path / "results" / "bench_Mine" / "bench_Mine.toml").populations
    assert len(runs) == 8
    assert all(each.first.settings.policy_kwargs["net_arch"] == [16] for each in runs)
    assert main(command) == 0
    assert "all 16 runs are done already" in capsys.readouterr().out


@pytest.mark.slow
def test_the_zoo_trains_unchanged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rl_zoo3")
    page = (ROOT / "benchmark" / "README.md").read_text(encoding="utf-8")
    found = re.search(r"```yaml\n# (ppo.yml)\n(.*?)```\n\n```text\n(.*?)```", page, re.DOTALL)
    assert found is not None
    monkeypatch.chdir(tmp_path)
    Path(found[1]).write_text(found[2].replace("10000", "500"), encoding="utf-8")
    for line in found[3].splitlines()[1:]:
        words = [sys.executable, *shlex.split(line)[1:]]
        subprocess.run(words, check=True, env=os.environ | {"PYTHONPATH": ":".join(sys.path)})


def test_callback_logs_what_assess_finds(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    from stable_baselines3 import PPO
    from stable_baselines3.common.logger import configure

    from benchmark.assess import assess
    from benchmark.callback import ExactEvalCallback

    env = gymnasium.make("envs:Proxemic/S1-v0", observation="one_hot")
    model = PPO("MlpPolicy", env, n_steps=50, batch_size=50, n_epochs=1, seed=0, device="cpu")
    model.set_logger(configure(str(tmp_path), ["csv"]))
    callback = ExactEvalCallback(100, stochastic=True, best_model=tmp_path / "best.zip")
    model.learn(200, callback=callback)
    logged = pd.read_csv(tmp_path / "progress.csv").dropna(subset=["eval/success"])
    assert logged["time/total_timesteps"].tolist() == [100, 200]
    best = PPO.load(tmp_path / "best.zip")
    found = assess(best, scenario="S1", observation="one_hot", stochastic=True)
    assert found.success == pytest.approx(logged["eval/success"].max(), abs=1e-6)
    model.learn(1000, callback=ExactEvalCallback(100, stop_at=0.0))
    assert model.num_timesteps == 100  # at once
    model.logger.close()
    with pytest.raises(InputError, match=r"gymnasium\.make"):
        PPO("MlpPolicy", ProxemicEnv("S1", "one_hot"), n_steps=50, batch_size=50).learn(
            50, callback=ExactEvalCallback(50)
        )
