"""The replication in miniature, through the real commands."""

from pathlib import Path

import pandas as pd

from benchmark.__main__ import main
from benchmark.tables import MEASURED, read


def test_results_do_not_depend_on_how_the_work_was_split(tmp_path: Path) -> None:
    command = ["run", "reproduce", "--smoke", "--results"]
    ways = ["--seeds", "0-1", "--jobs", "3"], ["--seeds", "1"], ["--jobs", "1"]
    for arguments in ways:
        assert main([*command, str(tmp_path), *arguments]) == 0
    assert main([*command, str(tmp_path / "whole"), "--report"]) == 0
    split, whole = (read(path / "reproduce_smoke") for path in (tmp_path, tmp_path / "whole"))
    for frame, other in zip(split, whole, strict=True):
        columns = frame.columns.difference([*MEASURED])
        pd.testing.assert_frame_equal(frame[columns], other[columns], check_exact=True)
