"""People as a set: a net embeds each of them, and embeddings are added (Zaheer et al. 2017).

Axis letters: O observations, K people, D numbers that the net is given for each of them.
"""

import json

import numpy as np

from envs import Model
from envs.arrays import Singles
from envs.inputs import Count, InputError, Table
from envs.observations import ENCODINGS, NUMBERS, observation_table

PEOPLE_EXTRACTOR = "agents.sb3.extractors:PeopleExtractor"
_PEOPLE = ("issuer", "offset", "relative")  # components


class PeopleArguments(Table):
    """Arguments of `agents.sb3.extractors.PeopleExtractor`, besides the observation space."""

    width: Count = 64
    """Units of each of the net's two layers."""
    per_person: Count = 2
    """Numbers for each person: row and column, and a third one with badges."""
    marks_first: bool = True
    """Whether the net is told who is the first person."""
    sees_agent: bool = True
    """Whether row and column of the agent's cell come before people."""


def check_people(model: Model, observation: str, arguments: PeopleArguments) -> None:
    """Refuses, by an InputError, arguments that do not fit observations.

    These must hold coordinates of the agent's cell, if it is seen, then of each person, and nothing
    else: a phase and wrong PINGs would pass for one more person.
    """
    names = [component.name for component in model.components]
    what = f"PeopleExtractor in {model.scenario.name}: observation {observation}"
    is_known = names[:-1] in ([], ["agent"]) and names[-1] in _PEOPLE
    if ENCODINGS[observation] not in NUMBERS or not is_known:
        accepted = "coordinates, centred or not, of people, or of the agent and people"
        raise InputError(f"{what} of {', '.join(names)}; accepted: {accepted}.")
    people = model.components[-1]
    expected = {
        "per_person": len(people.per_cell) // people.ones.shape[1],
        "sees_agent": len(names) > 1,
    }
    given, accepted = (
        ", ".join(f"{key} = {json.dumps(each[key])}" for key in expected)
        for each in (arguments.model_dump(), expected)
    )
    if given != accepted:
        raise InputError(
            f"{what}, policy_kwargs.features_extractor_kwargs: {given}; accepted: {accepted}."
        )


def people_table(model: Model, observation: str, arguments: PeopleArguments) -> Singles:
    """Returns what the net is given for each person in all observations, (O, K, D)."""
    check_people(model, observation, arguments)
    table = observation_table(model, observation)
    agent, people = np.split(table, [2 * arguments.sees_agent], axis=1)
    people = people.reshape(len(table), -1, arguments.per_person)
    marks = np.eye(people.shape[1])[:, : int(arguments.marks_first)]
    parts = (
        np.broadcast_to(part, (*people.shape[:2], part.shape[-1]))
        for part in (agent[:, None], people, marks)
    )
    return np.concatenate([*parts], axis=2).astype(np.float32)
