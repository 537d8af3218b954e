"""What learns, plans and judges. `ALGORITHMS` is the one table from a name to an algorithm.

Algorithms are imported when asked for, and torch only when one that needs it trains, so that a table of
Q-values does not wait for a deep-learning library.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from envs.inputs import Table, unknown_name

ALGORITHMS: Final = {
    "dqn": "agents.sb3.settings:DQN",
    "ppo": "agents.sb3.settings:PPO",
    "q_learning": "agents.tabular.learner:Q_LEARNING",
}


@dataclass(frozen=True, eq=False)
class Algorithm:
    """A way to learn: what it can be told, what it observes, and how it trains."""

    version: int  # part of every run's identity: raised when a change alters what is learned
    settings: type[Table]  # has `budget` and `time_limit`
    observations: tuple[str, ...]  # the forms it can learn from, see `envs.observations`
    packages: tuple[str, ...]  # whose versions belong into a run's record, beside the usual ones
    # `train(model, settings, observation, seeds, evaluation_steps, map_steps, logs)` trains one agent a seed;
    # each is the same, bit for bit, whoever else is trained with it. `map_steps` are some of the evaluation
    # steps, `logs` a folder for TensorBoard for each agent, or nothing; no result depends on either.
    train: Callable[..., "Training"]
    # Whether it trains many agents at once outside Python's global lock, and so belongs in a thread; else
    # it trains one after the other, and belongs in a process of its own.
    trains_together: bool
    writes_logs: bool  # whether it can tell TensorBoard of its training


@dataclass(frozen=True, eq=False, kw_only=True)
class Training:
    """What every algorithm tells of training N agents: O observations, A actions, T evaluation steps."""

    greedy: NDArray[np.uint8]  # (N, T, O) masks of greedy actions, see `agents.policy`
    # (N, T, O, A) probabilities of the policy that it acts by and improves, where that is not a greedy one
    # with a fixed share of exploration; else (N, 0, O, A).
    stochastic: NDArray[np.float64]
    # (N, V, O, A) at the V map steps: the action values, or the probabilities where it is stochastic; NaN
    # from where it diverged.
    values: NDArray[np.float32]
    disagreements: NDArray[np.int64]  # (N, T) wrong PINGs until then
    cpu_time_s: NDArray[np.float64]  # (N, T) spent on training until then
    updates: NDArray[np.int64]  # (N,) of the table or by gradient
    parameters: NDArray[np.int64]  # (N,) numbers that are learned
    # (N,) the first evaluation step whose policy was not finite, and from which on it counts as the uniform
    # random one; -1 where all went well.
    diverged_at: NDArray[np.int64]


def load_algorithm(name: str, source: str = "agents") -> Algorithm:
    """Returns an algorithm by its name.

    Args:
      name: A key of `ALGORITHMS`.
      source: The file that named it, for the message.

    Raises:
      InputError: Unknown name.
    """
    if name not in ALGORITHMS:
        unknown_name(source, "algorithm", name, ALGORITHMS)
    module, _, attribute = ALGORITHMS[name].partition(":")
    algorithm: Any = getattr(import_module(module), attribute)
    assert isinstance(algorithm, Algorithm)
    return algorithm
