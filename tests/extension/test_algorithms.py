"""Algorithms from outside: two tabular update rules, and algorithms of or like Stable-Baselines3's."""

import json
import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import pytest
from numpy.random import SeedSequence
from numpy.typing import NDArray
from pydantic import Field
from sb3_contrib import QRDQN

from agents import Schedule, load_algorithm
from agents.sb3.algorithms import Sb3Algorithm
from agents.sb3.method import Method
from agents.sb3.settings import Sb3Settings
from agents.tabular.learner import Settings, TabularAlgorithm
from agents.tabular.updates import Successor, UpdateRule
from benchmark.execution.driver import run
from benchmark.execution.store import Record, Store
from benchmark.experiments import RunSpecification, all_specifications, load_experiment
from envs import ACTIONS, InputError, Model, compile_scenario, load_scenario
from tests.agents.words import choose, uniform, words


def next_value(after: Successor) -> float:
    """Returns the value of the next action (Sutton & Barto 2018, section 6.4)."""
    return float(after.q[after.observation, after.action])


def expected_value(after: Successor) -> float:
    """Returns the expected value of the next action (Sutton & Barto 2018, section 6.6)."""
    mean = after.q[after.observation].mean()
    return float(after.epsilon * mean + (1 - after.epsilon) * after.highest)


SARSA: Final = TabularAlgorithm(UpdateRule(next_value, is_on_policy=True))
EXPECTED_SARSA: Final = TabularAlgorithm(UpdateRule(expected_value))


class A2cSettings(Sb3Settings):
    """An argument of SB3's A2C, and its default."""

    n_steps: Annotated[int, Field(ge=1, le=10**9)] = 5

    @property
    def rollout(self) -> int:
        """`n_steps` of every env."""
        return self.n_steps * self.n_envs


A2C: Final = Sb3Algorithm(Method("stable_baselines3:A2C", A2cSettings))


class Scaled(QRDQN):
    """QR-DQN with scaled rewards."""

    def __init__(self, *args: Any, scale: float = 1.0, **kwargs: Any) -> None:
        self.scale = scale
        super().__init__(*args, **kwargs)

    def _store_transition(
        self, replay_buffer: Any, buffer_action: Any, new_obs: Any, reward: Any, dones: Any, infos: Any
    ) -> None:
        super()._store_transition(replay_buffer, buffer_action, new_obs, self.scale * reward, dones, infos)


EXPERIMENT = f"""
description = "Algorithms from outside."
report = "comparison"
scenarios = ["S2"]
horizon = 50
evaluation_every = 200
map_every = 400

[settings]
budget = 400
time_limit = 30

[algorithms.sarsa]
algorithm = "{__name__}:SARSA"
observations = ["index"]
seeds = 3
settings = {{ record_every = 400 }}

[algorithms.expected_sarsa]
algorithm = "{__name__}:EXPECTED_SARSA"
observations = ["index"]
seeds = 3
settings = {{ record_every = 400, epsilon = 0.2 }}

[algorithms.a2c]
algorithm = "{__name__}:A2C"
observations = ["coordinates"]
seeds = 1
settings = {{ n_steps = 10, gamma = 0.9 }}

[algorithms.trpo]
algorithm = "sb3_contrib:TRPO"
observations = ["one_hot"]
seeds = 2
settings = {{ n_steps = 50, batch_size = 50, policy_kwargs = {{ net_arch = [16] }} }}

[algorithms.scaled]
algorithm = "{__name__}:Scaled"
observations = ["coordinates"]
seeds = 1
settings = {{ train_freq = [8, "step"], scale = 0.5 }}
"""


def textbook_sarsa(model: Model, settings: Settings, seed: SeedSequence) -> NDArray[np.float64]:
    """Learns action values by the algorithm in the box of section 6.4, from the words of a seed."""
    stream = words(seed)
    q = np.zeros((model.n_observations, len(ACTIONS)))

    def choose_in(state: int) -> int:
        values = q[model.observation[state]]
        greedy = [action for action in range(5) if values[action] == values.max()]
        return choose(next(stream), settings.epsilon, greedy[:1] if settings.ties == "lowest" else greedy)

    n_steps = 0
    while n_steps < settings.budget:
        state, action = model.start, choose_in(model.start)
        for step in range(1, (settings.time_limit or settings.budget) + 1):
            after = model.transitions(state)[action]
            noise = after.issuer_noise
            issuer_reward = after.issuer_reward + (noise * (2 * uniform(next(stream)) - 1) if noise else 0)
            target = after.grid_reward + issuer_reward
            following = -1
            if not after.terminated:
                following = choose_in(after.next_states[0])
                target += settings.discount * q[model.observation[after.next_states[0]], following]
            o = model.observation[state]
            q[o, action] += settings.learning_rate * (target - q[o, action])
            n_steps += 1
            state, action = after.next_states[0], following
            if after.terminated or n_steps == settings.budget or step == settings.time_limit:
                break
    return q


@pytest.mark.parametrize(
    "changes",
    [{}, {"time_limit": 7}, {"ties": "lowest", "epsilon": 0.1, "learning_rate": 0.3, "time_limit": 40}],
)
@pytest.mark.parametrize("scenario", ["S1", "S2"])
def test_sarsa_equals_the_textbooks_loop(scenario: str, changes: dict[str, Any]) -> None:
    model = compile_scenario(load_scenario(scenario))
    settings = Settings(**({"budget": 3000, "record_every": 3000} | changes))
    seeds = [SeedSequence([7, i]) for i in range(3)]
    training = SARSA.train(model, settings, "index", seeds, Schedule(3000))
    for i, seed in enumerate(seeds):
        assert (training.q[i] == textbook_sarsa(model, settings, seed)).all()
    assert training.episodes_ended.min() > 3


def test_expected_sarsa_learns_the_best_epsilon_greedy_values() -> None:
    # If the first wrong PING ends the episode, the cell is the state. If rewards are not random, a learning
    # rate of 1 is exact. The values are then the fixed point of the operator that mixes mean and maximum.
    model = compile_scenario(
        load_scenario("S3", {"ping_limit": 1, "grid.rows": 6, "grid.columns": 6, "issuer.position": [3, 3]})
    )
    budget = 30_000_000
    settings = Settings(learning_rate=1.0, epsilon=0.7, budget=budget, record_every=budget)
    q = EXPECTED_SARSA.train(model, settings, "index", [SeedSequence(0)], Schedule(budget)).q[0]
    expected = np.zeros_like(q)
    for _ in range(500):  # 0.9**500 is below 1e-22
        value = 0.7 * expected.mean(axis=1) + 0.3 * expected.max(axis=1)
        following = np.where(model.terminated, 0.0, value[model.next_state[:, :, 0]])
        expected = model.grid_reward + model.issuer_reward + 0.9 * following
    assert q == pytest.approx(expected, abs=1e-9)


def records_of(experiment: Path, store: Path) -> list[tuple[RunSpecification, Record]]:
    runs = all_specifications(load_experiment(experiment))
    with Store(store) as opened:
        assert run(runs, opened, jobs=2) == []
        records = opened.get([specification.digest for specification in runs])
    return list(zip(runs, records, strict=True))


def test_experiments_run_algorithms_from_outside(tmp_path: Path) -> None:
    path = tmp_path / "outside.toml"
    path.write_text(EXPERIMENT, encoding="utf-8")
    results = records_of(path, tmp_path / "runs.db")
    assert [record.status for _, record in results] == ["done"] * 10
    for specification, record in results:
        # A record holds what training alone, in this process, gives.
        training = load_algorithm(specification.algorithm).train(
            compile_scenario(specification.scenario),
            specification.settings,
            specification.observation,
            [specification.seed_sequence],
            specification.schedule,
        )
        for field in fields(training):
            if field.name != "cpu_time_s":
                expected = getattr(training, field.name)[0]
                if field.name == "values":
                    expected = np.round(expected.astype(np.float64), 3).astype(np.float32)
                if field.name == "stochastic":  # of the last evaluation step
                    expected = expected[-1:]
                assert record.arrays[field.name].tobytes() == expected.tobytes(), field.name
    learned = {specification.arm: record.arrays for specification, record in results}
    assert (learned["sarsa"]["q"] != learned["expected_sarsa"]["q"]).any()
    assert learned["a2c"]["stochastic"].sum(axis=-1) == pytest.approx(1)
    assert learned["a2c"]["updates"] == 400 / 10
    body = (2 * 64 + 64) + (64 * 64 + 64)
    assert learned["a2c"]["parameters"] == 2 * body + (64 * 5 + 5) + (64 + 1)
    assert learned["trpo"]["parameters"] == 2 * (120 * 16 + 16) + (16 * 5 + 5) + (16 + 1)
    assert learned["scaled"]["parameters"] == body + (64 + 1) * 5 * 200
    assert learned["scaled"]["updates"] == (400 - 104) / 8 + 1
    # What a record says of its settings includes the defaults of the class, and is read back.
    for specification, record in results:
        settings = json.loads(record.specification)["settings"]
        if specification.arm == "trpo":
            assert settings["cg_max_steps"] == 15
        cls = load_algorithm(specification.algorithm).settings
        assert cls.model_validate_json(json.dumps(settings)).model_dump(mode="json") == settings


def test_settings_from_outside_are_checked(tmp_path: Path) -> None:
    path = tmp_path / "outside.toml"
    path.write_text(EXPERIMENT.replace("n_steps = 10", "n_steps = 7"), encoding="utf-8")
    with pytest.raises(InputError, match=r"algorithms.a2c.*rollouts of 7 steps; accepted .* 399 or 406"):
        load_experiment(path)


RULE = """
from agents.tabular.learner import Settings, train
from agents.tabular.kernel import compile_kernel
from agents.tabular.updates import UpdateRule
from agents import Schedule
from envs import compile_scenario, load_scenario
from numpy.random import SeedSequence
SHARE = 1.0
def shared(after): return SHARE * after.highest
if __name__ == "__main__":
    rule = UpdateRule(shared)
    model = compile_scenario(load_scenario("S1"))
    training = train(model, Settings(budget=2000), [SeedSequence(0)], Schedule(2000), rule)
    stats = compile_kernel(rule, draws_outcomes=False, counts_visits=False).stats
    print(sum(stats.cache_hits.values()), training.q.sum())
"""


def test_compiled_rules_are_cached_until_they_change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    root = Path(__file__).parents[2]
    script = tmp_path / "rule.py"

    def output(text: str) -> list[str]:
        script.write_text(text, encoding="utf-8")
        command = [
            sys.executable,
            "-c",
            f"import runpy; runpy.run_path({str(script)!r}, run_name='__main__')",
        ]
        done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
        return done.stdout.split()

    compiled, loaded, changed = output(RULE), output(RULE), output(RULE.replace("1.0", "0.5"))
    assert [compiled[0], loaded[0], changed[0]] == ["0", "1", "0"]
    assert compiled[1] == loaded[1] != changed[1]
