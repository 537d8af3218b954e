"""Settings that an experiment takes from a search, whose scenarios and seeds it must not use."""

import hashlib
import json
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from agents import dynamic_programming, load_algorithm
from benchmark.experiments.schema import Declaration, Variant, overlap, read_experiment
from benchmark.experiments.search import Chosen, read_chosen
from envs import InputError, Scenario, load_scenario
from envs.inputs import unknown_name


def chosen_for(declared: Declaration, variant: str, observation: str) -> Chosen | None:
    """Returns the settings that a search has chosen for a learner, and its effort; None without a search.

    Raises an InputError if the search has chosen nothing for it, or has been changed since.
    """
    name, searched = declared.algorithms[variant].source
    if not name:
        return None
    source = f"{declared.argument}: {_key(declared, variant)}"
    search = _search(name)
    made, learner = read_chosen(search.path, source), f"{searched}, {observation}"
    if made.search != search.digest:
        what = f"{search.path} was made by another version of the search"
        raise InputError(f"{source}: {what}; run it again, with --report.")
    if learner not in made.learners:
        unknown_name(source, "learner of the search", learner, made.learners)
    return made.learners[learner]


def digest_of_search(search: Declaration) -> str:
    """Returns a digest of what a search depends on: its file but texts and colours, scenarios, versions."""
    texts: dict[str, Any] = dict.fromkeys(("description", "note", "report"), True)
    of_variants = {"__all__": {"title", "colour"}}
    content = search.model_dump(mode="json", exclude=texts | {"algorithms": of_variants})
    content["scenarios"] = [load_scenario(name).model_dump(mode="json") for name in search.scenarios]
    algorithms = [load_algorithm(variant.algorithm).version for variant in search.algorithms.values()]
    content["versions"] = [*algorithms, dynamic_programming.VERSION]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _key(declared: Declaration, variant: str) -> str:
    """Returns the key that names a search, for messages."""
    return f"algorithms.{variant}.tuned_by = {declared.algorithms[variant].tuned_by}"


def check_source(declared: Declaration, variant: str, path: Path) -> None:
    """Refuses, by an InputError, what does not name a variant of a search."""
    if not declared.algorithms[variant].tuned_by:
        return
    name, searched = declared.algorithms[variant].source
    where = f"{path}: {_key(declared, variant)}"
    if not name:
        raise InputError(f'{where}: accepted: "EXPERIMENT:VARIANT".')
    search = _search(name).declared
    if search.search is None:
        raise InputError(f"{where}: {name} has no table [search]; accepted: an experiment with one.")
    if searched not in search.algorithms:
        unknown_name(where, f"variant of {name}", searched, search.algorithms)


def check_seeds(declared: Declaration, variant: str, path: Path) -> None:
    """Refuses, by an InputError, seeds on which a variant's settings were chosen."""
    name, searched = declared.algorithms[variant].source
    taken = _search(name).declared.seeds_of_search(searched) if name else ()
    for own in {declared.seeds_of(variant, condition) for condition in declared.conditions.values()}:
        if any(overlap(own, seeds) for seeds in taken):
            used = " and ".join(f"{seeds.start} to {seeds.stop - 1}" for seeds in taken)
            found = f"{path}: {_key(declared, variant)}: the search has used the seeds {used}"
            raise InputError(f"{found}; accepted: seeds other than {own.start} to {own.stop - 1}.")


def check_unseen(scenario: Scenario, variant: Variant, path: Path) -> None:
    """Refuses, by an InputError, a scenario of the search that a variant names, under whatever name."""
    if other := _search(variant.source[0]).scenarios.get(content_of(scenario)):
        reason = f"{scenario.name} is {other}, a scenario of the search {variant.source[0]}"
        raise InputError(f"{path}: {reason}; accepted: other scenarios.")


def content_of(scenario: Scenario) -> str:
    """Returns a scenario as JSON without its name and description, which do not change the task."""
    return scenario.model_dump_json(exclude={"name", "description"})


class _Search(NamedTuple):
    """A search that others take settings from."""

    declared: Declaration
    path: Path
    scenarios: dict[str, str]  # names, by content
    digest: str


@lru_cache(maxsize=8)
def _search(name: str) -> _Search:
    declared, path = read_experiment(name)
    loaded = [load_scenario(scenario) for scenario in declared.scenarios]
    scenarios = {content_of(scenario): scenario.name for scenario in loaded}
    return _Search(declared, path, scenarios, digest_of_search(declared))
