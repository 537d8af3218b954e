"""Settings of Stable-Baselines3's algorithms, with SB3's argument names and defaults.

They are written out here because importing SB3 loads torch, and its signatures do not say which
values make sense. A test compares names and defaults with the signatures.
"""

import sys
from typing import Annotated, Any, ClassVar, Self

from pydantic import Field, model_validator

from agents.contract import LearnerSettings
from envs.inputs import Count, InputError, Share, Table, shortened
from envs.sources import imported

Units = Annotated[int, Field(ge=1, le=4096)]
BufferSize = Annotated[int, Field(ge=1, le=10_000_000)]
StepCount = Annotated[int, Field(ge=1, le=1_000_000)]
Positive = Annotated[float, Field(gt=0)]

OUR_SETTINGS = {"budget", "time_limit", "n_envs"}  # they are not arguments of SB3's classes


class OptimizerArguments(Table):
    """The part of SB3's `optimizer_kwargs` that can be set."""

    eps: Annotated[float, Field(ge=1e-12)] | None = None
    """Epsilon of Adam, the optimiser; by default 1e-8 for DQN and 1e-5 for PPO."""


class PolicyArguments(Table):
    """The part of SB3's `policy_kwargs` that can be set."""

    net_arch: Annotated[tuple[Units, ...], Field(max_length=8)] = (64, 64)
    """Units of each hidden layer; an empty list makes a linear net."""
    optimizer_kwargs: OptimizerArguments = OptimizerArguments()
    """Arguments of the optimiser."""
    features_extractor_class: Annotated[str, Field(pattern=r"^[\w.]+:[\w.]+$")] | None = None
    """The class of a net, as `module:attribute`, whose outputs the hidden layers are given instead
    of the observation. `agents.sb3.extractors` has two."""
    features_extractor_kwargs: dict[str, Any] = Field(default_factory=dict)
    """Arguments of this class, besides the observation space."""


def _features_extractor(name: str) -> object:
    """Imports a class of features extractors; anything else raises an InputError."""
    found = imported(name, "policy_kwargs", key := "features_extractor_class")
    # which every such class has loaded
    module = sys.modules.get("stable_baselines3.common.torch_layers")
    if module and isinstance(found, type) and issubclass(found, module.BaseFeaturesExtractor):
        return found
    raise InputError(
        f"policy_kwargs: {key} {shortened(name)}: accepted: a subclass of "
        "stable_baselines3.common.torch_layers.BaseFeaturesExtractor."
    )


class Sb3Settings(LearnerSettings):
    """What all of SB3's algorithms have in common; a subclass adds arguments of its class."""

    n_envs: Annotated[int, Field(ge=1, le=4096)] = 1
    """Environments that are stepped together."""
    gamma: Share = 0.99
    """Discount."""
    policy_kwargs: PolicyArguments = PolicyArguments()
    """The net."""

    default_epsilon: ClassVar[float]  # of Adam, in SB3's class

    @property
    def adam_epsilon(self) -> float:
        """Epsilon of Adam, the optimiser."""
        return self.policy_kwargs.optimizer_kwargs.eps or self.default_epsilon

    @property
    def discount_factor(self) -> float:
        """SB3's gamma."""
        return self.gamma

    @property
    def _rollout_key(self) -> str:
        return "train_freq" if "train_freq" in vars(self) else "n_steps"

    @property
    def rollout(self) -> int:
        """Environment steps from one round of gradient updates to the next."""
        return int(vars(self)[self._rollout_key]) * self.n_envs

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments of SB3's class, except policy and env."""
        return self._fitted(self.model_dump(mode="json", exclude=OUR_SETTINGS, exclude_none=True))

    def _fitted(self, arguments: dict[str, Any]) -> dict[str, Any]:
        """Returns the arguments with a features extractor's class in place of its name.

        The buffer is no larger than the budget: the rest would only take memory.
        """
        if "policy_kwargs" in arguments:
            # Any `optimizer_kwargs`, even empty ones, would unset SB3's epsilon of PPO.
            arguments["policy_kwargs"] = policy = {
                key: value for key, value in arguments["policy_kwargs"].items() if value != {}
            }
            if isinstance(name := policy.get(key := "features_extractor_class"), str):
                policy[key] = _features_extractor(name)
        size = vars(self).get("buffer_size")
        return arguments if size is None else arguments | {"buffer_size": min(size, self.budget)}

    @model_validator(mode="after")
    def _rollouts_fill_the_budget(self) -> Self:
        """Shortens a rollout of no set length, by less than half, to divide the budget."""
        key = self._rollout_key
        default = self.rollout // self.n_envs
        most = min(default, self.budget // self.n_envs)
        for steps in (default,) if key in self.model_fields_set else range(most, most // 2, -1):
            if self.budget % (steps * self.n_envs) == 0:
                if steps < default:
                    self.__dict__[key] = steps
                    self.model_fields_set.add(key)
                return self
        raise ValueError(
            f"budget = {self.budget} is not a whole number of rollouts of {self.rollout} steps "
            f"({key} = {default}); accepted: a multiple of {self.rollout}, or other {key}"
        )


class DqnSettings(Sb3Settings):
    """Arguments and defaults of SB3's DQN."""

    default_epsilon = 1e-8

    learning_rate: Positive = 1e-4
    """Learning rate of Adam, the optimiser."""
    buffer_size: BufferSize = 1_000_000
    """Transitions that the replay buffer holds; no more are allocated than the budget fills."""
    learning_starts: Annotated[int, Field(ge=0, le=10**9)] = 100
    """Steps before the first update."""
    batch_size: Annotated[int, Field(ge=1, le=100_000)] = 32
    """Transitions of a gradient step, drawn from the replay buffer."""
    tau: Share = 1.0
    """How far the target network moves towards the other one whenever it is updated; 1: it is a
    copy."""
    train_freq: Count = 4
    """Steps of each environment from one round of updates to the next; by default fewer if the
    budget needs it."""
    gradient_steps: Annotated[int, Field(ge=-1, le=10**6)] = 1
    """Gradient steps of a round; -1: as many as steps were made since the last one."""
    n_steps: StepCount = 1
    """Rewards that are added up before the target network estimates the rest of the return."""
    target_update_interval: Count = 10_000
    """Steps from one update of the target network to the next."""
    exploration_fraction: Annotated[float, Field(gt=0, le=1)] = 0.1
    """Share of the budget over which the probability of a random action falls, linearly."""
    exploration_initial_eps: Share = 1.0
    """Probability of a random action at first."""
    exploration_final_eps: Share = 0.05
    """Probability of a random action in the end."""
    max_grad_norm: Positive = 10.0
    """Norm to which longer gradients are cut."""


class PpoSettings(Sb3Settings):
    """Arguments and defaults of SB3's PPO."""

    default_epsilon = 1e-5

    n_steps: Annotated[int, Field(ge=2, le=1_000_000)] = 2048
    """Steps of each environment from one round of updates to the next; by default fewer, but more
    than half as many, if rollouts then divide the budget."""
    gae_lambda: Share = 0.95
    """Lambda of generalized advantage estimation."""
    ent_coef: Annotated[float, Field(ge=0)] = 0.0
    """Weight of the entropy in the loss."""
    vf_coef: Annotated[float, Field(ge=0)] = 0.5
    """Weight of the value function's error in the loss."""
    max_grad_norm: Positive = 0.5
    """Norm to which longer gradients are cut."""
    normalize_advantage: bool = True
    """Whether the advantages of a mini-batch are standardized."""
    learning_rate: Positive = 3e-4
    """Learning rate of Adam, the optimiser."""
    batch_size: Annotated[int, Field(ge=2, le=100_000)] = 64
    """Transitions of a gradient step."""
    n_epochs: Count = 10
    """How often a round of updates goes through its transitions."""
    clip_range: Positive = 0.2
    """How far the ratio of new to old probabilities may be from 1 before it is clipped."""
    clip_range_vf: Positive | None = None
    """How far a new value may be from the old one before it is clipped; by default it is not."""
    target_kl: Positive | None = None
    """Divergence from the old policy; a round of updates ends at 1.5 times this, by default
    never."""
