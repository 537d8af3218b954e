"""The command that writes the trained agent of a repeated run: it acts as the run was recorded to."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stable_baselines3 import DQN, PPO

from agents.policy import mask_policy
from benchmark.__main__ import main
from benchmark.assessment import assess
from benchmark.execution import driver
from benchmark.execution.executors import Threads
from benchmark.execution.store import Record, Store
from benchmark.experiments import RunSpecification, load_experiment
from tests.support import ROOT, specifications

EXPERIMENT = """
description = "One learner of each kind."
scenarios = ["S1", "S3"]
horizon = 50
evaluation_every = 300
map_every = 600
settings = { budget = 600, time_limit = 50 }
algorithms.tiles = { algorithm = "linear_q_lambda", observations = ["coordinates"], seeds = 2 }
algorithms.dqn = { algorithm = "compiled_dqn", observations = ["coordinates", "one_hot"], seeds = 2 }
algorithms.ppo = { algorithm = "compiled_ppo", observations = ["one_hot"], seeds = 2, settings.n_steps = 100 }
algorithms.table = { algorithm = "q_learning", observations = ["index"], seeds = 2 }
algorithms.stock = { algorithm = "ALGORITHM", observations = ["one_hot"], seeds = 2, settings.n_steps = 100 }
""".replace("ALGORITHM", "stable_baselines3:PPO")
COMPILED = ("tiles", "dqn", "ppo", "table")  # which are trained in threads
LEARNERS = {"tiles": "coordinates", "dqn": "one_hot", "ppo": "one_hot", "table": "index", "stock": "one_hot"}


def run_of(folder: Path, variant: str) -> RunSpecification:
    experiment = load_experiment(folder / "small.toml")
    return specifications(experiment, "default", "S3", variant, LEARNERS[variant], [1])[0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an experiment, and the compiled runs with seed 1 in S3, made as `run` does."""
    folder = tmp_path_factory.mktemp("export")
    (folder / "small.toml").write_text(EXPERIMENT, encoding="utf-8")
    with Store(folder / "runs.db") as store:
        assert driver.run([run_of(folder, name) for name in COMPILED], store, 1) == []
    return folder


@pytest.fixture(autouse=True)
def in_this_process(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Repeats runs in this process, as starting one takes seconds, unless a test is slow anyway."""
    if not request.node.get_closest_marker("slow"):
        monkeypatch.setattr("benchmark.commands.export.Processes", Threads)


def stored(folder: Path, variant: str) -> Record:
    with Store(folder / "runs.db", read_only=True) as store:
        return store.get([run_of(folder, variant).digest])[0]


def export(folder: Path, learner: str, file: str, *more: str) -> int:
    command = ["export", str(folder / "small.toml"), "--learner", learner, "--results", str(folder)]
    return main([*command, "--seed", "1", "--scenario", "S3", str(folder / file), *more])


@pytest.mark.parametrize("variant", [*COMPILED, pytest.param("stock", marks=pytest.mark.slow)])
def test_files_act_as_recorded(folder: Path, variant: str) -> None:
    name, run = f"{variant}, one_hot", run_of(folder, variant)
    with Store(folder / "runs.db") as store:
        assert driver.run([run], store, 1) == []  # in a process, unless it is there
    arrays = stored(folder, variant).arrays
    assert export(folder, f"{variant}, {run.observation}", f"{variant}.npz") == 0
    with np.load(folder / f"{variant}.npz", allow_pickle=False) as file:
        assert json.loads(str(file["about"]))["digest"] == run.digest
        assert (file["greedy"] == mask_policy(arrays["greedy"][-1])).all()
        assert (file["q"] == arrays["q"]).all()
        assert (file["stochastic"] == arrays["stochastic"].reshape(-1, 5)).all()
        observations = file["observations"]
    if variant in ("tiles", "table"):
        return
    assert export(folder, name, f"{variant}.zip") == 0
    model: Any = (DQN if variant == "dqn" else PPO).load(folder / f"{variant}.zip")
    assert (model.num_timesteps, json.loads(model.about)["digest"]) == (600, run.digest)
    assert (1 << model.predict(observations, deterministic=True)[0] == arrays["greedy"][-1]).all()
    tensor, _ = model.policy.obs_to_tensor(observations)
    if variant == "dqn":
        assert model.q_net(tensor).detach().numpy() == pytest.approx(arrays["q"], abs=1e-5)
    else:
        probabilities = model.policy.get_distribution(tensor).distribution.probs.detach().numpy()
        assert probabilities == pytest.approx(arrays["stochastic"][-1], abs=1e-6)


def test_documented_reader(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    assert export(folder, "table", "table.npz", "--scenario", "S1") == 0
    guide = (ROOT / "benchmark" / "commands" / "README.md").read_text(encoding="utf-8")
    read: dict[str, Any] = {}
    exec(re.findall(r"```python\n(.*?)```", guide, flags=re.DOTALL)[1], read)
    assert read["is_over"]
    policy = assess(read["act"], scenario="S1", observation="index").policy
    assert policy == pytest.approx(np.load("table.npz")["greedy"])


def test_a_different_run_is_not_written(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record = stored(folder, "tiles")
    forged = Record(**vars(record) | {"arrays": {**record.arrays, "q": record.arrays["q"] + 1}})
    for kept, code in ((forged, 2), (record, 0)):
        with Store(folder / "runs.db") as store:
            store.add([kept])
        assert export(folder, "tiles", "other.npz") == code
        assert (folder / "other.npz").exists() == (code == 0)
    assert "not written, since the repeated run differs in q." in capsys.readouterr().err
    assert [*folder.glob(".making*")] == []
