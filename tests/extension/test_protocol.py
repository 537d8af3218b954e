"""Contrasts of one's own, in TOML alone: of two tables, and of the conditions of a grid and of scenarios."""

from pathlib import Path

import pandas as pd
import pytest

from tests.benchmark.studies.conftest import results_of
from tests.support import small_experiment, variant

NOISE = ("default/all/noise=high", "default/all/noise=low")
# Does exploring less pay, and does it when actions are forgotten?
EXPERIMENT = small_experiment(
    scenarios=["S1", "S2"],
    horizon=200,
    evaluation_every=1000,
    map_every=5000,
    settings={"budget": 10_000, "time_limit": 200, "record_every": 10_000},
    report={
        "kind": "comparison",
        "omit": ["agents", "curves"],
        "margins": {"success": 0.2},
        "contrasts": [
            ["curious, index", "calm, index"],
            NOISE,
            ["curious, index @ S2", "curious, index @ S1"],
        ],
    },
    algorithms={
        "curious": variant(seeds=30, settings={"epsilon": 0.6}),
        "calm": variant(seeds=30, settings={"epsilon": 0.1, "learning_rate": 0.2}),
    },
    grids={"all": {"axes": {"noise": {"low": {}, "high": {"scenario": {"ping_limit": 1}}}}}},
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The experiment's folder of results."""
    return results_of(tmp_path_factory.mktemp("exploring"), EXPERIMENT)


def test_contrasts_are_differences_of_means_over_what_they_leave_open(folder: Path) -> None:
    contrasts = pd.read_csv(folder / "contrasts.csv")
    scores = pd.read_csv(folder / "scores.csv.gz")
    mean = scores.groupby(["variant", "condition", "scenario"])["success"].mean()
    high, low = NOISE
    expected = [
        *(mean["curious", condition].mean() - mean["calm", condition].mean() for condition in (low, high)),
        *(mean[name, high].mean() - mean[name, low].mean() for name in ("curious", "calm")),
        *(mean["curious", condition, "S2"] - mean["curious", condition, "S1"] for condition in (low, high)),
    ]
    assert contrasts["success_difference"].tolist() == pytest.approx(expected, abs=1e-5)
    assert contrasts["success_verdict"][0] == "worse"  # about half of the curious agents succeed in S2


def test_without_a_table_to_beat_the_answer_counts_verdicts(folder: Path) -> None:
    readme = (folder / "README.md").read_text(encoding="utf-8")
    answer = readme.partition("## What was found")[2].partition("\n## ")[0]
    counts = pd.read_csv(folder / "contrasts.csv")["success_verdict"].value_counts()
    for words in ("on success: ", *(f"{verdict} ({n} of 6)" for verdict, n in counts.items())):
        assert words in answer
    assert "nan" not in readme
    assert "keep" not in answer  # there is no deep learner
