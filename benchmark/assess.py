"""Assesses any agent exactly: its score, and a map of where it PINGs; the command `assess`.

An agent is a function of the observation, or a model of Stable-Baselines3. It is read as a table
over all observations, so it has to be memoryless.
"""

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs import ACTIONS, ZONES, InputError, Model, load_scenario
from envs.inputs import shortened
from envs.observations import compile_seen, observation_table
from envs.packages import contained, needed_by
from envs.scenario import ScenarioLike
from envs.sources import imported

with needed_by("benchmark.assess"):
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    from agents.dynamic_programming import Evaluation, evaluate
    from agents.policy import Policy
    from agents.sb3.algorithms import is_sb3_class
    from benchmark.records import check_anchors, unbounded_scores
    from benchmark.scenes import draw_policy, policy_legend
    from benchmark.style import check_file, figure_of, save

Act = Callable[[Any], object]  # from an observation to an action, or to probabilities of actions

HORIZON = 200  # steps after which an episode is truncated, as in the published experiments
PICTURES = (".png", ".svg")  # endings of files
_TOLERANCE = 1e-5  # for probabilities, which may be of single precision


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    if options.save is not None:
        check_file(options.save, *PICTURES)
    if (options.agent is None) == (options.model is None):
        raise InputError("assess: accepted: either --agent or --model.")
    if options.agent is not None:
        agent = imported(options.agent, "--agent", "function")
    elif not options.trust:
        runs = "loading a model runs any code that is in its file"
        raise InputError(f"--model {options.model}: {runs}; accepted: --trust, if you trust it.")
    else:
        agent = load_model(options.model, options.algorithm)
    assessment = assess(
        agent,
        scenario=options.scenario,
        observation=options.observation,
        stochastic=options.stochastic,
    )
    print(assessment)
    if options.save is not None:
        assessment.draw(options.save)
        print(f"\nmap: {options.save}")
    return 0


def load_model(path: str, algorithm: str | None) -> object:
    """Loads a saved model, by the import path of its class; runs any code that is in the file."""
    if algorithm is None:
        accepted = "--algorithm, the model's class, such as stable_baselines3:PPO, as well"
        raise InputError(f"--model {path}: accepted: {accepted}.")
    cls: Any = imported(algorithm, "--algorithm", "class")
    if not is_sb3_class(cls):
        accepted = "a subclass of stable_baselines3.common.base_class.BaseAlgorithm"
        raise InputError(f"--algorithm {algorithm}: accepted: {accepted}.")
    try:  # an empty replay buffer would only take memory
        return cls.load(path, device="cpu", custom_objects={"buffer_size": 1})
    except Exception as error:  # whatever the saved objects raise
        reason = f"cannot be loaded: {type(error).__name__}: {error}"
        raise InputError(
            f"--model {path}: {reason}; accepted: what model.save of {algorithm} wrote."
        ) from error


@dataclass(frozen=True, eq=False)
class Assessment:
    """What an agent does in a scenario. O observations, A actions."""

    model: Model  # the scenario, compiled for the form of observation
    observation: str  # the form that the agent is given
    policy: Policy  # (O, A) its action probabilities
    evaluation: Evaluation  # exact, from the scenario's starts
    note: str = ""  # what is not known about the agent

    @property
    def unbounded_score(self) -> float:
        """The return as a score, see `benchmark.records.anchors`; it can be below 0."""
        return float(unbounded_scores(self.evaluation.grid_return, self.model, HORIZON))

    @property
    def score(self) -> float:
        """The score clipped to [0, 1], as published learners are compared."""
        return min(max(self.unbounded_score, 0.0), 1.0)

    @property
    def success(self) -> float:
        """The probability that an episode ends with a PING in the target region."""
        return float(self.evaluation.success)

    def __repr__(self) -> str:
        exact = self.evaluation
        clipped = "(0: random or giving up, 1: optimal, knowing the state; clipped)"
        uncomfortable = exact.zone_steps[ZONES.index("uncomfortable")]
        return (
            f"{self.model.scenario.name}, observed as {self.observation}: a memoryless policy, "
            f"evaluated exactly over episodes of at most {HORIZON} steps\n"
            f"  success              {self.success:g}\n"
            f"  score                {self.score:<10g} {clipped}\n"
            f"  unbounded score      {self.unbounded_score:g}\n"
            f"  steps                {float(exact.steps):g}\n"
            f"  wrong PINGs          {float(exact.wrong_pings):g}\n"
            f"  uncomfortable steps  {float(uncomfortable):g}"
            + (f"\n  note: {self.note}" if self.note else "")
        )

    def draw(self, path: str | Path) -> None:
        """Draws where the agent PINGs, and its likeliest moves elsewhere, as a .png or .svg file.

        If it observes more than its cell, the map is of the person's first position and the first
        phase, before any wrong PING.

        Raises:
          InputError: The file name has another ending, or there is no such folder.
        """
        check_file(Path(path), *PICTURES)
        save(draw_map(self), Path(path))


def assess(
    agent: object,
    *,
    scenario: ScenarioLike,
    observation: str,
    stochastic: bool = False,
    overrides: Mapping[str, object] | None = None,
) -> Assessment:
    """Evaluates an agent exactly in a scenario, under the time limit of the published experiments.

    A model that was loaded does not say behind which wrappers it was trained. Its last observation
    shows most that change observations, but not, for example, `1 - o`, or one that changes actions:
    assess a function. With another environment, as by `load(path, env=env)` or `set_env`, a model
    loses this observation: the result then has a note that it may be wrong.

    Args:
      agent: A function that takes an observation and returns an action from 0 to 4
        (`envs.ACTIONS`), five probabilities, or what `model.predict` returns; a model of
        Stable-Baselines3, or its `predict`. A model's wrappers must not change observations or
        actions.
      scenario: A name or a path, see `envs.load_scenario`.
      observation: The form of observation that the agent takes, see `envs.observations`.
      stochastic: Whether a model draws its actions; otherwise it acts greedily.
      overrides: New values for keys of the scenario, by dotted key, as in `gymnasium.make`.

    Raises:
      InputError: The scenario, the form of observation or the model cannot be used, or a function
        returns something else, or another answer when it is asked again.
    """
    model, note = compile_seen(load_scenario(scenario, overrides), observation), ""
    owner = getattr(agent, "__self__", None)
    if getattr(agent, "__name__", "") == "predict" and is_sb3_class(type(owner)):
        agent = owner
    if is_sb3_class(type(agent)):
        policy = _policy_of_model(agent, model, observation, stochastic=stochastic)
        note = _note(agent)
    elif not callable(agent):
        accepted = "a function, or a model of Stable-Baselines3"
        raise InputError(f"agent = {_shown(agent)}: accepted: {accepted}.")
    elif stochastic:
        raise InputError("stochastic: accepted only with a model of Stable-Baselines3.")
    else:
        policy = _policy_of_function(agent, model, observation)
    check_anchors(model, HORIZON)
    return Assessment(model, observation, policy, evaluate(model, policy, HORIZON), note)


def _note(agent: Any) -> str:
    """Returns a warning if a model's last observation in training is missing; else empty."""
    if agent._last_obs is not None or not agent.num_timesteps:
        return ""
    return (
        "its last observation in training is missing: if wrappers, such as VecNormalize, changed "
        "what it observed, this result is wrong; assess a function that applies the same changes"
    )


def _policy_of_function(act: Act, model: Model, observation: str) -> Policy:
    """Returns a function's action probabilities, (O, A); it is called twice with each observation.

    The second call, in reverse order, detects functions with memory or randomness.
    """
    table = observation_table(model, observation)
    policy = np.stack([_asked(act, table, o) for o in range(len(table))])
    again = np.stack([_asked(act, table, o) for o in reversed(range(len(table)))])[::-1]
    if abs(again - policy).max() > _TOLERANCE:
        found = "act: returned another answer for the same observation, asked again"
        drawing = f"an agent that draws its actions returns {len(ACTIONS)} probabilities"
        raise InputError(f"{found}; accepted: one without memory; {drawing}.")
    return policy


def _asked(act: Act, table: NDArray[Any], o: int) -> NDArray[np.float64]:
    """Returns the action probabilities, (A,), that a function answers to an observation."""
    # As an environment gives it: a number, or an array that the function may change.
    given = int(table[o]) if table.ndim == 1 else table[o].copy()
    try:
        answer = contained()(act)(given)
    except Exception as error:  # whatever the function raises
        reason = f"{type(error).__name__}: {error}".removesuffix(".")
        raise InputError(f"act: failed for observation {o}: {reason}.") from error
    row = _row(answer)
    if row is None:
        raise InputError(
            f"act: returned {_shown(answer)} for observation {o}; accepted: an action, a whole "
            f"number from 0 to {len(ACTIONS) - 1}, or {len(ACTIONS)} probabilities that sum to "
            "one, or either with None, as in (action, None), which predict returns for a model "
            "without memory."
        )
    return row


def _row(answer: object) -> NDArray[np.float64] | None:
    """Returns the probabilities, (A,), that a function's answer stands for; None for no answer."""
    if isinstance(answer, tuple) and len(answer) == 2 and answer[1] is None:
        answer = answer[0]  # what a model's `predict` returns without a memory
    try:
        values = np.asarray(answer)
    except (ValueError, TypeError, RuntimeError):  # nested lists, or tensors that need a gradient
        return None
    if values.shape == () and values.dtype.kind in "iu" and 0 <= values < len(ACTIONS):
        values = np.eye(len(ACTIONS))[int(values)]
    if values.shape != (len(ACTIONS),) or values.dtype.kind not in "iuf" or (values < 0).any():
        return None
    total = values.sum(dtype=np.float64)
    return values / total if abs(total - 1.0) <= _TOLERANCE else None


def _shown(answer: object) -> str:
    return shortened(" ".join(repr(answer).split()), 100)


def _policy_of_model(agent: Any, model: Model, observation: str, *, stochastic: bool) -> Policy:
    """Returns the policy, (O, A), of a model of Stable-Baselines3."""
    from agents.sb3.tables import agent_table  # imports torch

    table, is_value = agent_table(agent, model, observation)
    if not stochastic:  # the first of several best actions, as in SB3
        return np.asarray(np.eye(len(ACTIONS))[table.argmax(axis=1)])
    if is_value:
        raise InputError("stochastic: accepted only with action probabilities.")
    return table


def draw_map(assessment: Assessment) -> Figure:
    """Draws the map of an agent, see `Assessment.draw`."""
    model, norm = assessment.model, Normalize(0.0, 1.0)
    rows, columns = model.scenario.grid.rows, model.scenario.grid.columns
    with figure_of(1, 1, (6.0, 2.1 + 4.6 * rows / columns)) as (figure, axes):
        figure.set_layout_engine("compressed")  # the colour scale gets the height of the map
        draw_policy(axes[0, 0], model, assessment.policy, norm)
        numbers = f"score {assessment.score:.3g}, success {assessment.success:.3g}"
        axes[0, 0].set_title(f"{model.scenario.name}: {numbers}")
        policy_legend(figure, [axes[0, 0]], model, norm)
    return figure
