"""The report of a search: what is picked of b trials, and what is published."""

import json
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from benchmark.__main__ import main
from benchmark.analysis.intervals import mean_over_scenarios
from benchmark.analysis.search import picked, references
from benchmark.drawing.tables import plain, write_csv
from benchmark.experiments import load_experiment
from benchmark.experiments.search import read_chosen, trials
from benchmark.folder import Folder, write_manifest
from benchmark.studies.search import REPORT
from benchmark.studies.search.results import at_edges, gain
from tests.support import ROOT, make, mistyped_columns

PUBLISHED = ROOT / "results" / "tuning"
TUNING = load_experiment("tuning")


def test_picks_are_those_of_all_draws() -> None:
    """Draws every pair of sets of b trials. References are the best, but no nets, that observe the same."""
    rng = np.random.default_rng(1)
    names = ["ppo, coordinates", "tiles, index", "table, index", "table, offset", "dqn, centre"]
    trials = pd.DataFrame(
        [name.split(", ") for name in np.repeat(names, 4)], columns=["variant", "observation"]
    )
    trials["trial"], trials["area"] = np.tile(range(4), 5), rng.integers(6, size=20) / 5  # with ties
    trials["fresh_area"] = np.repeat([0.9, 0.8, 0.7, 0.6, 0.9], 4)
    trials["A"], trials["B"] = rng.random((2, 20))
    against = references(trials, {"ppo": "deep", "dqn": "deep", "tiles": "linear", "table": "tabular"})
    assert [*against.items()] == [*zip(names, [names[1]] * 3 + [names[3]] * 2, strict=True)]
    rows = pd.DataFrame(picked(trials, against)).set_index(["variant", "scenario", "trials"])
    drawn = [trials[trials["variant"].eq(name) & trials["trial"].gt(0)] for name in ("ppo", "tiles")]
    for b, (scenario, column) in product((1, 2, 3), {"all": "area", "A": "A", "B": "B"}.items()):
        draws = [[side.loc[[*draw]] for draw in combinations(side.index, b)] for side in drawn]
        x, y = ([draw.nlargest(1, "area")[column].item() for draw in side] for side in draws)
        beats = np.mean([(np.sign(i - j) + 1) / 2 for i, j in product(x, y)])
        row = rows.loc["ppo"].loc[scenario].loc[b]
        assert (row["beats"], row["expected"]) == pytest.approx((beats, np.mean(x)))
    assert rows.loc["tiles"]["beats"].isna().all()


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([(1, 0.2, 0.5, 0.1), (0, 0.1, 0.1, 0.0)], "goes from 0.2 to 0.5 for the best learner, a, index"),
        ([(1, 0.4, 0.5, -0.2)], "no gain is shown for a, index: success averaged over training is 0.5"),
        ([(0, 0.5, 0.5, 0.0), (1, 0.2, 0.3, 0.1)], "For the best learner, a, index, the settings as"),
        ([(0, 0.0, 0.0, 0.0)] * 2, "No learner has learned in the search"),
        ([(0, 1.0, 1.0, 0.0)] * 2, "For a, index, the settings as declared stay the best"),
    ],
)
def test_headlines_claim_no_gain_that_is_not_shown(rows: Any, expected: str, tmp_path: Path) -> None:
    rows = [(*row, name, "index") for row, name in zip(rows, "ab", strict=False)]
    columns = ["trial", "default", "chosen", "gain_low", "variant", "observation"]
    write_csv(pd.DataFrame(rows, columns=columns), tmp_path / "chosen.csv")
    manifest = {"report": {"kind": "search"}, "scenarios": {}, "search": {"trials": 2}, "solved": None}
    write_manifest(tmp_path, manifest)
    assert expected in plain(REPORT.headline(Folder(tmp_path)) or "")


def test_means_are_over_scenarios() -> None:
    x, y = [np.ones(10), np.zeros(20)], [np.zeros(10), np.zeros(20)]
    mean = mean_over_scenarios(x)
    assert mean.value == gain(x, y).value == 0.5
    assert mean.low < 0.5 < mean.high
    assert gain(x, y).low > 0
    assert gain(x, x) == (0, 0, 0)  # the same runs
    assert gain(y, [np.zeros(10), np.zeros(20)]).low < 0  # others that fail, too


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `make tune` publishes of a miniature."""
    results = tmp_path_factory.mktemp("results")
    done = make("tune", "EXPERIMENT=tuning_smoke", f"RESULTS={results}")
    assert done.returncode == 0, done.stderr
    assert "72 runs done" in done.stdout
    assert "the chosen settings are in" in done.stdout
    assert "dqn, coordinates" in (results / "tuning_smoke" / "README.md").read_text(encoding="utf-8")
    return results / "tuning_smoke"


def test_a_policy_that_training_does_not_return_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, policy = tmp_path / "mine.toml", '"algorithms.q_learning.policy" = "stochastic"'
    path.write_text(f'extends = "tuning_smoke"\ndescription = "-"\n[changes]\n{policy}\n')
    assert main(["run", str(path), "--results", str(tmp_path / "results"), "--report"]) == 2
    assert "policy = stochastic: its training returns no such policy" in capsys.readouterr().err


def test_everything_of_a_search_is_published(folder: Path, tmp_path: Path) -> None:
    tables = {path.stem: pd.read_csv(path) for path in folder.glob("*.csv")}
    assert {name: len(table) for name, table in tables.items()} == {
        "chosen": 3, "picks": 27, "cost": 3, "trials": 12, "around": 18, "spaces": 5,
    }  # fmt: skip
    assert sorted(path.stem for path in folder.glob("*.svg")) == ["picks", "scenes", "trials"]
    assert [path.name for path in folder.glob("*.csv") if mistyped_columns(path)] == []
    again, families = tmp_path / "picks.csv", {"dqn": "deep", "q_learning": "tabular"}
    write_csv(pd.DataFrame(picked(tables["trials"], references(tables["trials"], families))), again)
    assert again.read_bytes() == (folder / "picks.csv").read_bytes()
    chosen = tables["chosen"].iloc[0]
    rows = tables["trials"]
    row = rows[(rows["observation"] == "index") & (rows["trial"] == chosen["trial"])].iloc[0]
    assert row["fresh_area"] == pytest.approx(chosen["chosen"], abs=1e-5)
    assert row["settings"] == chosen["settings"]
    settings = dict(part.split(" ") for part in chosen["settings"].split(", "))
    is_edge = not 0.03 * (1 / 0.03) ** 0.1 < float(settings["learning_rate"]) < 0.03**0.1
    assert ("learning_rate" in str(chosen.get("edges", ""))) == is_edge


def test_settings_at_edges_are_named() -> None:
    space = TUNING.learners["dqn, one_hot"].declared.search
    settings = {
        "learning_rate": 0.0095, "gamma": 0.8, "exploration_fraction": 0.5, "target_update_interval": 10_000,
        "train_freq": 4, "policy_kwargs.net_arch": [64, 64],
    }  # fmt: skip
    assert at_edges(space, settings) == ["learning_rate", "gamma", "target_update_interval"]
    assert at_edges(space, dict.fromkeys(space)) == []


def test_a_search_by_earliness_is_published(tmp_path: Path) -> None:
    """The tables have its column, the text says what it is, and nothing is around what is chosen."""
    path = tmp_path / "early.toml"
    path.write_text(
        'extends = "tuning_smoke"\ndescription = "-"\n[changes]\nsolved = { success = 0.05, growth = 1.5 }\n'
        '"search.around" = false\n"settings.budget" = 800\n'
    )
    assert main(["run", str(path), "--results", str(tmp_path / "results"), "--report"]) == 0
    folder = tmp_path / "results" / "early"
    assert not [*folder.glob("around.*")]
    trials = pd.read_csv(folder / "trials.csv")
    assert {"earliness", "fresh_earliness"} < {*trials}
    assert not {"area", "fresh_area"} & {*trials}
    chosen, text = pd.read_csv(folder / "chosen.csv"), (folder / "README.md").read_text(encoding="utf-8")
    assert chosen["chosen"].max() > 0.1
    assert trials["fresh_earliness"].max() == pytest.approx(chosen["chosen"].max(), abs=1e-5)
    assert "stays at or above 0.05 from then until step 2*s* or the end" in " ".join(text.split())
    assert "Which settings matter" not in text
    assert "area" not in text
    made = read_chosen(path, "here").learners
    assert all(found.score >= found.others[0].score for found in made.values())


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("looks", '"report.looks" = [2]'),
        ("panels", '"report.panels" = [{ title = "-", learners = ["dqn, coordinates"] }]'),
        ("solved.levels", "solved = { levels = [0.5] }"),
    ],
)
def test_keys_of_maps_are_refused_in_a_search(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], key: str, change: str
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'extends = "tuning_smoke"\ndescription = "-"\nchanges = {{ {change} }}\n')
    assert main(["run", str(path), "--results", str(tmp_path / "results"), "--report"]) == 2
    assert f"{key} with report.kind = search: accepted: kind = map" in capsys.readouterr().err


def test_published_trials_are_the_declared_ones() -> None:
    published = pd.read_csv(PUBLISHED / "trials.csv")
    for learner in TUNING.learners.values():
        is_own = published["variant"] == learner.variant
        rows = published[is_own & (published["observation"] == learner.observation)]
        drawn = trials(learner.variant, learner.declared.search, 48)
        assert len(rows) == len(drawn) == 49
        for settings, changes in zip(rows["settings"][1:], drawn[1:], strict=True):
            for key, value in changes.items():
                assert f"{key.split('.')[-1]} {json.dumps(value)}, " in f"{settings}, "


def test_experiments_take_what_is_published() -> None:
    """The file that experiments read says what the published table says."""
    published = pd.read_csv(PUBLISHED / "chosen.csv")
    chosen = read_chosen(ROOT / "benchmark" / "experiments" / "tuning.toml", "here").learners
    assert [*chosen] == [*(published["variant"] + ", " + published["observation"])]
    assert [found.trial for found in chosen.values()] == published["trial"].tolist()
    scores = [found.score for found in chosen.values()]
    assert scores == pytest.approx(published["chosen"], abs=1e-5)


@pytest.mark.parametrize("name", ["compare_deep", "beyond"])
def test_baselines_are_the_best_tables_and_tile_coding_of_the_search(name: str) -> None:
    experiment = load_experiment(name)
    best: dict[tuple[str, str], tuple[float, str]] = {}
    for learner in experiment.learners.values():
        if learner.chosen is not None and learner.family != "deep" and not learner.reference_for:
            key = learner.family, learner.declared.policy
            best[key] = max(best.get(key, (0.0, "")), (learner.chosen.score, learner.name))
    assert experiment.report is not None
    assert {*experiment.report.baseline} == {name for _, name in best.values()}


@pytest.mark.parametrize(
    "command", [["report", "--seeds=0-3"], ["report", "--partial"], ["run", "--seeds=0-3"]]
)
def test_a_search_has_its_own_seeds_and_no_part(
    command: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*command, "tuning_smoke", "--results", str(folder.parent)]) == 2
    assert command[1].partition("=")[0] in capsys.readouterr().err
