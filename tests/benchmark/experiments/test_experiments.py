"""What experiments declare, which runs follow, and what is refused."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents import load_algorithm
from benchmark.experiments import Experiment, all_specifications, load_experiment
from benchmark.experiments.schema import EXPERIMENT_DIRECTORY, Declaration, experiment_names, read_experiment
from benchmark.studies import report_of
from envs import InputError, load_scenario
from envs.inputs import parse, read_toml
from tests.support import ROOT, specifications

SMALL = load_experiment("reproduce", smoke=True)
COMPARED = load_experiment("compare_deep", smoke=True)
LARGE = ("groups", "tuning_map", "tuning_tables")  # with the most conditions


def extended(tmp_path: Path, name: str, **changes: Any) -> Experiment:
    """Loads an extension of the miniature, written to a file; __ in a key stands for a dot."""
    lines = [f'"{key.replace("__", ".")}" = {json.dumps(value)}' for key, value in changes.items()]
    path = tmp_path / f"{name}.toml"
    path.write_text("\n".join(['extends = "reproduce"', 'description = ""', "[changes]", *lines]))
    return load_experiment(path)


# What is declared


def test_an_extension_takes_over_no_text_that_may_be_false_of_it(tmp_path: Path) -> None:
    path, change = tmp_path / "mine.toml", '"algorithms.dqn.algorithm" = "sb3_dqn"'
    path.write_text(f'extends = "compare_deep"\ndescription = "-"\nchanges = {{ {change} }}\n', "utf-8")
    mine = read_experiment(path)[0]
    assert mine.report is not None
    assert (mine.note, mine.report["question"], mine.algorithms["dqn"].title) == ("", "", "")
    assert mine.algorithms["ppo"].title == "compiled PPO"
    assert extended(tmp_path, "noted", note="mine").declared.note == "mine"


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LARGE)) for name in experiment_names()]
)
def test_shipped_experiments_are_sound_and_published_runs_are_theirs(name: str) -> None:
    experiment, manifest = load_experiment(name), ROOT / "results" / name / "manifest.json"
    report = report_of(experiment).check(is_drawn=False)
    digests = sorted(run.digest for run in all_specifications(experiment))
    assert len({*digests}) == len(digests)
    published = json.loads(manifest.read_text(encoding="utf-8")) if manifest.exists() else None
    if published and report.study.stages is not None:
        assert published["runs"] >= len(digests)  # of which these are the first
    elif published:
        digest = hashlib.sha256("".join(digests).encode()).hexdigest()
        assert (published["runs"], published["digest"]) == (len(digests), digest)


def test_reproduce_declares_what_the_paper_says() -> None:
    experiment = load_experiment("reproduce")
    runs = specifications(experiment, "default", "S1", "q_learning", "index")
    assert [run.seed for run in runs] == list(range(1000))  # ten times as many as the paper's 100
    settings = runs[0].settings.model_dump()
    defaults = load_algorithm("q_learning").settings().model_dump()
    assert settings | {"record_every": 1} == defaults
    assert settings["learning_rate"] == settings["epsilon"] == 0.6
    assert settings["discount"] == 0.9
    assert settings["budget"] == 10_000
    # Every alternative of the specification, one of which changes only what is measured.
    assert set(experiment.declared.readings) == {
        "default", "epsilon", "max_q", "ping_discomfort", "budget", "ties", "origin", "time_limit",
        "equal_pay",
    }  # fmt: skip
    others = specifications(experiment, "epsilon", "S1", "q_learning", "index")
    assert [run.seed for run in others] == list(range(100))
    # max_q measures runs of the default; the control changes S1 and S2.
    assert len(all_specifications(experiment)) == 3 * 1000 + 6 * 3 * 100 + 2 * 100


def test_a_notebook_shows_no_list_of_runs() -> None:
    assert len(repr(SMALL)) < 100


def test_runs_of_a_population_share_its_identity() -> None:
    first, second = specifications(SMALL, "default", "S1", "q_learning", "index", [7, 8])
    alone = specifications(SMALL, "default", "S1", "q_learning", "index", [8])[0]
    assert (second.seed, second.digest, second.population) == (8, alone.digest, first.population)
    assert json.loads(second.content) == json.loads(second.population) | {"seed": 8}


# Identity and random streams


def test_identity_is_content_and_streams_have_names() -> None:
    runs = all_specifications(SMALL)
    by_digest = {run.digest: run for run in runs}
    again = all_specifications(load_experiment("reproduce", smoke=True), range(1))
    assert {run.digest for run in again} < set(
        by_digest
    )  # fewer seeds are the same runs, and none is a position in a list
    states: dict[tuple[str, int], set[bytes]] = {}
    for run in runs:
        state = run.seed_sequence.generate_state(4, np.uint64).tobytes()
        states.setdefault((run.scenario.name, run.seed), set()).add(state)
    assert all(len(words) == 1 for words in states.values())  # readings share streams ...
    assert len(set.union(*states.values())) == len(states) == 3 * 4  # ... scenarios and seeds do not
    learners = all_specifications(COMPARED)
    assert len({str(run.seed_sequence.entropy) for run in learners}) == len(learners)  # nor do learners


def test_experiments_of_one_stream_share_runs(tmp_path: Path) -> None:
    runs = all_specifications(load_experiment("reproduce"), range(2))
    other = all_specifications(extended(tmp_path, "other"), range(4))
    shared = all_specifications(extended(tmp_path, "shared", stream="reproduce"), range(4))
    assert {run.digest for run in runs} < {run.digest for run in shared}
    assert {run.digest for run in runs}.isdisjoint(run.digest for run in other)
    states = [group[0].seed_sequence.generate_state(4).tolist() for group in (runs, shared, other)]
    assert states[0] == states[1] != states[2]


def test_a_reference_takes_settings_and_observations_from_its_variant() -> None:
    variants = load_experiment("compare_deep").declared.algorithms
    checks = [variant for variant in variants.values() if variant.reference_for]
    assert len(checks) == 7
    for check in checks:
        checked = variants[check.reference_for]
        for key in ("settings", "policy"):
            assert getattr(check, key) == getattr(checked, key)
        assert {*check.observations} <= {*checked.observations}
        assert check.algorithm == checked.algorithm.replace("compiled_", "sb3_")


@pytest.mark.parametrize(("given", "of_30", "of_5"), [(1, 1, 1), (10, 3, 2), (35, 10, 2), (100, 30, 5)])
def test_a_reference_has_its_share_of_given_seeds_or_two(given: int, of_30: int, of_5: int) -> None:
    full = load_experiment("compare_deep")
    seeds: dict[str, set[int]] = {}
    for run in all_specifications(full, range(given)):
        seeds.setdefault(run.variant, set()).add(run.seed)
    for name, n in {"q_learning": given, "dqn": given, "sb3_ppo": of_30, "sb3_dqn_linear": of_5}.items():
        assert seeds[name] == set(range(n))


def test_first_runs_are_of_all_populations_and_each_has_a_folder() -> None:
    runs = all_specifications(COMPARED)
    first = runs[: len(COMPARED.populations)]
    assert {run.population for run in first} == {each.first.population for each in COMPARED.populations}
    assert {run.seed for run in first} == {400}
    assert len({run.folder for run in runs}) == len(runs)
    assert first[0].folder == "compare_deep_smoke/S1/q_learning_index/seed_400"


# Mistakes


MARGINS = "margins = { success = 0.1, score"
READINGS, ALL = "[readings.default]", "[grids.all.axes]\n"  # a grid is put before readings
OF_A_REPLICATION = [
    ("seeds = 100 ", "seeds = 0 ", "algorithms.q_learning.seeds = 0: input should be greater than"),
    ("seeds = 1000", "seeds = 1", "readings.default.seeds = 1: input should be greater than"),
    ("seeds = 100 ", "sedes = 6 ", "[algorithms.q_learning]: unknown key sedes (did you mean seeds?)"),
    ("epsilon = 0.6 ", "epsilon = 6.0 ", "algorithms.q_learning.settings: epsilon = 6.0"),
    ("epsilon = 0.4", "epsilon = -1.0", "readings.epsilon.settings: epsilon = -1.0"),
    ('"S1", "S2"', '"S1", "S7"', "mine.toml: scenarios: unknown scenario S7"),
    ('"q_learning"\nobs', '"q_lerning"\nobs', "unknown algorithm q_lerning (did you mean q_learning?)"),
    ("[8, 6]", "[8, 60]", "mine.toml: readings.origin.scenario: "),
    ('answer = "by the lowest index"', 'answer = ""', "readings.ties.answer"),
    ("[readings.default]", "[readings.plain]", "the table readings.default is missing"),
    ('["S1", "S2"]', '["S1", "S4"]', "readings.equal_pay.scenarios: unknown scenario S4"),
    ('"S2", "S3"]', '"S2", "S2"]', "scenarios: S2 is named twice"),
    ("map_every = 1000", "map_every = 600", "map_every = 600: accepted: a multiple of evaluation_every"),
    ("horizon = 200", 'name = "x"\nhorizon = 200', "unknown key name"),
    ("horizon = 200", 'stream = "../x"\nhorizon = 200', 'stream = "../x": accepted: a name of'),
    (READINGS, f"{ALL}rate = {{}}\n{READINGS}", "grids.all.axes.rate = {}: "),
    (READINGS, f"{ALL}rate.low.setting = {{}}\n{READINGS}", "[grids.all.axes.rate.low]: unknown key setting"),
    (READINGS, f"{ALL}rate.'a b' = {{}}\n{READINGS}", "accepted: a name or a number"),
    (READINGS, f"{ALL}rate.low.settings.epsilon = 2.0\n{READINGS}", "axes.rate.low.settings: epsilon = 2.0"),
    (READINGS, f"{ALL}pay.low.scenario.ping_limit = 0\n{READINGS}", "grids.all.axes.pay.low.scenario: "),
]
LINEAR = 'reference_for = "dqn_linear"'
OF_A_COMPARISON = [
    ('title = "compiled PPO"', 'title = "P\\nPO"', 'ppo.title = "P\\nPO": accepted: text in one line'),
    ('reference_for = "ppo"', 'reference_for = "sb3_dqn"', "sb3_ppo: reference_for: unknown variant sb3_dqn"),
    (MARGINS, "margins = { success = 0.21, score", "success = 0.21: input should be less than"),
    ('["index"]', '["one_hot"]', "unknown observation for q_learning one_hot; accepted: index, offset"),
    ("n_steps = 2000 #", "n_step = 2000 #", "unknown key n_step (did you mean n_steps?)"),
    (LINEAR, f'{LINEAR}\nobservations = ["coordinates"]', "dqn_linear does not learn from coordinates"),
    (
        f"""{LINEAR}\ntitle = "SB3's linear DQN on one-hot cells"\nalgorithm = "sb3_dqn\"""",
        f'{LINEAR}\nalgorithm = "sb3_ppo"',
        "algorithms.sb3_dqn_linear.settings",
    ),
    ('title = "compiled PPO"', 'family = "tabular"', "[algorithms.ppo]: unknown key family"),
    ("budget = 10000", "budget = 9999", "budget = 9999 is not a whole number of rollouts"),
    ('"every_cell"]', '"anywhere"]', "evaluated_from"),
    ("time_limit = 200", "time_limits = 200", "[settings], which q_learning shares: unknown key time_limits"),
]


@pytest.mark.parametrize(
    ("experiment", "old", "new", "expected"),
    [("reproduce", *mistake) for mistake in OF_A_REPLICATION]
    + [("compare_deep", *mistake) for mistake in OF_A_COMPARISON],
)
def test_mistakes_get_one_line(tmp_path: Path, experiment: str, old: str, new: str, expected: str) -> None:
    text = (EXPERIMENT_DIRECTORY / f"{experiment}.toml").read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(expected)):
        report_of(load_experiment(path))


NOT_NAMES = [
    "", "_x", "-x", ".", "..", "a.b", "a b", "a/b", "../../x", "a=b", "=1+1", "a|b", "a&b", "$x$", "<b>",
    "a,b", "é", "x\n", "1", "007", "1e5", "nan", "NA", "Null", "inf", "true", "x" * 61, "x.", "x ",
]  # fmt: skip


@pytest.mark.parametrize("name", NOT_NAMES)
def test_what_is_no_name_is_refused_in_a_sentence(name: str) -> None:
    for table in ("algorithms", "readings", "grids"):
        tables = read_toml(EXPERIMENT_DIRECTORY / "reproduce.toml")
        del tables["report"]
        tables["grids"] = {"all": {"axes": {"axis": {"low": {}}}}}
        named = tables[table]
        named[name] = next(iter(named.values()))
        with pytest.raises(InputError, match=rf"^mine\.toml: (the key )?{table}\..*accepted: "):
            parse(Declaration, tables, "mine.toml", name="mine")


@pytest.mark.parametrize("name", ["x" * 60, "9-x", "a-b_c", "NAN0", "1-2", "e5", "com10", "console"])
def test_other_names_are_those_of_runs_and_their_folders(tmp_path: Path, name: str) -> None:
    changes: dict[str, Any] = {
        f"algorithms__{name}__algorithm": "q_learning",
        f"algorithms__{name}__observations": ["index"],
        f"algorithms__{name}__seeds": 1,
        f"readings__{name}__question": "a",
        f"readings__{name}__answer": "b",
        f"grids__{name}__axes__{name}__{name}__settings__budget": 800,
    }
    experiment = extended(tmp_path, name, stream=name, **changes)
    condition = f"{name}/{name}/{name}={name}"
    run, *_ = specifications(experiment, condition, "S1", name, "index")
    assert run.folder == f"{name}/S1/{name}_index/{condition}/seed_0"


@pytest.mark.parametrize("stem", ["..", "a.b", "2024", "reproduce", "speed", "a_smoke", "a_seeds_0-9"])
def test_results_have_no_folder_of_others(tmp_path: Path, stem: str) -> None:
    with pytest.raises(InputError, match="results are named after the"):
        extended(tmp_path, stem)


@pytest.mark.parametrize("text", ["\x1b[2J", "x" * 10_001], ids=["control", "endless"])
@pytest.mark.parametrize("key", ["description", "report__question", "readings__ties__answer", "note"])
def test_endless_texts_and_control_characters_are_refused(tmp_path: Path, key: str, text: str) -> None:
    with pytest.raises(InputError, match=r"control characters|at most (200|10000) characters"):
        report_of(extended(tmp_path, "mine", **{key: text}))


def test_experiments_that_extend_themselves_are_refused(tmp_path: Path) -> None:
    for name, base in (("first", "second"), ("second", "first")):
        text = f'extends = "{tmp_path}/{base}.toml"\ndescription = ""\nchanges = {{}}\n'
        (tmp_path / f"{name}.toml").write_text(text)
    with pytest.raises(InputError, match=r"second\.toml: extends = .*first\.toml\": it extends itself"):
        load_experiment(tmp_path / "first.toml")


@pytest.mark.parametrize(
    ("grid", "name"), [("strangers", "TwoStrangers"), ("two", "TwoTalking"), ("three", "ThreeTalking")]
)
def test_grids_of_groups_have_the_people_of_the_shipped_scenes(grid: str, name: str) -> None:
    every = load_experiment("groups").populations
    found = next(each.scenario for each in every if each.condition.axes.get("grid") == grid)
    for key in ("grid", "group", "regions", "rewards", "observe", "ping_limit"):
        assert getattr(found, key) == getattr(load_scenario(name), key)
