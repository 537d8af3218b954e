"""The search: what it picks and runs again, its tables by hand, and what its text claims."""

from collections.abc import Sequence
from itertools import permutations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from benchmark import search
from benchmark.__main__ import main
from benchmark.experiment import Experiment, load_experiment
from benchmark.study import Data
from benchmark.tables import read
from benchmark.trials import read_chosen
from envs import InputError

TEXT = """
description = "A search in miniature: the numbers mean nothing."
scenarios = ["FarCorner", "SixPlaces"]
horizon = 200
evaluation_every = 100
map_every = 400
settings = { budget = 400, time_limit = 200 }
report = { kind = "search" }
search = { trials = 3, first_seed = 10, finalists = 2, seeds = 3 }

[algorithms.q_learning]
algorithm = "q_learning"
observations = ["index", "offset"]
seeds = 2
settings = { record_every = 400 }

[algorithms.q_learning.search]
learning_rate = { low = 0.03, high = 1.0, scale = "log" }
discount = { values = [0.9, 0.99] }
"""
USER = """
description = "Takes what was chosen."
scenarios = ["S1"]
horizon = 200
evaluation_every = 100
map_every = 100
settings = { budget = 400, time_limit = 200 }

[algorithms.tuned]
tuned_by = "mine:q_learning"
algorithm = "q_learning"
observations = ["offset"]
seeds = 2
first_seed = 50
"""
MAPPED = "map_every = 400\n"
SOLVED = "solved = { success = 0.5, growth = 2.0, given_up_after = 0.5 }\n"
SIZE = "finalists = 2, seeds = 3"
LEARNERS = ("q_learning, index", "q_learning, offset")
# Means by trial and scenario: trial 1 is lucky, trial 3 the best in the second scenario.
FIRST = [[0.1, 0.1], [0.9, 0.3], [0.5, 0.5], [0.2, 0.8]]
FRESH = [[0.1, 0.1], [0.3, 0.3], [0.4, 0.6], [0.2, 0.7]]
Means = Sequence[Sequence[float]]


def experiment_of(path: Path, changes: str = "", solved: str = "") -> Experiment:
    """Loads the miniature, perhaps with other values of `[search]` and further keys."""
    text = TEXT.replace(SIZE, changes or SIZE).replace(MAPPED, solved or MAPPED)
    (path / "mine.toml").write_text(text, encoding="utf-8")
    return load_experiment(path / "mine.toml")


def data_of(experiment: Experiment, first: Means, fresh: Means, random: float = 0.0) -> Data:
    """Returns runs of both learners, which learn at once, with success by trial and scenario."""
    declared, rows = experiment.declared.search, []
    assert declared is not None
    for each in experiment.populations:
        at = int(each.keys["trial"]), [*experiment.scenarios].index(each.scenario.name)
        for means, seeds in ((first, each.seeds), (fresh, declared.fresh)):
            rows += [{**each.keys, "seed": seed, "success": means[at[0]][at[1]]} for seed in seeds]
    runs = pd.DataFrame(rows).assign(budget=400, cpu_time_s=0.5)
    curves = runs.loc[runs.index.repeat(5)].assign(step=[0, 100, 200, 300, 400] * len(runs))
    curves["success"] *= [0, 1.5, 1, 1, 1] * len(runs)  # with the means as areas
    if experiment.declared.solved is None:
        runs["random_success"] = random
    return Data(experiment, search.Declared(kind="search"), runs, curves)


def drawn(data: Data) -> Data:
    """Returns data with its tables."""
    for name, function in search.TABLES.items():
        if (table := function(data)) is not None:
            data.tables[name] = table
    return data


# What is picked


@pytest.mark.parametrize(
    ("declared", "n_parts", "finalists", "picks"),  # fresh: 0.3, 0.5 and 0.45, against trial 0
    [
        ([0.1, 0.1], 1, [[1, 2]], [2]),
        ([0.6, 0.5], 1, [[1, 2]], [0]),
        ([0.4, 0.6], 1, [[1, 2]], [0]),  # as good as trial 2
        ([0.1, 0.1], 2, [[1], [2]], [1, 2]),
        ([0.6, 0.5], 2, [[1], [2]], [0, 2]),  # in the first part alone, trial 0 is a candidate
    ],
)
def test_the_winner_of_a_lottery_does_not_win(
    declared: list[float], n_parts: int, finalists: Any, picks: list[int], tmp_path: Path
) -> None:
    changes = f"finalists = {len(finalists[0])}, parts = {n_parts}, seeds = 3"
    experiment = experiment_of(tmp_path, changes)
    data = data_of(experiment, FIRST, [declared, *FRESH[1:]])
    for outcome in search.found(data):
        # Trials 2 and 3 have means of 0.5.
        assert (outcome.finalists, outcome.picks) == (finalists, picks)


def test_the_order_of_a_sum_decides_nothing() -> None:
    third = pd.Series({2: 0.1 + 0.2 + 0.3, 1: 0.3 + 0.2 + 0.1, 0: 0.5})
    assert third[2] > third[1]
    assert search.ranked(third) == [1, 2, 0]


# Measures


def test_area_is_success_averaged_over_training(tmp_path: Path) -> None:
    experiment = experiment_of(tmp_path)
    curve = {"trial": 0, "scenario": "FarCorner", "learner": LEARNERS[0], "seed": 0}
    curves = pd.DataFrame({**curve, "step": [0, 100, 400], "success": [0.0, 1.0, 0.0]})
    # Triangles of 100 and of 300 steps
    assert search.measured(experiment, curves)["measure"].tolist() == [0.5]


def test_earliness_follows_the_rule_step_by_step(tmp_path: Path) -> None:
    """Of random curves, against the definition."""
    experiment, rng = experiment_of(tmp_path, solved=SOLVED), np.random.default_rng(1)
    steps = [0, 100, 200, 300, 400]
    success = (rng.random((200, 5)) < 0.7).astype(float)
    names = {"trial": 0, "scenario": "FarCorner", "learner": LEARNERS[0]}
    curves = pd.DataFrame(
        {**names, "seed": seed, "step": step, "success": value}
        for seed, curve in enumerate(success)
        for step, value in zip(steps, curve, strict=True)
    )
    found = search.measured(experiment, curves)
    for curve, row in zip(success, found.itertuples(), strict=True):
        # For each evaluation, until when success has to stay: twice as many steps, or the end.
        until = [
            next((j for j in range(i + 1, 5) if steps[j] >= 2 * steps[i]), 4) for i in range(5)
        ]
        stays = [steps[i] for i, j in enumerate(until) if min(curve[i : j + 1]) >= 0.5]
        first = max(stays[0], 100) if stays else 400
        assert row.measure == pytest.approx(1 - np.log(first / 100) / np.log(4))
        assert row.steps == (first if first < 400 else np.inf)


# Tables


def test_chosen_settings_by_hand(tmp_path: Path) -> None:
    first, fresh = np.zeros((4, 2)), np.zeros((4, 2))
    first[1], fresh[1, 0] = 1.0, 1.0
    data = drawn(data_of(experiment_of(tmp_path), first.tolist(), fresh.tolist()))
    row = data.tables["chosen"].iloc[0]
    assert (row["trial"], row["default"], row["chosen"], row["gain"]) == (1, 0, 0.5, 0.5)
    # Three of three: at least 0.025 ** (1 / 3); none of three: at most 1 - that. Halves of both.
    reach = (1 - 0.025 ** (1 / 3)) / 2
    assert row["chosen_low"] == pytest.approx(0.5 - reach)
    assert row["chosen_high"] == pytest.approx(0.5 + reach)
    # Of the gain, three of the four means can be less favourable, and two more.
    assert row["gain_low"] == pytest.approx(0.5 - np.sqrt(3) * reach)
    assert row["settings"].startswith("learning_rate ")
    trials = data.tables["trials"]
    assert trials["area"].tolist() == [0, 1, 0, 0] * 2
    assert trials["FarCorner"].tolist() == [0, 1, 0, 0] * 2
    # Four trials with 2 runs and two finalists with 3, in 2 scenarios
    cost = data.tables["cost"].iloc[0]
    assert cost[["trials", "runs", "steps", "cpu_ms"]].tolist() == [3, 28, 28 * 400, 500]
    assert "effort" not in data.tables


def test_the_declared_settings_gain_nothing_on_themselves(tmp_path: Path) -> None:
    data = drawn(data_of(experiment_of(tmp_path), FIRST, [[1, 1], *FRESH[1:]]))
    row = data.tables["chosen"].iloc[0]
    assert row[["trial", "gain", "gain_low", "gain_high", "p"]].tolist() == [0, 0, 0, 0, 1]


def test_expected_steps_are_means_over_all_orders() -> None:
    """Every order of runs in turn, until one has learned; each failure costs the budget, 1,000."""
    for steps in ([300.0, 500.0, np.inf, np.inf, np.inf], [np.inf, 40.0], [7.0]):
        sums = []
        for order in permutations(steps):
            n_failed = [*map(np.isfinite, order)].index(True)
            sums.append(1000 * n_failed + order[n_failed])
        assert search.expected_drawn(np.array(steps), 1000) == pytest.approx(np.mean(sums))
    assert search.expected_drawn(np.array([np.inf]), 1000) == np.inf


def test_effort_by_hand(tmp_path: Path) -> None:
    """Success is constant, so a run learns by step 100 of 400, or never."""
    first = [[0.0, 0.9], [0.9, 0.0], [0.0, 0.0], [0.9, 0.0]]
    data = drawn(data_of(experiment_of(tmp_path, solved=SOLVED), first, FRESH))
    table = data.tables["effort"]
    rows = table[table["learner"] == LEARNERS[0]].drop(columns="learner").to_numpy().tolist()
    # In the first, of six others four learn: two fifths of a failure precede the first.
    drawn_in_first = 400 * 2 / 5 + 100
    assert rows == [
        ["all", np.inf, 4, 12, (400 + drawn_in_first + 100) / 2, np.inf],
        ["FarCorner", np.inf, 4, 6, 400 + drawn_in_first, drawn_in_first],
        ["SixPlaces", 100, 0, 6, 100, np.inf],
    ]


# Text


def headline(path: Path, first: Means, fresh: Means, random: float = 0.0, solved: str = "") -> str:
    """Returns the headline of a search with 200 fresh seeds, in which both learners are alike."""
    experiment = experiment_of(path, "finalists = 2, seeds = 200", solved)
    return " ".join(search.headline(drawn(data_of(experiment, first, fresh, random))).split())


BEST = [[0.0] * 2, [1.0] * 2, [0.0] * 2, [0.0] * 2]


def test_a_gain_is_claimed_with_learners_budget_seeds_and_margin(tmp_path: Path) -> None:
    text = headline(tmp_path, BEST, BEST)
    assert "3 trials are shown to raise mean success over training (400 steps; mean over" in text
    assert "FarCorner and SixPlaces, 200 fresh seeds in each)" in text
    assert "for q_learning (0 to 1) and q_learning of offsets (0 to 1)." in text
    assert "best" not in text
    assert "estimated at 0.05 or more" in text


@pytest.mark.parametrize(
    ("default", "chosen", "random"),
    [
        (0.5, 0.5, 0.0),  # alike
        (0.4, 0.449, 0.0),  # too small a gain
        (0.0, 0.2, 0.3),  # less than the random policy, so nothing has been learned
        (0.48, 0.56, 0.0),  # a gain that might be luck
    ],
)
def test_no_gain_is_claimed_that_is_not_shown(
    default: float, chosen: float, random: float, tmp_path: Path
) -> None:
    fresh = [[default] * 2, [chosen] * 2, [0.0] * 2, [0.0] * 2]
    text = headline(tmp_path, BEST, fresh, random)
    assert "are not shown to raise" in text
    assert "for any learner." in text


def test_a_learner_that_is_good_untrained_has_not_gained(tmp_path: Path) -> None:
    data = data_of(experiment_of(tmp_path, "finalists = 2, seeds = 200"), BEST, BEST)
    data.curves["success"] = data.runs["success"].repeat(5).to_numpy()  # also before training
    assert "are not shown to raise" in search.headline(drawn(data))


def test_of_runs_that_are_given_up_nothing_is_claimed(tmp_path: Path) -> None:
    text = headline(tmp_path, [[0.0] * 2] * 4, [[0.0] * 2] * 4, solved=SOLVED)
    assert "no run of any learner has learned before the end of its 400 steps (mean over" in text
    assert "not reached 0.25 by 50 % of the budget is given up" in text
    assert "even if it would learn late" in text


def test_a_search_needs_its_table() -> None:
    other: Any = SimpleNamespace(declared=SimpleNamespace(search=None), argument="mine")
    with pytest.raises(InputError, match=r"mine: it has no table \[search\]"):
        search.check(other, search.Declared(kind="search"))


# From runs


def test_a_search_is_run_and_its_choice_used(tmp_path: Path) -> None:
    """Both stages are trained once; what is chosen follows from the published runs alone."""
    experiment, folder = experiment_of(tmp_path), tmp_path / "mine"
    command = [str(experiment.path), "--results", str(tmp_path)]
    assert main(["run", *command, "--jobs", "1", "--report"]) == 0
    runs, curves = read(folder)
    assert {*runs["seed"]} == {0, 1, 10, 11, 12}
    chosen = read_chosen(experiment.path, "here").learners
    table = pd.read_csv(folder / "chosen.csv").set_index("learner")
    keys = ["learner", "trial", "step"]
    means = curves[curves["seed"] >= 10].groupby(keys)["success"].mean()
    for name in LEARNERS:
        success = means[name, chosen[name].trial]
        # By hand: the mean of evaluations, of which the first and the last count half.
        area = (success[0] / 2 + success[100] + success[200] + success[300] + success[400] / 2) / 4
        assert chosen[name].score == pytest.approx(area, abs=1e-6)
        assert table["chosen"][name] == pytest.approx(area, abs=1e-6)
    file = tmp_path / "mine.chosen.json"
    written = file.read_bytes()
    (tmp_path / "runs.db").unlink()
    file.unlink()
    assert main(["report", *command]) == 0
    assert file.read_bytes() == written
    user = tmp_path / "user.toml"
    user.write_text(USER.replace("mine:", f"{experiment.path}:"), encoding="utf-8")
    (population,) = load_experiment(user).populations
    settings = chosen["q_learning, offset"].settings
    assert population.first.settings.model_dump().items() >= settings.items()
    assert main(["report", *command, "--seeds", "0-3"]) == 2
