"""The command that writes the trained agent of a repeated run: it acts as the run was recorded to."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from stable_baselines3 import DQN, PPO

from agents.policy import mask_policy
from benchmark.__main__ import main
from benchmark.assessment import assess
from benchmark.execution import driver
from benchmark.execution.store import Record, Store
from benchmark.experiments import RunSpecification, load_experiment
from envs.observations import compile_seen, observation_table
from tests.support import ROOT, specifications

EXPERIMENT = """
description = "One learner of each kind."
scenarios = ["S1", "S3"]
horizon = 50
evaluation_every = 300
map_every = 600
settings = { budget = 600, time_limit = 50 }
algorithms.table = { algorithm = "watkins_q_lambda", observations = ["index"], seeds = 2 }
algorithms.tiles = { algorithm = "linear_q_lambda", observations = ["coordinates"], seeds = 2 }
algorithms.dqn = { algorithm = "compiled_dqn", observations = ["coordinates", "one_hot"], seeds = 2 }
algorithms.ppo = { algorithm = "compiled_ppo", observations = ["one_hot"], seeds = 2, settings.n_steps = 100 }
[algorithms.stock]
algorithm = "stable_baselines3:PPO"
observations = ["one_hot"]
seeds = 2
settings = { n_steps = 100 }
"""
LEARNERS = {"table": "index", "tiles": "coordinates", "dqn": "one_hot", "ppo": "one_hot", "stock": "one_hot"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an experiment, and its runs with seed 1 in S3, made as `run` does."""
    folder = tmp_path_factory.mktemp("export")
    (folder / "small.toml").write_text(EXPERIMENT, encoding="utf-8")
    with Store(folder / "runs.db") as store:
        assert driver.run([run_of(folder, name) for name in LEARNERS], store, 1) == []
    return folder


def run_of(folder: Path, variant: str) -> RunSpecification:
    experiment = load_experiment(folder / "small.toml")
    (run,) = specifications(experiment, "default", "S3", variant, LEARNERS[variant], [1])
    return run


def stored(folder: Path, variant: str) -> Record:
    with Store(folder / "runs.db", read_only=True) as store:
        return store.get([run_of(folder, variant).digest])[0]


def export(folder: Path, learner: str, file: str, *more: str) -> int:
    command = ["export", str(folder / "small.toml"), "--learner", learner, "--results", str(folder)]
    return main([*command, "--seed", "1", "--scenario", "S3", str(folder / file), *more])


def observations_of(run: RunSpecification) -> NDArray[Any]:
    return observation_table(compile_seen(run.scenario, run.observation), run.observation)


@pytest.mark.parametrize(("variant", "cls"), [("dqn", DQN), ("ppo", PPO), ("stock", PPO)])
def test_a_net_acts_in_stable_baselines3_as_recorded(folder: Path, variant: str, cls: Any) -> None:
    assert export(folder, f"{variant}, one_hot", f"{variant}.zip") == 0
    run, arrays = run_of(folder, variant), stored(folder, variant).arrays
    model = cls.load(folder / f"{variant}.zip")
    assert model.num_timesteps == 600
    assert json.loads(model.about)["digest"] == run.digest
    observations = observations_of(run)
    actions, _ = model.predict(observations, deterministic=True)
    assert (1 << actions == arrays["greedy"][-1]).all()
    tensor, _ = model.policy.obs_to_tensor(observations)
    if cls is DQN:
        assert model.q_net(tensor).detach().numpy() == pytest.approx(arrays["q"], abs=1e-5)
    else:
        probabilities = model.policy.get_distribution(tensor).distribution.probs.detach().numpy()
        assert probabilities == pytest.approx(arrays["stochastic"][-1], abs=1e-6)


def test_the_file_needs_none_of_this_project(folder: Path, tmp_path: Path) -> None:
    assert export(folder, "ppo", "alone.zip") == 0
    code = f"""
import sys
sys.path[:] = [path for path in sys.path if path != {str(ROOT)!r}]
sys.meta_path[:] = [finder for finder in sys.meta_path if "editable" not in str(finder)]
from stable_baselines3 import PPO
model = PPO.load({str(folder / "alone.zip")!r})
assert model.predict(model.observation_space.sample())[0] in range(5)
assert not {{"agents", "benchmark", "envs"}} & {{*sys.modules}}
"""
    done = subprocess.run([sys.executable, "-I", "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("variant", LEARNERS)
def test_tables_are_those_recorded(folder: Path, variant: str) -> None:
    assert export(folder, f"{variant}, {LEARNERS[variant]}", f"{variant}.npz") == 0
    run, arrays = run_of(folder, variant), stored(folder, variant).arrays
    with np.load(folder / f"{variant}.npz", allow_pickle=False) as file:
        assert json.loads(str(file["about"]))["seed"] == 1
        assert (file["observations"] == observations_of(run)).all()
        assert (file["greedy"] == mask_policy(arrays["greedy"][-1])).all()
        assert (file["q"] == arrays["q"]).all()
        assert (file["stochastic"] == arrays["stochastic"].reshape(-1, 5)).all()


def test_documented_reader(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    assert export(folder, "table", "table.npz", "--scenario", "S1") == 0
    guide = (ROOT / "benchmark" / "commands" / "README.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", guide, flags=re.DOTALL)
    read: dict[str, Any] = {}
    exec(code, read)
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


MISTAKES = {
    ("table", "table.zip"): "table.zip: accepted: a name that ends in .npz.",
    ("ppo", "ppo"): "ppo: accepted: a name that ends in .zip or .npz.",
    (
        "ppo, index",
        "ppo.zip",
    ): 'unknown learner ppo, index; accepted: "dqn, coordinates", "dqn, one_hot", "ppo',
    ("ppo", "ppo.zip", "--condition", "odd"): "ppo, one_hot: unknown condition odd; accepted: default.",
    ("ppo", "ppo.zip", "--seed", "-1"): "--seed",
}


@pytest.mark.parametrize(("arguments", "message"), MISTAKES.items())
def test_mistakes(
    folder: Path, arguments: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert export(folder, *arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
