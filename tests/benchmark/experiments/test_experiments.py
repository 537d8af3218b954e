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
from benchmark.experiments.schema import EXPERIMENT_DIRECTORY, experiment_names, read_experiment
from benchmark.studies import report_of
from envs import InputError, load_scenario
from tests.support import ROOT, specifications

SMALL = load_experiment("reproduce", smoke=True)
COMPARED = load_experiment("compare_deep", smoke=True)
LARGE = ("groups", "tuning_map", "tuning_tables")  # with the most conditions


def extended(tmp_path: Path, name: str, **changes: Any) -> Experiment:
    """Loads an extension of the replication, written to a file; __ in a key stands for a dot."""
    lines = [f'"{key.replace("__", ".")}" = {json.dumps(value)}' for key, value in changes.items()]
    path = tmp_path / f"{name}.toml"
    path.write_text("\n".join(['extends = "reproduce"', 'description = ""', "[changes]", *lines]))
    return load_experiment(path)


# What is declared


def test_an_extension_takes_over_no_text_that_may_be_false_of_it(tmp_path: Path) -> None:
    path, change = tmp_path / "mine.toml", '"algorithms.dqn.seeds" = 3'
    path.write_text(f'extends = "compare_deep"\ndescription = "-"\nchanges = {{ {change} }}\n', "utf-8")
    mine = read_experiment(path)[0]
    assert mine.report is not None
    assert (mine.note, mine.report["question"], mine.algorithms["dqn"].seeds) == ("", "", 3)
    assert extended(tmp_path, "noted", note="mine").declared.note == "mine"


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LARGE)) for name in experiment_names()]
)
def test_shipped_experiments_are_sound_and_published_runs_are_theirs(name: str) -> None:
    experiment, manifest = load_experiment(name), ROOT / "results" / name / "manifest.json"
    report = report_of(experiment).check(is_drawn=False)
    digests = sorted(run.digest for run in all_specifications(experiment))
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
    others = specifications(experiment, "epsilon", "S1", "q_learning", "index")
    assert [run.seed for run in others] == list(range(100))
    # max_q measures runs of the default; the control changes S1 and S2.
    assert len(all_specifications(experiment)) == 3 * 1000 + 6 * 3 * 100 + 2 * 100


def test_a_miniature_has_two_runs_of_each_learner_and_a_small_budget() -> None:
    runs = all_specifications(COMPARED)
    assert {len(population.seeds) for population in COMPARED.populations} == {2}
    assert {run.settings.budget for run in runs} == {400}  # of 10,000
    assert {run.folder.partition("/")[0] for run in runs} == {"compare_deep_smoke"}
    assert (COMPARED.name, COMPARED.argument) == ("compare_deep_smoke", "compare_deep --smoke")
    assert "mean nothing" in COMPARED.declared.note


# Identity and random streams


def test_identity_is_content_and_streams_have_names() -> None:
    runs = all_specifications(SMALL)
    again = all_specifications(load_experiment("reproduce", smoke=True), range(1))
    # Fewer seeds are the same runs: none is a position in a list.
    assert {run.digest for run in again} < {run.digest for run in runs}
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


@pytest.mark.parametrize(("given", "of_30", "of_5"), [(1, 1, 1), (35, 10, 2), (100, 30, 5)])
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
    assert len({run.folder for run in runs}) == len(runs)
    assert first[0].folder == "compare_deep_smoke/S1/q_learning_index/seed_400"


# Mistakes


READING = 'readings.default = { question = "a", answer = "b" }\n'
MISTAKES = [
    ("reproduce", "seeds = 100 ", "seeds = 0 ", "algorithms.q_learning.seeds = 0: input should be greater"),
    ("reproduce", "seeds = 100 ", "sedes = 6 ", "[algorithms.q_learning]: unknown key sedes (did you mean s"),
    ("reproduce", "epsilon = 0.4", "epsilon = -1.0", "q_learning.settings (epsilon): epsilon = -1.0"),
    ("reproduce", '"S1", "S2"', '"S1", "S7"', "mine.toml: scenarios: unknown scenario S7"),
    ("reproduce", '"q_learning"\nobs', '"q_lerning"\nobs', "unknown algorithm q_lerning (did you mean q_l"),
    ("reproduce", "[8, 6]", "[8, 60]", "mine.toml: readings.origin.scenario: "),
    ("reproduce", "[readings.default]", "[readings.plain]", "readings: accepted: one named default among"),
    ("reproduce", '["S1", "S2"]', '["S1", "S4"]', "readings.equal_pay.scenarios: S4: accepted: S1"),
    ("reproduce", "map_every = 1000", "map_every = 600", "map_every = 600: accepted: a multiple of eval"),
    ("when", "axes.room.14x17", "axes.room.large", 'large.[key] = "large": accepted: a number of'),
    ("when", "horizon", f"{READING}horizon", "readings and grids: accepted: one of readings"),
    ("compare_deep", 'title = "compiled PPO"', 'title = "P\\nPO"', "accepted: text in one line"),
    ("compare_deep", 'reference_for = "ppo"', 'reference_for = "sb3_dqn"', "unknown variant sb3_dqn"),
    ("compare_deep", '["index"]', '["one_hot"]', "unknown observation for q_learning one_hot; accepted: "),
    ("compare_deep", "n_steps = 2000 #", "n_step = 2000 #", "unknown key n_step (did you mean n_steps?)"),
    ("compare_deep", "budget = 10000", "budget = 9999", "budget = 9999 is not a whole number of rollouts"),
    (
        "compare_deep",
        "time_limit = 200",
        "time_limits = 200",
        "unknown key time_limits (did you mean time_limit?)",
    ),
]


@pytest.mark.parametrize(("experiment", "old", "new", "expected"), MISTAKES)
def test_mistakes_get_one_line(tmp_path: Path, experiment: str, old: str, new: str, expected: str) -> None:
    text = (EXPERIMENT_DIRECTORY / f"{experiment}.toml").read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(expected)):
        report_of(load_experiment(path))


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
        extended(tmp_path, stem)


def test_experiments_that_extend_themselves_are_refused(tmp_path: Path) -> None:
    for name, base in (("first", "second"), ("second", "first")):
        text = f'extends = "{tmp_path}/{base}.toml"\ndescription = ""\nchanges = {{}}\n'
        (tmp_path / f"{name}.toml").write_text(text)
    with pytest.raises(InputError, match=r"second\.toml: extends = .*first\.toml\": accepted: another"):
        load_experiment(tmp_path / "first.toml")


@pytest.mark.parametrize(
    ("grid", "name"), [("strangers", "TwoStrangers"), ("two", "TwoTalking"), ("three", "ThreeTalking")]
)
def test_grids_of_groups_have_the_people_of_the_shipped_scenes(grid: str, name: str) -> None:
    every = load_experiment("groups").populations
    found = next(each.scenario for each in every if each.condition.axes.get("grid") == grid)
    for key in ("grid", "group", "regions", "rewards", "observe", "ping_limit"):
        assert getattr(found, key) == getattr(load_scenario(name), key)
