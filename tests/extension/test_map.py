"""Another learner and another axis join a map by ten lines of TOML."""

from pathlib import Path

import pandas as pd

from benchmark.__main__ import main
from tests.benchmark.test_map import EXPERIMENT

MINE = """
extends = "BASE"
description = "SARSA joins, and so does the number of PINGs."

[changes]
"settings.budget" = 5000
"settings.record_every" = 5000
"algorithms.shared.seeds" = 3
"algorithms.table.seeds" = 3

[changes."algorithms.sarsa"]
algorithm = "sarsa"
observations = ["offset"]
seeds = 3

[changes."grids.pings"]
scenario = { "grid.rows" = 5, "grid.columns" = 6, "issuer.places" = 2 }
axes.pings.1.scenario = { ping_limit = 1 }
axes.pings.5.scenario = { ping_limit = 5 }
"""


def test_a_learner_and_an_axis_join_the_map(tmp_path: Path) -> None:
    (tmp_path / "base.toml").write_text(EXPERIMENT, encoding="utf-8")
    path = tmp_path / "mine.toml"
    path.write_text(MINE.replace("BASE", str(tmp_path / "base.toml")), encoding="utf-8")
    assert main(["run", str(path), "--report", "--jobs", "1", "--results", str(tmp_path)]) == 0
    cells = pd.read_csv(tmp_path / "mine" / "cells.csv")
    mine = cells[cells["learner"] == "sarsa, offset"]
    assert {*mine["grid"]} == {"places", "rooms", "new", "pings"}
    assert {*mine["n"]} == {3}
    assert mine["solved"].mean() > 0.5
    contrasts = pd.read_csv(tmp_path / "mine" / "contrasts.csv")
    assert {*contrasts.loc[contrasts["grid"] == "pings", "point"]} == {"pings 1", "pings 5"}
