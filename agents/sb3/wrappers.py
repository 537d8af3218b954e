"""What a net is given for an observation, after its wrappers; reads pickles without running code in them."""

import pickle
import re
from collections.abc import Collection
from pathlib import Path
from typing import IO, Any, Final

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnvWrapper, VecNormalize

from envs.inputs import InputError

# Where methods are defined that pass on observations and actions as they are, or normalise them.
_UNCHANGING: Final = re.compile(
    r"(envs\.(proxemic|vector)_env|agents\.sb3\.vec_env|gymnasium\.core\.(Reward)?Wrapper"
    r"|gymnasium\.wrappers\.(common|rendering|stateful_reward)|stable_baselines3\.common\.(monitor|vec_env\."
    r"(base_vec_env|dummy_vec_env|vec_check_nan|vec_monitor|vec_normalize|vec_video_recorder)))\."
)
_PRECISION: Final = 1e-5  # observations have single precision
_FUNCTION: Final = "a function that does so, such as lambda o: model.predict(wrapped(o), deterministic=True)"

# What arrays, generators of random numbers and VecNormalize are made of.
_DATA: Final = re.compile(
    r"collections\.OrderedDict|numpy\.(ndarray|dtype)"
    r"|numpy\._?core\.(multiarray\.(_reconstruct|scalar)|numeric\._frombuffer)"
    r"|numpy\.random\.(_pickle\.__(bit_)?generator_ctor|_pcg64\.PCG64)"
    r"|numpy\.random\.bit_generator\.(__pyx_unpickle_)?SeedSequence"
    r"|stable_baselines3\.common\.(running_mean_std\.RunningMeanStd|vec_env\.vec_normalize\.VecNormalize)"
)
# Classes that may be named, and the modules of packages that define some.
_CLASSES: Final = (spaces.Space, torch.nn.Module, torch.optim.Optimizer)
_MODULES: Final = re.compile(r"(gymnasium|torch\.(nn\.modules|optim)|stable_baselines3|sb3_contrib)\.")


def known_layers(env: Any, where: str) -> list[Any]:
    """Returns an agent's env, if any, and all that it wraps; an InputError if one may change something."""
    if env is None:
        return []
    methods = ("step", "reset", "step_async", "step_wait")
    sources = [getattr(env, name) for name in methods if hasattr(env, name)]
    if not isinstance(env, gymnasium.Wrapper | VecEnvWrapper):
        sources = [type(env)]
    if not all(_UNCHANGING.match(f"{source.__module__}.{source.__qualname__}") for source in sources):
        what = f"its environment includes {type(env).__name__}, which may change observations or actions"
        raise InputError(f"{where}: {what}; accepted: {_FUNCTION}.")
    inner = (vars(env).get("venv"), vars(env).get("env"), *vars(env).get("envs", ()))
    return [env, *(layer for each in inner for layer in known_layers(each, where))]


def net_inputs(
    agent: BaseAlgorithm, where: str, layers: list[Any], table: NDArray[Any], statistics: str | Path | None
) -> NDArray[Any]:
    """Returns what an agent's net is given for each row of an observation table, (O, ...).

    That is the row itself, unless its layers include a VecNormalize, or `statistics` is a file that one has
    saved. The last observation in training, which the agent keeps, has to agree, else an InputError.
    """
    if statistics is not None:
        return _normalized(agent, table, Path(statistics))
    found = [layer for layer in reversed(layers) if isinstance(layer, VecNormalize)]
    last: Any = getattr(found[0], "old_obs", None) if found else agent._last_obs
    if not _has_rows(table, last) or (last is None and not layers and agent.num_timesteps > 0):
        what = "its last observation in training is missing, or is not one of this scenario in this form"
        given = "" if layers else "the statistics of its VecNormalize as normalization, or "
        raise InputError(f"{where}: {what}; accepted: {given}{_FUNCTION}.")
    for normalizer in found:
        table = np.asarray(normalizer.normalize_obs(table))
    return table


def _normalized(agent: BaseAlgorithm, table: NDArray[Any], path: Path) -> NDArray[Any]:
    try:
        with path.open("rb") as file:
            normalizer: Any = unpickled(file, "it")
        if normalizer.observation_space != agent.observation_space:
            raise ValueError(f"observation_space = {normalizer.observation_space}")
        inputs = np.asarray(normalizer.normalize_obs(table))
        if not _has_rows(inputs, agent._last_obs):
            # Callbacks save an agent before it gets the newest observation, so this is taken out again.
            newest = np.asarray(normalizer.old_obs)
            normalizer.obs_rms.update_from_moments(newest.mean(axis=0), newest.var(axis=0), -len(newest))
            if not _has_rows(np.asarray(normalizer.normalize_obs(table)), agent._last_obs):
                raise ValueError("these statistics do not give the model's last observation in training")
    except Exception as error:  # whatever the saved object raises
        accepted = "what VecNormalize.save wrote when the model was saved"
        raise InputError(f"{path}: cannot be used: {first_line(error)}; accepted: {accepted}.") from error
    return inputs


def _has_rows(table: NDArray[Any], rows: Any) -> bool:
    """Returns whether a table has all these rows; None stands for no rows."""
    flat = table.reshape(len(table), -1)
    each = np.unique(np.reshape([] if rows is None else rows, (-1, flat.shape[1])), axis=0)
    return all(np.isclose(flat, row, _PRECISION, _PRECISION).all(axis=1).any() for row in each)


def unpickled(file: IO[bytes], what: str, modules: Collection[str] = ()) -> Any:
    """Reads a pickle, which messages call `what`, of arrays, spaces, nets' classes and plain values.

    Other names raise an UnpicklingError. `modules` are the user's own, where nets may be defined.
    """

    class Unpickler(pickle.Unpickler):
        def find_class(self, module: str, name: str) -> Any:
            if _DATA.fullmatch(f"{module}.{name}"):
                return super().find_class(module, name)
            if _MODULES.match(module) or module in modules:
                found = super().find_class(module, name)
                if isinstance(found, type) and issubclass(found, _CLASSES) and found.__module__ == module:
                    return found
            remedy = "if you trust the file, load it in Python, and assess the loaded model"
            raise pickle.UnpicklingError(f"{what} needs {module}.{name}, which could run any code ({remedy})")

    return Unpickler(file).load()


def first_line(error: Exception) -> str:
    """Returns the first line of an error's message, or its type, without a full stop or a colon."""
    lines = str(error).strip().splitlines()
    return lines[0].rstrip(".:") if lines else type(error).__name__
