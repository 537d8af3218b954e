"""Sentences of a comparison: verdicts follow from evidence, and numbers from the rows that they link to."""

import json
import re
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import pytest

from benchmark.drawing.tables import LINK, plain
from benchmark.page import build
from benchmark.reports import load_report, texts
from benchmark.reports.comparison import findings
from benchmark.reports.comparison.findings import Findings
from benchmark.reports.published import Published

PUBLISHED = Path(__file__).parents[3] / "results" / "compare_deep"
SCENARIOS = ("S1", "S2")


class Made(NamedTuple):
    """A learner of a comparison made by hand."""

    family: str
    n: int  # runs in each scenario
    success: tuple[float, float]  # by scenario
    mean: float
    better: tuple[float, float] = (0.4, 0.6)  # the interval of the probability to outscore each other learner
    settings: dict[str, Any] = {}  # noqa: RUF012
    check_of: str = ""
    batch_size: int = 1


def folder(tmp_path: Path, **learners: Made) -> Published:
    """Writes the tables that sentences are made of; every learner has the observation `index`."""
    keys = {name: {"algorithm": name, "observation": "index"} for name in learners}
    places = [
        (name, made, scenario, place)
        for name, made in learners.items()
        for place, scenario in enumerate(SCENARIOS)
    ]
    frames: dict[str, list[dict[str, Any]]] = {
        "summary": [
            {"scenario": scenario, **keys[name], "n": made.n, "success": made.success[place], "diverged": 0}
            for name, made, scenario, place in places
        ],
        "aggregate": [
            {**keys[name], "policy": "greedy", "evaluated_from": "start", "metric": "mean"}
            | {"value": made.mean, "low": made.mean - 0.1, "high": made.mean + 0.1}
            for name, made in learners.items()
        ],
        "improvement": [
            {"x": f"{x}, index", "y": f"{y}, index", "probability": sum(made.better) / 2}
            | {"low": made.better[0], "high": made.better[1]}
            for x, made in learners.items()
            for y in learners
            if x != y
        ],
        "curves": [
            {"scenario": scenario, **keys[name], "step": step, "success": 0.5, "disagreements": 10.0}
            for name, _, scenario, _ in places
            for step in (0, 1000)
        ],
        "threshold": [
            {"scenario": scenario, **keys[name], "n": made.n, "reached_share": made.success[place]}
            | {"stays_step_median": 1000.0 if made.success[place] else float("inf")}
            for name, made, scenario, place in places
        ],
        "region": [
            {"scenario": scenario, **keys[name], "precision": 0.5, "recall": 0.5, "overlap": 0.3}
            for name, _, scenario, _ in places
        ],
        "cost": [
            {**keys[name], "cpu_time_s": 2.4 if made.family == "deep" else 0.0001, "parameters": 600}
            | {"peak_memory_mb": 200.0}
            for name, made in learners.items()
        ],
    }
    for name, rows in frames.items():
        pd.DataFrame(rows).to_csv(tmp_path / f"{name}.csv", index=False)
    arms = {
        name: {
            "algorithm": "mine",
            "family": made.family,
            "packages": ["numba", "torch"] if made.batch_size > 1 else ["stable_baselines3", "torch"],
            "settings": {"budget": 1000} | made.settings,
            "check_of": made.check_of,
            "batch_size": made.batch_size,
        }
        for name, made in learners.items()
    }
    (tmp_path / "manifest.json").write_text(json.dumps({"horizon": 200, "algorithms": arms}))
    return Published(tmp_path)


TABLE = Made("tabular", 100, (1.0, 0.9), 0.9, batch_size=25)
WINNER = Made("deep", 10, (0.9, 0.9), 0.95, (0.6, 0.9))
LOSER = Made("deep", 10, (0.1, 0.0), 0.1, (0.0, 0.4))


@pytest.mark.parametrize(
    ("learners", "outcome"),
    [
        ({"net": WINNER}, "earns"),
        ({"net": WINNER, "other": LOSER}, "earns"),
        ({"net": LOSER}, "does not earn"),
        ({"net": LOSER._replace(better=(0.3, 0.5))}, "does not earn"),
        ({"net": LOSER, "other": LOSER._replace(better=(0.3, 0.51))}, "undecided"),
        # Three runs, none of which succeeds, against a table of which two in three do:
        ({"table": TABLE._replace(n=3, success=(1.0, 0.67)), "net": LOSER._replace(n=3)}, "undecided"),
        ({"net": LOSER._replace(n=3)}, "undecided"),
        ({"net": LOSER, "other": LOSER._replace(n=9)}, "undecided"),
        # Two runs that outscore the table without ever succeeding:
        ({"net": WINNER._replace(n=2, success=(0.0, 0.0))}, "undecided"),
        ({"net": WINNER._replace(success=(0.9, 0.0))}, "undecided"),
        ({"net": WINNER._replace(n=9)}, "undecided"),
        ({"table": TABLE._replace(n=9), "net": WINNER}, "undecided"),
        ({"net": WINNER._replace(better=(0.5, 0.9))}, "undecided"),
    ],
)
def test_verdict_takes_evidence(tmp_path: Path, learners: dict[str, Made], outcome: str) -> None:
    found = Findings(folder(tmp_path, **({"table": TABLE} | learners)))
    assert found.outcome() == outcome
    headline = found.sentences()[0]
    words = {
        "earns": "deep RL earns its keep over a table here: `net, index` does better than the best",
        "does not earn": "deep RL does not earn its keep over a table here: no deep learner does better",
        "undecided": "it is undecided whether deep RL earns its keep over a table here",
    }
    assert [name for name, text in words.items() if text in headline] == [outcome]
    assert "compares compiled code with Python" in headline


def test_headline_says_if_runs_are_too_few(tmp_path: Path) -> None:
    few = Findings(folder(tmp_path, table=TABLE, net=WINNER._replace(n=9))).sentences()[0]
    assert "a verdict takes at least 10 runs per scenario and learner" in few
    assert "([9](summary.csv#row=4-5) runs per scenario)" in few
    other = tmp_path / "other"
    other.mkdir()
    enough = Findings(folder(other, table=TABLE, net=WINNER._replace(better=(0.4, 0.6)))).sentences()[0]
    assert "a verdict takes" not in enough


def test_best_table_is_any_tabular_learner(tmp_path: Path) -> None:
    better = TABLE._replace(mean=0.99)
    found = Findings(folder(tmp_path, q_learning=TABLE, sarsa=better, net=LOSER))
    assert found.best_table == ("sarsa", "index")
    assert [learner.algorithm for learner in found.deep] == ["net"]
    assert "the best table, `sarsa`" in found.sentences()[0]


def test_words_follow_numbers(tmp_path: Path) -> None:
    net = LOSER._replace(better=(0.4, 0.7), settings={"policy_kwargs": {"net_arch": []}})
    headline, tables, deep, linear, steps, cost, *_ = Findings(
        folder(tmp_path, table=TABLE, net=net)
    ).sentences()
    assert headline.endswith(
        "has [0.10](aggregate.csv#row=3) [0.00, 0.20] ([10](summary.csv#row=4-5) runs per scenario): no "
        "significant difference from `table, index` (P = [0.55](improvement.csv#row=3) [0.40, 0.70]). It "
        "takes [24,000 times](cost.csv#row=2-3) the CPU time of that table, but this compares compiled code "
        "with Python: against a table in plain Python it is about 50 to 190 times."
    )
    assert (
        "succeeds with probability [1.00](summary.csv#row=2) in S1, [0.90](summary.csv#row=3) in S2" in tables
    )
    assert "no significant difference from `table, index`" in deep
    assert "A single linear layer over index (`net`, [600](cost.csv#row=3) parameters" in linear
    assert (
        "`net, index` [at the last evaluation](threshold.csv#row=4) in S1, [never](threshold.csv#row=5) in S2"
        in steps
    )
    assert "0.1 ms](cost.csv#row=2) of CPU time" in cost


BATCHED = LOSER._replace(n=100, batch_size=25)
CHECK = WINNER._replace(check_of="net")


def test_no_verdict_rests_on_a_check(tmp_path: Path) -> None:
    found = Findings(folder(tmp_path, table=TABLE, net=BATCHED, net_sb3=CHECK))
    assert found.outcome() == "does not earn"
    assert found.deep == [("net", "index")] == [found.best_deep]
    assert found.checks == {("net_sb3", "index"): ("net", "index")}
    *others, cost, _, _, last = found.sentences()
    assert "net_sb3" in cost
    assert "net_sb3" in last
    assert not any("net_sb3" in text for text in others)


def test_checks_are_told_with_both_scores_and_a_verdict_by_the_interval(tmp_path: Path) -> None:
    for place, (check, verdict) in enumerate(
        (
            (CHECK, "a significant difference"),
            (CHECK._replace(better=(0.4, 0.6)), "no significant difference"),
            (CHECK._replace(n=9), "too few runs for a verdict"),
        )
    ):
        (directory := tmp_path / str(place)).mkdir()
        text = Findings(folder(directory, table=TABLE, net=BATCHED, net_sb3=check)).sentences()[-1]
        low, high = check.better
        assert text == (
            "Checks have the settings of the learners that they check and are trained by Stable-Baselines3 "
            f"itself. Mean scores of each check ([{check.n}](summary.csv#row=6-7) runs per scenario) and of "
            "the learner that it checks ([100](summary.csv#row=4-5)): `net_sb3, index` "
            "[0.95](aggregate.csv#row=4) [0.85, 1.05] and [0.10](aggregate.csv#row=3) [0.00, 0.20] "
            f"({verdict}, P = [{(low + high) / 2:.2f}](improvement.csv#row=7) [{low:.2f}, {high:.2f}]). "
            "These intervals are not corrected for their number, and with few runs only large differences "
            "would show."
        )


def test_terms_say_what_trains_checks_and_how_many_runs_they_have(tmp_path: Path) -> None:
    def terms(name: str, **learners: Made) -> dict[str, str]:
        (directory := tmp_path / name).mkdir()
        words = load_report("comparison").words
        assert words is not None
        return dict(words(folder(directory, table=TABLE, net=BATCHED, **learners)))

    by_sb3 = terms("sb3", net_sb3=CHECK)
    assert by_sb3["check"] == (
        "a learner with the settings of another one, trained by another implementation: `net_sb3` checks "
        "`net`. Stable-Baselines3's classes learn; denormal numbers count as zero, and Adam's step is fused. "
        "Figures show it hollow, beside the learner that it checks. It is not ranked, and no verdict rests "
        "on it."
    )
    assert "With ten runs or fewer, as checks have, bootstrap intervals" in by_sb3["intervals"]
    assert "Stable-Baselines3's classes" not in terms("mine", other=CHECK._replace(batch_size=2))["check"]
    assert "With ten runs or fewer bootstrap" in terms("many", net_sb3=CHECK._replace(n=11))["intervals"]
    without = terms("none")
    assert "check" not in without
    assert "With ten runs or fewer bootstrap" in without["intervals"]


def test_costs_say_what_is_trained_in_batches(tmp_path: Path) -> None:
    headline, *_, cost, _, _, _ = Findings(
        folder(tmp_path, table=TABLE, net=BATCHED, net_sb3=CHECK)
    ).sentences()
    assert headline.endswith(
        "Trained in batches of up to 25 runs, it takes [24,000 times](cost.csv#row=2-3) the CPU time of that "
        "table."
    )
    assert "a run of `net, index`, trained in batches of up to 25 runs, takes [2.4 s](cost.csv#row=3)" in cost
    assert cost.endswith(
        "That is [24,000 times](cost.csv#row=2-3) the CPU time of the table. A run of its check "
        "`net_sb3, index` takes [2.4 s](cost.csv#row=4): [24,000 times](cost.csv#row=2;4) the CPU time of "
        "the table, which is compiled, and about 50 to 190 times that of one in plain Python."
    )


def test_papers_table_is_put_into_perspective(tmp_path: Path) -> None:
    settings = {"learning_rate": 0.6, "epsilon": 0.6, "discount": 0.9, "budget": 10_000}
    with_note = folder(tmp_path, table=TABLE._replace(settings=settings), net=LOSER)
    assert "0.515" in Findings(with_note).sentences()[1]
    other = tmp_path / "other"
    other.mkdir()
    without = folder(other, table=TABLE._replace(settings=settings | {"epsilon": 0.1}), net=LOSER)
    assert "0.515" not in Findings(without).sentences()[1]


@pytest.mark.parametrize("learners", [{"a": TABLE, "b": TABLE}, {"a": LOSER, "b": WINNER}])
def test_nothing_is_said_without_both_families(tmp_path: Path, learners: dict[str, Made]) -> None:
    assert findings.table(folder(tmp_path, **learners)).empty


def rows_of(places: str) -> list[int]:
    """Returns the places in a data frame that a link's rows are at."""
    rows: list[int] = []
    for part in places.split(";"):
        first, _, last = part.partition("-")
        rows += range(int(first) - 2, int(last or first) - 1)
    return rows


def test_every_number_of_the_findings_is_in_the_row_that_it_links_to() -> None:
    published = Published(PUBLISHED)
    sentences = findings.table(published)["text"]
    has_checks = any(arm.get("check_of") for arm in published.manifest["algorithms"].values())
    assert len(sentences) == 11 + has_checks
    links = [match for text in sentences for match in LINK.findall(text)]
    assert len(links) > 80
    n_checked = 0
    for text, file, rows in links:
        # Of several rows a number is the mean; a share may be in per cent.
        means = pd.read_csv(PUBLISHED / file).iloc[rows_of(rows)].mean(numeric_only=True)
        decimals = len(text.partition(".")[2])
        shown = {f"{mean:,.{decimals}f}" for mean in means} | {f"{mean:.1%}" for mean in means}
        if re.fullmatch(r"[-\d,.]+%?", text):
            assert text in shown, (text, file, rows)
            n_checked += 1
        else:
            assert re.fullmatch(r"[\d,]+ times|[\d.]+ m?s|never|at the last evaluation|none", text), text
    assert n_checked > 80


def test_every_percentage_has_its_number_of_runs() -> None:
    for text in findings.table(Published(PUBLISHED))["text"]:
        for place in re.finditer(r"\d%", plain(text)):
            assert re.match(r"\d% of \d+ runs", plain(text)[place.start() :]), text


def test_published_texts_are_what_the_published_tables_say(tmp_path: Path) -> None:
    for name in build.PUBLISHED:
        copy = tmp_path / name
        copy.mkdir()
        for path in (PUBLISHED.parent / name).iterdir():
            (copy / path.name).symlink_to(path)
        for file in ("README.md", "findings.csv"):
            (copy / file).unlink(missing_ok=True)
        texts.write(copy)
        for file in ("README.md", "findings.csv"):
            if (PUBLISHED.parent / name / file).exists():
                made = (copy / file).read_text(encoding="utf-8")
                assert made == (PUBLISHED.parent / name / file).read_text(encoding="utf-8"), (name, file)
