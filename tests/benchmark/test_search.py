"""The search: what it picks and runs again, its tables by hand, and what its text claims."""

from collections.abc import Sequence
from itertools import combinations, permutations, product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark import search
from benchmark.__main__ import main
from benchmark.experiment import Experiment, load_experiment
from benchmark.study import Data, Report
from benchmark.tables import read
from benchmark.trials import read_chosen
from envs import InputError
from tests.benchmark.populations import with_tables
from tests.support import made

TEXT = """
description = "A search in miniature: the numbers mean nothing."
scenarios = ["FarCorner", "SixPlaces"]
horizon = 200
evaluation_every = 100
settings = { budget = 400, time_limit = 200 }
report = { kind = "search" }
search = { trials = 2, first_seed = 10, finalists = 2, seeds = 3 }
solved = { success = 0.5, growth = 2.0, given_up_after = 0.5 }

[algorithms.q_learning]
algorithm = "q_learning"
observations = ["index", "offset"]
seeds = 2
candidates = [{ learning_rate = 0.6, discount = 0.9 }]

[algorithms.q_learning.search]
learning_rate = { low = 0.03, high = 1.0, scale = "log" }
discount = { values = [0.9, 0.99] }
"""
USER = """
description = "Takes what was chosen."
scenarios = ["S1"]
horizon = 200
evaluation_every = 100
settings = { budget = 400, time_limit = 200 }

[algorithms.tuned]
tuned_by = "mine:q_learning"
algorithm = "q_learning"
observations = ["offset"]
seeds = 2
first_seed = 50
"""
SIZE = "finalists = 2, seeds = 3"
LEARNERS = ("q_learning, index", "q_learning, offset")
STEPS = [0, 100, 200, 400]
# Means by trial and scenario: trial 1 is lucky, trial 3 the best in the second scenario.
FIRST = [[0.1, 0.1], [0.9, 0.3], [0.5, 0.5], [0.2, 0.8]]
FRESH = [[0.1, 0.1], [0.3, 0.3], [0.4, 0.6], [0.2, 0.7]]
BEST = [[0.0] * 2, [1.0] * 2, [0.0] * 2, [0.0] * 2]
Means = Sequence[Sequence[float]]


def experiment_of(path: Path, changes: str = SIZE, *others: tuple[str, str]) -> Experiment:
    """Loads the miniature, perhaps with other values of `[search]` and other texts."""
    text = TEXT.replace(SIZE, changes)
    for old, new in others:
        assert old in text
        text = text.replace(old, new)
    return made(path / "mine.toml", text)


def data_of(experiment: Experiment, first: Means, fresh: Means) -> Data:
    """Returns runs of both learners, which learn at once, with success by trial and scenario."""
    declared, rows = experiment.declared.search, []
    assert declared is not None
    for each in experiment.populations:
        at = int(each.keys["trial"]), [*experiment.scenarios].index(each.scenario.name)
        for means, seeds in ((first, each.seeds), (fresh, declared.fresh)):
            rows += [{**each.keys, "seed": seed, "success": means[at[0]][at[1]]} for seed in seeds]
    runs = pd.DataFrame(rows).assign(budget=400, cpu_time_s=0.5)
    curves = runs.loc[runs.index.repeat(len(STEPS))].assign(step=STEPS * len(runs))
    curves["success"] *= np.sign(curves["step"])  # 0 before training
    return Data(experiment, Report(kind="search"), runs, curves)


def drawn(data: Data) -> Data:
    """Returns data with its tables."""
    return with_tables(data, search.TABLES)


# What is picked


@pytest.mark.parametrize(
    ("declared", "picked"),  # fresh: 0.3 and 0.5, against trial 0
    [([0.1, 0.1], 2), ([0.6, 0.5], 0), ([0.4, 0.6], 0), ([0.5, 0.496], 0), ([0.5, 0.48], 2)],
)
def test_the_winner_of_a_lottery_does_not_win(
    declared: list[float], picked: int, tmp_path: Path
) -> None:
    """Nor does a trial whose mean differs by less than is rounded."""
    data = data_of(experiment_of(tmp_path), FIRST, [declared, *FRESH[1:]])
    for outcome in search.found(data):
        # Trials 2 and 3 have means of 0.5.
        assert (outcome.finalists, outcome.picked) == ([1, 2], picked)


def test_runs_that_are_missing_are_not_made_up(tmp_path: Path) -> None:
    data = data_of(experiment_of(tmp_path), FIRST, FRESH)
    is_gone = (data.curves["trial"] == 2) & (data.curves["seed"] == 12)
    with pytest.raises(InputError, match="lack fresh runs of finalists of q_learning, index"):
        [*search.outcomes(data.experiment, data.curves[~is_gone])]


# Measures


def test_area_is_success_averaged_over_the_logarithm_of_steps(tmp_path: Path) -> None:
    """From 100 to 200 steps is as much as from 200 to 400."""
    names = {"trial": 0, "scenario": "FarCorner", "seed": [0, 0, 0, 0, 1, 1, 1, 1]}
    curves = {"learner": LEARNERS[0], "step": STEPS * 2, "success": [0.9, 0, 1, 0, 0, 0, 0, 1]}
    experiment = experiment_of(tmp_path)
    found = search.measured(experiment, pd.DataFrame(names | curves))
    assert found["area"].tolist() == pytest.approx([(0.5 + 0.5) / 2, 0.5 / 2])
    assert found["steps"].tolist() == [np.inf] * 2  # what is reached by the last one does not count
    # Of another learner, with other evaluations: 1 for 3 of 4 doublings, and a half for the last
    other = {"learner": LEARNERS[1], "step": [0, 50, 400, 800], "success": [0, 1, 1, 0]}
    both = pd.concat([pd.DataFrame(names | curves), pd.DataFrame({**names, "seed": 0} | other)])
    found = search.measured(experiment, both)
    assert found["area"].tolist() == pytest.approx([0.5, 0.25, (3 + 0.5) / 4])


# Tables


def test_chosen_settings_by_hand(tmp_path: Path) -> None:
    first, fresh = np.zeros((4, 2)), np.zeros((4, 2))
    first[3], fresh[3, 0] = 1.0, 1.0
    data = drawn(data_of(experiment_of(tmp_path), first.tolist(), fresh.tolist()))
    row = data.tables["chosen"].iloc[0]
    assert (row["trial"], row["default"], row["chosen"], row["gain"]) == (3, 0, 0.5, 0.5)
    # Four trials with 2 runs and with 3, in 2 scenarios
    assert row[["trials", "runs", "steps"]].tolist() == [3, 40, 40 * 400]
    trials = data.tables["trials"][:4].drop(columns=["learner", "settings"])
    assert trials.to_dict("list") == {
        "trial": [0, 1, 2, 3],
        "kind": ["default", "drawn", "drawn", "candidate"],
        "area": [0, 0, 0, 1],
        "median_steps": [np.inf] * 3 + [100],
        "is_finalist": [True, False, False, True],
        "fresh_area": [0, 0, 0, 0.5],
        "n_fresh": [6] * 4,
        "is_chosen": [False] * 3 + [True],
    }
    settings = data.tables["trials"]["settings"]
    assert [settings[0], settings[3]] == ["{}", '{"learning_rate": 0.6, "discount": 0.9}']


def test_p_of_gain_is_that_of_all_permutations() -> None:
    """Of 6 x 6 choices of two of four runs in each of two scenarios."""
    for chosen, default in (([[3, 4], [0, 9]], [[1, 2], [5, 5]]), ([[1, 1]] * 2, [[0, 0]] * 2)):
        both = np.concatenate([chosen, default], axis=1)
        sums = [
            both[0, [*first]].sum() + both[1, [*second]].sum()
            for first, second in product(combinations(range(4), 2), repeat=2)
        ]
        exact = np.mean(np.array(sums) >= np.sum(chosen))
        found = search.p_of_gain(np.array(chosen), np.array(default))
        assert found == pytest.approx(exact, abs=0.01)


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
    first = [[0.0, 0.9], [0.9, 0.0], [0.0, 0.9], [0.9, 0.0]]
    row = drawn(data_of(experiment_of(tmp_path), first, FRESH)).tables["effort"].iloc[0]
    # Without the candidate, two of four others learn in each scenario. Trial 0 learns in the second
    # only.
    of_others = 400 * 2 / 3 + 100
    assert row[["default", "learned", "tried"]].tolist() == [np.inf, 4, 8]
    assert row["total"] == pytest.approx((400 + of_others + 100) / 2)
    assert row["drawn"] == pytest.approx(of_others)


# Text


def headline(path: Path, first: Means, fresh: Means, rise: float = 1.0) -> str:
    """Returns the headline of a search with 50 fresh seeds, in which both learners are alike."""
    data = data_of(experiment_of(path, "finalists = 2, seeds = 50"), first, fresh)
    data.curves.loc[data.curves["step"] == 0, "success"] = data.runs["success"] * (1 - rise)
    return " ".join(search.headline(drawn(data)).split())


def test_a_gain_is_claimed_with_its_size_and_effort(tmp_path: Path) -> None:
    text = headline(tmp_path, BEST, BEST)
    assert "among 3 trials besides the declared ones are shown to raise success" in text
    assert "for 2 of 2 learners, by 1.00 to 1.00 (50 fresh runs in each scenario)" in text
    # Trial 0 fails, two of four others learn at step 100: 2/3 of a failure.
    assert "- FarCorner and SixPlaces: q_learning (767)" in text


@pytest.mark.parametrize(
    ("default", "chosen", "rise"),
    [
        (0.5, 0.5, 1.0),  # alike
        (0.4, 0.449, 1.0),  # too small a gain
        (0.0, 1.0, 0.0),  # as good untrained
    ],
)
def test_no_gain_is_claimed_that_is_not_shown(
    default: float, chosen: float, rise: float, tmp_path: Path
) -> None:
    text = headline(tmp_path, BEST, [[default] * 2, [chosen] * 2, *BEST[2:]], rise)
    assert "are shown to raise" in text
    assert "for none of 2 learners (" in text


def test_a_gain_of_two_of_three_runs_is_not_shown(tmp_path: Path) -> None:
    data = data_of(experiment_of(tmp_path), BEST, BEST)
    data.curves.loc[data.curves["seed"] == 12, "success"] = 0.0
    table = drawn(data).tables["chosen"]
    assert table["gain"].tolist() == pytest.approx([2 / 3] * 2)
    assert {*table["verdict"]} == {"no gain shown"}


def test_of_runs_that_are_given_up_nothing_is_claimed(tmp_path: Path) -> None:
    never = [[0.0] * 2] * 4
    assert "SixPlaces: none, since none learns everywhere" in headline(tmp_path, never, never)
    text = search.reading(data_of(experiment_of(tmp_path), never, never)).replace("\n", " ")
    assert "not reached 0.25 by 50 % of the budget is given up" in text
    assert "even if it would learn late" in text


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("solved = {", "#", r"\[solved\] is missing; this report needs both"),
        ("budget = 400", "budget = 100", "budget = 100: accepted: more than evaluation_every"),
    ],
)
def test_what_cannot_be_measured_is_refused(
    tmp_path: Path, old: str, new: str, expected: str
) -> None:
    experiment = experiment_of(tmp_path, SIZE, (old, new))
    with pytest.raises(InputError, match=rf"mine\.toml: .*{expected}"):
        search.check(experiment, Report(kind="search"))


# From runs


def test_a_search_is_run_and_its_choice_used(tmp_path: Path) -> None:
    """Both stages are trained once; what is chosen follows from the published runs alone."""
    experiment, folder = experiment_of(tmp_path), tmp_path / "mine"
    command = [str(experiment.path), "--results", str(tmp_path)]
    assert main(["run", *command, "--jobs", "1", "--report"]) == 0
    runs, curves = read(folder)
    assert {*runs["seed"]} == {0, 1, 10, 11, 12}
    chosen = read_chosen(experiment.path).learners
    table = pd.read_csv(folder / "chosen.csv").set_index("learner")
    keys = ["learner", "trial", "step"]
    means = curves[curves["seed"] >= 10].groupby(keys)["success"].mean()
    for name in LEARNERS:
        success = means[name, chosen[name].trial]
        # By hand: evaluations are a doubling apart, and the first and the last count half.
        area = (success[100] / 2 + success[200] + success[400] / 2) / 2
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
