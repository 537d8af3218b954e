"""What a comparison concludes: rules by hand, and outcomes that must not be drawn."""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from benchmark.folder import Folder
from benchmark.studies import comparison
from benchmark.studies.comparison.analysis import FEWEST_RUNS, ComparisonAnalysis
from benchmark.studies.comparison.contrasts import Means, contrast, holm, standings
from tests.benchmark.studies.made import Cell, Made, analysis_of, compared, item, random_success, table

RANDOM = random_success("S1")
TABLE, WEAK = Made("tabular", (1.0, 0.6, 1.0)), Made("tabular", 0.3)
WINNER, EQUAL, LOSER = Made("deep", 1.0), Made("deep", (1.0, 0.6, 1.0)), Made("deep", 0.05)


def outcomes(analysis: ComparisonAnalysis) -> list[str]:
    return [row["outcome"] for row in analysis.outcomes]


class Tables(dict[str, pd.DataFrame]):
    """A folder of results that has some tables."""

    def frame(self, name: str) -> pd.DataFrame:
        return self[f"{name}.csv"]


def headline(analysis: ComparisonAnalysis) -> str:
    names = ["contrasts"] + ["outcomes"] * bool(analysis.outcomes)
    folder = Tables({f"{name}.csv": table(name, analysis) for name in names})
    return comparison.STUDY.headline(cast(Folder, folder)) or ""


CASES: list[tuple[dict[str, Made], str]] = [
    ({"table": WEAK, "net": WINNER}, "earns"),
    ({"table": Made("tabular", 0.0), "net": WINNER}, "no baseline learned"),
    ({"table": TABLE, "net": LOSER}, "does not earn"),
    ({"table": TABLE, "net": LOSER, "other": EQUAL}, "does not earn"),
    ({"table": TABLE, "net": EQUAL}, "does not earn"),  # equivalent: nothing is gained
    ({"table": TABLE, "net": EQUAL._replace(n=12)}, "undecided"),
    ({"table": WEAK, "net": WINNER._replace(n=9)}, "no verdict"),
    ({"table": WEAK, "net": WINNER, "other": LOSER._replace(n=2)}, "no verdict"),
    ({"table": Made("tabular", 0.0), "net": Made("deep", 0.0)}, "neither learned"),
    # A reference wins, but no verdict rests on references.
    ({"table": TABLE, "net": LOSER, "net_sb3": WINNER._replace(reference_for="net")}, "does not earn"),
    # Better in success, worse in score: not "earns".
    ({"table": WEAK._replace(score=0.9), "net": WINNER._replace(score=0.5)}, "mixed"),
    # The random policy has to be beaten in success alone.
    ({"table": WEAK._replace(score=0.0), "net": WINNER._replace(score=0.0)}, "earns"),
    # One net is better in success and worse in score, another is better in both.
    ({"table": WEAK, "other": WINNER._replace(score=0.0), "net": WINNER}, "earns"),
    # It is enough to be worse in one scenario and better in none.
    ({"table": Made("tabular", 0.8, 900), "net": Made("deep", (0.8, 0.65, 0.8), 900)}, "does not earn"),
    # In the mean, differences must not cancel.
    ({"table": Made("tabular", (0.7, 1.0, 1.0)), "net": Made("deep", (1.0, 0.85, 0.85))}, "mixed"),
    # A table at 0.92 leaves less room than the margin, and can still be beaten.
    ({"table": Made("tabular", 0.92), "net": WINNER}, "earns"),
    ({"table": WEAK._replace(policy="stochastic"), "net": WINNER}, "another policy"),
    ({"table": WEAK._replace(budget=800), "net": WINNER}, "unequal budgets"),
    ({"table": TABLE, "net": LOSER._replace(budget=800)}, "unequal budgets"),
    ({"table": WEAK, "net": WINNER._replace(observation="offset")}, "another input"),
    ({"table": Made("tabular", 0.0), "net": WINNER._replace(observation="offset")}, "another input"),
    # What leaves less room than the margin, by its interval, cannot be beaten where no scenario has room.
    ({"table": Made("tabular", 0.97), "net": Made("deep", 0.95, 12)}, "cannot be beaten"),
    ({"table": Made("tabular", 0.97, 12), "net": Made("deep", 0.95, 12)}, "undecided"),
    ({"table": Made("tabular", (1.0, 0.85, 1.0), 900), "net": Made("deep", (0.8, 1.0, 0.8), 900)}, "mixed"),
]


@pytest.mark.parametrize(("learners", "expected"), CASES)
def test_outcome_against_one_baseline(learners: dict[str, Made], expected: str) -> None:
    """It is the same whatever the family of the baseline."""
    for family in ("tabular", "deep"):
        other = learners | {"table": learners["table"]._replace(family=family)}
        assert outcomes(compared(other, baseline=["table"])) == [expected]


# Two baselines, one of each class of policy

SOFT, SOFT_WINNER = (Made(family, s, policy="stochastic") for family, s in (("tabular", 0.3), ("deep", 1.0)))
UNTRAINED = Made("tabular", RANDOM, policy="stochastic", every_run=True)
NOTHING = WEAK._replace(success=0.0)
TWO: list[tuple[dict[str, Made], str]] = [
    ({"net": WINNER}, "earns"),
    ({"soft": WEAK, "net": WINNER._replace(policy="stochastic")}, "another policy"),
    ({"table": NOTHING, "net": WINNER}, "another policy"),
    ({"table": NOTHING, "soft": UNTRAINED, "net": WINNER}, "no baseline learned"),
    ({"soft": SOFT._replace(success=0.8), "net": Made("deep", 0.6)}, "does not earn"),
    ({"soft": SOFT._replace(success=1.0), "net": Made("deep", 0.6)}, "cannot be beaten"),  # nor both tables
    ({"soft": SOFT._replace(success=1.0, n=12), "net": WINNER}, "undecided"),
    ({"table": NOTHING, "soft": SOFT._replace(success=0.0), "net": Made("deep", 0.0)}, "neither learned"),
    ({"table": NOTHING, "net": Made("deep", 0.0)}, "does not earn"),
    # Policy and input have to be those of the same table.
    ({"soft": SOFT._replace(observation="offset"), "net": SOFT_WINNER}, "another input"),
    # A winner is enough, whatever another net does.
    ({"net": WINNER, "other": LOSER}, "earns"),
]


@pytest.mark.parametrize(("learners", "expected"), TWO)
def test_deep_rl_has_to_beat_every_baseline(learners: dict[str, Made], expected: str) -> None:
    made = {"table": WEAK, "soft": SOFT} | learners
    assert outcomes(compared(made, baseline=["table", "soft"])) == [expected]


@pytest.mark.parametrize(
    ("tiles", "net", "expected"),
    [
        (0.3, 1.0, "earns"),
        (0.8, 0.6, "does not earn"),  # the table is beaten, but tile coding does better
        (0.0, 1.0, "earns"),  # tile coding has not learned, but the table has
    ],
)
def test_tile_coding_has_to_be_beaten_like_a_table(tiles: float, net: float, expected: str) -> None:
    learners = {"table": WEAK, "tiles": Made("linear", tiles), "net": Made("deep", net)}
    # What baselines are among each other has no part in it.
    pairs = [("net", "table"), ("net", "tiles"), ("tiles", "table")]
    assert outcomes(compared(learners, pairs, ["table", "tiles"])) == [expected]


@pytest.mark.parametrize(
    ("verdicts", "expected"),
    [
        (("better", "better"), "better"),
        (("better", "undecided"), "undecided"),
        (("better", "equivalent"), "equivalent"),
        (("better", "worse"), "worse"),
        (("equivalent", "worse"), "worse"),
        (("equivalent", "mixed"), "equivalent"),
        (("better", "mixed"), "mixed"),
        (("neither learned", "better"), "neither learned"),
        (("worse", "no verdict"), "no verdict"),
        (("better",), None),  # not compared with both
    ],
)
def test_one_verdict_against_two_baselines(verdicts: tuple[str, ...], expected: str | None) -> None:
    for order in (1, -1):
        rows = pd.DataFrame(
            {"x": "net", "y": y, "success_verdict": verdict}
            for y, verdict in zip(("table", "soft"), verdicts[::order], strict=False)
        )
        assert standings(rows, ["table", "soft"]).get("net") == expected


# The random policy


def test_a_net_at_the_random_policy_does_not_earn_its_keep_over_a_greedy_table_at_0() -> None:
    """As PPO with a learning rate of 1e-12 in TurningHidden: better than the table, and never trained."""
    random = random_success("TurningHidden")
    assert 0.05 < random < 0.5
    net = Made("deep", random, 100, policy="stochastic", every_run=True)
    learners = {"table": Made("tabular", 0.0), "net": net}
    analysis = compared(learners, baseline=["table"], scenarios=["TurningHidden"])
    (row,) = analysis.contrasts
    assert row["success_verdict"] == "neither learned"
    assert row["random_success"] == pytest.approx(random)
    assert outcomes(analysis) == ["neither learned"]
    learners["dqn"] = Made("deep", 1.0, policy="stochastic")
    analysis = compared(learners, baseline=["table"], scenarios=["TurningHidden"])
    assert outcomes(analysis) == ["no baseline learned"]


def test_the_random_policy_is_beaten_by_an_exact_binomial_test() -> None:
    random = random_success("S1")
    learners = {"x": Made("deep", 0.4, 20), "y": Made("tabular", 0.05, 20)}
    (row,) = compared(learners, [("x", "y")], scenarios=["S1"]).contrasts
    for side, count in (("x", 8), ("y", 1)):
        expected = stats.binomtest(count, 20, random, alternative="greater").pvalue
        assert row[f"p_random_{side}"] == pytest.approx(min(expected, 1.0), rel=1e-6)


# Scenarios


@pytest.mark.parametrize(
    ("x", "y", "verdict", "apart"),
    [
        ((1.0, 0.85, 0.85), (0.7, 1.0, 1.0), "mixed", "S1, S2, S3"),  # the same on average
        ((1.0, 0.85, 1.0), (1.0, 1.0, 1.0), "mixed", "S2"),
        ((0.1, 1.0, 1.0), (0.0, 1.0, 1.0), "mixed", "S1"),  # as large as the margin
        ((1.0, 1.0, 0.7), (0.2, 0.2, 0.9), "mixed", "S3"),  # better on average, and worse in one by 0.2
        ((1.0, 1.0, 0.85), (0.2, 0.2, 0.9), "better", "S3"),  # in S3 it may be worse by more than 0.1
        ((0.2, 0.2, 0.9), (1.0, 1.0, 0.85), "worse", "S3"),
        ((1.0, 1.0, 1.0), (0.2, 0.2, 0.9), "better", ""),
        ((1.0, 1.0, 0.95), (1.0, 1.0, 1.0), "equivalent", "S3"),
    ],
)
def test_scenarios_that_stand_apart_are_named(
    x: Sequence[float], y: Sequence[float], verdict: str, apart: str
) -> None:
    (row,) = compared({"x": Made("deep", x), "y": Made("tabular", y)}, baseline=["y"]).contrasts
    assert (row["success_verdict"], row["success_except"]) == (verdict, apart)
    for name, own, other in zip(("S1", "S2", "S3"), x, y, strict=True):
        alone = contrast(Means([own], [100]), Means([other], [100]), 0.1)
        low, high = alone.difference_low_90, alone.difference_high_90
        is_shown = {"better": low > -0.1, "worse": high < 0.1, "equivalent": low > -0.1 and high < 0.1}
        if verdict != "mixed":
            assert is_shown[verdict] == (name not in apart), name


def test_contrasts_in_one_scenario_have_no_part_in_the_outcome() -> None:
    learners = {"table": WEAK, "net": WINNER, "other": LOSER}
    pairs = [("net", "table"), ("other @ S1", "table @ S1"), ("net @ S1", "table @ S2")]
    assert outcomes(compared(learners, pairs, ["table"])) == ["earns"]
    analysis = compared(learners, pairs, ["table"], pool="none")
    assert outcomes(analysis) == ["earns"] * 3
    named = [("net, index", "table, index")] * 3
    named += [("other, index @ S1", "table, index @ S1"), ("net, index @ S1", "table, index @ S2")]
    assert sorted((row["x"], row["y"]) for row in analysis.contrasts) == sorted(named)


MIRROR = {"better": "worse", "worse": "better"}


@pytest.mark.parametrize("y", [(0.2, 0.2, 0.9), (1.0, 0.9, 1.0), (0.9, 1.0, 0.3), (0.0, 0.0, 0.0)])
def test_exchanging_x_and_y_exchanges_better_and_worse_and_nothing_else(y: tuple[float, ...]) -> None:
    learners = {"x": Made("tabular", (1.0, 1.0, 0.7)), "y": Made("tabular", y)}
    (one,), (other,) = (compared(learners, [pair]).contrasts for pair in (("x", "y"), ("y", "x")))
    for endpoint in ("success", "score"):
        verdict = str(one[f"{endpoint}_verdict"])
        assert other[f"{endpoint}_verdict"] == MIRROR.get(verdict, verdict)
        assert one[f"{endpoint}_except"] == other[f"{endpoint}_except"]
        for key, opposite in (("", ""), ("_low", "_high"), ("_low_90", "_high_90")):
            value = one[f"{endpoint}_difference{key}"]
            assert value == pytest.approx(-other[f"{endpoint}_difference{opposite}"])
        for key in ("p_different", "p_equivalent"):
            assert one[f"{endpoint}_{key}"] == pytest.approx(other[f"{endpoint}_{key}"], nan_ok=True)


def test_every_scenario_has_its_own_verdict_and_all_are_adjusted_together() -> None:
    learners = {"x": Made("deep", (1.0, 0.25), 20), "y": Made("tabular", 1.0, 20)}
    rows = compared(learners, baseline=["y"], scenarios=["S1", "S2"], pool="none").contrasts
    assert [row["scenario"] for row in rows] == ["S1", "S2"]
    assert [row["success_verdict"] for row in rows] == ["undecided", "worse"]
    raw = [contrast(Means([share], [20]), Means([1.0], [20]), 0.1) for share in (1.0, 0.25)]
    for key in ("p_different", "p_equivalent"):
        expected = holm([getattr(each, key) for each in raw])
        assert [row[f"success_{key}"] for row in rows] == pytest.approx(expected)


def test_few_runs_have_no_verdict_but_count_in_the_adjustment() -> None:
    learners = {"few": Made("deep", 0.5, 8), "net": Made("deep", 0.5, 50), "y": Made("tabular", 1.0, 50)}
    few, net = compared(learners, baseline=["y"], scenarios=["S1"]).contrasts
    assert (few["success_verdict"], net["success_verdict"]) == ("no verdict", "worse")
    raw = contrast(Means([0.5], [50]), Means([1.0], [50]), 0.1).p_different  # the smaller one
    assert net["success_p_different"] == pytest.approx(2 * raw)


def test_conditions_have_outcomes_of_their_own() -> None:
    """A net that wins under one condition only does not earn its keep under all."""
    cells = [
        Cell(name, np.full(100, share), family=family, condition=condition)
        for condition, net in (("default/noise=low", 0.0), ("default/noise=high", 1.0))
        for name, family, share in (("net", "deep", net), ("table", "tabular", 0.4))
    ]
    for pool in ("scenarios", "none"):
        analysis = analysis_of(cells, [("net", "table")], ["table"], pool=pool)
        assert [(row["condition"], row["success_verdict"]) for row in analysis.contrasts] == [
            ("default/noise=low", "worse"),
            ("default/noise=high", "better"),
        ]
        found = {row["condition"]: row["outcome"] for row in analysis.outcomes}
        assert found == {"default/noise=low": "does not earn", "default/noise=high": "earns"}


# The answer in a sentence


def test_the_answer_counts_scenarios_by_outcome() -> None:
    learners = {
        "table": Made("tabular", (0.3, 0.8, 1.0, 0.0, 0.0)),
        "net": Made("deep", (1.0, 0.1, 1.0, 0.0, 1.0), 50),
    }
    scenarios = ["S1", "S2", "S3", "Hall", "Walls"]
    assert headline(compared(learners, baseline=["table"], scenarios=scenarios, pool="none")) == (
        "Whether deep RL earns its keep: a net beats every baseline in success (1 of 5); only nets are shown "
        "to beat the random policy (1 of 5); no net beats every baseline in success (1 of 5); cannot be "
        "beaten here: a baseline leaves no room (1 of 5); no learner is shown to beat the random policy "
        "(1 of 5)."
    )


def test_the_answer_counts_verdicts_without_baselines() -> None:
    learners = {"table": TABLE, "net": LOSER, "other": EQUAL}
    analysis = compared(learners, [("net", "table"), ("net", "other")])
    assert item("outcomes").tabulate(analysis) is None
    assert headline(analysis) == "Verdicts on success: worse (2 of 2)."


@pytest.mark.parametrize(
    ("x", "y", "verdicts"),
    [
        ((0.3, 400, 0.9), (0.3, 400, 0.5), ("equivalent", "better")),
        ((0.9, 400, 0.5), (0.3, 400, 0.9), ("better", "worse")),
        ((0.9, 400, 0.9), (0.3, 400, 0.5), ("better", "better")),
        ((0.0, 400), (0.0, 400), ("neither learned", "neither learned")),
        # The random policy succeeds as often as x, and more often than y.
        ((RANDOM, 400, 0.2), (0.0, 400), ("neither learned", "better")),
    ],
)
def test_score_and_success_have_verdicts_of_their_own(
    x: tuple[Any, ...], y: tuple[Any, ...], verdicts: tuple[str, str]
) -> None:
    made = {name: Made("tabular", *own)._replace(every_run=True) for name, own in (("x", x), ("y", y))}
    (row,) = compared(made, [("x", "y")], scenarios=["S1"]).contrasts
    assert (row["success_verdict"], row["score_verdict"]) == verdicts


def test_nothing_is_to_be_learned_where_the_random_policy_succeeds() -> None:
    for random, outcome in ((0.9, "nothing to learn"), (0.89, "no baseline learned")):
        analysis = compared({"table": TABLE, "net": WINNER}, baseline=["table"], random=random)
        assert outcomes(analysis) == [outcome]


def test_nets_are_contrasted_with_learners_of_the_same_input_beside_the_declared_ones() -> None:
    beside = {"near": WEAK._replace(observation="offset"), "tiles": Made("linear", 0.3), "net": WINNER}
    beside |= {"long": WEAK._replace(budget=800), "check": WEAK._replace(reference_for="table")}
    analysis = compared({"table": WEAK, **beside}, [("net", "near")], ["near"])
    rows = analysis.same_input
    assert [row["y"] for row in rows] == ["table, index", "tiles, index"]  # same budget, no reference
    raw = contrast(Means([1.0] * 3, [100] * 3), Means([0.3] * 3, [100] * 3), 0.1).p_different
    assert [row["success_p_different"] for row in rows] == pytest.approx(holm([raw, raw]))
    assert outcomes(analysis) == ["another input"]
    assert compared({"table": WEAK, **beside}, baseline=["table"]).same_input == []


def test_later_contrasts_are_adjusted_among_themselves_over_all_scenarios_and_in_each() -> None:
    learners = {"table": WEAK, "net": WINNER, "other": Made("deep", 0.4)}
    later = (("other, index", "table, index"),)
    alone = compared(learners, [("net", "table")], ["table"])
    analysis = compared(learners, [("net", "table")], ["table"], later=later)
    *added, declared = analysis.contrasts
    assert declared == alone.contrasts[0]
    assert [row["x"] for row in added] == ["other, index", *(f"other, index @ S{i}" for i in (1, 2, 3))]
    assert {row["declared"] for row in added} == {"later"}
    means = [Means([0.4] * n, [100] * n) for n in (3, 1, 1, 1)]
    raw = [contrast(x, Means([0.3] * len(x.means), x.sizes), 0.1).p_different for x in means]
    assert [row["success_p_different"] for row in added] == pytest.approx(holm(raw))
    assert outcomes(analysis) == outcomes(alone)  # which later contrasts do not change


def test_the_document_names_the_fewest_runs() -> None:
    rules = comparison.STUDY.document.read_text(encoding="utf-8")
    assert f"fewer than {FEWEST_RUNS} runs" in rules
