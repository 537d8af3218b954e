"""Proxemic scenarios as Gymnasium environments.

Importing this package registers an id for every TOML file in `envs/scenarios`, for example
`Proxemic/S1-v0`, with a time limit of 200 steps; so does the prefix of an id, as below.

>>> import gymnasium
>>> env = gymnasium.make("envs:Proxemic/S1-v0", observation="coordinates")
>>> env.observation_space.shape
(2,)
>>> env.reset()[1]["zone"] == ZONES.index("outside")
True
"""

import gymnasium

from envs.inputs import InputError, is_name
from envs.model import ACTIONS, EVENTS, Model, compile_scenario
from envs.observations import OBSERVATIONS
from envs.people import Ping
from envs.proxemic_env import ProxemicEnv
from envs.regions import ZONES
from envs.scenario import Scenario, load_scenario, scenario_names

__all__ = [
    "ACTIONS",
    "EVENTS",
    "OBSERVATIONS",
    "ZONES",
    "InputError",
    "Model",
    "Ping",
    "ProxemicEnv",
    "Scenario",
    "compile_scenario",
    "load_scenario",
    "scenario_names",
]

for _name in filter(is_name, scenario_names()):  # a misnamed file is reported when it is loaded
    gymnasium.register(
        id=f"Proxemic/{_name}-v0",
        entry_point="envs.proxemic_env:ProxemicEnv",
        max_episode_steps=200,
        kwargs={"scenario": _name},
    )
