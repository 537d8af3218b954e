"""The manifest of a folder of results: what was run, and with which code and machines."""

import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from benchmark.execution.store import Provenance
from benchmark.experiments import DEFAULT_CONDITION, Population, RunSpecification
from benchmark.studies import Data, Declared


def manifest_of(data: Data[Declared], seeds: Sequence[int] | None) -> dict[str, object]:
    """Returns the manifest; drawing again gives the same."""
    declared, runs = data.experiment.declared, data.specifications
    of = {run.digest: group.population.first.population for group in data.groups for run in group.runs}
    sizes = Counter(of.values())
    # One run of each learner in each scenario, by default or else under the first condition that has it.
    first: dict[tuple[str, str], Population] = {}
    for population in (group.population for group in data.groups):
        first.setdefault((population.scenario.name, population.learner.name), population)
    option = "" if seeds is None else f" --seeds {seeds[0]}-{seeds[-1]}"
    return {
        "experiment": declared.name,
        "description": declared.description,
        "command": f"python -m benchmark run {declared.argument}{option} --report",
        "partial": data.note,
        "argument": declared.argument,
        "report": data.declared.model_dump(mode="json"),
        **declared.model_dump(mode="json", include={"solved", "search"}),
        "horizon": declared.horizon,
        "scenarios": {name: each.scenario.model_dump(mode="json") for (name, _), each in first.items()},
        "algorithms": _variants(data, first, sizes),
        "note": declared.note.strip(),
        "readings": {
            name: reading.model_dump(include={"title", "question", "answer"})
            | ({"curve": reading.curve} if name == DEFAULT_CONDITION and reading.curve == "table" else {})
            for name, reading in declared.readings.items()
        },
        "runs": len(runs),
        "digest": digest_of(runs),
        **_made_by(data.provenance),
    }


def digest_of(runs: Sequence[RunSpecification]) -> str:
    """Returns a digest that identifies a set of runs."""
    return hashlib.sha256("".join(sorted(run.digest for run in runs)).encode()).hexdigest()


def _variants(
    data: Data[Declared], first: Mapping[tuple[str, str], Population], sizes: Mapping[str, int]
) -> dict[str, dict[str, Any]]:
    variants: dict[str, dict[str, Any]] = {}
    for (_, name), population in first.items():
        learner = data.experiment.learners[name]
        about = learner.declared.model_dump(include={"algorithm", "title", "policy", "tuned_by"})
        about |= {"family": learner.family, "runs": sizes[population.first.population]}  # in a scenario
        variant = variants.setdefault(learner.variant, about | {"settings": {}})
        # Of several picks of a search, which take turns, it has the first; the search's report has all.
        variant["settings"][learner.observation] = population.first.settings.model_dump(mode="json")
    return variants


def _made_by(provenance: Sequence[Provenance]) -> dict[str, object]:
    keys = {"commits": "commit", "machines": "machine", "processors": "processor", "versions": "versions"}
    texts = {key: {json.dumps(run[name], sort_keys=True) for run in provenance} for key, name in keys.items()}
    return {key: [json.loads(text) for text in sorted(values)] for key, values in texts.items()} | {
        "first_started_at": min(run["started_at"] for run in provenance),
        "last_started_at": max(run["started_at"] for run in provenance),
        "busy_time_s": round(sum(run["wall_time_s"] for run in provenance), 3),
    }
