"""Reads the policy of an agent of Stable-Baselines3, or of a class like its own, as a table.

It knows what a net is given for an observation, after its wrappers, and reads pickles without
running code in them.
"""

import json
import pickle
import re
from base64 import b64decode
from collections.abc import Callable
from inspect import signature
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import ZipFile

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnvWrapper

from envs import Model
from envs.arrays import Floats
from envs.inputs import InputError
from envs.model import ACTIONS
from envs.observations import observation_space, observation_table
from envs.packages import imported

# Pickled attributes of a saved agent without which its policy cannot be made and checked.
_NEEDED = ("policy_class", "policy_kwargs", "observation_space", "action_space", "_last_obs")
# Arguments of methods that decide. A state is a memory only if a method returns one, too.
_ARGUMENTS = {"state", "episode_start", "deterministic", "args", "kwargs"}
# Where methods are defined that pass on observations and actions as they are.
_UNCHANGING = re.compile(
    r"(envs\.proxemic_env|agents\.sb3\.vec_env|gymnasium\.core\.(Reward)?Wrapper"
    r"|gymnasium\.wrappers\.(common|rendering|stateful_reward)|stable_baselines3\.common\."
    r"(monitor|vec_env\.(base_vec_env|dummy_vec_env|vec_check_nan|vec_monitor|vec_video_recorder))"
    r")\."
)
_PRECISION = 1e-5  # observations have single precision
_FUNCTION = (
    "a function that does so, such as lambda o: model.predict(wrapped(o), deterministic=True)"
)

# What arrays and generators of random numbers are made of.
_DATA = re.compile(
    r"collections\.OrderedDict|numpy\.(ndarray|dtype)"
    r"|numpy\._?core\.(multiarray\.(_reconstruct|scalar)|numeric\._frombuffer)"
    r"|numpy\.random\.(_pickle\.__(bit_)?generator_ctor|_pcg64\.PCG64)"
    r"|numpy\.random\.bit_generator\.(__pyx_unpickle_)?SeedSequence"
)
# Classes that may be named, and the modules of packages that define some.
_CLASSES = (spaces.Space, torch.nn.Module, torch.optim.Optimizer)
_MODULES = re.compile(
    r"(agents\.sb3|gymnasium|torch\.(nn\.modules|optim)|stable_baselines3|sb3_contrib)\."
)
_AT_ONCE = 20_000  # observations, to save memory


class Output(NamedTuple):
    """What an agent's net says about actions, and how to ask it."""

    read: Callable[[torch.Tensor], torch.Tensor]  # observations (O, ...) -> (O, A)
    is_value: bool  # whether these are action values; else they are probabilities
    net: torch.nn.Module  # holds all learned parameters, and each once


def output_of(agent: BaseAlgorithm) -> Output:
    """Returns how to ask an agent's net; one that cannot be asked raises a ValueError."""
    policy: Any = agent.policy
    if isinstance(net := getattr(policy, "q_net", None), torch.nn.Module):
        return Output(net, is_value=True, net=net)
    if isinstance(net := getattr(policy, "quantile_net", None), torch.nn.Module):
        # Mean quantiles are action values (Dabney et al. 2018, eq. 3).
        return Output(lambda o: net(o).mean(dim=1), is_value=True, net=net)
    if not hasattr(policy, "get_distribution"):
        kinds = (
            "action values (q_net, quantile_net) nor a distribution of actions (get_distribution)"
        )
        raise ValueError(f"{type(policy).__name__} has neither {kinds}")
    return Output(
        lambda o: policy.get_distribution(o).distribution.probs, is_value=False, net=policy
    )


def _batches(observations: torch.Tensor) -> list[torch.Tensor]:
    return [observations[i : i + _AT_ONCE] for i in range(0, len(observations), _AT_ONCE)]


def policy_table(agent: BaseAlgorithm, observations: torch.Tensor) -> Floats:
    """Returns (O, A) action values or probabilities; not finite after divergence."""
    output = output_of(agent)
    agent.policy.set_training_mode(False)
    with torch.no_grad():
        try:
            outputs = torch.cat([output.read(batch) for batch in _batches(observations)])
            table = outputs.cpu().numpy().astype(np.float64)
        except ValueError:  # torch refuses probabilities that are not finite
            return np.full((len(observations), len(ACTIONS)), np.nan)
    return table if output.is_value else table / table.sum(axis=1, keepdims=True)


def readable_table(agent: BaseAlgorithm, observations: torch.Tensor) -> Floats:
    """Returns `policy_table` of any agent; raises an exception if a table is not enough."""
    name = type(agent).__name__
    methods = (agent.predict, getattr(agent.policy, "get_distribution", agent.predict))
    extra = {
        argument for method in methods for argument in [*signature(method).parameters][1:]
    } - _ARGUMENTS
    if extra:
        raise ValueError(
            f"{name} needs more than the observation: it takes {', '.join(sorted(extra))}"
        )
    table = policy_table(agent, observations)
    if table.shape != (len(observations), len(ACTIONS)) or not np.isfinite(table).all():
        policy = type(agent.policy).__name__
        raise ValueError(f"{policy} gives no finite number for each of the {len(ACTIONS)} actions")
    answers = [
        agent.predict(batch.cpu().numpy(), deterministic=True) for batch in _batches(observations)
    ]
    actions, memory = np.concatenate([action for action, _ in answers]), answers[0][1]
    if (
        memory is not None
        or not np.isclose(table[np.arange(len(table)), actions], table.max(axis=1)).all()
    ):
        raise ValueError(f"predict of {name} has a memory, or returns other actions than its net")
    return table


AgentTable = tuple[Floats, bool]  # (O, A), and whether it has action values


def saved_table(path: Path, algorithm: str, model: Model, observation: str) -> AgentTable:
    """Reads the policy of a model that was saved by `model.save`, as `agent_table` does.

    `algorithm` is the import path of its class, for example `"stable_baselines3:DQN"`. No code from
    the file is run: of its pickled objects, those that the policy needs are read by `unpickled`,
    the others not at all. A class of nets must be of Stable-Baselines3, torch, or the module of the
    algorithm's class.
    """
    cls: Any = imported(algorithm, str(path), "algorithm")
    if not (isinstance(cls, type) and issubclass(cls, BaseAlgorithm)):
        accepted = "a subclass of stable_baselines3.common.base_class.BaseAlgorithm"
        raise InputError(
            f"{path}: {algorithm} is not a class of saved models; accepted: {accepted}."
        )
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; accepted: a file written by model.save.")
    modules = {algorithm.partition(":")[0], *(base.__module__ for base in cls.__mro__)}
    try:
        agent: BaseAlgorithm = cls.load(
            path, device="cpu", custom_objects=_attributes(path, cls, modules)
        )
    except Exception as error:  # whatever the saved objects raise
        reason = first_line(error).partition(". ")[0]  # torch adds advice on its own arguments
        accepted = f"accepted: what model.save of {algorithm} wrote"
        raise InputError(f"{path}: cannot be loaded: {reason}; {accepted}.") from error
    return agent_table(agent, str(path), model, observation)


def _attributes(path: Path, cls: Any, modules: set[str]) -> dict[str, Any]:
    """Returns values for all pickled attributes of a saved agent, so that `load` unpickles none."""
    with ZipFile(path) as archive:
        saved = json.loads(archive.read("data"))
    pickles = {
        k: v[":serialized:"]
        for k, v in saved.items()
        if isinstance(v, dict) and ":serialized:" in v
    }
    needed = [key for key in _NEEDED if key in pickles]
    read = {key: unpickled(b64decode(pickles[key]), key, modules) for key in needed}
    fresh = cls(
        policy=(saved | read)["policy_class"], env=None, device="cpu", _init_setup_model=False
    )
    # An empty replay buffer would only take memory, and the name of an environment would be
    # imported.
    return {key: vars(fresh).get(key) for key in pickles} | read | {"buffer_size": 1, "env": None}


def agent_table(agent: BaseAlgorithm, where: str, model: Model, observation: str) -> AgentTable:
    """Reads an agent's policy; an InputError, which names `where`, if it does not fit."""
    observations = observation_table(model, observation)
    expected = {
        "observation": observation_space(observations, observation),
        "action": spaces.Discrete(len(ACTIONS)),
    }
    try:
        layers = known_layers(agent.get_env(), where)
        for kind, space in expected.items():
            given = getattr(agent, f"{kind}_space")
            if given != space:
                setting = f'{model.scenario.name} with observation = "{observation}"'
                raise InputError(
                    f"{where}: {kind}_space = {given}; accepted in {setting}: {space}."
                )
        last: Any = agent._last_obs
        if not _has_rows(observations, last) or (
            last is None and not layers and agent.num_timesteps > 0
        ):
            what = "its last observation in training is missing, or not of this scenario and form"
            raise InputError(f"{where}: {what}; accepted: {_FUNCTION}.")
        table = readable_table(agent, torch.as_tensor(observations, device=agent.device))
    except InputError:
        raise
    except Exception as error:  # whatever the net, or what a file has made of the agent, raises
        found = f"{where}: cannot be evaluated: {first_line(error)}"
        accepted = "a model that decides by the observation alone, or a function of the observation"
        raise InputError(f"{found}; accepted: {accepted}.") from error
    return table, output_of(agent).is_value


def known_layers(env: Any, where: str) -> list[Any]:
    """Returns an agent's env and all that it wraps; an InputError if one may change something."""
    if env is None:
        return []
    methods = ("step", "reset", "step_async", "step_wait")
    sources = [getattr(env, name) for name in methods if hasattr(env, name)]
    if not isinstance(env, gymnasium.Wrapper | VecEnvWrapper):
        sources = [type(env)]
    if not all(
        _UNCHANGING.match(f"{source.__module__}.{source.__qualname__}") for source in sources
    ):
        what = f"{type(env).__name__}, which may change observations or actions"
        raise InputError(f"{where}: its environment includes {what}; accepted: {_FUNCTION}.")
    inner = (vars(env).get("venv"), vars(env).get("env"), *vars(env).get("envs", ()))
    return [env, *(layer for each in inner for layer in known_layers(each, where))]


def _has_rows(table: NDArray[Any], rows: Any) -> bool:
    """Returns whether a table has all these rows; None stands for no rows."""
    flat = table.reshape(len(table), -1)
    each = np.unique(np.reshape([] if rows is None else rows, (-1, flat.shape[1])), axis=0)
    return all(np.isclose(flat, row, _PRECISION, _PRECISION).all(axis=1).any() for row in each)


def unpickled(content: bytes, what: str, modules: set[str]) -> Any:
    """Reads a pickle, called `what`, of arrays, spaces, nets' classes and plain values.

    Other names raise an UnpicklingError. `modules` are the user's own, where nets may be defined.
    """

    class Unpickler(pickle.Unpickler):
        def find_class(self, module: str, name: str) -> Any:
            if _DATA.fullmatch(f"{module}.{name}"):
                return super().find_class(module, name)
            if _MODULES.match(module) or module in modules:
                found = super().find_class(module, name)
                if (
                    isinstance(found, type)
                    and issubclass(found, _CLASSES)
                    and found.__module__ == module
                ):
                    return found
            remedy = "if you trust the file, load it in Python, and assess the loaded model"
            raise pickle.UnpicklingError(
                f"{what} needs {module}.{name}, which could run any code ({remedy})"
            )

    return Unpickler(BytesIO(content)).load()


def first_line(error: Exception) -> str:
    """Returns the first line of an error's message, or its type, without a full stop or a colon."""
    lines = str(error).strip().splitlines()
    return lines[0].rstrip(".:") if lines else type(error).__name__
