"""A learner from outside joins a search by a few lines of TOML."""

from pathlib import Path

import pandas as pd
import pytest

from benchmark.__main__ import main
from benchmark.experiment import load_experiment
from tests.benchmark.test_search import LEARNERS, TEXT
from tests.support import small_experiment, variant

MINE = """
extends = "BASE"
description = "SARSA joins."

[changes]
"search.trials" = 3

[changes."algorithms.mine"]
algorithm = "sarsa"
observations = ["index"]
seeds = 2
scenarios = ["FarCorner"]
candidates = [{ epsilon = 0.25 }]
search = { epsilon = { low = 0.01, high = 0.6, scale = "log" } }
"""


@pytest.mark.slow
def test_a_learner_joins_the_search(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.toml"
    (tmp_path / "base.toml").write_text(TEXT, encoding="utf-8")
    path.write_text(MINE.replace("BASE", str(tmp_path / "base.toml")), encoding="utf-8")
    assert main(["run", str(path), "--results", str(tmp_path / "results"), "--report"]) == 0
    folder = tmp_path / "results" / "mine"
    chosen = pd.read_csv(folder / "chosen.csv")
    assert [*chosen["learner"]] == [*LEARNERS, "mine, index"]
    runs = pd.read_csv(folder / "runs.csv.gz")
    assert {*runs[runs["learner"] == "mine, index"]["scenario"]} == {"FarCorner"}
    # Another experiment takes what was chosen for it.
    tuned = tmp_path / "tuned.toml"
    mine = variant("sarsa", first_seed=50, tuned_by=f"{path}:mine")
    tuned.write_text(small_experiment(report={"kind": "comparison"}, algorithms={"mine": mine}))
    assert main(["run", str(tuned), "--results", str(tmp_path / "results"), "--report"]) == 0
    assert "2 runs done" in capsys.readouterr().out
    experiment = load_experiment(tuned)
    (population,) = experiment.populations
    found = experiment.learners["mine, index"].chosen
    assert found is not None
    assert population.first.settings.model_dump()["epsilon"] == found.settings.get("epsilon", 0.6)
