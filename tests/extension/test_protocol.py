"""A protocol of one's own: an experiment with two tables decides which of them succeeds more often."""

from pathlib import Path

import pandas as pd

from benchmark.__main__ import main

EXPERIMENT = """
description = "Does exploring less pay?"
report = "comparison"
scenarios = ["S1", "S2"]
horizon = 200
evaluation_every = 1000
map_every = 5000
settings = { budget = 10000, time_limit = 200, record_every = 10000 }

[protocol]
contrasts = [["curious, index", "calm, index"]]
success_margin = 0.2
fewest_runs = 20

[algorithms.curious]
algorithm = "q_learning"
observations = ["index"]
seeds = 30
settings = { epsilon = 0.6 }

[algorithms.calm]
algorithm = "q_learning"
observations = ["index"]
seeds = 30
settings = { epsilon = 0.1, learning_rate = 0.2 }
"""


def test_protocol_decides(tmp_path: Path) -> None:
    """In S2, about half of the curious agents succeed and nearly all of the calm ones."""
    path = tmp_path / "exploring.toml"
    path.write_text(EXPERIMENT, encoding="utf-8")
    assert main(["run", str(path), "--report", "--results", str(tmp_path)]) == 0
    folder = tmp_path / "exploring"
    (row,) = pd.read_csv(folder / "contrasts.csv").itertuples()
    success = pd.read_csv(folder / "scores.csv").groupby(["algorithm", "scenario"])["success"].mean()
    expected = success["curious"].mean() - success["calm"].mean()
    assert abs(row.success_difference - expected) < 1e-5
    assert row.success_verdict == "worse"
    readme = (folder / "README.md").read_text(encoding="utf-8")
    assert "**With 10,000 steps of training, of 1 contrast, 1 is worse.**" in readme
    assert "`curious, index` is worse than `calm, index` in success: -0." in readme
    assert "keep" not in readme.partition("## Comparison")[0]  # there is no deep learner
