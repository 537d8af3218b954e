"""Reads objects that Stable-Baselines3 has pickled, without running code from their file."""

import pickle
import re
from collections.abc import Collection
from typing import IO, Any, Final

import torch
from gymnasium import spaces

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
_MODULES: Final = re.compile(
    r"(gymnasium\.spaces|torch\.(nn\.modules|optim)|stable_baselines3|sb3_contrib)\."
)


def unpickled(file: IO[bytes], what: str, modules: Collection[str] = ()) -> Any:
    """Reads a pickle, which messages call `what`, of arrays, spaces, nets' classes and plain values.

    Whatever else it names is an UnpicklingError. `modules` are the user's own, where nets may be defined.
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
