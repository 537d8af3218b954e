"""README says what published tables show."""

import shutil
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from benchmark import front
from benchmark.experiment import PUBLISHED
from benchmark.experiments import compare_deep
from benchmark.folder import (
    MANIFEST,
    MEANINGS,
    README,
    Folder,
    csv_text,
    read_csv,
    write_manifest,
    write_text,
)
from benchmark.tables import RUNS
from envs import InputError
from tests.support import ROOT

RESULTS = ROOT / "results"
THERE = [name for name in PUBLISHED if (RESULTS / name).is_dir()]


def test_readme_is_what_the_tables_make() -> None:
    text = front.readme(RESULTS)
    assert (ROOT / README).read_text(encoding="utf-8") == text
    assert len(text.split()) <= 700
    assert (RESULTS / README).read_text(encoding="utf-8") == front.index(RESULTS)


@pytest.mark.parametrize("name", THERE)
def test_readme_of_a_folder_is_short_and_its_columns_are_explained(name: str) -> None:
    text = (RESULTS / name / README).read_text(encoding="utf-8")
    assert len(text.split()) <= 900
    if RUNS in Folder(RESULTS / name).files:
        meanings = read_csv((RESULTS / name / MEANINGS).read_bytes())
        assert meanings["meaning"].ne("").all()


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """The published tables."""
    for name in THERE:
        (tmp_path / name).mkdir()
        for file in (MANIFEST, README, *Folder(RESULTS / name).files):
            shutil.copy(RESULTS / name / file, tmp_path / name / file)
    return tmp_path


def rewrite(folder: Path, name: str, table: pd.DataFrame) -> None:
    """Writes a table and the manifest again, as if they had been made as they are."""
    write_text(folder / f"{name}.csv", csv_text(table))
    write_manifest(folder, Folder(folder).manifest)


@pytest.mark.parametrize(
    ("name", "column", "value", "fault"),
    [
        ("summary", "n", 10, "there are 100 runs"),
        ("contrasts", "success_verdict", "better", "no net is better than tile coding"),
        ("contrasts", "success_margin", 0.5, "the margin is 0.1"),
    ],
)
def test_a_claim_that_tables_do_not_show_is_refused(
    copied: Path, name: str, column: str, value: Any, fault: str
) -> None:
    table = Folder(copied / "compare_deep").tables()[name]
    table[column] = value
    rewrite(copied / "compare_deep", name, table)
    with pytest.raises(InputError, match=f"README: the published tables do not show that {fault}"):
        front.readme(copied)


def test_numbers_are_those_of_the_tables(copied: Path) -> None:
    folder = copied / "compare_deep"
    table = Folder(folder).tables()["summary"]
    is_shown = (table["learner"] == "sb3_ppo, one_hot") & (table["scenario"] == "S1")
    table.loc[is_shown, "success"] = 0.1234
    rewrite(folder, "summary", table)
    before, after = (front.readme(path).splitlines() for path in (RESULTS, copied))
    ((_, row),) = [(x, y) for x, y in zip(before, after, strict=True) if x != y]
    assert row.startswith("| SB3's PPO, tuned | ")
    assert row.split(" | ")[1] == "0.12"
    text = compare_deep.finding(Folder(folder).tables())
    assert "and its PPO, a stochastic policy, 0.12, " in " ".join(text.split())


def test_what_is_not_there_is_left_out(copied: Path) -> None:
    for name in PUBLISHED[1:]:
        shutil.rmtree(copied / name, ignore_errors=True)
    headings = [line for line in front.readme(copied).splitlines() if line.startswith("## ")]
    assert headings == ["## The paper, replicated", "## Benchmark your own algorithm", "## Words"]
