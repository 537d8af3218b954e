"""What an agent's net says about actions, as a table over all observations.

The table is read from any agent with the interface of Stable-Baselines3: its policy is asked, not its class.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.save_util import load_from_zip_file

from envs import Model
from envs.inputs import InputError, imported
from envs.model import ACTIONS
from envs.observations import observation_space, observation_table


@dataclass(frozen=True)
class Output:
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
            f"{type(policy).__name__} has neither action values (q_net, quantile_net) nor a distribution of "
            "actions (get_distribution)"
        )
    return Output(lambda o: policy.get_distribution(o).distribution.probs, is_value=False, net=policy)


def policy_table(agent: BaseAlgorithm, observations: torch.Tensor) -> NDArray[np.float64]:
    """Returns what an agent's net says about every observation (O, ...), by one forward pass.

    Returns:
      (O, A): action values, or probabilities whose rows sum to one; not finite if the net diverged.
    """
    output = output_of(agent)
    agent.policy.set_training_mode(False)
    with torch.no_grad():
        try:
            table = output.read(observations).cpu().numpy().astype(np.float64)
        except ValueError:  # torch refuses probabilities that are not finite
            return np.full((len(observations), len(ACTIONS)), np.nan)
    return np.asarray(table if output.is_value else table / table.sum(axis=1, keepdims=True))


def readable_table(agent: BaseAlgorithm, observations: torch.Tensor) -> NDArray[np.float64]:
    """Returns `policy_table` of an agent of any class; raises a ValueError if there is none."""
    name = type(agent.policy).__name__
    try:
        table = policy_table(agent, observations)
    except (AttributeError, IndexError, RuntimeError, TypeError) as error:
        raise ValueError(f"{name} gives no table of actions: {first_line(error)}") from error
    if table.shape != (len(observations), len(ACTIONS)) or not np.isfinite(table).all():
        raise ValueError(f"{name} gives no finite number for each of the {len(ACTIONS)} actions")
    return table


def first_line(error: Exception) -> str:
    """Returns the first line of an error's message, without a full stop, or its type if it has no message."""
    lines = str(error).strip().splitlines()
    return lines[0].rstrip(".") if lines else type(error).__name__


class AgentTable(NamedTuple):
    """The policy of an agent."""

    table: NDArray[np.float64]  # (O, A) action values, or probabilities whose rows sum to one
    is_value: bool  # whether these are action values


def saved_table(path: Path, algorithm: str, model: Model, observation: str) -> AgentTable:
    """Reads the policy of a model that was saved by `model.save`.

    Such a file holds pickled objects, and loading it can run any code: load only files that you trust.
    `algorithm` is the import path of its class, for example `"stable_baselines3:DQN"`.

    Raises:
      InputError: The file cannot be loaded as this class; or see `agent_table`.
    """
    cls = imported(algorithm, str(path), "algorithm")
    if not (isinstance(cls, type) and issubclass(cls, BaseAlgorithm)):
        raise InputError(
            f"{path}: {algorithm} is not a class of saved models; "
            "accepted: a subclass of stable_baselines3.common.base_class.BaseAlgorithm."
        )
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; accepted: a file written by model.save.")
    try:
        # An empty replay buffer as large as the one in training would only take memory.
        agent: BaseAlgorithm = cls.load(path, device="cpu", custom_objects={"buffer_size": 1})
    except Exception as error:  # whatever the pickled objects raise
        if policy := _policy_of_others(path, cls):
            raise InputError(
                f"{path}: it holds the policy {policy}, which {algorithm} does not have; accepted: the class "
                "of the saved model."
            ) from error
        raise InputError(f"{path}: cannot be loaded as {algorithm}: {first_line(error)}.") from error
    return agent_table(agent, str(path), model, observation)


def _policy_of_others(path: Path, cls: type[BaseAlgorithm]) -> str:
    """Returns the name of the policy that a file holds, if it is not one of a class; else empty."""
    with suppress(Exception):  # whatever the pickled objects raise
        policy: Any = (load_from_zip_file(path, device="cpu")[0] or {})["policy_class"]
        return "" if issubclass(policy, tuple(cls.policy_aliases.values())) else str(policy.__name__)
    return ""


def agent_table(agent: BaseAlgorithm, where: str, model: Model, observation: str) -> AgentTable:
    """Reads the policy of an agent, which messages call `where`; see `saved_table`.

    Raises:
      InputError: It was made for other observations or actions, or its net gives no finite table.
    """
    observations = observation_table(model, observation)
    expected = {"observation": observation_space(observations), "action": spaces.Discrete(len(ACTIONS))}
    for kind, space in expected.items():
        given = getattr(agent, f"{kind}_space")
        if given != space:
            raise InputError(
                f"{where}: {kind}_space = {given}; accepted in {model.scenario.name} with observation = "
                f'"{observation}": {space}.'
            )
    try:
        table = readable_table(agent, torch.as_tensor(observations, device=agent.device))
    except ValueError as error:
        raise InputError(f"{where}: {first_line(error)}.") from error
    return AgentTable(table, output_of(agent).is_value)
