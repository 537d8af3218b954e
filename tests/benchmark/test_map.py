"""Maps: verdicts on made-up runs, with truth by hand, by book and by simulation."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from benchmark import map as maps
from benchmark.experiment import load_experiment
from benchmark.study import Data
from envs import InputError
from envs.inputs import parse

SHARED, TABLE = "shared, offset", "table, index"
BUDGET, N = 100_000, 20
NEVER: dict[float, float] = {}
EXPERIMENT = f"""
description = "A map in miniature."
scenarios = ["Anywhere"]
horizon = 60
evaluation_every = 100
solved = {{ success = 0.9, growth = 1.2 }}
settings = {{ budget = {BUDGET}, time_limit = 60, record_every = {BUDGET}, epsilon = 0.1 }}

[report]
kind = "map"
contrasts = [["{SHARED}", "{TABLE}"]]
answer = {{ grid = "new", point = "places 8", unseen = "new" }}
panels = [{{ grid = "places", title = "All", learners = ["{SHARED}", "{TABLE}"] }}]

[grids.places]
scenario = {{ "grid.rows" = 5, "grid.columns" = 6 }}
axes.places.4.scenario = {{ "issuer.places" = 4 }}
axes.places.16.scenario = {{ "issuer.places" = 16 }}

[grids.rooms]
axes.room.5x6.scenario = {{ "grid.rows" = 5, "grid.columns" = 6 }}
axes.room.6x7.scenario = {{ "grid.rows" = 6, "grid.columns" = 7 }}
axes.places.4.scenario = {{ "issuer.places" = 4 }}

[grids.new]
scenario = {{ "grid.rows" = 5, "grid.columns" = 6 }}
axes.places.8.scenario = {{ "issuer.places" = 8, "issuer.unseen" = 13 }}

[algorithms]
table = {{ algorithm = "q_learning", observations = ["index"], seeds = {N} }}

[algorithms.shared]
title = "shared table"
algorithm = "q_learning"
observations = ["offset"]
seeds = {N}
"""
Curve = Mapping[float, float]  # success from each of these steps on; 0 before


def made(
    folder: Path,
    shared: Sequence[Curve],
    table: Sequence[Curve],
    *,
    unseen: tuple[float, float] = (0.5, 0.5),
    change: tuple[str, str] = ("", ""),
) -> Data:
    """Returns a map whose runs have these curves in turn, everywhere, with all of its tables."""
    path = folder / "hand.toml"
    path.write_text(EXPERIMENT.replace(*change), encoding="utf-8")
    experiment = load_experiment(path)
    declared = parse(maps.Declared, experiment.declared.report or {}, "hand")
    starts = {start for curve in (*shared, *table) for start in curve}
    ladder = [BUDGET / 1.2**i for i in range(38)]
    steps = np.unique(np.round([0, *ladder, *starts, *(0.9 * start for start in starts)]))
    runs, curves = [], []
    for population in experiment.populations:
        is_shared = population.learner.name == SHARED
        own, new = (shared, unseen[0]) if is_shared else (table, unseen[1])
        for i, seed in enumerate(population.seeds):
            success = np.zeros(len(steps))
            for start, value in own[i % len(own)].items():
                success[steps >= start] = value
            keys = {**population.keys, "seed": seed}
            curve = {"step": steps, "success": success, "training_wrong_pings": steps / 10}
            curves.append(pd.DataFrame(keys | curve))
            has_new = new if population.scenario.issuer.unseen else np.nan
            run = {"run": population.first.with_seed(seed).digest, "budget": BUDGET}
            run |= {"success": success[-1], "unseen_success": has_new}
            runs.append(keys | run | {"cpu_learned_s": 1.0, "diverged_at": np.inf})
    data = Data(experiment, declared, pd.DataFrame(runs), pd.concat(curves, ignore_index=True))
    for name, function in maps.TABLES.items():
        table_made = function(data)
        assert table_made is not None
        data.tables[name] = table_made
    return data


def declared_of(path: Path) -> None:
    """Reads and checks a map."""
    experiment = load_experiment(path)
    maps.check(experiment, parse(maps.Declared, experiment.declared.report or {}, "mine"))


def row_of(data: Data, grid: str = "places") -> "pd.Series[Any]":
    """Returns the first contrast of a grid."""
    table = data.tables["contrasts"]
    return table[table["grid"] == grid].iloc[0]


@pytest.mark.parametrize(
    ("shared", "table", "verdict", "why", "ratio"),
    [
        ({1000: 1}, {1600: 1}, "faster", "", 1.6),
        ({1600: 1}, {1000: 1}, "slower", "", 0.625),
        ({1000: 1}, NEVER, "faster", "", 100),  # the budget counts
        ({1000: 1}, {1050: 1}, "no verdict", maps.SMALL, 1.05),
        (NEVER, NEVER, maps.NEITHER, "", np.nan),
        ({1000: 1}, {1000: 1}, "undecided", "", 1),
        ({0: 1}, NEVER, "no verdict", maps.UNTRAINED, np.nan),
        ({BUDGET: 1}, NEVER, "no verdict", maps.AT_LAST, 1),
        ({5000: 1}, {BUDGET: 1}, "faster", "", 20),
        ({1000: 1, 3000: 0, BUDGET: 1}, {9000: 1}, "no verdict", maps.LOST, 9),
        ({1000: 1, 90_000: 0}, {9000: 1}, "no verdict", maps.LOST, 9),
        # below the level in few evaluations, but for most steps
        ({30: 1, 5000: 0, BUDGET: 1}, {9000: 1}, "no verdict", maps.LOST, 300),
        ({1000: 1, 3000: 0, 4000: 1}, {9000: 1}, "faster", "", 9),  # recovers
        ({1000: 1}, {9000: 1, 90_000: 0}, "faster", "", 9),  # the loser may lose more
    ],
)
def test_verdicts_and_ratios_by_hand(
    shared: Curve, table: Curve, verdict: str, why: str, ratio: float, tmp_path: Path
) -> None:
    data = made(tmp_path, [shared], [table])
    row = row_of(data)
    assert (row["verdict"], row["why_none"]) == (verdict, why)
    assert row[["ratio", "ratio_low", "ratio_high"]].tolist() == pytest.approx(
        [ratio] * 3, nan_ok=True
    )
    words = {"faster": "fewer", "slower": "more"}
    assert row["wrong_pings_verdict"] == words.get(verdict, verdict)  # a tenth of the steps
    headline = maps.headline(data)
    assert "shared table of offsets compared with table" in headline
    assert f"grid `places`, one learner is faster in {2 * (verdict in words)} of 2" in headline
    assert "above 0.9, at every evaluation until" in " ".join(headline.split())
    assert "to the end of all 100,000 steps" in headline
    if verdict != "undecided":
        learned = f"{bool(shared) * N} and {bool(table) * N} runs learn"
        assert f"{verdict} at places 4 ({learned})" in headline
        assert f"{N} pairs of runs; also different: input" in headline
        assert f"; {why}." in headline or not why


def test_one_of_two_that_mostly_fail_learns_more_often(tmp_path: Path) -> None:
    """Not a word of neither learning, though most runs of neither do; and nobody wins."""
    change = f"seeds = {N}", "seeds = 200"
    data = made(tmp_path, [{1000: 1}, NEVER, NEVER], [NEVER], change=change)
    assert data.tables["cells"]["n_solved"].tolist()[:2] == [0, 67]
    row = row_of(data)
    assert (row["verdict"], row["why_none"]) == ("no verdict", maps.NOT_LEARNED)
    assert row["faster"] == pytest.approx((67 + 133 / 2) / 200)


@pytest.mark.parametrize(
    ("unseen", "shared", "verdict", "why"),
    [
        ((0.8, 0.5), {1000: 1}, "fewer", ""),
        ((0.5, 0.8), {1000: 1}, "more", ""),
        ((0.35, 0.3502), {1000: 1}, "no verdict", maps.SMALL),
        ((0.8, 0.5), NEVER, "no verdict", maps.NOT_LEARNED),
        ((0.5, 0.5), {1000: 1}, "undecided", ""),
    ],
)
def test_failures_in_unseen_places(
    unseen: tuple[float, float], shared: Curve, verdict: str, why: str, tmp_path: Path
) -> None:
    data = made(tmp_path, [shared], [{9000: 1}], unseen=unseen)
    row = row_of(data, "new")
    assert (row["failures_verdict"], row["failures_why"]) == (verdict, why)
    assert data.tables["contrasts"]["failures_verdict"].notna().sum() == 1


def test_a_net_that_knows_all_untrained_does_not_fail_less(tmp_path: Path) -> None:
    row = row_of(made(tmp_path, [{0: 1}], [{9000: 1}], unseen=(0.8, 0.5)), "new")
    assert (row["failures_verdict"], row["failures_why"]) == ("no verdict", maps.UNTRAINED)


def test_texts_name_what_else_differs_and_who_is_given_up(tmp_path: Path) -> None:
    change = '"offset"]', '"offset"]\nsettings = { time_limit = 9 }'
    headline = maps.headline(made(tmp_path, [{1000: 1}], [{9000: 1}], change=change))
    assert "time limit 9 against 60" in headline
    assert "given up" not in headline
    data = made(tmp_path, [NEVER], [NEVER], change=("growth", "given_up_after = 0.6, growth"))
    for text in (maps.headline(data), maps.reading(data)):
        assert "by 60 % of the budget is given up" in " ".join(text.split())


@pytest.mark.parametrize(("budget", "steps"), [(800, 800), (200, 200), (400, np.inf)])
def test_a_run_has_learned_if_success_stays_to_its_end(budget: int, steps: float) -> None:
    curves = pd.DataFrame({"step": [0, 100, 200, 400, 800], "success": [0.0, 0.0, 1.0, 0.0, 1.0]})
    curves = curves.assign(seed=0, training_wrong_pings=curves["step"] / 10)
    found = maps.until_learned(curves[curves["step"] <= budget], 0.9)
    assert (*found["steps"], *found["wrong_pings"]) == (steps, steps / 10)
    assert found["at_last"].tolist() == [steps == budget]


def pair(x: Any, y: Any, before: float = 0.99) -> maps.Pair:
    """Returns what pairs of runs took, whose evaluations are by default one percent apart."""

    def side(steps: Any) -> pd.DataFrame:
        own = pd.DataFrame({"steps": np.asarray(steps, dtype=float)})
        own["steps_before"] = own["steps"] * before
        return own.assign(lost=False, at_last=False, untrained=False)

    return {"x": side(x), "y": side(y)}


def decided(*pairs: maps.Pair) -> pd.DataFrame:
    """Returns what is decided of some contrasts."""
    return maps.decide_all(dict(zip("abcdef", pairs, strict=False)), "steps", maps.Margins())


def test_steps_down_by_hand() -> None:
    """15 of 19 pairs do not decide one of two contrasts, but the last one."""
    y, at = np.full(19, 100.0), np.arange(19)
    clear, close = (pair(np.where(at < n_lost, 200.0, 50.0), y) for n_lost in (0, 4))
    assert 0.05 / 3 / 2 < stats.binom.sf(14, 19, 0.5) <= 0.05 / 3
    assert decided(close, clear)["verdict"].tolist() == ["faster", "faster"]
    assert decided(close, close)["verdict"].tolist() == ["undecided", "undecided"]
    # Clopper and Pearson: the upper tail at the lower end is the tail of two contrasts
    first = decided(close, clear).iloc[0]
    assert stats.binom.sf(14, 19, first["faster_low"]) == pytest.approx(0.05 / 3 / 2)
    assert first["faster_low"] < 0.5 < first["faster"]


@pytest.mark.parametrize(
    ("less", "more", "is_small"), [(0, 0, True), (0, 1, False), (3, 3.3, False)]
)
def test_medians_of_nothing_do_not_differ(less: float, more: float, *, is_small: bool) -> None:
    """In half of its runs and one, the learner that takes more needs no wrong PING either."""
    x, y = np.full(41, less), np.where(np.arange(41) < 21, more, 9.0)
    winner, loser = pair(np.full(41, 50.0), np.full(41, 50.0)).values()
    sides = winner.assign(wrong_pings=x), loser.assign(wrong_pings=y)
    found = maps._flaw(*sides, "wrong_pings", maps.Margins())
    assert (found == maps.SMALL) == is_small


def test_a_small_probability_has_no_verdict() -> None:
    for n_lost, verdict in (
        (82, "no verdict"),
        (79, "faster"),
    ):  # of 200, of which 41 % is too near
        table = decided(pair(np.where(np.arange(200) < n_lost, 200.0, 50.0), np.full(200, 100.0)))
        assert table["verdict"].tolist() == [verdict]
        assert (table["why_none"] == maps.SMALL).tolist() == [verdict == "no verdict"]


@pytest.mark.parametrize(
    ("before", "y", "why"),
    [(0.5, 60.0, maps.COARSE), (0.9, 60.0, ""), (0.5, 110.0, "")],  # 110 / 2 is after 50
)
def test_evaluations_that_are_too_far_apart(before: float, y: float, why: str) -> None:
    table = decided(pair(np.full(20, 50.0), np.full(20, y), before))
    assert table["why_none"].tolist() == [why]
    assert table["verdict"].tolist() == ["no verdict" if why else "faster"]


@pytest.mark.parametrize("spread", [0.0, 0.5])
def test_a_map_has_no_wrong_verdict_in_95_of_100(spread: float) -> None:
    """Of equal learners, none may be called faster anywhere on a map, in at least 95 % of maps.

    What a scenario draws makes runs of a seed alike, in all cells of a map and for both learners.
    Half of the contrasts have a clear winner, so that steps down are taken.
    """
    rng, n_maps, n_wrong = np.random.default_rng(7), 60, 0
    for _ in range(n_maps):
        places, pairs = rng.normal(size=16) * spread, []
        for i in range(6):
            x, y = (np.exp(5 + places + rng.normal(size=16)).round() for _ in "xy")
            pairs.append(pair(x * (1e-4 if i % 2 else 1.0), y))
        found = decided(*pairs)["verdict"].tolist()
        assert {*found[1::2]} == {"faster"}
        n_wrong += {*found[::2]} != {"undecided"}
    assert n_wrong <= stats.binom.ppf(0.998, n_maps, 0.05)


def test_a_contrast_in_two_grids_is_decided_once(tmp_path: Path) -> None:
    data = made(tmp_path, [{1000: 1}], [{1600: 1}])
    runs = [*data.tables["contrasts"]["faster_low"].unique()]
    assert len(data.tables["contrasts"]) == 5
    # `places 4` and the room of 5 x 6 cells with 4 places are the same: four are different
    assert runs == [pytest.approx((0.05 / 3 / 4) ** (1 / N))]


def axes_of(figure: str, data: Data) -> list[Any]:
    """Returns the axes of a figure."""
    drawn = maps.FIGURES[figure](data)
    assert drawn is not None
    return [*drawn.axes]


def test_figures_by_hand(tmp_path: Path) -> None:
    data = made(tmp_path, [{7000: 1}], [NEVER])
    left, right = axes_of("answer", data)
    names = ["All", "shared table of offsets", "table"]
    assert [label.get_text() for label in left.get_yticklabels()] == names
    assert [text.get_text() for text in left.texts] == ["7,000", f"0 of {N} learn"]
    assert [text.get_text() for text in right.texts] == ["0.50", "0.50"]
    dots = [line for line in left.lines if len(line.get_xdata()) == 1]
    assert [float(*line.get_xdata()) for line in dots] == [7000, BUDGET]
    assert [line.get_markerfacecolor() == "white" for line in dots] == [False, True]
    (axis,) = axes_of("map", data)
    assert [label.get_text() for label in axis.get_xticklabels()] == ["4", "16"]
    lines = [line.get_ydata().tolist() for line in axis.lines if len(line.get_ydata()) == 2]
    assert lines == [[7000, 7000], [BUDGET, BUDGET], [BUDGET, BUDGET]]  # the last is hollow
    (axis,) = axes_of("unseen", data)
    assert axis.lines[0].get_ydata().tolist() == [0.5]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("solved = ", "# ", "[solved] is missing"),
        (f"seeds = {N}", "seeds = 13", f"{SHARED} and {TABLE}: accepted: two learners in one"),
        ('["Anywhere"]', '["Anywhere", "AnywhereHidden"]', "scenarios: 2: accepted: exactly one"),
        (
            '"offset"]',
            '"offset"]\nsettings = { budget = 900, record_every = 900 }',
            "seeds and budget",
        ),
        ('grid = "places"', 'grid = "rooms"', "unknown grid with one axis rooms"),
        ("places 8", "places 9", "unknown point with unseen places new, places 9"),
        (f'"{TABLE}"] }}', '"net, index"] }', "unknown learner net, index"),
        (f'["{SHARED}", "{TABLE}"]]', f'["{SHARED}", "net, index"]]', "unknown learner net, index"),
        (f'["{SHARED}", "{TABLE}"]]', f'["{TABLE}", "{TABLE}"]]', "is named twice"),
    ],
)
def test_mistakes_are_named(old: str, new: str, message: str, tmp_path: Path) -> None:
    assert old in EXPERIMENT
    path = tmp_path / "mine.toml"
    path.write_text(EXPERIMENT.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(message)) as refused:
        declared_of(path)
    assert len(refused.value.args) == 1
