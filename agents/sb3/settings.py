"""The deep learners: Stable-Baselines3's DQN and PPO (Raffin et al. 2021), and what they can be told.

Settings bear SB3's own argument names and, where nothing is said, SB3's own values. torch and SB3 are
not imported here but by `agents.sb3.training`, when somebody trains.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from numpy.random import SeedSequence
from pydantic import Field, model_validator

from agents.contract import LearnerSettings, Schedule, Training
from envs import InputError, Model
from envs.inputs import Table

VERSION: Final = 2  # part of every run's identity: raise it when a change alters what is learned
OBSERVATIONS: Final = ("one_hot", "coordinates")

_Whole = Annotated[int, Field(ge=1, le=10**9)]
_Positive = Annotated[float, Field(gt=0)]
_Share = Annotated[float, Field(ge=0, le=1)]


class PolicyArguments(Table):
    """SB3's `policy_kwargs`, as far as they are offered."""

    net_arch: Annotated[tuple[_Whole, ...], Field(max_length=8)] = (64, 64)  # hidden layers; none: linear


class _Settings(LearnerSettings):
    """What both have in common. Keys are SB3's argument names, but for the first three."""

    n_envs: Annotated[int, Field(ge=1, le=4096)] = 1  # envs stepped at once
    gamma: _Share = 0.99
    policy_kwargs: PolicyArguments = PolicyArguments()

    @property
    def discount_factor(self) -> float:
        """SB3's gamma."""
        return self.gamma

    @property
    def rollout(self) -> int:
        """Environment steps from one round of gradient updates to the next."""
        raise NotImplementedError

    @model_validator(mode="after")
    def _rollouts_fill_the_budget(self) -> Self:
        rollout = self.rollout
        if self.budget % rollout:
            below = self.budget // rollout * rollout
            accepted = [n for n in (below, below + rollout) if n]
            raise ValueError(
                f"budget = {self.budget} is not a whole number of rollouts of {rollout} steps; "
                f"accepted with this rollout: {' or '.join(map(str, accepted))}"
            )
        return self


class DqnSettings(_Settings):
    """SB3's arguments of DQN, and its defaults; a test compares both with SB3 itself."""

    learning_rate: _Positive = 1e-4
    buffer_size: _Whole = 1_000_000  # transitions; room is made for no more than the budget brings
    learning_starts: Annotated[int, Field(ge=0, le=10**9)] = 100
    batch_size: _Whole = 32
    tau: _Share = 1.0
    train_freq: _Whole = 4
    gradient_steps: Annotated[int, Field(ge=-1, le=10**6)] = 1
    n_steps: _Whole = 1
    target_update_interval: _Whole = 10_000
    exploration_fraction: Annotated[float, Field(gt=0, le=1)] = 0.1
    exploration_initial_eps: _Share = 1.0
    exploration_final_eps: _Share = 0.05
    max_grad_norm: _Positive = 10.0

    @property
    def rollout(self) -> int:
        """`train_freq` steps of every env."""
        return self.train_freq * self.n_envs


class PpoSettings(_Settings):
    """SB3's arguments of PPO, and its defaults; a test compares both with SB3 itself."""

    learning_rate: _Positive = 3e-4
    n_steps: _Whole = 2048
    batch_size: Annotated[int, Field(ge=2, le=10**9)] = 64
    n_epochs: _Whole = 10
    gae_lambda: _Share = 0.95
    clip_range: _Positive = 0.2
    clip_range_vf: _Positive | None = None
    normalize_advantage: bool = True
    ent_coef: Annotated[float, Field(ge=0)] = 0.0
    vf_coef: Annotated[float, Field(ge=0)] = 0.5
    max_grad_norm: _Positive = 0.5
    target_kl: _Positive | None = None

    @property
    def rollout(self) -> int:
        """`n_steps` of every env."""
        return self.n_steps * self.n_envs

    @model_validator(mode="after")
    def _advantages_vary(self) -> Self:
        if self.rollout == 1:
            raise ValueError("n_steps * n_envs = 1: accepted: at least 2, or there is nothing to compare")
        return self


@dataclass(frozen=True)
class Sb3Algorithm:
    """One of SB3's algorithms, see `agents.contract.Algorithm`."""

    name: str
    settings: type[_Settings]
    version: int = VERSION
    family: Literal["tabular", "deep"] = "deep"
    observations: tuple[str, ...] = OBSERVATIONS
    packages: tuple[str, ...] = ("stable_baselines3", "torch")
    batch_size: int = 1
    placement: Literal["thread", "process"] = "process"
    depends_on_batch: bool = False
    writes_logs: bool = True

    def train(
        self,
        model: Model,
        settings: Any,
        observation: str,
        seeds: Sequence[SeedSequence],
        schedule: Schedule,
        logs: Sequence[Path] = (),
    ) -> Training:
        """Trains by `agents.sb3.training.train`.

        Raises:
          InputError: A package is not installed.
        """
        try:
            from agents.sb3 import training
        except ModuleNotFoundError as error:
            raise InputError(
                f"{self.name}: needs the package {error.name}, which is not installed; make compare-deep "
                "installs it."
            ) from error
        return training.train(
            self.name,
            model,
            settings,
            observation,
            seeds,
            schedule.evaluation_steps,
            schedule.map_steps,
            logs,
        )


DQN: Final = Sb3Algorithm("dqn", DqnSettings)
PPO: Final = Sb3Algorithm("ppo", PpoSettings)
