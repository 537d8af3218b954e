"""The space of a search, its trials, and experiments that take what it has chosen."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from benchmark.experiments import (
    Experiment,
    all_specifications,
    load_experiment,
    specification,
    specifications,
)
from benchmark.experiments.search import Choice, Space, Span, trials
from envs import InputError, load_scenario, scenario_names
from envs.scenario import SCENARIO_DIRECTORY
from tests.benchmark.reports.conftest import experiment_of

SPACE: Space = {
    "learning_rate": Span(low=0.01, high=1, scale="log", why="-"),
    "epsilon": Span(low=0, high=0.5, why="-"),
    "every": Span(low=10, high=1000, scale="log", whole=True, why="-"),
    "policy_kwargs.net_arch": Choice(values=([8], [8, 8]), why="-"),
}
SEARCH = """
description = "A table in a scene."
scenarios = ["FarCorner"]
horizon = 50
evaluation_every = 100
map_every = 200
settings = { budget = 200 }
search = { trials = 4, finalists = 2, first_seed = 10, seeds = 3 }

[algorithms.q_learning]
algorithm = "q_learning"
observations = ["index", "offset"]
seeds = 2
settings = { discount = 0.8 }
search = { learning_rate = { low = 0.03, high = 1.0, scale = "log", why = "-" } }
"""
TUNED = """
description = "The same table in another scene."
scenarios = ["S1"]
horizon = 50
evaluation_every = 100
map_every = 200
settings = { budget = 200 }

[algorithms.mine]
algorithm = "q_learning"
observations = ["index", "offset"]
seeds = 2
first_seed = 100
tuned_by = "PATH:q_learning"
settings = { epsilon = 0.3 }

[algorithms.plain]
algorithm = "q_learning_plain"
reference_for = "mine"
seeds = 1
first_seed = 100
"""


def chosen(learning_rate: float) -> dict[str, object]:
    """What a search writes of a learner."""
    effort = {"trials": 4, "runs": 10, "steps": 2000, "cpu_time_s": 0.1}
    return {"trial": 3, "settings": {"discount": 0.8, "learning_rate": learning_rate}, "score": 0.5} | effort


@pytest.fixture
def search(tmp_path: Path) -> Experiment:
    """A search, and beside its file what it has chosen."""
    search = experiment_of(tmp_path / "search.toml", SEARCH)
    learners = {"q_learning, index": chosen(0.25), "q_learning, offset": chosen(0.75)}
    text = json.dumps({"search": specification.digest_of_search(search), "learners": learners})
    (tmp_path / "search.chosen.json").write_text(text)
    return search


def tuned(tmp_path: Path, *changes: tuple[str, str]) -> Experiment:
    """An experiment that takes its settings from the search."""
    text = TUNED.replace("PATH", str(tmp_path / "search.toml"))
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return experiment_of(tmp_path / "tuned.toml", text)


def forget() -> None:
    """Lets searches be read again, which a process does once."""
    specification._read_search.cache_clear()
    specification._digest_of_search.cache_clear()
    specification._scenarios_of_search.cache_clear()


def test_trials_stay_the_same_when_a_search_is_lengthened() -> None:
    long, short = trials("dqn", SPACE, 70), trials("dqn", SPACE, 5)
    assert long[:6] == short
    assert long[0] == {}
    assert trials("ppo", SPACE, 5)[1:] != short[1:]


def test_trials_fill_the_space_evenly() -> None:
    """Of 64 points of a Sobol sequence in each dimension, one is in every 64th of the range."""
    drawn = trials("dqn", SPACE, 64)[1:]
    shares = {
        "learning_rate": [np.log10(each["learning_rate"]) / 2 + 1 for each in drawn],
        "epsilon": [each["epsilon"] / 0.5 for each in drawn],
    }
    for values in shares.values():
        assert sorted(np.array(values) * 64 // 1) == pytest.approx(
            np.arange(64), abs=1
        )  # rounded to 3 digits
    assert [each["policy_kwargs.net_arch"] for each in drawn].count([8]) == 32
    assert all(isinstance(each["every"], int) and 10 <= each["every"] <= 1000 for each in drawn)


def test_every_learner_of_a_variant_has_the_same_trials(search: Experiment) -> None:
    drawn = trials("q_learning", search.algorithms["q_learning"].search, 4)
    for t, changes in enumerate(drawn):
        runs = {
            name: specifications(search, f"default/trial={t}", "FarCorner", "q_learning", name)
            for name in ("index", "offset")
        }
        (index, *_), (offset, *_) = runs.values()
        assert index.settings == offset.settings
        expected = {"discount": 0.8, "budget": 200} | changes
        assert index.settings.model_dump(include={*expected}) == expected
    assert len({run.digest for run in all_specifications(search)}) == 5 * 2 * 2


@pytest.mark.usefixtures("search")
def test_learners_take_what_was_chosen_for_their_observation(tmp_path: Path) -> None:
    experiment = tuned(tmp_path)
    for variant in ("mine", "plain"):
        for observation, learning_rate in (("index", 0.25), ("offset", 0.75)):
            (run, *_) = specifications(experiment, "default", "S1", variant, observation)
            found = run.settings.model_dump(include={"learning_rate", "discount", "epsilon"})
            assert found == {"learning_rate": learning_rate, "discount": 0.8, "epsilon": 0.3}


@pytest.mark.usefixtures("search")
@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (
            ('["S1"]', '["S1", "FarCorner"]'),
            "FarCorner is FarCorner, a scenario of the search; accepted: other",
        ),
        (
            ("first_seed = 100", "first_seed = 14"),
            "the search has used the seeds 0 to 1 and 10 to 14; accepted: seeds other than 14 to 15",
        ),
        (("description", 'stream = "search"\ndescription'), "its stream is that of the search; accepted: an"),
        ((":q_learning", ":dqn"), "unknown variant of .* dqn; accepted: q_learning"),
        (('"index", "offset"', '"index", "offset", "one_hot"'), "unknown observation for q_learning one_hot"),
        (
            ("PATH:q_learning", "reproduce:q_learning"),
            "reproduce has no table .search.; accepted: an experiment with",
        ),
        (("PATH:q_learning", "q_learning"), 'accepted: "EXPERIMENT:VARIANT"'),
    ],
)
def test_what_the_search_has_seen_is_refused(tmp_path: Path, change: tuple[str, str], reason: str) -> None:
    old, new = change
    with pytest.raises(InputError, match=reason):
        tuned(tmp_path, (old.replace("PATH", str(tmp_path / "search.toml")), new))


@pytest.mark.usefixtures("search")
@pytest.mark.parametrize("has_other_start", [False, True])
def test_a_scene_under_another_name_is_refused(tmp_path: Path, has_other_start: bool) -> None:
    """Also one that a condition makes the same; but not one with another start."""
    text = (SCENARIO_DIRECTORY / "FarCorner.toml").read_text(encoding="utf-8")
    text = re.sub("description.*", 'description = "Mine."', text)
    if has_other_start:
        text = text.replace("[9, 11]", "[0, 0]")
    (tmp_path / "Mine.toml").write_text(text)
    scene = ('"S1"', f'"{tmp_path / "Mine.toml"}"')
    if has_other_start:
        assert tuned(tmp_path, scene).name == "tuned"
        condition = '[sweep.at.corner]\nscenario = { "grid.start" = [9, 11] }\n\n[algorithms.plain]'
        with pytest.raises(InputError, match=r"Mine\.toml is FarCorner, a scenario of the search"):
            tuned(tmp_path, scene, ("[algorithms.plain]", condition))
    else:
        with pytest.raises(InputError, match=r"Mine\.toml is FarCorner, a scenario of the search"):
            tuned(tmp_path, scene)


def test_no_scene_of_the_search_is_reported() -> None:
    def essence(name: str) -> str:
        return load_scenario(name).model_dump_json(exclude={"name", "description"})

    seen = {essence(name): name for name in load_experiment("tuning").scenarios}
    assert len(seen) == 4
    others = [name for name in scenario_names() if name not in seen.values()]
    assert [name for name in others if essence(name) in seen] == []


@pytest.mark.usefixtures("search")
def test_a_changed_search_is_run_again(tmp_path: Path) -> None:
    path = tmp_path / "search.toml"
    path.write_text(path.read_text().replace('why = "-"', 'why = "Another text."'))
    forget()
    tuned(tmp_path)
    for old, new in (("low = 0.03", "low = 0.05"), ("FarCorner", f"{tmp_path / 'FarCorner.toml'}")):
        scene = (SCENARIO_DIRECTORY / "FarCorner.toml").read_text(encoding="utf-8")
        (tmp_path / "FarCorner.toml").write_text(scene.replace("[9, 11]", "[9, 10]"))
        path.write_text(SEARCH.replace(old, new))
        forget()
        with pytest.raises(InputError, match=r"was made by another version of the search"):
            tuned(tmp_path)


@pytest.mark.usefixtures("search")
@pytest.mark.parametrize(
    "text", ["", "[]", '{"search": "", "learners": {"q_learning, index": {"trial": 1}}}']
)
def test_damaged_choices_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "search.chosen.json").write_text(text)
    with pytest.raises(
        InputError, match=r"search\.chosen\.json is damaged; run the search search with --report"
    ):
        tuned(tmp_path)


@pytest.mark.usefixtures("search")
def test_choices_must_be_there(tmp_path: Path) -> None:
    (tmp_path / "search.chosen.json").unlink()
    with pytest.raises(InputError, match=r"cannot be read .*: run the search search with --report first"):
        tuned(tmp_path)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (("low = 0.03", "low = 3.0"), "low = 3.0: accepted: less than high = 1.0"),
        (("low = 0.03", "low = 0.0"), "low = 0.0: accepted: above 0, or scale"),
        (('why = "-"', 'why = ""'), 'why = "": accepted: at least 1'),
        (("learning_rate = {", "speed = {"), "unknown key speed"),
        (("high = 1.0", "high = 2.0"), "less than or equal to 1"),
        (
            ('low = 0.03, high = 1.0, scale = "log"', "low = 0.0, high = 1.0"),
            "learning_rate = 0.0: .* greater than 0",
        ),
        (("low = 0.03", "whole = true, low = 0.03"), "low = 0.03, high = 1.0: accepted: whole numbers, both"),
        (("seeds = 2\n", "seeds = 1\n"), "algorithms.q_learning.seeds = 1: accepted: at least 2 in a search"),
        (
            ("learning_rate = {", "budget = { low = 1.0, high = 2.0, why = '-' }, learning_rate = {"),
            "search.budget: accepted",
        ),
        (
            ("first_seed = 10", "first_seed = 1"),
            "first_seed = 0: accepted: seeds outside 1 to 5, which its later stages use",
        ),
        (
            ("search = { trials", "sweep = { a = { b = {} } }\nsearch = { trials"),
            "no sweep, readings or solved",
        ),
        (
            ("search = { trials = 4, finalists = 2, first_seed = 10, seeds = 3 }", ""),
            "a table .search. beside it",
        ),
    ],
)
def test_searches_that_are_refused(tmp_path: Path, change: tuple[str, str], reason: str) -> None:
    assert change[0] in SEARCH
    with pytest.raises(InputError, match=reason):
        experiment_of(tmp_path / "search.toml", SEARCH.replace(*change))
