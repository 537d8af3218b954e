"""A run's identity, random stream, schedule, and when it has learned."""

import hashlib
import json
import re
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from benchmark.experiment import load_experiment
from benchmark.specification import evaluation_steps, solved
from envs import InputError, load_scenario
from envs.scenario import SCENARIO_DIRECTORY
from tests.support import made, small_experiment, variant

RUN = load_experiment("reproduce").populations[0].first  # of Q-learning in S1


def test_an_identity_is_the_digest_of_all_that_a_result_depends_on() -> None:
    content = json.loads(RUN.content)
    assert RUN.digest == hashlib.sha256(RUN.content.encode()).hexdigest()
    assert content["seed"] == 0
    assert content["scenario"] == load_scenario("S1").model_dump(mode="json")
    assert content["settings"]["learning_rate"] == 0.6
    others = [
        RUN.with_seed(1),
        replace(RUN, stream="other"),
        replace(RUN, horizon=100),
        replace(RUN, map_every=4000),
        replace(RUN, versions={**RUN.versions, "model": 99}),
        replace(RUN, settings=RUN.settings.model_copy(update={"epsilon": 0.5})),
        replace(RUN, scenario=load_scenario("S1", {"rewards.other": -0.2})),
    ]
    assert len({RUN.digest, *(run.digest for run in others)}) == 8
    assert replace(RUN, condition="other").digest == RUN.digest
    assert replace(RUN, seed=1).digest == others[0].digest


def test_random_streams_follow_from_names() -> None:
    names = json.dumps(["reproduce", "S1", "q_learning", "index", 3])
    entropy = int.from_bytes(hashlib.sha256(names.encode()).digest())
    expected = np.random.SeedSequence(entropy).generate_state(4)
    run = replace(RUN.with_seed(3), scenario=load_scenario("S1", {"rewards.other": -0.2}))
    assert run.seed_sequence.generate_state(4).tolist() == expected.tolist()


def test_values_are_recorded_unless_only_curves_are() -> None:
    run = replace(RUN, settings=RUN.settings.model_copy(update={"budget": 500}))
    assert run.schedule.evaluation_steps == (0, 250, 500)
    assert run.schedule.map_steps == (0, 500)
    until = replace(run, evaluation_every=100, solved={"growth": 2.0})
    assert until.schedule.evaluation_steps == (0, 100, 200, 400, 500)
    assert until.schedule.map_steps == ()
    model = 120 * (3 + 4 * 5 * 2)  # cells, evaluations, and values of actions on two maps
    assert run.record_size == model


@pytest.mark.parametrize(("every", "growth"), [(1, 1.15), (100, 1.3), (7, 2.0), (250, 1.0)])
def test_evaluations_grow_apart(every: int, growth: float) -> None:
    steps = evaluation_steps(10_000, every, growth)
    assert (steps[0], steps[1], steps[-1]) == (0, every, 10_000)
    assert all(step % every == 0 for step in steps[:-1])
    for earlier, later in pairwise(steps[1:-1]):
        assert max(growth * earlier, earlier + every) <= later <= growth * earlier + every


def test_a_run_has_learned_if_it_stays_until_twice_as_many_steps() -> None:
    """Against the definition, tried at every evaluation."""
    generator = np.random.default_rng(1)
    steps = [0, 100, 200, 300, 500, 800, 1200]
    for _ in range(300):
        curve = generator.choice([0.5, 0.9, 1.0], len(steps), p=[0.3, 0.3, 0.4]).tolist()
        found, is_final = solved(curve, steps, 0.9)
        for first, step in enumerate(steps):
            end = next((i for i, s in enumerate(steps) if s >= 2 * step and i > first), None)
            if min(curve[first : None if end is None else end + 1]) >= 0.9:
                assert (found, is_final) == (first, end is not None)
                break
        else:
            assert (found, is_final) == (len(steps), False)


def test_no_module_is_imported_that_only_a_text_names(tmp_path: Path) -> None:
    """Neither in a description, nor beside a file that `bench` wrote among results."""
    text = small_experiment(scenarios=["told.toml"])
    scenario = (SCENARIO_DIRECTORY / "S1.toml").read_text(encoding="utf-8")
    told = re.sub('description = ".*"', 'description = "this.q:x"', scenario)
    (tmp_path / "told.toml").write_text(told, encoding="utf-8")
    assert made(tmp_path / "mine.toml", text).populations[0].first.digest
    assert "this" not in sys.modules
    (folder := tmp_path / "bench_Mine").mkdir()
    (folder / "stranger.py").write_text("import this", encoding="utf-8")
    text = small_experiment(algorithms={"mine": variant("stranger:Mine")})
    with pytest.raises(InputError, match="No module named 'stranger'"):
        made(folder / "bench_Mine.toml", text)
