"""Classes like those of Stable-Baselines3 by their import path, and models that they have saved."""

import inspect
import json
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from numpy.random import SeedSequence
from numpy.typing import NDArray
from sb3_contrib import QRDQN
from stable_baselines3 import A2C, DQN, PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.dqn.policies import DQNPolicy, QNetwork

from agents import Schedule, Training, load_algorithm
from agents.dynamic_programming import evaluate, solve
from agents.policy import mask_policy
from agents.sb3.algorithms import Sb3Algorithm
from agents.sb3.imported import ImportedSettings
from agents.sb3.tables import policy_table, saved_table
from agents.sb3.training import make_agent
from agents.sb3.vec_env import SB3VecEnv
from envs import InputError, Model, ProxemicVectorEnv, compile_scenario, load_scenario
from envs.inputs import parse
from envs.observations import observation_table
from tests.agents.test_sb3 import CHANGING, SMALL

HERE = __name__
S1 = compile_scenario(load_scenario("S1"))
SCHEDULE = Schedule(400, (0, 200, 400), (0, 400))


def algorithm(path: str) -> Sb3Algorithm:
    loaded = load_algorithm(path, "mine.toml")
    assert isinstance(loaded, Sb3Algorithm)
    return loaded


def settings_of(path: str, **values: Any) -> ImportedSettings:
    settings = parse(algorithm(path).settings, values, "mine.toml")
    assert isinstance(settings, ImportedSettings)
    return settings


def trained(path: str, model: Model = S1, observation: str = "one_hot", **values: Any) -> Training:
    settings = parse(load_algorithm(path).settings, {"budget": 400, "time_limit": 50} | values, "mine.toml")
    schedule = Schedule(settings.budget, (0, settings.budget // 2, settings.budget), (0, settings.budget))
    return load_algorithm(path).train(model, settings, observation, [SeedSequence([5, 0])], schedule)


# Classes that users could write


class Stepwise(DQN):
    """Has an argument of its own and passes the others on."""

    def __init__(self, *args: Any, warm_up: int = 50, schedule: Any = lambda x: x, **kwargs: Any) -> None:
        self.warm_up = warm_up
        self.schedule = schedule
        super().__init__(*args, **kwargs)


class Warmer(Stepwise):
    """A later version, with another default."""

    def __init__(self, *args: Any, warm_up: int = 60, **kwargs: Any) -> None:
        super().__init__(*args, warm_up=warm_up, **kwargs)


class Loose(A2C):
    """Annotations that are texts, missing, wrong, or unknown."""

    def __init__(  # type: ignore[no-untyped-def]
        self,
        policy: Any,
        env: Any,
        n_steps: "int" = 10,
        gamma: "float" = 0.9,
        scale=2,
        share: int = 0.5,  # type: ignore[assignment]
        mode: "NotThere" = "slow",  # type: ignore[name-defined]  # noqa: F821
        sizes: tuple[int, ...] = (1, 2),
        rollout: int = 3,
        device: str = "cpu",
    ) -> None:
        self.seen = (scale, share, mode, sizes, rollout)
        super().__init__(policy, env, n_steps=n_steps, gamma=gamma, device=device)


class Demanding(A2C):
    """Needs an argument."""

    def __init__(self, policy: Any, env: Any, factor: float, **kwargs: Any) -> None:
        self.factor = factor
        super().__init__(policy, env, **kwargs)


class Callback(A2C):
    """Needs an argument that no file can hold."""

    def __init__(self, policy: Any, env: Any, function: Callable[[], int], **kwargs: Any) -> None:
        self.function = function
        super().__init__(policy, env, **kwargs)


class Hidden(A2C):
    """Passes another number of steps than its signature says."""

    def __init__(self, policy: Any, env: Any, n_steps: int = 5, **kwargs: Any) -> None:
        super().__init__(policy, env, n_steps=2 * n_steps, **kwargs)


class Undiscounted(A2C):
    """Has no argument for the discount."""

    def __init__(self, policy: Any, env: Any, n_steps: int = 5, device: str = "cpu") -> None:
        super().__init__(policy, env, n_steps=n_steps, device=device)


class Episodic(DQN):
    """Trains after whole episodes by default."""

    def __init__(self, *args: Any, train_freq: tuple[int, str] = (1, "episode"), **kwargs: Any) -> None:
        kwargs["train_freq"] = train_freq
        super().__init__(*args, **kwargs)


class Mute(DQN):
    """Its policy has neither values nor probabilities."""

    def _setup_model(self) -> None:
        super()._setup_model()
        del self.policy.q_net


class Overrun(A2C):
    """Takes more steps than it is told."""

    def learn(self, total_timesteps: int, *args: Any, **kwargs: Any) -> Any:
        return super().learn(total_timesteps + 50, *args, **kwargs)


class DropoutPolicy(DQNPolicy):
    """A Q-network whose training differs from its use."""

    def make_q_net(self) -> QNetwork:
        net = super().make_q_net()
        net.q_net.append(torch.nn.Dropout(0.5))
        return net


class DropoutDqn(DQN):
    """DQN with dropout, which notes the modes in which its net is used."""

    policy_aliases = {"MlpPolicy": DropoutPolicy}  # noqa: RUF012
    modes: set[tuple[str, bool]] = set()  # noqa: RUF012

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        self.modes.add(("acting", self.policy.q_net.training))
        super().train(gradient_steps, batch_size)
        self.modes.add(("training", self.policy.q_net.training))


# Training


@pytest.mark.parametrize(
    ("name", "path", "values"),
    [
        ("dqn", "stable_baselines3:DQN", {"train_freq": 2, "learning_rate": 1e-3, "n_envs": 2}),
        ("ppo", "stable_baselines3:PPO", {"n_steps": 50, "batch_size": 32, "n_epochs": 2}),
        ("a2c", "stable_baselines3.a2c:A2C", {"policy_kwargs": {"net_arch": [16]}}),
        ("qrdqn", "sb3_contrib:QRDQN", {"policy_kwargs": {"n_quantiles": 10}, "gradient_steps": 2}),
    ],
)
@pytest.mark.parametrize("observation", ["one_hot", "coordinates"])
def test_path_and_name_of_a_class_train_the_same(
    name: str, path: str, values: dict[str, Any], observation: str
) -> None:
    model = compile_scenario(load_scenario("S2", CHANGING))
    by_name = trained(name, model, observation, **values)
    by_path = trained(path, model, observation, **values)
    for key, array in vars(by_name).items():
        if key != "cpu_time_s":
            assert array.tobytes() == getattr(by_path, key).tobytes(), key
    assert by_path.updates[0] > 0


def test_another_package_solves_a_small_scene() -> None:
    training = trained(
        "sb3_contrib:TRPO",
        SMALL,
        budget=6000,
        n_envs=4,
        n_steps=50,
        batch_size=100,
        gamma=0.9,
        gae_lambda=0.8,
    )
    optimum = solve(SMALL, 1.0, 50).value[SMALL.start]
    reached = evaluate(SMALL, mask_policy(training.greedy[:, -1:]), 50).grid_return[0, 0]
    assert reached == pytest.approx(optimum, abs=1e-9)
    assert training.stochastic[0].sum(axis=-1) == pytest.approx(1)


def test_quantiles_are_averaged() -> None:
    settings = settings_of("sb3_contrib:QRDQN", budget=400, policy_kwargs={"n_quantiles": 7})
    env = SB3VecEnv(ProxemicVectorEnv(1, observation="coordinates", autoreset_mode="SameStep"))
    agent: Any = make_agent(algorithm("sb3_contrib:QRDQN").method, settings, env)
    observations = torch.as_tensor(observation_table(S1, "coordinates"))
    with torch.no_grad():  # the layers by hand: the last has seven quantiles of five actions
        first, _, second, _, last = agent.policy.quantile_net.quantile_net
        values = last(torch.relu(second(torch.relu(first(observations)))))
    expected = values.reshape(120, 7, 5).numpy().astype(np.float64).mean(axis=1)
    assert policy_table(agent, observations) == pytest.approx(expected, abs=1e-6)


def test_nets_with_modes_are_read_as_they_are_used() -> None:
    DropoutDqn.modes.clear()
    path = f"{HERE}:DropoutDqn"
    training = trained(path, learning_rate=1e-3)
    assert DropoutDqn.modes == {("acting", False), ("training", True)}
    assert (training.q == trained(path, learning_rate=1e-3).q).all()
    assert (training.values[0, -1] == training.q[0].astype(np.float32)).all()
    assert (training.q[0] != 0).all()  # dropout would set half of them to 0


def test_steps_that_are_not_those_declared_are_an_error() -> None:
    with pytest.raises(InputError, match="Overrun: trained for 450 steps; accepted: the budget of 400"):
        trained(f"{HERE}:Overrun")


# Settings


@pytest.mark.parametrize("path", ["stable_baselines3:A2C", "stable_baselines3:DQN", "sb3_contrib:TRPO"])
def test_defaults_are_the_classs_and_part_of_the_identity(path: str) -> None:
    algo = algorithm(path)
    signature = inspect.signature(algo.method.load().__init__).parameters
    budget = 10_000 if "A2C" in path or "DQN" in path else 10_240
    written = json.loads(settings_of(path, budget=budget).model_dump_json())
    for key in written.keys() & signature.keys() - {"policy_kwargs"}:
        assert written[key] == signature[key].default, key
    policy = inspect.signature(algo.method.load().policy_aliases["MlpPolicy"].__init__).parameters
    for key, value in written["policy_kwargs"].items():
        assert value == policy[key].default, key
    left_out = signature.keys() - written.keys()
    assert left_out == set(algo.settings.refused) & signature.keys() | {"self"}  # type: ignore[attr-defined]
    assert settings_of(path, budget=budget).discount_factor == 0.99


def test_arguments_that_are_passed_on_are_settings_too() -> None:
    settings = settings_of(f"{HERE}:Stepwise", warm_up=70, train_freq=8)
    assert settings.arguments == {"warm_up": 70, "train_freq": 8, "buffer_size": 10_000}
    assert json.loads(settings.model_dump_json())["schedule"] is None  # a function: the class's own default
    assert settings.rollout == 8
    first, second = (settings_of(f"{HERE}:{name}").model_dump_json() for name in ("Stepwise", "Warmer"))
    assert first.replace('"warm_up":50', '"warm_up":60') == second != first


def test_annotations_say_as_much_as_they_can() -> None:
    path = f"{HERE}:Loose"
    written = json.loads(settings_of(path).model_dump_json())
    assert {"scale": 2, "share": 0.5, "mode": "slow", "sizes": [1, 2]}.items() <= written.items()
    settings = settings_of(path, scale="big", mode=[1], sizes=[3], n_steps=20)
    env = SB3VecEnv(ProxemicVectorEnv(1, observation="coordinates", autoreset_mode="SameStep"))
    agent: Any = make_agent(algorithm(path).method, settings, env)
    assert agent.seen == ("big", 0.5, [1], (3,), 3)
    for values, expected in [
        ({"n_steps": "5"}, 'n_steps = "5": input should be a valid integer'),
        ({"sizes": ["a"]}, "sizes"),
        ({"rollout": 3}, "rollout = 3: cannot be set, because its name has another meaning"),
    ]:
        with pytest.raises(InputError, match=expected):
            settings_of(path, **values)  # type: ignore[arg-type]


def test_required_arguments_are_required_settings() -> None:
    assert settings_of(f"{HERE}:Demanding", factor=2).arguments == {"factor": 2.0}
    with pytest.raises(InputError, match=r"mine.toml: the key factor is missing\."):
        settings_of(f"{HERE}:Demanding")
    assert settings_of(f"{HERE}:Episodic", train_freq=5).rollout == 5
    with pytest.raises(InputError, match=r"mine.toml: the key train_freq is missing\."):
        settings_of(f"{HERE}:Episodic")


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("A2C", {"learning_rat": 1.0}, r"unknown key learning_rat \(did you mean learning_rate"),
        ("A2C", {"n_steps": 5.5}, "n_steps = 5.5: input should be a valid integer"),
        ("A2C", {"learning_rate": "fast"}, 'learning_rate = "fast": input should be a valid '),
        ("A2C", {"use_rms_prop": 1}, "use_rms_prop = 1: input should be a valid boolean"),
        ("A2C", {"gamma": 1.5}, "gamma = 1.5: input should be less than or equal to 1"),
        ("A2C", {"n_steps": 3}, "not a whole number of rollouts of 3 steps"),
        ("A2C", {"n_steps": 5, "n_envs": 3}, "rollouts of 15 steps"),
        ("A2C", {"policy": "CnnPolicy"}, 'policy = "CnnPolicy": cannot be set, because'),
        ("A2C", {"env": "x"}, 'env = "x": cannot be set, because the experiment names'),
        ("A2C", {"seed": 3}, "seed = 3: cannot be set, because every run derives its seed"),
        ("A2C", {"device": "cuda"}, 'device = "cuda": cannot be set, because agents train'),
        ("A2C", {"verbose": 1}, "verbose = 1: cannot be set, because training prints"),
        ("A2C", {"tensorboard_log": "x"}, "cannot be set, because run --tensorboard"),
        ("A2C", {"_init_setup_model": False}, "cannot be set, because it is private"),
        ("A2C", {"rollout_buffer_class": "x"}, "cannot be set, because .* TOML"),
        ("A2C", {"use_sde": True}, "A2C cannot be made: "),
        ("A2C", {"policy_kwargs": 3}, "policy_kwargs = 3: accepted: a table"),
        ("A2C", {"policy_kwargs": {"activation_fn": "x"}}, "activation_fn = .* be set"),
        ("A2C", {"policy_kwargs": {"net_arch": "x"}}, "net_arch = .*: a list or a table"),
        ("A2C", {"policy_kwargs": {"ortho_int": True}}, r"did you mean ortho_init\?"),
        ("DQN", {"train_freq": [1, "episode"]}, 'train_freq = .*accepted: .* "step"'),
        ("DQN", {"train_freq": [3, "step"]}, "rollouts of 3 steps"),
        ("DQN", {"train_freq": 0}, "train_freq = 0: accepted: a number of steps from 1"),
        ("DQN", {"replay_buffer_kwargs": {"size": 3}}, "DQN cannot be made: .*'size'"),
    ],
)  # fmt: skip
def test_settings_that_cannot_be_are_refused(name: str, values: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError, match=f"^mine.toml: .*?{expected}") as refusal:
        settings_of(f"stable_baselines3:{name}", **values)
    assert re.search(r"[^.]\.$", str(refusal.value))


def test_train_freq_may_say_that_it_counts_steps() -> None:
    settings = settings_of("stable_baselines3:DQN", train_freq=[8, "step"], n_envs=2, budget=400)
    assert settings.rollout == 16
    assert settings.arguments == {"train_freq": (8, "step"), "buffer_size": 400}
    assert json.loads(settings.model_dump_json())["train_freq"] == [8, "step"]


def test_settings_travel_to_other_processes() -> None:
    settings = settings_of(
        "sb3_contrib:QRDQN", budget=400, train_freq=[4, "step"], policy_kwargs={"net_arch": [8]}
    )
    travelled = pickle.loads(pickle.dumps(settings))
    assert travelled == settings
    assert travelled.arguments == settings.arguments
    again = algorithm("sb3_contrib:QRDQN").settings.model_validate_json(settings.model_dump_json())
    assert again.model_dump_json() == settings.model_dump_json()  # as a record has it


def test_packages_are_those_of_the_class_and_its_bases() -> None:
    assert algorithm("sb3_contrib:TRPO").packages == ("sb3_contrib", "stable_baselines3", "torch")
    assert algorithm(f"{HERE}:Stepwise").packages == ("stable_baselines3", "torch")


# Classes that cannot be trained


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("stable_baselines3:SAC", "SAC cannot be made: The algorithm only supports .*Box.* Discrete"),
        ("sb3_contrib:RecurrentPPO", "accepted: a class that has a policy called MlpPolicy"),
        ("sb3_contrib:ARS", "accepted: a class with an argument gamma"),
        (f"{HERE}:Undiscounted", "accepted: a class with an argument gamma"),
        (
            f"{HERE}:Mute",
            r"Mute cannot be evaluated: DQNPolicy has neither action values .* nor a distribution",
        ),
        (f"{HERE}:Hidden", "Hidden has rollouts of 10 steps; accepted: 5, as its settings say"),
        (f"{HERE}:Callback", "Callback needs the argument function; accepted: .* a TOML file can hold"),
        ("stable_baselines3:A3C", "cannot be imported: .*no attribute 'A3C'"),
        ("stable_baselines3.common.buffers:ReplayBuffer", "is not an algorithm; accepted: .*BaseAlgorithm"),
        ("no_such_thing:Foo", "No module named 'no_such_thing'; if no_such_thing is in a package, install"),
    ],
)
def test_classes_that_cannot_be_trained_are_refused(path: str, expected: str) -> None:
    with pytest.raises(InputError, match=f"^mine.toml: .*?{expected}") as refusal:
        algorithm(path)
    assert re.search(r"[^.]\.$", str(refusal.value))


@pytest.mark.parametrize("missing", ["torch", "stable_baselines3", "sb3_contrib"])
def test_missing_packages_get_a_sentence(missing: str) -> None:
    code = (
        f"import sys; sys.modules[{missing!r}] = None\n"
        "from agents import load_algorithm\n"
        "try: load_algorithm('sb3_contrib:QRDQN', 'mine.toml')\n"
        "except ValueError as error: print(error)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.startswith("mine.toml: algorithm sb3_contrib:QRDQN cannot be imported: ")
    assert missing in done.stdout
    assert done.stdout.endswith("[deep]' installs it (in a checkout: make .venv/.deep).\n")


def test_only_arms_by_path_import_torch() -> None:
    code = (
        "import sys; from agents import ALGORITHMS, load_algorithm\n"
        "for name in ALGORITHMS: load_algorithm(name).settings(budget=10240)\n"
        "assert 'torch' not in sys.modules\n"
        "load_algorithm('stable_baselines3:A2C').settings()\n"
        "assert 'torch' in sys.modules"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=Path(__file__).parents[2], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_looking_at_a_class_draws_no_random_numbers() -> None:
    torch.manual_seed(3)
    expected = torch.rand(2)
    torch.manual_seed(3)
    settings_of("stable_baselines3:A2C", n_steps=25)
    assert (torch.rand(2) == expected).all()


# Saved models

MODELS: dict[str, tuple[type[BaseAlgorithm], dict[str, Any]]] = {
    "stable_baselines3:DQN": (DQN, {"learning_starts": 50}),
    "stable_baselines3:PPO": (PPO, {"n_steps": 50, "batch_size": 50, "n_epochs": 1}),
    "stable_baselines3:A2C": (A2C, {}),
    "sb3_contrib:QRDQN": (QRDQN, {"learning_starts": 50, "policy_kwargs": {"n_quantiles": 9}}),
}


def saved(path: Path, name: str, observation: str, scenario: str = "S1") -> BaseAlgorithm:
    """Trains a model as the users of Stable-Baselines3 do, and saves it."""
    cls, arguments = MODELS[name]
    env = gymnasium.make(f"envs:Proxemic/{scenario}-v0", observation=observation)
    model = cls("MlpPolicy", env, seed=0, device="cpu", **arguments).learn(100)
    model.save(path)
    return model


@pytest.mark.parametrize("observation", ["index", "one_hot", "coordinates"])
@pytest.mark.parametrize("name", MODELS)
def test_saved_models_become_tables(name: str, observation: str, tmp_path: Path) -> None:
    model = saved(tmp_path / "model.zip", name, observation)
    table, is_value = saved_table(tmp_path / "model.zip", name, S1, observation)
    assert table.shape == (120, 5)
    assert is_value == ("DQN" in name)
    for values, array in zip(table, observation_table(S1, observation), strict=True):
        assert values.argmax() == model.predict(array, deterministic=True)[0]
    if not is_value:
        assert table.sum(axis=1) == pytest.approx(1)
        many: NDArray[Any] = np.repeat(observation_table(S1, observation)[:1], 20_000, axis=0)
        shares = np.bincount(model.predict(many)[0], minlength=5) / 20_000
        assert shares == pytest.approx(table[0], abs=0.015)


class Lever(gymnasium.Env[Any, Any]):
    """An env with the observations of S1 and two actions."""

    observation_space = gymnasium.spaces.Box(0.0, 1.0, (2,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, **_: Any) -> tuple[Any, dict[str, Any]]:
        return np.zeros(2, dtype=np.float32), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ARG002
        return np.zeros(2, dtype=np.float32), 0.0, False, True, {}


def test_saved_models_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    dqn, path = "stable_baselines3:DQN", tmp_path / "model.zip"
    with pytest.raises(InputError, match=r"model.zip: there is no such file"):
        saved_table(path, dqn, S1, "one_hot")
    path.write_text("no zip", encoding="utf-8")
    with pytest.raises(InputError, match=r"model.zip: cannot be loaded as stable_baselines3:DQN: .*[^.]\.$"):
        saved_table(path, dqn, S1, "one_hot")
    saved(path, dqn, "one_hot")
    for other, observation in (
        (S1, "coordinates"),
        (S1, "index"),
        (compile_scenario(load_scenario("S1", CHANGING)), "one_hot"),
    ):
        with pytest.raises(InputError, match=r"model.zip: observation_space = Box.*120.*accepted in S1 with"):
            saved_table(path, dqn, other, observation)
    with pytest.raises(InputError, match="cannot be loaded as sb3_contrib:QRDQN"):
        saved_table(path, "sb3_contrib:QRDQN", S1, "one_hot")
    with pytest.raises(InputError, match="is not a class of saved models; accepted: a subclass"):
        saved_table(path, "agents.sb3.algorithms:DQN", S1, "one_hot")
    with pytest.raises(InputError, match="unknown form picture"):
        saved_table(path, dqn, S1, "picture")
    A2C("MlpPolicy", Lever(), device="cpu").save(path)
    with pytest.raises(InputError, match=r"action_space = Discrete\(2\); accepted .*: Discrete\(5\)\.$"):
        saved_table(path, "stable_baselines3:A2C", S1, "coordinates")
    for name, attribute in ((dqn, "q_net"), ("stable_baselines3:PPO", "action_net")):
        model = saved(path, name, "coordinates")
        with torch.no_grad():
            next(getattr(model.policy, attribute).parameters()).fill_(float("nan"))
        model.save(path)
        with pytest.raises(InputError, match="gives no finite number for each of the 5 actions"):
            saved_table(path, name, S1, "coordinates")
