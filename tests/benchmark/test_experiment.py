"""What experiments declare, which runs follow, and what is refused."""

import inspect
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents import load_algorithm
from benchmark import experiment as module
from benchmark.experiment import (
    EXPERIMENT_DIRECTORY,
    Experiment,
    digest_of_search,
    experiment_names,
    load_experiment,
    read_experiment,
)
from benchmark.trials import Choice, Choices, Chosen, Search, Span, trials, write_choices
from envs import InputError
from envs.inputs import Table
from envs.scenario import SCENARIO_DIRECTORY
from tests.support import all_specifications, made, small_experiment, variant

LARGE = ("tuning",)  # with the most conditions
BASE = """
description = "A table in a scene."
scenarios = ["S1"]
horizon = 50
evaluation_every = 100
map_every = 200
settings = { budget = 200 }
"""
SMALL = f"""{BASE}
[algorithms.table]
algorithm = "q_learning"
observations = ["index"]
seeds = 2
"""
SEARCH = f"""{BASE.replace("S1", "FarCorner")}
search = {{ trials = 4, finalists = 2, first_seed = 10, seeds = 3 }}

[algorithms.q]
algorithm = "q_learning"
observations = ["index", "offset"]
seeds = 2
settings = {{ discount = 0.8 }}
candidates = [{{ learning_rate = 0.5, discount = 0.7 }}]
search = {{ learning_rate = {{ low = 0.03, high = 1.0, scale = "log" }} }}
"""
TUNED = f"""{BASE}
[algorithms.mine]
algorithm = "q_learning"
observations = ["index", "offset"]
seeds = 2
first_seed = 100
tuned_by = "search.toml:q"
settings = {{ epsilon = 0.3 }}

[algorithms.plain]
algorithm = "tests.agents.plain:Q_LEARNING"
observations = ["offset"]
seeds = 2
first_seed = 101
tuned_by = "search.toml:q"
settings = {{ epsilon = 0.3 }}
"""
GRIDS = """
[algorithms.rest]
algorithm = "sarsa"
observations = ["index"]
seeds = 2

[algorithms.unnamed]
algorithm = "expected_sarsa"
observations = ["index"]
seeds = 2

[grids.both]
learners = ["table"]
scenario = { "rewards.other" = -0.05 }
axes.rate = { "0.6" = {}, "0.2" = { settings = { learning_rate = 0.2 } } }
axes.limit.20.settings = { time_limit = 20 }

[grids.other]
learners = ["rest"]
axes.limit.5.settings = { time_limit = 5 }
"""
READINGS = """
[readings.limit]
answer = "20 steps"
settings = { time_limit = 20 }

[readings.default]
answer = "no"
"""


def changed(text: str, *changes: tuple[str, str]) -> str:
    """Returns a text with these replacements."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


def extended(path: Path, changes: str = "", base: str = "reproduce") -> Experiment:
    """Loads an extension, which is written to a file."""
    text = f'extends = "{base}"\ndescription = "-"\n[changes]\n{changes}'
    return made(path, text)


# What is declared


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (name in LARGE)) for name in experiment_names()],
)
def test_shipped_experiments_are_sound(name: str) -> None:
    experiment = load_experiment(name)
    assert (experiment.name, experiment.argument) == (name, name)
    assert len({run.folder for run in all_specifications(experiment)}) > 20


def test_every_key_has_a_docstring() -> None:
    """In `use_attribute_docstrings`, a docstring becomes the description of a field."""
    tables: list[type[Table]] = [
        cls for _, cls in inspect.getmembers(module, inspect.isclass) if issubclass(cls, Table)
    ]
    declared = [cls for cls in tables if cls.__module__ == module.__name__]
    assert len(declared) == 7
    declared += [Search, Span, Choice]
    missing = [
        f"{cls.__name__}.{key}"
        for cls in declared
        for key, field in cls.model_fields.items()
        if not field.description
    ]
    assert missing == []


def test_reproduce_declares_what_the_paper_says() -> None:
    experiment = load_experiment("reproduce")
    runs = experiment.populations[0].runs()  # of the default in S1
    assert [run.seed for run in runs] == list(range(1000))  # ten times as many as the paper's 100
    settings = runs[0].settings.model_dump()
    defaults = load_algorithm("q_learning").settings().model_dump()
    assert settings | {"record_every": 1} == defaults
    assert settings["learning_rate"] == settings["epsilon"] == 0.6
    assert settings["discount"] == 0.9
    assert settings["budget"] == 10_000
    # max_q measures runs of the default; the control changes S1 and S2.
    assert len(all_specifications(experiment)) == 3 * 1000 + 6 * 3 * 100 + 2 * 100


def test_learners_have_titles_that_say_what_they_are(tmp_path: Path) -> None:
    variants = {
        "table": variant("watkins_q_lambda", "index", "offset", title="Q(λ) table"),
        "tiles": variant("linear_q_lambda", "coordinates"),
    }
    learners = made(tmp_path / "mine.toml", small_experiment(algorithms=variants)).learners
    assert {name: learner.title for name, learner in learners.items()} == {
        "table, index": "Q(λ) table",
        "table, offset": "Q(λ) table of offsets",
        "tiles, coordinates": "tiles on coordinates",
    }


def test_an_extension_takes_over_no_text_that_may_be_false_of_it(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    report = {"kind": "comparison", "question": "Why?"}
    made(tmp_path / "base.toml", small_experiment(note="Theirs.", report=report))
    mine = extended(path, '"algorithms.table.seeds" = 3', "base.toml").declared
    assert mine.report is not None
    assert (mine.note, mine.report["question"]) == ("", "")
    assert mine.algorithms["table"].seeds == 3
    assert extended(path, 'note = "mine"').declared.note == "mine"


def test_a_miniature_has_two_runs_of_each_learner_and_a_small_budget(tmp_path: Path) -> None:
    text = small_experiment(settings={"budget": 10_000}, algorithms={"table": variant(seeds=9)})
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    small = load_experiment(tmp_path / "mine.toml", smoke=True)
    assert [(run.seed, run.settings.budget) for run in all_specifications(small)] == [
        (0, 400),
        (1, 400),
    ]
    assert (small.name, small.argument) == ("mine_smoke", "mine.toml --smoke")
    assert "mean nothing" in small.declared.note


# Conditions


def test_conditions_are_the_points_of_a_grid(tmp_path: Path) -> None:
    """A learner that no grid names is in all."""
    experiment, found = made(tmp_path / "grid.toml", SMALL + GRIDS), {}
    for population in experiment.populations:
        settings = population.first.settings.model_dump()
        values = settings["learning_rate"], settings["time_limit"]
        found[(*population.keys.values(),)] = *values, population.scenario.rewards.other
    assert [*experiment.populations[0].keys] == ["scenario", "grid", "point", "learner"]
    assert found == {
        ("S1", grid, point, f"{name}, index"): values
        for grid, point, names, values in (
            ("both", "rate 0.6, limit 20", ("table", "unnamed"), (0.6, 20, -0.05)),
            ("both", "rate 0.2, limit 20", ("table", "unnamed"), (0.2, 20, -0.05)),
            ("other", "limit 5", ("rest", "unnamed"), (0.6, 5, -0.1)),
        )
        for name in names
    }


def test_a_reading_adds_runs_and_keeps_those_of_the_experiment_without_it(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    plain = all_specifications(made(path, SMALL))
    experiment = made(path, SMALL + READINGS)
    runs = all_specifications(experiment)
    assert [run.condition for run in runs] == ["default", "limit"] * 2
    assert [run.digest for run in runs[::2]] == [run.digest for run in plain]
    assert [run.settings.time_limit for run in runs] == [None, 20] * 2
    keys = {"scenario": "S1", "reading": "limit", "learner": "table, index"}
    assert experiment.populations[1].keys == keys


def test_a_trial_is_a_condition_of_its_variant(tmp_path: Path) -> None:
    experiment = made(tmp_path / "search.toml", SEARCH)
    tried = trials("q", experiment.declared.algorithms["q"].search, 4)
    tried.append({"learning_rate": 0.5, "discount": 0.7})
    assert [each.keys["trial"] for each in experiment.populations] == [*np.repeat(range(6), 2)]
    for population in experiment.populations:
        expected = {"discount": 0.8, "budget": 200} | tried[int(population.keys["trial"])]
        assert population.first.settings.model_dump(include={*expected}) == expected


# Runs


def test_fewer_seeds_are_the_same_runs_and_conditions_share_streams(tmp_path: Path) -> None:
    small = load_experiment("reproduce", smoke=True)
    runs, again = all_specifications(small), all_specifications(small, range(1))
    assert {run.digest for run in again} < {run.digest for run in runs}
    states: dict[tuple[str, int], set[str]] = {}
    for run in runs:
        state = str(run.seed_sequence.generate_state(4))
        states.setdefault((run.scenario.name, run.seed), set()).add(state)
    assert all(len(words) == 1 for words in states.values())  # readings share streams ...
    assert len(set.union(*states.values())) == len(states) == 3 * 4  # ... others do not
    two = small_experiment(
        algorithms={"a": variant("q_learning", "index", "offset"), "b": variant()}
    )
    learners = all_specifications(made(tmp_path / "two.toml", two))
    assert len({str(run.seed_sequence.entropy) for run in learners}) == len(learners) == 6


def test_experiments_of_one_stream_share_runs(tmp_path: Path) -> None:
    digests = [
        {run.digest for run in all_specifications(experiment, range(2))}
        for experiment in (
            load_experiment("reproduce"),
            extended(tmp_path / "shared.toml", 'stream = "reproduce"'),
            extended(tmp_path / "other.toml"),
        )
    ]
    assert digests[0] == digests[1]
    assert digests[0].isdisjoint(digests[2])


@pytest.mark.parametrize(("given", "of_30", "of_5"), [(1, 1, 1), (35, 10, 2), (100, 30, 5)])
def test_learners_have_shares_of_given_seeds_or_two(
    given: int, of_30: int, of_5: int, tmp_path: Path
) -> None:
    counts = {"most": 100, "some": 30, "few": 5}
    variants = {name: variant(seeds=n, title=name) for name, n in counts.items()}
    experiment = made(tmp_path / "mine.toml", small_experiment(algorithms=variants))
    seeds: dict[str, set[int]] = {}
    for run in all_specifications(experiment, range(given)):
        seeds.setdefault(run.variant, set()).add(run.seed)
    assert {name: len(own) for name, own in seeds.items()} == {
        "most": given,
        "some": of_30,
        "few": of_5,
    }


# Settings from a search

RATES = {"index": 0.25, "offset": 0.75}


@pytest.fixture
def chosen(tmp_path: Path) -> Path:
    """A search with a pick for each form of observation; returns its folder."""
    search = made(tmp_path / "search.toml", SEARCH)
    effort: Any = {"trials": 4, "runs": 10, "steps": 2000, "cpu_time_s": 0.1}
    learners = {}
    for form, rate in RATES.items():
        settings: dict[str, object] = {"learning_rate": rate, "discount": 0.8}
        learners[f"q, {form}"] = Chosen(trial=1, settings=settings, score=0.5, **effort)
    digest = digest_of_search(search.declared)
    write_choices(search.path, Choices(search=digest, trials="", learners=learners))
    return tmp_path


def test_runs_have_the_pick_for_their_observation(chosen: Path) -> None:
    experiment = made(chosen / "tuned.toml", TUNED)
    assert [[*each.seeds] for each in experiment.populations] == 2 * [[100, 101]] + [[101, 102]]
    for population in experiment.populations:
        assert population.learner.search == "search.toml"
        for run in population.runs():
            settings = run.settings.model_dump()
            rate = RATES[population.learner.observation]
            assert (settings["learning_rate"], settings["discount"]) == (rate, 0.8)
            assert settings["epsilon"] == 0.3


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('"S1"', '"FarCorner"', "FarCorner is a scenario of a search"),
        ('"S1"', '"Mine.toml"', "Mine is a scenario of a search"),
        ("first_seed = 100", "first_seed = 1", "uses the seeds 0 to 1: accepted: .* than 1 to 2"),
        ("first_seed = 100", "first_seed = 12", "the seeds 10 to 12: accepted: .* than 12 to 13"),
        ("toml:q", "toml:dqn", "unknown learner of the search dqn, index"),
        ("search.toml:q", "reproduce:q_learning", "accepted: SEARCH:VARIANT of one with a table"),
        ("search.toml:q", "tuning", "accepted: SEARCH:VARIANT of one with a table"),
        ('"offset"]', '"centred"]', "unknown learner of the search q, centred"),
    ],
)
def test_what_a_search_does_not_offer_is_refused(
    chosen: Path, old: str, new: str, reason: str
) -> None:
    text = (SCENARIO_DIRECTORY / "FarCorner.toml").read_text(encoding="utf-8")
    (chosen / "Mine.toml").write_text(re.sub("description.*", 'description = "Mine."', text))
    with pytest.raises(InputError, match=rf"tuned\.toml: .*{reason}"):
        made(chosen / "tuned.toml", changed(TUNED, (old, new)))


def test_only_what_a_search_depends_on_changes_its_digest(chosen: Path) -> None:
    def digest(old: str, new: str) -> str:
        return digest_of_search(made(chosen / "search.toml", changed(SEARCH, (old, new))).declared)

    same = digest("A table in a scene.", "Another text.")
    assert same == digest("map_every", 'note = "-"\nmap_every')
    others = [digest("map_every = 200", f"solved.growth = {growth}") for growth in (1.1, 1.2)]
    assert len({same, *others, digest("horizon = 50", "horizon = 51")}) == 4
    with pytest.raises(InputError, match=r"search\.toml has changed since; run it again"):
        made(chosen / "tuned.toml", TUNED)


# Mistakes

MISTAKES = [
    ("reproduce", "seeds = 100 ", "seeds = 0 ", "q_learning.seeds = 0: input should be greater"),
    ("reproduce", "seeds = 100 ", "sedes = 6 ", "unknown key sedes (did you mean seeds?)"),
    ("reproduce", "epsilon = 0.4", "epsilon = -1.0", "q_learning.settings (epsilon): epsilon = -1"),
    ("reproduce", '"S1", "S2"', '"S1", "S7"', "mine.toml: scenarios: unknown scenario S7"),
    ("reproduce", '"q_learning"\nobs', '"q_lerning"\nobs', "unknown algorithm q_lerning (did you"),
    ("reproduce", "[8, 6]", "[8, 60]", "mine.toml: origin: "),
    ("reproduce", '["S1", "S2"]', '["S1", "S4"]', "equal_pay: scenarios: S4: accepted: S1"),
    ("reproduce", "map_every = 1000", "map_every = 600", "map_every = 600: accepted: a multiple"),
    ("reproduce", '"Q-learning table"', '"P\\nPO"', "accepted: text in one line"),
    ("reproduce", '["index"]', '["one_hot"]', "unknown observation for q_learning one_hot"),
    ("reproduce", "discount =", "discont =", "unknown key discont (did you mean discount?)"),
]  # fmt: skip


LAST, MAPS = "seeds = 2\n", "map_every = 200"
GRID = f"{LAST}[grids.g]\naxes.limit.5.settings.time_limit = 5\n"
CANDIDATES = "candidates = [{ epsilon = 0.5 }]"
OTHER = """[algorithms.other]
algorithm = "q_learning"
observations = ["index"]
seeds = 2
search = { epsilon = { low = 0, high = 1 } }

[algorithms.q]"""
FOUND = "search = { trials = 4, first_seed = 10 }"
UNUSED = [
    ("", LAST, GRID.replace("limit.5", "limit.large"), 'large.[key] = "large": accepted: a number'),
    ("", LAST, f"{GRID}learners = ['tables']", "unknown learner tables (did you mean table"),
    ("", LAST, f"{GRID}settings.time_limit = 9", "settings.time_limit is named twice"),
    ("", LAST, f'{LAST}{READINGS}[report]\nkind = "map"', "readings in a map: accepted: no such"),
    ("", MAPS, f"{MAPS}\nsolved = {{}}", "map_every = 200: accepted: no such key"),
    ("", MAPS, 'report = "comparison"\nsolved = {}', "solved in a comparison: accepted: no"),
    ("", MAPS, FOUND, "table.search: accepted: in each variant, together"),
    ("", LAST, f"{LAST}search.epsilon.values = [0, 1]", "search: accepted: in each variant,"),
    ("", MAPS, 'evaluated_from = ["start"]', "unknown key evaluated_from"),
    ("", LAST, f"{LAST}{CANDIDATES}", "table.candidates: accepted: only together with"),
    ("", LAST, f"{LAST}scenarios = ['S1']", "table.scenarios: accepted: only together with"),
    ("search", LAST, f"{LAST}first_seed = 9\n", "first_seed: a search uses the seeds 10 to 12"),
    ("search", "{ learning_rate = {", "{ budget = {", "a search of budget: accepted: other"),
    ("search", LAST, f"{LAST}scenarios = ['FarCornr']\n", "FarCornr (did you mean FarCorner?): a"),
    ("search", "discount = 0.7", "budget = 100", "a search of budget: accepted: other settings"),
    ("search", "discount = 0.7", "discount = 7", "settings (trial 5): discount = 7: input should"),
    ("search", "discount = 0.7", "discont = 0.7", "(trial 5): unknown key discont (did you"),
    ("search", '[algorithms.q]', OTHER, "algorithms: accepted: as many seeds and candidates in"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "old", "new", "expected"), MISTAKES + UNUSED)
def test_mistakes_and_what_nobody_would_read_get_one_line(
    tmp_path: Path, name: str, old: str, new: str, expected: str
) -> None:
    text = {"": SMALL, "search": SEARCH}.get(name)
    if text is None:
        text = (EXPERIMENT_DIRECTORY / f"{name}.toml").read_text(encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(expected)):
        made(tmp_path / "mine.toml", changed(text, (old, new)))


@pytest.mark.parametrize("table", ["algorithms", "readings"])
@pytest.mark.parametrize("name", ["../x", "a b", "=1+1", "1e5", "NA", "x" * 61])
def test_what_is_no_name_is_refused_in_a_sentence(tmp_path: Path, table: str, name: str) -> None:
    text = (EXPERIMENT_DIRECTORY / "reproduce.toml").read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(f'{text}\n[{table}."{name}"]\nanswer = "a"\n', "utf-8")
    with pytest.raises(InputError, match=rf"mine\.toml: (the key )?{table}\..*accepted: "):
        read_experiment(tmp_path / "mine.toml")


@pytest.mark.parametrize("stem", ["a.b", "2024", "reproduce", "speed", "a_smoke", "a_seeds_0-9"])
def test_results_have_no_folder_of_others(tmp_path: Path, stem: str) -> None:
    with pytest.raises(InputError, match="results are named after the"):
        extended(tmp_path / f"{stem}.toml")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ('"algorithms.sb3_dqm.seeds" = 3', "algorithms.sb3_dqm.algorithm is missing"),
        ('"horizon.x" = 1', "cannot set horizon.x: horizon is a value"),
    ],
)
def test_changes_are_of_something(tmp_path: Path, changes: str, expected: str) -> None:
    with pytest.raises(InputError, match=rf"mine\.toml: .*{re.escape(expected)}"):
        extended(tmp_path / "mine.toml", changes)


@pytest.mark.parametrize("budget", ['"200"', "0"])
def test_a_miniature_hides_no_mistake(tmp_path: Path, budget: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(changed(SMALL, ("budget = 200", f"budget = {budget}")), encoding="utf-8")
    with pytest.raises(InputError, match=f"budget = {budget}: input should be"):
        load_experiment(path, smoke=True)


def test_an_extension_extends_no_extension(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"first\.toml: unknown key extends"):
        extended(tmp_path / "first.toml", base="first.toml")
