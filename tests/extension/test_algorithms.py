"""Algorithms from outside: an update rule, a module beside the experiment, classes like SB3's."""

import json
import linecache
import os
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import pytest
from sb3_contrib import QRDQN

from agents import load_algorithm
from agents.tabular.kernel import compile_kernel
from benchmark.experiment import load_experiment
from benchmark.job import execute_job
from benchmark.run import execute
from benchmark.store import Store
from tests.support import ROOT, all_specifications, arrays_of, small_experiment, variant


class Scaled(QRDQN):
    """QR-DQN with scaled rewards."""

    def __init__(self, *args: Any, scale: float = 1.0, **kwargs: Any) -> None:
        self.scale = scale
        super().__init__(*args, **kwargs)

    def _store_transition(
        self,
        replay_buffer: Any,
        buffer_action: Any,
        new_obs: Any,
        reward: Any,
        dones: Any,
        infos: Any,
    ) -> None:
        super()._store_transition(
            replay_buffer, buffer_action, new_obs, self.scale * reward, dones, infos
        )


TRPO = {"n_steps": 50, "batch_size": 50, "policy_kwargs": {"net_arch": [16]}}
SCALED = {"train_freq": 8, "scale": 0.5}
EXPERIMENT = small_experiment(
    scenarios=["S2"],
    evaluation_every=200,
    map_every=400,
    settings={"budget": 400, "time_limit": 30},
    algorithms={
        "trpo": variant("sb3_contrib:TRPO", "one_hot", seeds=1, settings=TRPO),
        "scaled": variant(f"{__name__}:Scaled", "coordinates", seeds=1, settings=SCALED),
    },
)


@pytest.mark.slow
def test_experiments_run_classes_like_those_of_sb3(tmp_path: Path) -> None:
    path = tmp_path / "outside.toml"
    path.write_text(EXPERIMENT, encoding="utf-8")
    runs = all_specifications(load_experiment(path))
    with Store(tmp_path / "runs.db") as store:
        assert execute(runs, store, jobs=1) == []
        records = store.get([specification.digest for specification in runs])
    learned = {}
    for specification, record in zip(runs, records, strict=True):
        # A record holds what training alone gives, and settings that can be read back.
        assert arrays_of([record]) == arrays_of(execute_job([specification]))
        settings = json.loads(record.specification)["settings"]
        cls = load_algorithm(specification.algorithm).settings
        assert cls.model_validate_json(json.dumps(settings)).model_dump(mode="json") == settings
        learned[specification.variant] = record.arrays
    assert learned["trpo"]["parameters"] == 2 * (120 * 16 + 16) + (16 * 5 + 5) + (16 + 1)
    assert learned["scaled"]["updates"] == (400 - 104) / 8 + 1


RULE = """
from agents.tabular.kernel import compile_kernel
from agents.tabular.learner import Settings, TabularAlgorithm
from agents.tabular.updates import UpdateRule
from agents import Schedule
from envs import compile_scenario, load_scenario
from numpy.random import SeedSequence
SHARE = 1.0
def shared(after): return SHARE * after.highest
rule = UpdateRule(shared)
model = compile_scenario(load_scenario("S1"))
settings, seeds = Settings(budget=2000), [SeedSequence(0)]
training = TabularAlgorithm(rule).train(model, settings, "index", seeds, Schedule(2000))
stats = compile_kernel(rule).stats
result = sum(stats.cache_hits.values()), training.q.sum()
"""


@pytest.mark.slow
def test_compiled_rules_are_compiled_anew_in_every_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    script = tmp_path / "rule.py"

    def result(text: str) -> Any:
        script.write_text(text, encoding="utf-8")
        compile_kernel.cache_clear()  # as in a new process
        linecache.checkcache()
        return runpy.run_path(str(script))["result"]

    compiled, loaded, changed = result(RULE), result(RULE), result(RULE.replace("1.0", "0.5"))
    assert [compiled[0], loaded[0], changed[0]] == [0, 0, 0]
    assert compiled[1] == loaded[1] != changed[1]


BESIDE = "import helper_of_mine\nfrom tests.agents.plain import Q_LEARNING as LEARNER\n"
OF_MODULE_BESIDE = small_experiment(
    algorithms={"beside": variant("beside_mine:LEARNER"), "table": variant()}
)


@pytest.mark.slow
def test_runs_depend_on_the_module_beside_the_experiment(tmp_path: Path) -> None:
    (tmp_path / "beside_mine.py").write_text(BESIDE, encoding="utf-8")
    (tmp_path / "helper_of_mine.py").write_text("SHARE = 0.5", encoding="utf-8")
    (tmp_path / "mine.toml").write_text(OF_MODULE_BESIDE, encoding="utf-8")
    (tmp_path / "elsewhere").mkdir()
    command = [sys.executable, "-m", "benchmark", "run", "../mine.toml", "--jobs", "1"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}

    def run_again() -> str:
        done = subprocess.run(
            command, cwd=tmp_path / "elsewhere", env=environment, capture_output=True, text=True
        )
        return done.stdout + done.stderr * bool(done.returncode)

    assert run_again().startswith("mine: 4 runs done, 0 were done already.\n")
    (tmp_path / "helper_of_mine.py").write_text("SHARE = 0.75", encoding="utf-8")
    assert run_again().startswith("mine: 2 runs done, 2 were done already.\n")
