"""The equivalence: its verdict and tables by hand, its sentences, and all of it in miniature."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy import stats

from benchmark.__main__ import main
from benchmark.analysis.intervals import combined
from benchmark.drawing.tables import LINK, plain, write_csv
from benchmark.execution.store import Store
from benchmark.experiments import Experiment, all_specifications, load_experiment
from benchmark.page import build
from benchmark.reports import load_report
from benchmark.reports.equivalence import findings, tables
from benchmark.reports.equivalence.data import Data, Name, Runs, load
from benchmark.reports.equivalence.tables import MARGIN, verdict
from benchmark.reports.published import Published
from envs import InputError
from tests.support import mistyped_columns

PUBLISHED = Path(__file__).parents[3] / "results"
# Two tables, each checked by the same table with random streams of its own.
TABLES = """
description = "Tables against tables."
report = "equivalence"
scenarios = ["S1", "S2"]
horizon = 200
evaluation_every = 100
map_every = 200
settings = { budget = 400, time_limit = 200 }
algorithms.table = { algorithm = "q_learning", observations = ["index"], seeds = 3 }
algorithms.greedy = { algorithm = "q_learning", observations = ["index"], seeds = 3, settings.epsilon = 0.1 }
algorithms.table_check = { check_of = "table", algorithm = "q_learning", seeds = 2 }
algorithms.greedy_check = { check_of = "greedy", algorithm = "q_learning", seeds = 2 }
"""


def experiment_of(tmp_path: Path) -> Experiment:
    """Loads the experiment with tables."""
    path = tmp_path / "tables.toml"
    path.write_text(TABLES, encoding="utf-8")
    return load_experiment(path)


def runs_of(success: NDArray[np.float64], scores: NDArray[np.float64] | None = None) -> Runs:
    """Returns runs that learn between steps 0 and 100 to succeed and score so, (N,) each."""
    final = np.column_stack([np.zeros(len(success)), success])
    over_training = final if scores is None else np.column_stack([np.zeros(len(scores)), scores])
    return Runs(range(len(success)), [0, 100], final, over_training)


def shares(count: int, n: int) -> NDArray[np.float64]:
    """Returns the successes of n runs, so many of which succeed."""
    return (np.arange(n) < count).astype(float)


def data_of(**pairs: tuple[Runs, Runs]) -> Data:
    """Returns arms and their checks in S1."""
    runs = {}
    for name, (arm, check) in pairs.items():
        runs[Name("S1", name, "index")] = arm
        runs[Name("S1", f"{name}_check", "index")] = check
    return Data(runs, {f"{name}_check": name for name in pairs})


# The verdict


@pytest.mark.parametrize(
    ("ends_90", "ends_95", "expected"),
    [
        ((-0.1, 0.1), (-0.14, 0.14), "equivalent"),
        ((-0.1, 0.14), (-0.12, 0.16), "equivalent"),  # the 95 % interval may reach beyond the margin
        ((0.02, 0.14), (0.01, 0.16), "equivalent"),  # and exclude 0
        ((-0.14, -0.02), (-0.16, -0.01), "equivalent"),
        ((0.02, MARGIN), (0.01, 0.16), "different"),  # an end at the margin is not within it
        ((-MARGIN, -0.02), (-0.16, -0.01), "different"),
        ((0.3, 0.5), (0.28, 0.52), "different"),
        ((-0.5, -0.3), (-0.52, -0.28), "different"),
        ((0.01, 0.2), (0.0, 0.21), "undecided"),  # an end at 0 does not exclude it
        ((-0.2, -0.01), (-0.21, 0.0), "undecided"),
        ((-0.1, MARGIN), (-0.12, 0.17), "undecided"),
        ((-0.5, 0.5), (-0.6, 0.6), "undecided"),
    ],
)
def test_verdict(ends_90: tuple[float, float], ends_95: tuple[float, float], expected: str) -> None:
    assert verdict(ends_90, ends_95) == expected


# Tables, by hand


def test_success_by_hand() -> None:
    """56 of 70 against 48 of 80: each distance is a root of summed squares."""
    row = tables.equivalence(data_of(arm=(runs_of(shares(56, 70)), runs_of(shares(48, 80)))), {}).iloc[0]
    assert row[["scenario", "algorithm", "observation", "check"]].tolist() == [
        "S1",
        "arm",
        "index",
        "arm_check",
    ]
    assert row[["n", "check_n"]].tolist() == [70, 80]
    assert row[["success", "check_success", "success_difference"]].tolist() == pytest.approx([0.8, 0.6, 0.2])
    ends = row[["success_difference_low", "success_difference_high"]].tolist()
    x, y = (stats.binomtest(count, n).proportion_ci() for count, n in ((56, 70), (48, 80)))
    reach = np.hypot(0.8 - x.low, y.high - 0.6), np.hypot(x.high - 0.8, 0.6 - y.low)
    assert ends == pytest.approx([0.2 - reach[0], 0.2 + reach[1]])
    assert ends[0] < row["success_difference_low_90"] < row["success_difference_high_90"] < ends[1]
    assert row["success_margin"] == MARGIN
    assert row["success_verdict"] == "different"


def test_fractions_of_success_count() -> None:
    """An agent with several greedy actions may succeed in some episodes only."""
    halves = runs_of(np.full(4, 0.5))
    row = tables.equivalence(data_of(arm=(halves, runs_of(shares(2, 4)))), {}).iloc[0]
    assert row["success_difference"] == 0
    assert row["success_difference_high"] == -row["success_difference_low"] > 0.4


def test_scores_by_a_second_method() -> None:
    rng = np.random.default_rng(0)
    scores = rng.normal(0.4, 0.3, 90)
    other = rng.normal(0.2, 0.3, 60)
    row = tables.equivalence(
        data_of(arm=(runs_of(shares(9, 90), scores), runs_of(shares(6, 60), other))), {}
    ).iloc[0]
    clipped, other_clipped = scores.clip(0, 1), other.clip(0, 1)
    assert row["score_difference"] == pytest.approx(clipped.mean() - other_clipped.mean())
    assert row["score"] == pytest.approx(clipped.mean())
    assert row["check_score"] == pytest.approx(other_clipped.mean())
    error = np.sqrt(clipped.var() / 90 + other_clipped.var() / 60)
    low, high = row[["score_difference_low", "score_difference_high"]]
    # Of numbers in [0, 1] the interval is wider than the normal one, as if they were 0 or 1.
    assert low < row["score_difference"] - 1.96 * error < row["score_difference"] + 1.96 * error < high
    distance = max(abs((scores <= x).mean() - (other <= x).mean()) for x in [*scores, *other])
    assert row["ks"] == pytest.approx(distance)
    assert row["ks_p"] < 0.05


def test_curves_and_scores_hold_both_sides() -> None:
    data = data_of(arm=(runs_of(shares(1, 2), np.array([0.5, 1.0])), runs_of(shares(3, 3))))
    curves = tables.curves(data, {})
    assert curves["algorithm"].tolist() == ["arm"] * 2 + ["arm_check"] * 2
    assert curves["step"].tolist() == [0, 100] * 2
    assert curves["success"].tolist() == [0, 0.5, 0, 1]
    assert curves["score"].tolist() == [0, 0.75, 0, 1]
    assert curves["success_low"][0] == pytest.approx(0)
    assert curves["success_high"][0] > 0.5  # none of two shows little
    scores = tables.scores(data, {})
    assert scores["seed"].tolist() == [0, 1, 0, 1, 2]
    assert scores["success"].tolist() == [1, 0, 1, 1, 1]
    assert scores["unbounded_score"].tolist() == [0.5, 1, 1, 1, 1]


# Sentences


def published(tmp_path: Path, data: Data) -> Published:
    """Writes the table that sentences are made of."""
    write_csv(tables.equivalence(data, {}), tmp_path / "equivalence.csv")
    return Published(tmp_path)


def rows_of(places: str) -> list[int]:
    """Returns the places in a data frame that a link's rows are at."""
    rows: list[int] = []
    for part in places.split(";"):
        first, _, last = part.partition("-")
        rows += range(int(first) - 2, int(last or first) - 1)
    return rows


ALL_VERDICTS = {
    "same": (runs_of(shares(100, 100)), runs_of(shares(100, 100))),
    "close": (runs_of(shares(100, 100)), runs_of(shares(94, 100))),  # a difference is shown, a small one
    "apart": (runs_of(shares(90, 100)), runs_of(shares(60, 100))),
    "mixed": (runs_of(shares(50, 100)), runs_of(shares(56, 100))),
}


def test_sentences_say_what_the_table_says(tmp_path: Path) -> None:
    folder = published(tmp_path, data_of(**ALL_VERDICTS))
    frame = folder.frame("equivalence")
    assert frame["success_verdict"].tolist() == ["equivalent", "equivalent", "different", "undecided"]
    assert findings.headline(folder) == (
        "Agents of `same`, `close`, `apart` and `mixed` against those of `same_check`, `close_check`, "
        "`apart_check` and `mixed_check`: in 4 pairs of populations, success is equivalent within a margin "
        "of 0.15 in [2](equivalence.csv#row=2-3), different in [1](equivalence.csv#row=4) and undecided in "
        "[1](equivalence.csv#row=5). The largest difference is [0.3](equivalence.csv#row=4) [0.177, 0.415], "
        "of `apart, index` against `apart_check` in S1."
    )
    different, undecided, small, resolution, scores, distributions, chance = map(
        plain, findings.sentences(folder)
    )
    assert different == (
        "Different in success: `apart, index` against `apart_check` in S1: 0.3 [0.177, 0.415]."
    )
    assert undecided.startswith("Undecided: `mixed, index` against `mixed_check` in S1: -0.06 [")
    assert small.startswith(
        "Equivalent, but with a difference whose 95 % interval excludes 0: `close, index`"
    )
    assert resolution == (
        "With 100 runs of an arm and 100 of its check, half of which succeed, the 90 % interval of the "
        "difference extends 0.12 to either side. Such a pair is `equivalent` only if the observed difference "
        "is below about 0.03, and `different` only if it is above about 0.14; even with equal probabilities "
        "of success it is more often undecided than equivalent."
    )
    assert "excludes 0 in 2 of 4 pairs" in scores
    assert "in 1 of 4 pairs" in distributions
    assert f"about {1 - 0.95**4:.2f}" in chance


def test_every_number_of_the_sentences_is_in_the_row_that_it_links_to(tmp_path: Path) -> None:
    folder = published(tmp_path, data_of(**ALL_VERDICTS))
    texts = [findings.headline(folder), *findings.sentences(folder)]
    links = [match for text in texts for match in LINK.findall(text)]
    assert len(links) > 10
    for number, file, places in links:
        rows = pd.read_csv(tmp_path / file).iloc[rows_of(places)]
        shown = {f"{value:g}" for value in rows.select_dtypes("number").to_numpy().ravel()}
        assert number in shown | {str(len(rows))}, (number, file, places)


def test_sentences_without_some_verdicts(tmp_path: Path) -> None:
    few = published(tmp_path, data_of(mixed=(runs_of(shares(1, 3)), runs_of(shares(1, 2)))))
    assert "equivalent within a margin of 0.15 in none, different in none and undecided in [1]" in (
        findings.headline(few)
    )
    undecided, resolution, *_ = findings.sentences(few)
    assert undecided.startswith("Undecided: ")
    assert "With [3](equivalence.csv#row=2) runs of an arm and [2](" in resolution
    assert "Such a pair cannot be `equivalent`, and is `different` only above about" in resolution


@pytest.mark.parametrize("n", [70, 100, 160, 200, 400])
def test_what_is_more_often_the_case_by_the_binomial_distribution(tmp_path: Path, n: int) -> None:
    """Sums the probabilities of both counts, if both sides succeed with probability one half."""
    both = runs_of(shares(n // 2, n))
    (resolution,) = [
        text
        for text in findings.sentences(published(tmp_path, data_of(arm=(both, both))))
        if "half of which" in text
    ]
    probability = stats.binom.pmf(np.arange(n + 1), n, 0.5)
    of_distance = np.convolve(probability, probability[::-1])[n:] * np.where(np.arange(n + 1), 2, 1)
    ends = [
        [
            combined([1, -1], [0.5 + apart / n / 2, 0.5 - apart / n / 2], [n, n], level)
            for level in (0.90, 0.95)
        ]
        for apart in range(n + 1)
    ]
    verdicts = np.array([verdict(*pair) for pair in ends])
    equivalent, undecided = (of_distance[verdicts == name].sum() for name in ("equivalent", "undecided"))
    if n == 100:
        assert equivalent == pytest.approx(0.276, abs=0.005)
    assert ("more often undecided than equivalent" in resolution) == (undecided > equivalent)


def test_equivalence_of_failures_is_named(tmp_path: Path) -> None:
    none = runs_of(shares(0, 100))
    texts = findings.sentences(published(tmp_path, data_of(bad=(none, none), **ALL_VERDICTS)))
    assert "In [1](equivalence.csv#row=2) of the equivalent pairs no run of either side succeeds." in texts


@pytest.mark.parametrize("apart", [2, 3, 14, 15])
def test_what_runs_can_decide_where_half_succeed(apart: int) -> None:
    """As the sentence has it: equivalent below 0.03, different above 0.14."""
    arm, check = (runs_of(shares(count, 100)) for count in (50 + apart // 2, 50 + apart // 2 - apart))
    row = tables.equivalence(data_of(arm=(arm, check)), {}).iloc[0]
    assert row["success_verdict"] == {2: "equivalent", 15: "different"}.get(apart, "undecided")


# What is refused


def test_experiments_that_cannot_be_reported_on_are_refused() -> None:
    check, full = load_report("equivalence").check, load_experiment("equivalence")
    with pytest.raises(
        InputError, match=r"reproduce_smoke: algorithms: no arm has the key check_of; accepted"
    ):
        check(load_experiment("reproduce_smoke"))
    readings = load_experiment("reproduce_smoke").readings
    with pytest.raises(InputError, match="readings, sweep: an equivalence takes the default condition alone"):
        check(full.model_copy(update={"readings": readings}))


def test_missing_runs_are_refused(tmp_path: Path) -> None:
    experiment = experiment_of(tmp_path)
    with Store(tmp_path / "runs.db") as store:
        with pytest.raises(InputError, match="3 of 3 runs of table in S1 are missing or failed"):
            load(experiment, store, None, False)
        with pytest.raises(
            InputError, match="--partial: tables is reported only when all its runs are there; acc"
        ):
            load(experiment, store, None, True)


# In miniature


@pytest.mark.parametrize("name", ["tables", "equivalence_smoke"])
def test_everything_is_there(tmp_path: Path, name: str) -> None:
    experiment = experiment_of(tmp_path) if name == "tables" else load_experiment(name)
    given = str(tmp_path / "tables.toml") if name == "tables" else name
    assert main(["run", given, "--report", "--jobs", "2", "--results", str(tmp_path)]) == 0
    folder = tmp_path / name
    expected = {"README.md", "manifest.json", "index.html", "scores.csv"}
    expected |= {f"equivalence.{end}" for end in ("csv", "md", "tex", "png", "svg")}
    expected.add("curves.csv")
    assert {path.name for path in folder.iterdir() if not path.name.startswith(".")} == expected
    assert len(pd.read_csv(folder / "scores.csv")) == len(all_specifications(experiment))
    assert [mistyped_columns(path) for path in folder.glob("*.csv")] == [[]] * 3
    frame = pd.read_csv(folder / "equivalence.csv")
    checked = [
        population for population in experiment.populations if population[1] in set(frame["algorithm"])
    ]
    assert [*zip(frame["scenario"], frame["algorithm"], frame["observation"], strict=True)] == checked
    curves = pd.read_csv(folder / "curves.csv")
    last = {tuple(row[:3]): row for _, row in curves[curves["step"] == 400].iterrows()}
    for _, row in frame.iterrows():
        for arm, prefix in ((row["algorithm"], ""), (row["check"], "check_")):
            end = last[row["scenario"], arm, row["observation"]]
            assert end[["success", "score"]].tolist() == [
                row[f"{prefix}success"],
                row[f"{prefix}score"],
            ]
        assert experiment.algorithms[row["check"]].check_of == row["algorithm"]
    readme = (folder / "README.md").read_text(encoding="utf-8")
    undecided = (frame["success_verdict"] == "undecided").sum()
    assert f"in {len(frame)} pairs of populations" in readme
    assert f"and undecided in {undecided}." in readme  # two runs decide little
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert "<h1>Do compiled agents succeed as often as those of Stable-Baselines3?</h1>" in page
    assert 'href="equivalence.csv#row=2"' in page
    assert 'id="explorer"' not in page
    if name == "tables":
        shutil.copytree(PUBLISHED / "reproduce", tmp_path / "reproduce")
        folder.rename(tmp_path / "equivalence")
        page = build.write(tmp_path).read_text(
            encoding="utf-8"
        )  # of the published experiments that are there
        assert page.index('<section id="equivalence"') < page.index('<section id="replication"')
        assert 'href="equivalence/equivalence.csv#row=2"' in page


def test_miniature_has_the_same_learners() -> None:
    full, small = load_experiment("equivalence"), load_experiment("equivalence_smoke")
    assert full.populations == small.populations
    assert len(all_specifications(small)) < 100
