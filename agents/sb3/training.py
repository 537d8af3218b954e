"""Trains agents of Stable-Baselines3 so that a run does not depend on what else runs beside it.

SB3's classes do the learning, on a batch of envs, with one torch thread, random streams from
one seed, and exactly the declared number of environment steps.
"""

import hashlib
import time
import warnings
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.random import SeedSequence
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecEnv
from torch.optim.optimizer import register_optimizer_step_post_hook

from agents.contract import Fields, Schedule, snapshots
from agents.people import PeopleArguments, check_people
from agents.sb3.extractors import PeopleExtractor
from agents.sb3.settings import Sb3Settings
from agents.sb3.tables import first_line, output_of, policy_table, readable_table
from agents.sb3.vec_env import SB3VecEnv
from envs import ACTIONS, InputError, Model, Scenario, compile_scenario, load_scenario
from envs.inputs import parse
from envs.observations import compile_seen, observation_table


def make_agent(cls: type[BaseAlgorithm], settings: Sb3Settings, env: VecEnv) -> BaseAlgorithm:
    """Makes an agent for an env of `settings.n_envs` envs, on the CPU, not seeded yet."""
    arguments: dict[str, Any] = {"device": "cpu", **settings.arguments}
    with warnings.catch_warnings():  # the last mini-batch of a rollout is allowed to be smaller
        warnings.filterwarnings("ignore", message="You have specified a mini-batch size")
        agent = cls("MlpPolicy", env, **arguments)
    # Fused, Adam takes the same step in one call. As an argument, that would unset SB3's epsilon of
    # Adam.
    optimizer = getattr(agent.policy, "optimizer", None)
    if isinstance(optimizer, torch.optim.Adam):
        for group in optimizer.param_groups:
            group["fused"] = True
    return agent


def check_settings(cls: type[BaseAlgorithm], settings: Sb3Settings, path: str) -> None:
    """Refuses, by a ValueError, what cannot be trained: makes an agent, reads its table.

    A features extractor is only imported: it may need another form of observation.
    """
    model = compile_scenario(load_scenario("S1"))
    env = SB3VecEnv(model, "coordinates", settings.n_envs)
    with torch.random.fork_rng(devices=[]), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            table = torch.as_tensor(observation_table(model, "coordinates"))
            policy = settings.arguments.get("policy_kwargs", {})
            plain = {
                key: policy[key] for key in policy if not key.startswith("features_extractor_")
            }
            if plain != policy:
                settings = settings.model_copy(update={"policy_kwargs": plain})
            readable_table(make_agent(cls, settings, env), table)
        except Exception as error:  # whatever the class raises
            raise ValueError(f"{path} cannot be trained: {first_line(error)}") from error


class _Snapshots(BaseCallback):
    """Keeps what the net says, the wrong PINGs so far and the CPU seconds at each evaluation step.

    The policy changes only between rollouts, so the policy at a rollout's start is that of every
    evaluation step from there to the next rollout.
    """

    def __init__(
        self, env: SB3VecEnv, rollout: int, observations: torch.Tensor, schedule: Schedule
    ) -> None:
        super().__init__()
        self._env = env
        self._rollout = rollout
        self._next_rollout = 0
        self._observations = observations  # (O, ...)
        self._points = schedule.evaluation_steps
        self._may_end = schedule.may_end
        self._n_policies = 0  # evaluation steps whose policy is known
        self.has_ended = False  # early
        n_points = len(self._points)
        # see `policy_table`
        self.tables = np.full((n_points, len(observations), len(ACTIONS)), np.nan)
        self.disagreements = np.zeros(n_points, dtype=np.int64)
        self.cpu_time_s = np.zeros(n_points)
        self._started_s = time.thread_time()

    def _on_rollout_start(self) -> None:
        step = self.model.num_timesteps
        if step != self._next_rollout:
            raise InputError(
                f"{type(self.model).__name__}: a rollout began after {step} steps; accepted: after "
                f"{self._next_rollout}, since the settings say that a rollout has {self._rollout} "
                "steps."
            )
        self._next_rollout += self._rollout
        self.keep_policy(before=self._next_rollout)

    def _on_step(self) -> bool:
        n_past = bisect_right(self._points, self.model.num_timesteps - self._env.num_envs)
        self.disagreements[n_past:] = self._env.disagreements
        return not self.has_ended

    def keep_policy(self, before: int) -> None:
        """Keeps the present policy for the evaluation steps before a step that have none yet."""
        first = self._n_policies
        end = bisect_left(self._points, before)
        if first == end:
            return
        now_s = time.thread_time()
        self.cpu_time_s[first:] = now_s - self._started_s
        table = policy_table(self.model, self._observations)
        if not np.isfinite(table).all():
            raise ValueError("the net diverged")
        self.tables[first:end] = table
        self._n_policies = end
        if self._may_end is not None and any(self._may_end(i, table) for i in range(first, end)):
            self.tables[end:] = table
            self.has_ended = True
            self._n_policies = len(self._points)
        self._started_s += time.thread_time() - now_s  # reading policies is not training


def train_agent(
    cls: type[BaseAlgorithm],
    model: Model,
    settings: Sb3Settings,
    observation: str,
    seed: SeedSequence,
    schedule: Schedule,
) -> Fields:
    """Trains an agent of a class, see `agents.contract.SequentialAlgorithm`."""
    policy = settings.arguments.get("policy_kwargs", {})
    if policy.get("features_extractor_class") is PeopleExtractor:
        given = policy.get("features_extractor_kwargs", {})
        where = "policy_kwargs.features_extractor_kwargs"
        check_people(model, observation, parse(PeopleArguments, given, where))
    with _isolated(seed) as (env_seed, action_seed):
        env = SB3VecEnv(model, observation, settings.n_envs, settings.time_limit)
        env.seed(env_seed)
        observations = torch.as_tensor(observation_table(model, observation))
        agent = make_agent(cls, settings, env)
        # Without one, SB3 makes a temporary folder for every agent, and leaves it there.
        agent.set_logger(Logger(None, []))
        agent.action_space.seed(action_seed)
        kept = _Snapshots(env, settings.rollout, observations, schedule)
        updates: list[None] = []
        hook = register_optimizer_step_post_hook(lambda *_: updates.append(None))
        try:
            agent.learn(settings.budget, callback=kept, log_interval=None)  # type: ignore[arg-type]
            if agent.num_timesteps != settings.budget and not kept.has_ended:
                raise InputError(
                    f"{cls.__name__}: trained for {agent.num_timesteps} steps; accepted: the "
                    f"budget of {settings.budget}."
                )
            kept.keep_policy(before=settings.budget + 1)
        except ValueError:  # torch, too, refuses to draw from probabilities that are not finite
            if np.isfinite(policy_table(agent, observations)).all():
                raise
        finally:
            hook.remove()
        if schedule.keep:
            schedule.keep(agent)
        digest = hashlib.sha256()
        for name, weights in sorted(agent.policy.state_dict().items()):
            digest.update(name.encode() + weights.numpy().tobytes())
        output = output_of(agent)
        final = policy_table(agent, observations)
        return {
            **snapshots(kept.tables, final, schedule, is_value=output.is_value),
            "disagreements": kept.disagreements,
            "cpu_time_s": kept.cpu_time_s,
            "updates": len(updates),
            "parameters": sum(weights.numel() for weights in output.net.parameters()),
            "weights": np.frombuffer(digest.digest(), dtype=np.uint8),
        }


def save(path: Path, about: str, scenario: Scenario, settings: Any, form: str, agent: Any) -> None:
    """Saves a model of SB3, or a compiled net as one; a ValueError if it would act otherwise."""
    model = agent
    if not isinstance(agent, BaseAlgorithm):
        seen = compile_seen(scenario, form)
        env = SB3VecEnv(seen, form, settings.n_envs, settings.time_limit)
        model = make_agent(DQN if agent.is_value else PPO, settings, env)
        model._last_obs = env.reset()  # as after training; `assess` looks at it
        model.num_timesteps = int(agent.envs.n_steps[0])
        w = agent.weights()
        n = len(agent.weights()) // 2
        # DQN has two equal nets. PPO has all hidden layers of actor and critic before their last
        # ones.
        w = w * 2 if agent.is_value else [*w[: n - 2], *w[n:-2], *w[n - 2 : n], *w[-2:]]
        for parameter, values in zip(model.policy.parameters(), w, strict=True):
            parameter.data = torch.tensor(values.T)
        table = policy_table(model, torch.as_tensor(observation_table(seen, form)))
        if n_other := np.count_nonzero(table.argmax(axis=1) != agent.table().argmax(axis=1)):
            raise ValueError(
                f"in PyTorch, rounding changes {n_other} actions; accepted: an .npz file"
            )
    model.about = about
    model.save(path)


@contextmanager
def _isolated(seed: SeedSequence) -> Iterator[tuple[int, int]]:
    """Seeds the global generators and sets one torch thread; yields seeds for env and actions.

    Meanwhile denormal numbers, into which Adam's unused moments decay, count as zero: they are
    slow.
    """
    words = seed.generate_state(14, np.uint32)
    parts = words[4:6], words[6:10], words[10:]
    integers = [int.from_bytes(part.astype("<u4").tobytes(), "little") for part in parts]
    numpy_state = np.random.get_state()  # noqa: NPY002
    threads = torch.get_num_threads()
    try:
        with torch.random.fork_rng(devices=[]):
            torch.set_num_threads(1)
            torch.set_flush_denormal(True)
            torch.manual_seed(integers[0])
            np.random.seed(words[:4])  # noqa: NPY002
            yield integers[1], integers[2]
    finally:
        torch.set_flush_denormal(False)  # torch's default; it cannot be asked
        torch.set_num_threads(threads)
        np.random.set_state(numpy_state)  # noqa: NPY002
