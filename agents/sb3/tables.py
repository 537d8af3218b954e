"""Reads the policy of an agent of Stable-Baselines3, or of a class like its own, as a table.

It knows what a net is given for an observation, after its wrappers.
"""

import re
from collections.abc import Callable
from inspect import signature
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnvWrapper

from envs import ACTIONS, InputError, Model
from envs.arrays import Floats
from envs.observations import observation_space, observation_table

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
        raise ValueError(
            f"{type(policy).__name__} has neither action values (q_net, quantile_net) nor a "
            "distribution of actions (get_distribution)"
        )
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
    actions = np.concatenate([action for action, _ in answers])
    memory = answers[0][1]
    if (
        memory is not None
        or not np.isclose(table[np.arange(len(table)), actions], table.max(axis=1)).all()
    ):
        raise ValueError(f"predict of {name} has a memory, or returns other actions than its net")
    return table


def agent_table(agent: BaseAlgorithm, model: Model, observation: str) -> tuple[Floats, bool]:
    """Returns an agent's policy, (O, A), and whether it has action values.

    An agent that does not fit raises an InputError.
    """
    observations = observation_table(model, observation)
    expected = {
        "observation": observation_space(observations, observation),
        "action": spaces.Discrete(len(ACTIONS)),
    }
    try:
        layers = _known_layers(agent.get_env())
        for kind, space in expected.items():
            given = getattr(agent, f"{kind}_space")
            if given != space:
                raise InputError(
                    f"agent: {kind}_space = {given}; accepted in {model.scenario.name} with "
                    f'observation = "{observation}": {space}.'
                )
        last: Any = agent._last_obs
        if not _has_rows(observations, last) or (
            last is None and not layers and agent.num_timesteps > 0
        ):
            raise InputError(
                "agent: its last observation in training is missing, or not of this scenario and "
                f"form; accepted: {_FUNCTION}."
            )
        table = readable_table(agent, torch.as_tensor(observations, device=agent.device))
    except InputError:
        raise
    except Exception as error:  # whatever the net raises
        accepted = "a model that decides by the observation alone, or a function of the observation"
        if {each.dtype for each in agent.policy.parameters()} != {torch.float32}:
            accepted = "a net in single precision; model.policy.float() converts it"
        raise InputError(
            f"agent: cannot be evaluated: {first_line(error)}; accepted: {accepted}."
        ) from error
    return table, output_of(agent).is_value


def _known_layers(env: Any) -> list[Any]:
    """Returns an agent's env and all that it wraps; an InputError if one may change something."""
    if env is None:
        return []
    methods = ("step", "reset", "step_async", "step_wait")
    sources = [getattr(env, name) for name in methods if hasattr(env, name)]
    if not isinstance(env, gymnasium.Wrapper | VecEnvWrapper):
        sources.append(type(env))
    if not all(
        _UNCHANGING.match(f"{source.__module__}.{source.__qualname__}") for source in sources
    ):
        raise InputError(
            f"agent: its environment includes {type(env).__name__}, which may change observations "
            f"or actions; accepted: {_FUNCTION}."
        )
    inner = (vars(env).get("venv"), vars(env).get("env"), *vars(env).get("envs", ()))
    return [env, *(layer for each in inner for layer in _known_layers(each))]


def _has_rows(table: NDArray[Any], rows: Any) -> bool:
    """Returns whether a table has all these rows; None stands for no rows."""
    flat = table.reshape(len(table), -1)
    each = np.unique(np.reshape([] if rows is None else rows, (-1, flat.shape[1])), axis=0)
    return all(np.isclose(flat, row, _PRECISION, _PRECISION).all(axis=1).any() for row in each)


def first_line(error: Exception) -> str:
    """Returns the first line of an error's message, or its type, without a full stop or a colon."""
    lines = str(error).strip().splitlines()
    return lines[0].rstrip(".:") if lines else type(error).__name__
