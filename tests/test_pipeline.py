"""The replication in miniature, through the real commands."""

from pathlib import Path

import pandas as pd
import pytest

from benchmark.__main__ import main
from benchmark.tables import MEASURED, read
from tests.support import mistyped_columns

PARTS = 20  # of the nine claims


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of the replication in miniature."""
    results = tmp_path_factory.mktemp("results")
    command = ["run", "reproduce", "--smoke", "--results", str(results)]
    assert main([*command, "--report"]) == 0
    return results


def test_tables_agree_with_each_other(results: Path) -> None:
    folder = results / "reproduce_smoke"
    assert [path.name for path in folder.glob("*.csv") if mistyped_columns(path)] == []
    claims, optimal, learning = (
        pd.read_csv(folder / f"{name}.csv") for name in ("claims", "optimal", "learning")
    )
    assert claims["agents"].value_counts().to_dict() == {2: PARTS, 4: PARTS}
    last = learning.loc[learning["step"] == 400, "success"]
    assert optimal["success"].tolist()[:3] == last.tolist()


def test_results_do_not_depend_on_how_the_work_was_split(results: Path, tmp_path: Path) -> None:
    command = ["run", "reproduce", "--smoke", "--results", str(tmp_path)]
    for arguments in (["--seeds", "0-1", "--jobs", "3"], ["--seeds", "1"], ["--jobs", "1"]):
        assert main([*command, *arguments]) == 0
    for frame, other in zip(
        read(tmp_path / "reproduce_smoke"), read(results / "reproduce_smoke"), strict=True
    ):
        columns = frame.columns.difference([*MEASURED])
        pd.testing.assert_frame_equal(frame[columns], other[columns], check_exact=True)
