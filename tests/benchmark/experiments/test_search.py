"""The space of a search, its trials, and experiments that take what it has chosen."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from agents.sb3.settings import PolicyArguments
from benchmark.experiments import Experiment, choices
from benchmark.experiments.search import Choice, Search, Space, Span, trials
from benchmark.sealed import sealed, unsealed
from envs import InputError
from envs.scenario import SCENARIO_DIRECTORY
from tests.benchmark.studies.conftest import experiment_of

SPACE: Space = {
    "learning_rate": Span(low=0.01, high=1, scale="log"),
    "epsilon": Span(low=0, high=0.5),
    "every": Span(low=10, high=1000, scale="log", whole=True),
    "policy_kwargs.net_arch": Choice(values=([8], [8, 8])),
}
BASE = """
description = "A table in a scene."
scenarios = ["FarCorner"]
horizon = 50
evaluation_every = 100
map_every = 200
settings = { budget = 200 }
"""
SEARCH = f"""{BASE}
search = {{ trials = 4, finalists = 2, first_seed = 10, seeds = 3 }}

[algorithms.q_learning]
algorithm = "q_learning"
observations = ["index", "offset"]
seeds = 2
settings = {{ discount = 0.8 }}
search = {{ learning_rate = {{ low = 0.03, high = 1.0, scale = "log" }} }}
"""
TUNED = f"""{BASE.replace("FarCorner", "S1")}
[algorithms.mine]
algorithm = "q_learning"
observations = ["index", "offset"]
seeds = 2
first_seed = 100
tuned_by = "PATH:q_learning"
settings = {{ epsilon = 0.3 }}

[algorithms.plain]
algorithm = "tests.agents.plain:Q_LEARNING"
reference_for = "mine"
seeds = 1
first_seed = 100
"""


FORMS = ("index", "offset")
PICKS = {1: 0.1, 6: 0.2, 9: 0.3}  # learning rates by trial


def chosen(learning_rate: float) -> dict[str, object]:
    """What a search writes of a learner."""
    effort = {"trials": 4, "runs": 10, "steps": 2000, "cpu_time_s": 0.1}
    best = {"trial": 3, "settings": {"discount": 0.8, "learning_rate": learning_rate}, "score": 0.5}
    return best | effort


@pytest.fixture
def search(tmp_path: Path) -> Experiment:
    """A search, and beside its file what it has chosen for each form of observation."""
    search = experiment_of(tmp_path / "search.toml", SEARCH)
    learners = {"q_learning, index": chosen(0.25), "q_learning, offset": chosen(0.75)}
    content = {"search": choices.digest_of_search(search.declared), "trials": "", "learners": learners}
    (tmp_path / "search.chosen.json").write_text(sealed(content, indent=1))
    return search


def tuned(tmp_path: Path, *changes: tuple[str, str]) -> Experiment:
    """An experiment that takes its settings from the search."""
    text = TUNED.replace("PATH", str(tmp_path / "search.toml"))
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return experiment_of(tmp_path / "tuned.toml", text)


def test_trials_fill_the_space_evenly() -> None:
    """Of 64 points of a Sobol sequence in each dimension, one is in every 64th of the range."""
    first, *others = trials("dqn", SPACE, 64)
    assert first == {}
    assert others != trials("ppo", SPACE, 64)[1:]
    drawn = pd.DataFrame(others)
    for shares in (np.log10(drawn["learning_rate"]) / 2 + 1, drawn["epsilon"] / 0.5):
        assert sorted(shares * 64 // 1) == pytest.approx(np.arange(64), abs=1)  # rounded to 3 digits
    assert [*drawn["policy_kwargs.net_arch"]].count([8]) == 32
    assert drawn["every"].dtype == int
    assert drawn["every"].between(10, 1000).all()


def test_every_learner_of_a_variant_has_the_same_trials(search: Experiment) -> None:
    drawn = trials("q_learning", search.declared.algorithms["q_learning"].search, 4)
    assert len(search.populations) == 5 * 2
    for population in search.populations:
        expected = {"discount": 0.8, "budget": 200} | drawn[int(population.condition.axes["trial"])]
        assert population.first.settings.model_dump(include={*expected}) == expected


@pytest.mark.usefixtures("search")
def test_learners_take_what_was_chosen_for_their_observation(tmp_path: Path) -> None:
    for population in tuned(tmp_path).populations:
        learning_rate = {"index": 0.25, "offset": 0.75}[population.learner.observation]
        expected = {"learning_rate": learning_rate, "discount": 0.8, "epsilon": 0.3}
        assert population.first.settings.model_dump(include={*expected}) == expected
        assert population.learner.chosen is not None
        assert (population.learner.chosen.trial, population.learner.chosen.runs) == (3, 10)


@pytest.mark.usefixtures("search")
def test_runs_take_turns_with_the_picks_of_several_parts(tmp_path: Path) -> None:
    """Seed 100 has the first pick, and a reference implementation the same as its variant with each seed."""
    file = tmp_path / "search.chosen.json"
    content = unsealed(file.read_bytes())
    for found in content["learners"].values():
        picks = [{"trial": t, "settings": {"learning_rate": rate}, "score": 0.5} for t, rate in PICKS.items()]
        found["picks"] = picks
    file.write_text(sealed(content, indent=1))
    experiment = tuned(
        tmp_path, ("seeds = 2", "seeds = 5"), ("seeds = 1\nfirst_seed = 100", "seeds = 2\nfirst_seed = 101")
    )
    expected = {100: 0.1, 101: 0.2, 102: 0.3, 103: 0.1, 104: 0.2}
    for population in experiment.populations:
        settings = {run.seed: run.settings.model_dump() for run in population.runs()}
        rates = {seed: values["learning_rate"] for seed, values in settings.items()}
        assert rates == {seed: expected[seed] for seed in population.seeds}
        assert {values["epsilon"] for values in settings.values()} == {0.3}
        assert [population.pick_of(seed) for seed in (99, 100, 104)] == [2, 0, 1]
        assert population.first.settings.model_dump()["learning_rate"] == 0.1


def test_parts_of_a_search_are_evenly_spread() -> None:
    """Of 4 parts of 16 trials, each has a point in every 16th of a range; trial 0 stands for a point."""
    search = Search(trials=63, parts=4, finalists=2, first_seed=0)
    assert search.blocks == [range(16), range(16, 32), range(32, 48), range(48, 64)]
    drawn = trials("dqn", SPACE, 63, 4)
    assert drawn[1:] == trials("dqn", SPACE, 64)[2:]
    for block in search.blocks[1:]:
        shares = [float(str(drawn[trial]["epsilon"])) / 0.5 for trial in block]
        assert sorted(share * 16 // 1 for share in shares) == pytest.approx(np.arange(16), abs=1)


def test_only_what_a_search_depends_on_changes_its_digest(search: Experiment, tmp_path: Path) -> None:
    def digest(old: str, new: str) -> str:
        assert old in SEARCH
        other = experiment_of(tmp_path / "search.toml", SEARCH.replace(old, new))
        return choices.digest_of_search(other.declared)

    same = choices.digest_of_search(search.declared)
    assert digest("A table in a scene", "Another text") == same
    assert digest("horizon", "solved = { growth = 1.1 }\nhorizon") != same
    growths = {digest("horizon", f"solved = {{ growth = {growth} }}\nhorizon") for growth in (1.1, 1.2, 1.2)}
    assert len(growths) == 2


def test_trials_change_single_arguments_of_the_optimiser(tmp_path: Path) -> None:
    net = """
algorithm = "compiled_dqn"
observations = ["one_hot"]
seeds = 2
settings = { policy_kwargs = { net_arch = [5], optimizer_kwargs = { eps = 0.1 } } }

[algorithms.q_learning.search]
"policy_kwargs.KEY" = { values = VALUES }
"""
    head = SEARCH.partition("algorithm =")[0]
    for key, values, expected in (
        ("net_arch", [[8], [9]], {((5,), 0.1), ((8,), 0.1), ((9,), 0.1)}),
        ("optimizer_kwargs.eps", [0.2, 0.3], {((5,), 0.1), ((5,), 0.2), ((5,), 0.3)}),
    ):
        text = head + net.replace("KEY", key).replace("VALUES", str(values))
        tried = [each.first.settings for each in experiment_of(tmp_path / "mine.toml", text).populations]
        nets: list[PolicyArguments] = [vars(settings)["policy_kwargs"] for settings in tried]
        assert {(each.net_arch, each.optimizer_kwargs.eps) for each in nets} == expected


@pytest.mark.usefixtures("search")
@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('["S1"]', '["S1", "FarCorner"]', "FarCorner is FarCorner, a scenario of the search"),
        ("first_seed = 100", "first_seed = 12", "seeds 0 to 1 and 10 to 12; accepted: .* than 12 to 13"),
        (":q_learning", ":dqn", "unknown variant of .* dqn; accepted: q_learning"),
        ("PATH:q_learning", "reproduce:q_learning", "reproduce has no table .search.; accepted"),
    ],
)  # fmt: skip
def test_what_a_search_does_not_offer_is_refused(tmp_path: Path, old: str, new: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        tuned(tmp_path, (old.replace("PATH", str(tmp_path / "search.toml")), new))


@pytest.mark.usefixtures("search")
def test_a_scene_under_another_name_is_refused(tmp_path: Path) -> None:
    """Here one that a condition makes the same."""
    text = (SCENARIO_DIRECTORY / "FarCorner.toml").read_text(encoding="utf-8")
    text = re.sub("description.*", 'description = "Mine."', text)
    (tmp_path / "Mine.toml").write_text(text.replace("[9, 11]", "[0, 0]"))
    mine = ('"S1"', f'"{tmp_path / "Mine.toml"}"')
    assert tuned(tmp_path, mine).name == "tuned"
    condition = '[grids.all.axes.at.1]\nscenario = { "grid.start" = [9, 11] }\n\n[algorithms.plain]'
    with pytest.raises(InputError, match=r"Mine is FarCorner, a scenario of the search"):
        tuned(tmp_path, mine, ("[algorithms.plain]", condition))


@pytest.mark.usefixtures("search")
@pytest.mark.parametrize(("old", "new"), [("low = 0.03", "low = 0.05"), ("FarCorner", "PATH/FarCorner.toml")])
def test_a_changed_search_is_run_again(tmp_path: Path, old: str, new: str) -> None:
    scene = (SCENARIO_DIRECTORY / "FarCorner.toml").read_text(encoding="utf-8")
    (tmp_path / "FarCorner.toml").write_text(scene.replace("[9, 11]", "[9, 10]"))
    (tmp_path / "search.toml").write_text(SEARCH.replace(old, new.replace("PATH", str(tmp_path))))
    with pytest.raises(InputError, match=r"was made by another version of the search"):
        tuned(tmp_path)


@pytest.mark.usefixtures("search")
@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (".*", None, "is missing"),
        (".*", "[]", "is damaged"),
        (r'"learning_rate": 0\.25', '"learning_rate": 0.26', "is damaged"),
    ],
)
def test_missing_and_changed_choices_are_refused(
    tmp_path: Path, old: str, new: str | None, reason: str
) -> None:
    path = tmp_path / "search.chosen.json"
    text, count = re.subn(old, new or "", path.read_text(), count=1, flags=re.DOTALL)
    assert count == 1
    path.unlink() if new is None else path.write_text(text)
    again = rf"{reason}; python -m benchmark run \S*search\.toml --report makes it anew\."
    with pytest.raises(InputError, match=again):
        tuned(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("low = 0.03", "low = 0.0", "low = 0.0: accepted: above 0, or scale"),
        ("learning_rate = {", "budget = {", "search.budget: accepted: other"),
        ("first_seed = 10", "first_seed = 1", "accepted: seeds outside 1 to 3, which its finalists use"),
        ("search = { trials = 4, finalists = 2, first_seed = 10, seeds = 3 }", "", "a table .search."),
    ],
)  # fmt: skip
def test_searches_that_are_refused(tmp_path: Path, old: str, new: str, reason: str) -> None:
    assert old in SEARCH
    with pytest.raises(InputError, match=reason):
        experiment_of(tmp_path / "search.toml", SEARCH.replace(old, new))
