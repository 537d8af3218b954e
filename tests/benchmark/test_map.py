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
from benchmark.study import Data
from envs import InputError
from envs.inputs import parse
from tests.benchmark.populations import with_tables
from tests.support import made as loaded

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
panels = [{{ grid = "places", title = "All", learners = ["{SHARED}", "{TABLE}"] }}]

[report.ladder]
grids = ["places", "new"]
rungs = [
  {{ title = "cells", tiles = "{TABLE}", nets = {{ DQN = "{SHARED}", PPO = "{SHARED}" }} }},
  {{ title = "offsets", tiles = "{SHARED}" }},
]

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
    experiment = loaded(folder / "hand.toml", EXPERIMENT.replace(*change))
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
            run |= {"success": success[-1], "unseen_success": has_new, "new_way_success": has_new}
            runs.append(keys | run | {"diverged_at": np.inf})
    data = Data(experiment, declared, pd.DataFrame(runs), pd.concat(curves, ignore_index=True))
    return with_tables(data, maps.TABLES)


def row_of(data: Data, grid: str = "places") -> "pd.Series[Any]":
    """Returns the first contrast of a grid."""
    table = data.tables["contrasts"]
    return table[table["grid"] == grid].iloc[0]


@pytest.mark.parametrize(
    ("shared", "table", "verdict", "why"),
    [
        ({1000: 1}, {1600: 1}, "faster", ""),
        ({1600: 1}, {1000: 1}, "slower", ""),
        ({1000: 1}, NEVER, "faster", ""),  # the budget counts
        ({1000: 1}, {1050: 1}, "no verdict", maps.SMALL),
        (NEVER, NEVER, maps.NEITHER, ""),
        (NEVER, {1000: 1, 1500: 0, 2500: 1, 3000: 0}, maps.NEITHER, ""),  # not until 2000
        ({1000: 1}, {1000: 1}, "undecided", ""),
        ({0: 1}, NEVER, "no verdict", maps.UNTRAINED),
        ({BUDGET: 1}, NEVER, "no verdict", maps.AT_LAST),
        ({5000: 1}, {BUDGET: 1}, "faster", ""),
        ({1000: 1, 3000: 0, BUDGET: 1}, {9000: 1}, "no verdict", maps.LOST),
        ({1000: 1, 90_000: 0}, {9000: 1}, "no verdict", maps.LOST),
        # below the level in few evaluations, but for most steps
        ({30: 1, 5000: 0, BUDGET: 1}, {9000: 1}, "no verdict", maps.LOST),
        ({1000: 1, 3000: 0, 4000: 1}, {9000: 1}, "faster", ""),  # recovers
        ({1000: 1}, {9000: 1, 90_000: 0}, "faster", ""),  # the loser may lose more
    ],
)
def test_verdicts_by_hand(
    shared: Curve, table: Curve, verdict: str, why: str, tmp_path: Path
) -> None:
    data = made(tmp_path, [shared], [table])
    row = row_of(data)
    assert (row["steps_verdict"], row["steps_why"]) == (verdict, why)
    headline = " ".join(maps.headline(data).split())
    n_decided = 5 * (verdict in ("faster", "slower"))  # of one at each point
    assert f"faster in {n_decided} of 5 contrasts" in headline
    named = (
        f"- shared table of offsets compared with table: {verdict} (places: places 4, places 16)"
    )
    assert (named in headline) == (n_decided > 0)
    took = data.tables["took"]
    assert (took["wrong_pings"] == took["steps"] / 10).all()


def test_one_of_two_that_mostly_fail_learns_more_often(tmp_path: Path) -> None:
    """Not a word of neither learning, though most runs of neither do; and nobody wins."""
    change = f"seeds = {N}", "seeds = 200"
    data = made(tmp_path, [{1000: 1}, NEVER, NEVER], [NEVER], change=change)
    assert data.tables["cells"]["n_solved"].tolist()[:2] == [0, 67]
    row = row_of(data)
    assert (row["steps_verdict"], row["steps_why"]) == ("no verdict", maps.NOT_LEARNED)
    assert row["steps_wins"] == pytest.approx((67 + 133 / 2) / 200)


@pytest.mark.parametrize(
    ("unseen", "shared", "verdict", "why"),
    [
        ((0.8, 0.5), {1000: 1}, "better", ""),
        ((0.5, 0.8), {1000: 1}, "worse", ""),
        ((0.35, 0.3502), {1000: 1}, "no verdict", maps.SMALL),
        ((0.8, 0.5), NEVER, "no verdict", maps.NOT_LEARNED),
        ((0.5, 0.5), {1000: 1}, "undecided", ""),
        ((0.8, 0.5), {0: 1}, "no verdict", maps.UNTRAINED),
    ],
)
def test_failures_in_unseen_places(
    unseen: tuple[float, float], shared: Curve, verdict: str, why: str, tmp_path: Path
) -> None:
    data = made(tmp_path, [shared], [{9000: 1}], unseen=unseen)
    row = row_of(data, "new")
    for unit in ("unseen", "new_way"):
        assert (row[f"{unit}_verdict"], row[f"{unit}_why"]) == (verdict, why)
        assert data.tables["contrasts"][f"{unit}_verdict"].notna().sum() == 1


def test_pairs_are_runs_of_the_same_seed(tmp_path: Path) -> None:
    """Twelve runs of a net meet the first twelve of tile coding, in whatever order."""
    change = f'index"], seeds = {N}', 'index"], settings.time_limit = 9, seeds = 12'
    curves: list[Curve] = [*([{1000.0: 1.0}] * 12), NEVER]
    data = made(tmp_path, curves, [{9000: 1}], change=change)
    row = row_of(data)
    assert row[["n", "steps_wins", "learned_x", "learned_y"]].tolist() == [12, 1, 12, 12]
    differs = "time limit 60 against 9; input one-hot offsets against one-hot cells"
    assert row["differs"] == differs


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
    assert decided(close, clear)["steps_verdict"].tolist() == ["faster", "faster"]
    assert decided(close, close)["steps_verdict"].tolist() == ["undecided", "undecided"]
    # Clopper and Pearson: the upper tail at the lower end is the tail of two contrasts
    first = decided(close, clear).iloc[0]
    assert stats.binom.sf(14, 19, first["steps_wins_low"]) == pytest.approx(0.05 / 3 / 2)
    assert first["steps_wins_low"] < 0.5 < first["steps_wins"]


@pytest.mark.parametrize(
    ("n_lost", "n", "y", "before", "why"),
    [
        (82, 200, 100.0, 0.99, maps.SMALL),  # 41 % is too near one half
        (79, 200, 100.0, 0.99, ""),
        (0, 20, 60.0, 0.5, maps.COARSE),
        (0, 20, 60.0, 0.9, ""),
        (0, 20, 110.0, 0.5, ""),  # 110 / 2 is after 50
    ],
)
def test_small_probabilities_and_coarse_evaluations_have_no_verdict(
    n_lost: int, n: int, y: float, before: float, why: str
) -> None:
    x = np.where(np.arange(n) < n_lost, 200.0, 50.0)
    table = decided(pair(x, np.full(n, y), before))
    assert table["steps_why"].tolist() == [why]
    assert table["steps_verdict"].tolist() == ["no verdict" if why else "faster"]


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
        found = decided(*pairs)["steps_verdict"].tolist()
        assert {*found[1::2]} == {"faster"}
        n_wrong += {*found[::2]} != {"undecided"}
    assert n_wrong <= stats.binom.ppf(0.998, n_maps, 0.05)


def test_a_contrast_in_two_grids_is_decided_once(tmp_path: Path) -> None:
    data = made(tmp_path, [{1000: 1}], [{1600: 1}])
    runs = [*data.tables["contrasts"]["steps_wins_low"].unique()]
    assert len(data.tables["contrasts"]) == 5
    # `places 4` and the room of 5 x 6 cells with 4 places are the same: four are different
    assert runs == [pytest.approx((0.05 / 3 / 4) ** (1 / N))]


def axes_of(figure: str, data: Data) -> list[Any]:
    """Returns the axes of a figure."""
    drawn = maps.FIGURES[figure](data)
    assert drawn is not None
    return [*drawn.axes]


def dots_of(axis: Any) -> list[Any]:
    """Returns what is drawn with a mark, and not without a point."""
    return [line for line in axis.lines if line.get_marker() != "None" and line.get_xdata().size]


def test_rungs_by_hand(tmp_path: Path) -> None:
    """A row for each net of a rung and point; the last one is chance."""
    table = made(tmp_path, [{7000: 1}], [NEVER], unseen=(0.75, 0.5)).tables["rungs"]
    assert table["net"].tolist() == ["DQN", "PPO"] * 3 + ["none"] * 3 + [""]
    assert table["point"].tolist()[:6:2] == ["places 4", "places 16", "places 8"]
    row = table.iloc[4]
    expected = {"rung": "cells", "tiles_n_solved": 0, "net_n_solved": N, "net_wins": 1.0}
    expected |= {"tiles_steps": np.inf, "net_steps": 7000, "steps_verdict": "faster"}
    expected |= {"tiles_unseen_success": 0.5, "net_new_way_success": 0.75}
    assert {name: row[name] for name in expected} == expected
    chance = table.iloc[-1]
    assert 0 < chance["net_unseen_success"] == chance["tiles_new_way_success"] < 0.2


def test_nets_that_run_at_some_points_only(tmp_path: Path) -> None:
    """Tables lack them elsewhere; figures show a learner that runs at one point only at all."""
    extra = f'[grids.extra]\nlearners = ["{SHARED}"]\naxes.places.2.scenario."issuer.places" = 2\n'
    places = f'[grids.places]\nlearners = ["{TABLE}"]\n'
    change = "[grids.places]\n", f"{extra}{places}"
    data = made(tmp_path, [{7000: 1}], [{900: 1}], change=change)
    table = data.tables["rungs"]
    assert table["net"].tolist() == ["none", "none", "DQN", "PPO", "none", ""]
    for axis in axes_of("ladder", data)[:3]:
        assert [float(*dot.get_ydata()) for dot in dots_of(axis)] == [900, 7000, 7000]


def test_figures_by_hand(tmp_path: Path) -> None:
    data = made(tmp_path, [{7000: 1}], [NEVER], unseen=(0.75, 0.5))
    axes = axes_of("ladder", data)
    for axis, expected in ((axes[2], [1.6 * BUDGET, 7000, 7000]), (axes[5], [0.5, 0.75, 0.75])):
        dots = dots_of(axis)
        assert [float(*dot.get_ydata()) for dot in dots if dot.get_mfc() != "white"] == expected
        hollow = [float(*dot.get_xdata()) for dot in dots if dot.get_mfc() == "white"]
        assert hollow == ([-0.13] if axis is axes[2] else [])
    top, _ = axes_of("along", data)
    assert [label.get_text() for label in top.get_xticklabels()] == ["4", "16"]
    lines = [line.get_ydata().tolist() for line in top.lines if len(line.get_ydata()) == 2]
    assert lines == [[7000, 7000], *[[1.6 * BUDGET] * 2] * 2]  # the last is hollow


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("solved = ", "# ", "[solved] is missing"),
        (f"seeds = {N}", f"seeds = {N}, first_seed = 7", "accepted: two learners in one grid"),
        ('["Anywhere"]', '["Anywhere", "AnywhereHidden"]', "scenarios: 2: accepted: exactly one"),
        (
            '"offset"]',
            '"offset"]\nsettings = { budget = 900, record_every = 900 }',
            "first seed and budget",
        ),
        ('grid = "places"', 'grid = "rooms"', "unknown grid with one axis rooms"),
        ('grids = ["places"', 'grids = ["rooms"', "unknown grid with one axis rooms"),
        (f'"{TABLE}"] }}', '"net, index"] }', "unknown learner net, index"),
        (f'tiles = "{SHARED}"', 'tiles = "net, index"', "unknown learner net, index"),
        (f'["{SHARED}", "{TABLE}"]]', f'["{SHARED}", "net, index"]]', "unknown learner net, index"),
        (f'["{SHARED}", "{TABLE}"]]', f'["{TABLE}", "{TABLE}"]]', "is named twice"),
    ],
)
def test_mistakes_are_named(old: str, new: str, message: str, tmp_path: Path) -> None:
    assert old in EXPERIMENT
    experiment = loaded(tmp_path / "mine.toml", EXPERIMENT.replace(old, new, 1))
    report = experiment.declared.report or {}
    with pytest.raises(InputError, match=re.escape(message)) as refused:
        maps.check(experiment, parse(maps.Declared, report, "mine"))
    assert len(refused.value.args) == 1
