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
    all_specifications,
    digest_of_search,
    experiment_names,
    load_experiment,
    read_experiment,
)
from benchmark.trials import Choice, Choices, Chosen, Finalist, Search, Span, trials, write_choices
from envs import InputError, load_scenario
from envs.inputs import Table
from envs.scenario import SCENARIO_DIRECTORY
from tests.support import small_experiment, toml, variant

COMPARED = load_experiment("compare_deep", smoke=True)
LARGE = ("tuning", "tuning_map", "tuning_tables")  # with the most conditions
ASKED = {"question": "a", "answer": "b"}
RATE = {"learning_rate": {"low": 0.03, "high": 1.0, "scale": "log"}}
SEARCH = {
    "scenarios": ["FarCorner"],
    "search": {"trials": 4, "finalists": 2, "first_seed": 10, "seeds": 3},
    "algorithms": {
        "q": variant("q_learning", "index", "offset", settings={"discount": 0.8}, search=RATE)
    },
}
TUNED = {
    "mine": variant(
        "q_learning",
        "index",
        "offset",
        first_seed=100,
        tuned_by="search.toml:q",
        settings={"epsilon": 0.3},
    ),
    "plain": {
        "algorithm": "tests.agents.plain:Q_LEARNING",
        "reference_for": "mine",
        "seeds": 1,
        "first_seed": 100,
    },
}


def made(path: Path, **changes: Any) -> Experiment:
    """Loads a small experiment with these changes, which is written to a file; None drops a key."""
    text = re.sub(r"\w+ = none\n", "", small_experiment(**changes))
    path.write_text(text, encoding="utf-8")
    return load_experiment(path)


def extended(path: Path, base: object = "reproduce", **changes: Any) -> Experiment:
    """Loads an extension, written to a file; __ in a key stands for a dot."""
    table = {key.replace("__", "."): value for key, value in changes.items()}
    path.write_text(f"{toml({'extends': str(base), 'description': '-'})}\n[changes]\n{toml(table)}")
    return load_experiment(path)


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
    runs = experiment.population("default", "S1", "q_learning, index").runs()
    assert [run.seed for run in runs] == list(range(1000))  # ten times as many as the paper's 100
    settings = runs[0].settings.model_dump()
    defaults = load_algorithm("q_learning").settings().model_dump()
    assert settings | {"record_every": 1} == defaults
    assert settings["learning_rate"] == settings["epsilon"] == 0.6
    assert settings["discount"] == 0.9
    assert settings["budget"] == 10_000
    # max_q measures runs of the default; the control changes S1 and S2.
    assert len(all_specifications(experiment)) == 3 * 1000 + 6 * 3 * 100 + 2 * 100


def test_a_reference_takes_settings_and_observations_from_its_variant() -> None:
    variants = load_experiment("compare_deep").declared.algorithms
    references = [each for each in variants.values() if each.reference_for]
    assert len(references) == 7
    for each in references:
        of = variants[each.reference_for]
        assert (each.settings, each.policy, each.tuned_by) == (of.settings, of.policy, of.tuned_by)
        assert {*each.observations} <= {*of.observations}
        assert each.algorithm == of.algorithm.replace("compiled_", "sb3_")


def test_learners_have_titles_that_say_what_they_are() -> None:
    titles = {name: learner.title for name, learner in COMPARED.learners.items()}
    assert titles["watkins_q_lambda, index"] == "Q(λ) table"
    assert titles["softmax_table, one_hot"] == "softmax table"  # PPO without hidden layers
    assert titles["dqn, one_hot"] == "compiled DQN on one-hot cells"
    assert titles["tile_coding, coordinates"] == "tile coding on coordinates"
    families = {learner.family for learner in COMPARED.learners.values()}
    assert families == {"tabular", "linear", "deep"}


def test_an_extension_takes_over_no_text_that_may_be_false_of_it(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    mine = extended(path, "sb3", algorithms__sb3_dqn__seeds=3).declared
    assert mine.report is not None
    assert (mine.note, mine.report["question"]) == ("", "")
    assert mine.algorithms["sb3_dqn"].seeds == 3
    assert extended(path, note="mine").declared.note == "mine"
    made(tmp_path / "base.toml", report={"kind": "comparison"})
    solved = extended(path, "base.toml", solved={"success": 0.8}, report__kind="map")
    assert solved.populations[0].first.map_every == solved.declared.evaluation_every


def test_a_miniature_has_two_runs_of_each_learner_and_a_small_budget() -> None:
    assert {len(population.seeds) for population in COMPARED.populations} == {2}
    assert {run.settings.budget for run in all_specifications(COMPARED)} == {400}  # of 10,000
    assert (COMPARED.name, COMPARED.argument) == ("compare_deep_smoke", "compare_deep --smoke")
    assert "mean nothing" in COMPARED.declared.note


# Conditions


def test_conditions_are_the_points_of_a_grid(tmp_path: Path) -> None:
    grid = {
        "scenario": {"rewards.other": -0.05},
        "learners": ["table"],
        "axes": {
            "rate": {"0.6": {}, "0.2": {"settings": {"learning_rate": 0.2}}},
            "limit": {"20": {"settings": {"time_limit": 20}}},
        },
    }
    other = {"learners": ["rest"], "axes": {"limit": {"5": {"settings": {"time_limit": 5}}}}}
    names = {name: variant() for name in ("table", "rest", "unnamed")}
    grids = {"both": grid, "other": other}
    experiment = made(tmp_path / "grid.toml", algorithms=names, grids=grids)
    found = {}
    for population in experiment.populations:
        settings = population.first.settings.model_dump()
        values = settings["learning_rate"], settings["time_limit"]
        found[(*population.keys.values(),)] = *values, population.scenario.rewards.other
    assert [*experiment.populations[0].keys] == ["scenario", "grid", "point", "learner"]
    assert found == {
        ("S1", "both", "rate 0.6, limit 20", "table, index"): (0.6, 20, -0.05),
        ("S1", "both", "rate 0.6, limit 20", "unnamed, index"): (0.6, 20, -0.05),
        ("S1", "both", "rate 0.2, limit 20", "table, index"): (0.2, 20, -0.05),
        ("S1", "both", "rate 0.2, limit 20", "unnamed, index"): (0.2, 20, -0.05),
        ("S1", "other", "limit 5", "rest, index"): (0.6, 5, -0.1),
        ("S1", "other", "limit 5", "unnamed, index"): (0.6, 5, -0.1),
    }


def test_a_reading_adds_runs_and_keeps_those_of_the_experiment_without_it(tmp_path: Path) -> None:
    path, limit = tmp_path / "mine.toml", {"settings": {"time_limit": 20}, **ASKED}
    plain = all_specifications(made(path))
    readings = {"limit": limit, "default": ASKED}
    experiment = made(path, readings=readings)
    runs = all_specifications(experiment)
    assert [run.condition for run in runs] == ["default", "limit"] * 2
    assert [run.digest for run in runs[::2]] == [run.digest for run in plain]
    assert [run.settings.time_limit for run in runs] == [None, 20] * 2
    keys = {"scenario": "S1", "reading": "limit", "learner": "table, index"}
    assert experiment.populations[1].keys == keys


def test_a_trial_is_a_condition_of_its_variant(tmp_path: Path) -> None:
    experiment = made(tmp_path / "search.toml", **SEARCH)
    drawn = trials("q", experiment.declared.algorithms["q"].search, 4)
    assert [each.keys["trial"] for each in experiment.populations] == [*np.repeat(range(5), 2)]
    for population in experiment.populations:
        expected = {"discount": 0.8, "budget": 200} | drawn[int(population.keys["trial"])]
        assert population.first.settings.model_dump(include={*expected}) == expected


@pytest.mark.parametrize(
    ("grid", "name"),
    [("strangers", "TwoStrangers"), ("two", "TwoTalking"), ("three", "ThreeTalking")],
)
def test_grids_of_groups_have_the_people_of_the_shipped_scenes(grid: str, name: str) -> None:
    every = load_experiment("groups").populations
    found = next(each.scenario for each in every if each.keys["grid"] == grid)
    for key in ("grid", "group", "regions", "rewards", "observe", "ping_limit"):
        assert getattr(found, key) == getattr(load_scenario(name), key)


# Runs


def test_fewer_seeds_are_the_same_runs_and_conditions_share_streams() -> None:
    small = load_experiment("reproduce", smoke=True)
    runs, again = all_specifications(small), all_specifications(small, range(1))
    assert {run.digest for run in again} < {run.digest for run in runs}
    states: dict[tuple[str, int], set[str]] = {}
    for run in runs:
        state = str(run.seed_sequence.generate_state(4))
        states.setdefault((run.scenario.name, run.seed), set()).add(state)
    assert all(len(words) == 1 for words in states.values())  # readings share streams ...
    assert len(set.union(*states.values())) == len(states) == 3 * 4  # ... others do not
    learners = all_specifications(COMPARED)
    assert len({str(run.seed_sequence.entropy) for run in learners}) == len(learners)


def test_experiments_of_one_stream_share_runs(tmp_path: Path) -> None:
    digests = [
        {run.digest for run in all_specifications(experiment, range(2))}
        for experiment in (
            load_experiment("reproduce"),
            extended(tmp_path / "shared.toml", stream="reproduce"),
            extended(tmp_path / "other.toml"),
        )
    ]
    assert digests[0] == digests[1]
    assert digests[0].isdisjoint(digests[2])


@pytest.mark.parametrize(("given", "of_30", "of_5"), [(1, 1, 1), (35, 10, 2), (100, 30, 5)])
def test_a_reference_has_its_share_of_given_seeds_or_two(given: int, of_30: int, of_5: int) -> None:
    seeds: dict[str, set[int]] = {}
    for run in all_specifications(load_experiment("compare_deep"), range(given)):
        seeds.setdefault(run.variant, set()).add(run.seed)
    expected = {"q_learning": given, "dqn": given, "sb3_ppo": of_30, "sb3_dqn_linear": of_5}
    assert {name: seeds[name] for name in expected} == {
        name: set(range(n)) for name, n in expected.items()
    }


def test_first_runs_are_of_all_populations() -> None:
    runs = all_specifications(COMPARED)
    firsts = [population.first.population for population in COMPARED.populations]
    assert [run.population for run in runs[: len(firsts)]] == firsts
    assert runs[0].folder == "compare_deep_smoke/S1/q_learning_index/seed_400"


# Settings from a search


@pytest.fixture
def chosen(tmp_path: Path) -> Path:
    """A search with two picks for each form of observation; returns its folder."""
    search = made(tmp_path / "search.toml", **SEARCH)
    effort: Any = {"trials": 4, "runs": 10, "steps": 2000, "cpu_time_s": 0.1}
    learners = {}
    for form, rates in (("index", (0.25, 0.5)), ("offset", (0.75, 1.0))):
        picks = [
            Finalist(trial=t, settings={"learning_rate": rate, "discount": 0.8}, score=0.5)
            for t, rate in enumerate(rates)
        ]
        learners[f"q, {form}"] = Chosen(**dict(picks[0]), picks=tuple(picks), **effort)
    digest = digest_of_search(search.declared)
    write_choices(search.path, Choices(search=digest, trials="", learners=learners))
    return tmp_path


def test_runs_take_turns_with_the_picks_for_their_observation(chosen: Path) -> None:
    """A reference implementation has the same pick with each seed."""
    algorithms = {**TUNED, "plain": TUNED["plain"] | {"seeds": 2, "first_seed": 101}}
    expected = {
        "index": {100: 0.25, 101: 0.5, 102: 0.25},
        "offset": {100: 0.75, 101: 1.0, 102: 0.75},
    }
    experiment = made(chosen / "tuned.toml", algorithms=algorithms)
    assert [[*each.seeds] for each in experiment.populations] == 2 * [[100, 101]] + 2 * [[101, 102]]
    for population in experiment.populations:
        assert [len(population.firsts), population.learner.search] == [2, "search.toml"]
        for run in population.runs():
            settings = run.settings.model_dump()
            rate = expected[population.learner.observation][run.seed]
            assert (settings["learning_rate"], settings["discount"]) == (rate, 0.8)
            assert settings["epsilon"] == 0.3


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"scenarios": ["S1", "FarCorner"]}, "FarCorner is FarCorner, a scenario of the search"),
        ({"scenarios": ["Mine.toml"]}, "Mine is FarCorner, a scenario of the search"),
        ({"first_seed": 1}, "a search uses the seeds 0 to 1: accepted: .* than 1 to 2"),
        ({"first_seed": 12}, "a search uses the seeds 10 to 12: accepted: .* than 12 to 13"),
        ({"tuned_by": "search.toml:dqn"}, "unknown variant of .* dqn; accepted: q"),
        ({"tuned_by": "reproduce:q_learning"}, "accepted: SEARCH:VARIANT of one with a table"),
        ({"tuned_by": "tuning"}, "accepted: SEARCH:VARIANT of one with a table"),
        ({"observations": ["offset_one_hot"], "algorithm": "compiled_dqn"}, "unknown learner of"),
    ],
)  # fmt: skip
def test_what_a_search_does_not_offer_is_refused(
    chosen: Path, changes: dict[str, Any], reason: str
) -> None:
    text = (SCENARIO_DIRECTORY / "FarCorner.toml").read_text(encoding="utf-8")
    (chosen / "Mine.toml").write_text(re.sub("description.*", 'description = "Mine."', text))
    scenarios = changes.pop("scenarios", ["S1"])
    with pytest.raises(InputError, match=rf"tuned\.toml: .*{reason}"):
        made(
            chosen / "tuned.toml", scenarios=scenarios, algorithms={"mine": TUNED["mine"] | changes}
        )


def test_only_what_a_search_depends_on_changes_its_digest(chosen: Path) -> None:
    def digest(**changes: Any) -> str:
        return digest_of_search(made(chosen / "search.toml", **(SEARCH | changes)).declared)

    assert digest(description="Another text", note="x") == digest()
    others = [digest(solved={"growth": growth}, map_every=None) for growth in (1.1, 1.2)]
    assert len({digest(), *others, digest(horizon=51)}) == 4
    with pytest.raises(InputError, match=r"search\.toml has changed since; run it again"):
        made(chosen / "tuned.toml", algorithms=TUNED)


# Mistakes

MISTAKES = [
    ("reproduce", "seeds = 100 ", "seeds = 0 ", "q_learning.seeds = 0: input should be greater"),
    ("reproduce", "seeds = 100 ", "sedes = 6 ", "unknown key sedes (did you mean seeds?)"),
    ("reproduce", "epsilon = 0.4", "epsilon = -1.0", "q_learning.settings (epsilon): epsilon = -1"),
    ("reproduce", '"S1", "S2"', '"S1", "S7"', "mine.toml: scenarios: unknown scenario S7"),
    ("reproduce", '"q_learning"\nobs', '"q_lerning"\nobs', "unknown algorithm q_lerning (did you"),
    ("reproduce", "[8, 6]", "[8, 60]", "mine.toml: origin: "),
    ("reproduce", "[readings.default]", "[readings.plain]", "readings: accepted: one named def"),
    ("reproduce", '["S1", "S2"]', '["S1", "S4"]', "equal_pay: scenarios: S4: accepted: S1"),
    ("reproduce", "map_every = 1000", "map_every = 600", "map_every = 600: accepted: a multiple"),
    ("when", "axes.room.14x17", "axes.room.large", 'large.[key] = "large": accepted: a number of'),
    ("when", '"ppo, centred"]', '"ppo, central"]', "unknown learner ppo, central (did you mean"),
    ("sb3", 'title = "SB3\'s PPO"', 'title = "P\\nPO"', "accepted: text in one line"),
    ("sb3", 'title = "SB3\'s PPO"', 'title = "SB3\'s DQN"', "accepted: learners whose titles"),
    ("compare_deep", 'reference_for = "ppo"', 'reference_for = "sb3_dqn"', "unknown variant sb3_d"),
    ("sb3", '["index"]', '["one_hot"]', "unknown observation for q_learning one_hot; accepted: "),
    ("sb3", "n_steps = 500 ", "n_step = 500 ", "unknown key n_step (did you mean n_steps?)"),
    ("sb3", "time_limit = 200", "time_limits = 200", "unknown key time_limits (did you mean time"),
    ("sb3", "seeds = 10\nsettings", "seeds = 99_999\nsettings", "accepted: at most 100,000"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "old", "new", "expected"), MISTAKES)
def test_mistakes_get_one_line(
    tmp_path: Path, name: str, old: str, new: str, expected: str
) -> None:
    text = (EXPERIMENT_DIRECTORY / f"{name}.toml").read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(expected)):
        load_experiment(path)


EPSILON = {"settings": {"epsilon": 0.0}}
LIMIT = {"axes": {"limit": {"5": {"settings": {"time_limit": 5}}}}}
BUDGET = {"search": {"budget": RATE["learning_rate"]}}
UNUSED = [
    ({"settings": {"budget": 200, "epsilon": 0.1}, "own": EPSILON}, "settings.epsilon: no run"),
    ({"own": EPSILON, "grids": {"g": LIMIT | EPSILON}}, "table.settings.epsilon: no run has it"),
    ({"grids": {"g": LIMIT | {"settings": {"epsilon": 0.6}}}}, "grids.g.settings changes no run"),
    ({"grids": {"g": LIMIT | {"scenario": {"ping_limit": 5}}}}, "grids.g.scenario changes no run"),
    ({"grids": {"g": LIMIT | {"settings": {"time_limit": 9}}}}, "settings.time_limit is named"),
    ({"readings": {"default": ASKED | {"scenarios": ["S1"]}}}, "readings.default.scenarios ch"),
    ({"readings": {"default": ASKED}, "grids": {"g": LIMIT}}, "readings and grids: accepted: "),
    ({"solved": {}, "map_every": 200}, "map_every = 200: accepted: no such key"),
    ({"solved": {}, "report": "comparison", "map_every": None}, "solved in a comparison: acce"),
    ({"readings": {"default": ASKED}, "report": "map"}, "readings in a map: accepted: grids"),
    ({"own": {"search": RATE}}, "table.search: accepted: a table [search] beside it"),
    ({"search": SEARCH["search"]}, "algorithms.table: accepted: a table search, as the"),
    ({"search": SEARCH["search"], "own": BUDGET}, "search.budget: accepted: other"),
    ({"search": SEARCH["search"], "own": {"search": RATE, "first_seed": 9}}, "the seeds 10 to 12"),
    ({"own": {"reference_for": "table"}}, "reference_for: unknown variant table"),
    ({"own": {"observations": []}}, "table.observations: accepted: at least one form"),
    ({"evaluated_from": ["start"]}, "unknown key evaluated_from"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "expected"), UNUSED)
def test_what_nobody_would_read_is_refused(
    tmp_path: Path, changes: dict[str, Any], expected: str
) -> None:
    algorithms = {"table": variant() | changes.get("own", {})}
    rest = {key: value for key, value in changes.items() if key != "own"}
    with pytest.raises(InputError, match=rf"mine\.toml: .*{re.escape(expected)}"):
        made(tmp_path / "mine.toml", algorithms=algorithms, **rest)


@pytest.mark.parametrize("key", ["settings", "policy", "tuned_by"])
def test_a_reference_sets_nothing_that_it_takes(tmp_path: Path, key: str) -> None:
    own = {"settings": EPSILON["settings"], "policy": "greedy", "tuned_by": "tuning:dqn"}
    other = {"algorithm": "sarsa", "reference_for": "table", "seeds": 2, key: own[key]}
    with pytest.raises(InputError, match=rf"algorithms\.other\.{key}: .* takes it from table"):
        made(tmp_path / "mine.toml", algorithms={"table": variant(), "other": other})


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


def test_experiments_that_extend_themselves_are_refused(tmp_path: Path) -> None:
    (tmp_path / "first.toml").write_text("")
    with pytest.raises(InputError, match=r"extends = .*first\.toml\": accepted: another"):
        extended(tmp_path / "first.toml", "second.toml", x=extended_by(tmp_path))


def extended_by(folder: Path) -> int:
    """Writes an experiment that extends the first one."""
    text = 'extends = "first.toml"\ndescription = ""\nchanges = {}\n'
    return (folder / "second.toml").write_text(text)
