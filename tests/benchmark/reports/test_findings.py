"""Sentences of a comparison: verdicts follow from the protocol, and numbers from the rows they link to."""

import json
import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from benchmark.drawing.tables import LINK, plain, write_csv
from benchmark.page import build
from benchmark.reports import load_report, texts
from benchmark.reports.comparison import figures, findings, tables
from benchmark.reports.comparison.data import Data
from benchmark.reports.comparison.findings import Findings
from benchmark.reports.comparison.protocol import Learner, Protocol, answer, outcome
from benchmark.reports.published import Published
from tests.benchmark.reports.made import compared

PUBLISHED = Path(__file__).parents[3] / "results" / "compare_deep"
MARGIN = 0.1
START = "With 1,000 steps of training"
ALONE = " and by success alone, "


class Made(NamedTuple):
    """A learner of a comparison made by hand, and how often its runs succeed."""

    family: str
    success: Sequence[float]  # by scenario
    n: int = 100  # runs in each scenario
    check_of: str = ""
    packages: tuple[str, ...] = ("torch",)


def named(name: str) -> Learner:
    return Learner(name, "index")


def data_of(
    learners: Mapping[str, Made], contrasts: Sequence[tuple[str, str]], reference: str = "", fewest: int = 10
) -> Data:
    """Returns a comparison in which the first runs of each population succeed, and the others fail."""
    scenarios = [f"S{place + 1}" for place in range(len(next(iter(learners.values())).success))]

    def success(made: Made, place: int) -> NDArray[np.float64]:
        return np.tile((np.arange(made.n) < round(made.success[place] * made.n))[:, None], 5).astype(float)

    populations = {
        named(name): {
            scenario: compared("S1", made.n, success=success(made, place))
            for place, scenario in enumerate(scenarios)
        }
        for name, made in learners.items()
    }
    pairs = [(named(x), named(y)) for x, y in contrasts]
    decisive = [x for x, y in pairs if reference and y == named(reference)]
    protocol = Protocol(
        reference=named(reference) if reference else None,
        decisive=[x for x in decisive if learners[x.algorithm].family == "deep"],
        contrasts=pairs,
        success_margin=MARGIN,
        score_margin=MARGIN / 2,
        fewest_runs=fewest,
        is_declared=True,
    )
    checks = {named(name): named(made.check_of) for name, made in learners.items() if made.check_of}
    return Data(populations, checks=checks, protocol=protocol)


def published(folder: Path, data: Data, learners: Mapping[str, Made]) -> Published:
    """Writes the tables that sentences about verdicts are made of."""
    folder.mkdir(exist_ok=True)
    for name in ("summary", "aggregate", "contrasts"):
        frame = getattr(tables, name)(data)
        write_csv(frame, folder / f"{name}.csv")
    arms = {
        name: {
            "algorithm": "mine",
            "family": made.family,
            "packages": made.packages,
            "settings": {"budget": 1000},
            "check_of": made.check_of,
        }
        for name, made in learners.items()
    }
    manifest = {"horizon": 200, "algorithms": arms, "facts": data.facts, "partial": data.note}
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    return Published(folder)


def told(
    folder: Path, learners: Mapping[str, Made], contrasts: Sequence[tuple[str, str]], **more: Any
) -> list[str]:
    """Returns what is said of learners, without links."""
    found = Findings(published(folder, data_of(learners, contrasts, **more), learners))
    return [plain(text) for text in found.sentences()]


TABLE = Made("tabular", (1.0, 0.9))
WINNER = Made("deep", (1.0, 1.0))
EQUAL = Made("deep", (1.0, 0.9))
LOSER = Made("deep", (0.1, 0.0))
WEAK = Made("tabular", (0.3, 0.3))


@pytest.mark.parametrize(
    ("learners", "expected"),
    [
        ({"table": WEAK, "net": WINNER}, "earns"),
        ({"table": WEAK, "net": WINNER, "other": LOSER}, "earns"),
        ({"table": TABLE, "net": LOSER}, "does not earn"),
        ({"table": TABLE, "net": LOSER, "other": EQUAL}, "does not earn"),
        ({"table": TABLE, "net": EQUAL}, "does not earn"),  # equivalent: nothing is gained
        ({"table": TABLE, "net": EQUAL._replace(n=12)}, "undecided"),
        ({"table": TABLE, "net": LOSER, "other": EQUAL._replace(n=12)}, "undecided"),
        # Three runs, none of which succeeds, against a table of which two in three do:
        ({"table": Made("tabular", (1.0, 0.67), n=3), "net": LOSER._replace(n=3)}, "no verdict"),
        ({"table": WEAK, "net": WINNER._replace(n=9)}, "no verdict"),
        ({"table": WEAK._replace(n=9), "net": WINNER}, "no verdict"),
        ({"table": WEAK, "net": WINNER, "other": LOSER._replace(n=2)}, "no verdict"),
        # Policies that never succeed win nothing, not even against a table that never succeeds:
        ({"table": Made("tabular", (0.0, 0.0)), "net": Made("deep", (0.0, 0.0))}, "no verdict"),
        ({"table": Made("tabular", (0.0, 0.0)), "net": WINNER}, "earns"),
        ({"table": Made("tabular", (0.0, 0.0), n=2), "net": Made("deep", (0.0, 0.0), n=2)}, "no verdict"),
    ],
)
def test_headline_follows_from_the_contrasts(
    tmp_path: Path, learners: dict[str, Made], expected: str
) -> None:
    contrasts = [(name, "table") for name in learners if name != "table"]
    data = data_of(learners, contrasts, "table")
    frame = tables.contrasts(data)
    assert frame is not None
    assert data.protocol is not None
    assert outcome(data.protocol, frame) == expected
    headline = told(tmp_path, learners, contrasts, reference="table")[0]
    words = {
        "earns": f"{ALONE}deep RL earns its keep over a table here: `net, index` succeeds more often than ",
        "does not earn": f"{ALONE}deep RL does not earn its keep over a table here: ",
        "undecided": f"{ALONE}it is undecided whether deep RL earns its keep over a table here: ",
        "no verdict": ", there is no verdict on whether deep RL earns its keep over a table: ",
    }
    assert [name for name, text in words.items() if headline.startswith(f"{START}{text}")] == [expected]
    titles = {
        "earns": "Deep RL earns its keep over the table here",
        "does not earn": "Deep RL does not earn its keep over the table here",
        "undecided": "Undecided: does deep RL earn its keep over the table here?",
        "no verdict": "No verdict on whether deep RL earns its keep over the table",
    }
    assert answer(data.protocol, frame) == titles[expected]


def test_missing_runs_leave_no_verdict(tmp_path: Path) -> None:
    learners = {"table": WEAK, "net": WINNER}
    data = data_of(learners, [("net", "table")], "table")
    data = Data(data.learners, missing="1 of 400 runs are missing", protocol=data.protocol)
    headline, contrast, *_ = Findings(published(tmp_path, data, learners)).sentences()
    assert headline.endswith("earns its keep over a table: runs are missing.")
    assert contrast.startswith(
        "There is no verdict on `net, index` against `table, index` in success: [+0.700]"
    )


def test_headline_says_why_there_is_no_verdict(tmp_path: Path) -> None:
    def reason(name: str, **learners: Made) -> str:
        (folder := tmp_path / name).mkdir()
        return told(folder, learners, [("net", "table")], reference="table")[0].partition("table: ")[2]

    few = WINNER._replace(n=9)
    assert reason("few", table=WEAK, net=few) == "a verdict takes 10 runs per scenario and learner."
    none = Made("tabular", (0.0, 0.0))
    failing = "no deep learner is better, and `table, index` succeeds less often than the margin of 0.1."
    assert reason("none", table=none, net=Made("deep", (0.0, 0.0))) == failing


def test_headline_says_how_little_room_a_table_leaves(tmp_path: Path) -> None:
    def last(name: str, table: Made) -> str:
        (folder := tmp_path / name).mkdir()
        return told(folder, {"table": table, "net": LOSER}, [("net", "table")], reference="table")[0]

    everything = last("all", Made("tabular", (1.0, 1.0)))
    assert everything.endswith(" The table succeeds in every run, so no learner could succeed more often.")
    most = last("most", Made("tabular", (1.0, 0.9)))
    assert most.endswith(" No learner could succeed more often than the table by more than 0.050.")
    assert last("some", Made("tabular", (0.5, 0.9))).endswith("].")


def test_without_any_contrast_there_is_no_verdict(tmp_path: Path) -> None:
    """As after an interrupt, when tables are there and nets are not."""
    learners = {"table": TABLE, "other": WEAK, "net": WINNER}
    data = data_of(learners, [("net", "table")], "table")
    there = {learner: each for learner, each in data.learners.items() if learner.algorithm != "net"}
    left = Data(there, missing="100 of 300 runs are missing", protocol=data.protocol)
    assert tables.contrasts(left) is None
    frames = {"summary": tables.summary(left), "aggregate": tables.aggregate(left)}
    for name, frame in frames.items():
        write_csv(frame, tmp_path / f"{name}.csv")
    published(tmp_path / "whole", data, learners)  # for its manifest
    (tmp_path / "whole" / "manifest.json").rename(tmp_path / "manifest.json")
    headline = Findings(Published(tmp_path)).sentences()[0]
    assert headline == f"{START}, there is no verdict: runs are missing."
    assert figures.summary(frames["summary"], None, frames["aggregate"], left.context).axes
    pairs = tables.improvement(left)
    assert figures.improvement(pairs, left.context) is not None  # of the other table with the reference


def test_learners_that_are_left_out_leave_no_verdict(tmp_path: Path) -> None:
    learners = {"table": WEAK, "net": WINNER, "other": WINNER}
    data = data_of(learners, [("net", "table"), ("other", "table")], "table")
    there = {learner: each for learner, each in data.learners.items() if learner.algorithm != "other"}
    left = Data(there, protocol=data.protocol)
    frame = tables.contrasts(left)
    assert frame is not None
    assert data.protocol is not None
    assert outcome(data.protocol, frame) == "no verdict"
    assert "no verdict" in Findings(published(tmp_path, left, learners)).sentences()[0]


def test_contrasts_in_words(tmp_path: Path) -> None:
    learners = {
        "table": TABLE,
        "net": LOSER,
        "same": EQUAL._replace(n=400),
        "close": Made("deep", (1.0, 0.8)),
        "small": Made("tabular", (1.0, 0.84), n=2000),
        "big": Made("tabular", (1.0, 0.9), n=2000),
    }
    pairs = [("net", "table"), ("table", "net"), ("same", "table"), ("close", "table"), ("small", "big")]
    _, worse, better, same, undecided, small, *_ = told(tmp_path, learners, pairs, reference="table")
    assert re.fullmatch(
        r"`net, index` is worse than `table, index` in success: -0\.900 \[-0\.9\d\d, -0\.8\d\d\]\. In score: "
        r"equivalent, 0\.000 \[-0\.0\d\d, \+0\.0\d\d\]\.",
        worse,
    )
    assert better.startswith("`table, index` is better than `net, index` in success: +0.900 [+0.8")
    assert same.startswith("`same, index` is equivalent to `table, index` in success: 0.000 [-0.0")
    assert "significant" not in same
    assert undecided.startswith("`close, index` against `table, index` is undecided in success: -0.050 [-0.1")
    assert re.search(
        r" \(p = [\d.]+ for no difference, [\d.]+ for one as large as 0\.1\); a new study would need about "
        r"[\d,]+ runs per scenario and learner to decide it with a power of 80 %, if the means stay",
        undecided,
    )
    assert re.search(r"; the difference is significant \(p = [\d.e-]+\), but smaller than 0\.1\.", small)


def test_without_a_reference_contrasts_are_counted(tmp_path: Path) -> None:
    learners = {"a": EQUAL, "b": LOSER, "c": EQUAL}
    headline = told(tmp_path, learners, [("a", "b"), ("b", "c"), ("a", "c")])[0]
    assert headline == (
        "With 1,000 steps of training, of 3 contrasts, 1 is better, 1 is worse and 1 is equivalent."
    )


def test_no_verdict_rests_on_a_check(tmp_path: Path) -> None:
    learners = {
        "table": TABLE,
        "net": LOSER,
        "net_sb3": WINNER._replace(check_of="net", packages=("stable_baselines3",)),
    }
    headline, contrast, last = told(tmp_path, learners, [("net", "table")], reference="table")
    assert "does not earn" in headline
    assert "net_sb3" not in headline + contrast
    assert last == (
        "Checks have the settings of the learners that they check and are trained by another implementation, "
        "nets by Stable-Baselines3 itself. Success probability of each check (100 runs per scenario) and of "
        "the learner that it checks (100): `net_sb3, index` 1.00 [0.97, 1.00] and 0.05 [0.02, 0.09]. No "
        "verdict rests on them."
    )


JUDGED = re.compile(r"`(\w+), index` is (better than|worse than|equivalent to) `(\w+), index` in success")


def contradictions(
    sentences: Sequence[str], truth: Mapping[str, Sequence[float]], decisive: Sequence[str]
) -> list[str]:
    """Lists the sentences that say something else than the true probabilities of success."""
    mean = {name: float(np.mean(values)) for name, values in truth.items()}
    wrong = []
    for text in sentences:
        for x, word, y in JUDGED.findall(text):
            difference = mean[x] - mean[y]
            is_right = {
                "better than": difference > 1e-9,
                "worse than": difference < -1e-9,
                "equivalent to": abs(difference) < MARGIN - 1e-9,
            }[word]
            wrong += [] if is_right else [text]
    headline = sentences[0].partition("\n\n")[0]
    gains = [mean[name] - mean["table"] for name in decisive]
    if "deep RL earns its keep" in headline and "whether" not in headline and max(gains) <= 1e-9:
        wrong.append(headline)
    if "does not earn its keep" in headline and max(gains) >= MARGIN - 1e-9:
        wrong.append(headline)
    if "succeeds more often" in headline or "succeed more often" in headline:
        for name in re.findall(r"`(\w+), index`", headline.partition(": ")[2].partition("than")[0]):
            wrong += [headline] if mean[name] <= mean["table"] + 1e-9 else []
    return wrong


probabilities = st.lists(st.integers(0, 10).map(lambda tenths: tenths / 10), min_size=2, max_size=2)
grids = st.fixed_dictionaries(dict.fromkeys(("table", "net", "other"), probabilities))
PAIRS = [("net", "table"), ("other", "table"), ("net", "other")]
FAMILY = {"table": "tabular", "net": "deep", "other": "deep"}


@settings(deadline=None, max_examples=60)
@given(grids, st.sampled_from([2, 9, 10, 30, 200]))
def test_no_sentence_contradicts_the_truth_if_runs_are_as_expected(
    grid: dict[str, list[float]], n: int
) -> None:
    """Of runs that succeed as often as their true probability says."""
    exact = {name: [round(value * n) / n for value in values] for name, values in grid.items()}
    learners = {name: Made(FAMILY[name], values, n) for name, values in exact.items()}
    with tempfile.TemporaryDirectory() as directory:
        sentences = told(Path(directory), learners, PAIRS, reference="table")
    assert contradictions(sentences, exact, ["net", "other"]) == []
    if n < 10:
        assert "there is no verdict" in sentences[0]
        assert not any(map(JUDGED.search, sentences))
    for x, word, _ in JUDGED.findall(" ".join(sentences)):
        assert word != "better than" or max(exact[x]) > 0  # success 0 never wins
    assert not re.search(r"\bbecause\b|\bcause|\bexplain|\bdue to\b|\bthanks to\b", " ".join(sentences))


def test_sentences_rarely_contradict_the_truth_by_chance() -> None:
    """Grids of known truth, from which runs are drawn: at most about one grid in ten may mislead."""
    rng, n_wrong, n_judged = np.random.default_rng(0), 0, 0
    for place in range(50):
        truth = {name: rng.choice([0.0, 0.3, 0.5, 0.9, 0.95, 1.0], size=2) for name in FAMILY}
        if place % 2:
            truth["net"] = truth["table"]  # no difference
        n = int(rng.choice([10, 40]))
        drawn = {name: (rng.binomial(n, values) / n).tolist() for name, values in truth.items()}
        learners = {name: Made(FAMILY[name], values, n) for name, values in drawn.items()}
        with tempfile.TemporaryDirectory() as directory:
            sentences = told(Path(directory), learners, PAIRS, reference="table")
        n_judged += len(JUDGED.findall(" ".join(sentences)))
        wrong = contradictions(sentences, {k: v.tolist() for k, v in truth.items()}, ["net", "other"])
        n_wrong += bool(wrong)
    assert n_judged > 40
    assert n_wrong <= 7


# What is published


def rows_of(places: str) -> list[int]:
    """Returns the places in a data frame that a link's rows are at."""
    rows: list[int] = []
    for part in places.split(";"):
        first, _, last = part.partition("-")
        rows += range(int(first) - 2, int(last or first) - 1)
    return rows


@pytest.mark.parametrize("folder", ["compare_deep", "ablation"])
def test_every_number_of_the_findings_is_in_the_row_that_it_links_to(folder: str) -> None:
    path = PUBLISHED.parent / folder
    sentences = findings.table(Published(path))["text"]
    links = [match for text in sentences for match in LINK.findall(text)]
    assert len(links) > 10
    n_checked = 0
    for text, file, rows in links:
        # Of several rows a number is the mean.
        means = pd.read_csv(path / file).iloc[rows_of(rows)].mean(numeric_only=True)
        decimals = len(text.partition(".")[2])
        shown = {f"{mean:,.{decimals}f}" for mean in means} | {f"{mean:+.{decimals}f}" for mean in means}
        shown.add(str(len(rows_of(rows))))  # of rows that are counted
        if re.fullmatch(r"[-+\d,.]+", text):
            assert text in shown or text == "0.00", (text, file, rows)
            n_checked += 1
        else:
            assert re.fullmatch(
                r"[\d,.]+ times|[\d.]+ m?s|never|at the last evaluation|none|\d+ to \d+", text
            ), text
    assert n_checked > 10


@pytest.mark.parametrize("folder", ["compare_deep", "ablation"])
def test_published_sentences_judge_by_the_contrasts_alone(folder: str) -> None:
    """Words that judge stand in the headline and in the sentences of contrasts, and nowhere else."""
    path = PUBLISHED.parent / folder
    sentences = [plain(text) for text in findings.table(Published(path))["text"]]
    n_contrasts = len(pd.read_csv(path / "contrasts.csv"))
    judging = re.compile(
        r"\b(better|worse|equivalent|significant\w*|best|outperform\w*|superior|as good as)\b"
    )
    for text in sentences[1 + n_contrasts :]:
        assert not judging.search(text), text
    assert not re.search(r"\bbecause\b|\bcause|\bexplain|\bdue to\b", " ".join(sentences))


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


def test_terms_say_what_trains_checks(tmp_path: Path) -> None:
    def terms(name: str, **learners: Made) -> dict[str, str]:
        (directory := tmp_path / name).mkdir()
        all_learners = {"table": TABLE, "net": LOSER} | learners
        words = load_report("comparison").words
        data = data_of(all_learners, [("net", "table")], "table")
        return dict(words(published(directory, data, all_learners)))

    by_sb3 = terms("sb3", net_sb3=WINNER._replace(check_of="net", packages=("stable_baselines3",)))
    assert by_sb3["check"] == (
        "a learner with the settings of another one, trained by another implementation: `net_sb3` checks "
        "`net`. Nets are those of Stable-Baselines3 itself; denormal numbers count as zero, and Adam's step "
        "is fused. Figures show it hollow, beside the learner that it checks. No verdict rests on it."
    )
    other = terms("mine", other=WINNER._replace(check_of="net"))
    assert "Stable-Baselines3" not in other["check"]
    assert "check" not in terms("none")
