"""The leaderboard: files that submit a policy, from which all scores are computed again.

A file holds the policy as a table over observations, so nothing is trained or loaded to check it.
"""

import hashlib
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import pandas as pd
from markupsafe import Markup
from pydantic import AfterValidator, Field

from agents.dynamic_programming import evaluate
from benchmark.assessment import HORIZON, RESULTS, Assessment
from benchmark.drawing.tables import to_markdown
from benchmark.publish import files
from benchmark.publish.templates import templates_in
from envs import ACTIONS, InputError, load_scenario
from envs.inputs import Line, Table, check_file_name, parse, read_toml, shortened, unknown_name
from envs.observations import OBSERVATIONS, compile_seen
from envs.scenario import scenario_names

_HEAD: Final = "# Made by python -m benchmark assess --submit. Keys above scenario are declared, not checked."
_TOLERANCE: Final = 1e-9  # for probabilities and scores
_DECIMALS: Final = 12  # compared in scores and successes
_MAX_FILE: Final = 2_000_000  # bytes: 250,000 numbers of a policy, and 2,000 rows with all digits
_TEMPLATE: Final = Path(__file__).with_suffix(".md.jinja")


def _distribution(row: tuple[float, ...]) -> tuple[float, ...]:
    is_positive = all(math.copysign(1, p) > 0 for p in row)  # -0.0 is not
    if not (len(row) == len(ACTIONS) and is_positive and abs(sum(row) - 1) <= _TOLERANCE / 2):
        raise ValueError(f"accepted: {len(ACTIONS)} probabilities, none of them -0.0, that sum to one")
    return row


Count = Annotated[int, Field(ge=0, le=10**12)]
Row = Annotated[tuple[float, ...], AfterValidator(_distribution)]


class Submission(Table):
    """A policy with its scores, named after its file."""

    learner: Annotated[Line, Field(min_length=1, max_length=60)]
    """What learned the policy, or "by hand"."""
    training_steps: Count
    """Environment steps of its training; 0 without any."""
    search_trials: Count
    """How many settings were tried; 0 without a search."""
    note: Annotated[Line, Field(max_length=500)] = ""
    """Anything else, such as the settings or where the code is."""
    model: Annotated[Line, Field(max_length=500)] = ""
    """The saved model that the policy was read from, if any: its file, class and digest."""
    scenario: str
    """The name of a shipped scenario."""
    scenario_sha256: str
    """The digest of all of the scenario but its description."""
    observation: str
    """The form of observation."""
    score: float
    """The return as a score, clipped to [0, 1]."""
    success: float
    """Probability that an episode ends with a PING in the target region."""
    grid_return: float
    """Expected sum of the grid's rewards of an episode."""
    steps: float
    """Expected length of an episode."""
    rows: Annotated[tuple[Row, ...], Field(min_length=1, max_length=2000)]
    """The different rows of the policy: probabilities of UP, DOWN, LEFT, RIGHT and PING."""
    policy: Annotated[tuple[int, ...], Field(max_length=250_000)]
    """For each observation, which of these rows it has, from 0."""


def submit(assessment: Assessment, path: Path, **declared: str | int) -> None:
    """Writes a file; `declared` has the first keys of `Submission`. It may raise an InputError."""
    if path.suffix != ".toml":
        raise InputError(f"{path}: accepted: a name that ends in .toml.")
    _check_name(path)
    if path.exists():
        raise InputError(f"{path}: exists already; accepted: a new file.")
    scenario = assessment.scenario
    if scenario.name not in scenario_names() or scenario != load_scenario(scenario.name):
        raise InputError(f"{path}: scenario = {scenario.name}: accepted: a shipped scenario, unchanged.")
    rows, policy = np.unique(assessment.policy + 0.0, axis=0, return_inverse=True)
    table = {"rows": rows.tolist(), "policy": policy.ravel().tolist()}
    submission = parse(Submission, declared | _computed(assessment) | table, str(path))
    # TOML has numbers, lists, and texts in one line as JSON has them.
    lines = [f"{key} = {json.dumps(value, ensure_ascii=False)}\n" for key, value in submission]
    files.write_text(path, "".join([f"{_HEAD}\n", *lines]))


def _check_name(path: Path) -> None:
    check_file_name(path, "a submission is")
    for other in path.parent.glob("*"):
        if other.name != path.name and other.name.lower() == path.name.lower():
            raise InputError(f"{path}: {other.name} differs only in case; accepted: a different name.")


def checked(path: Path) -> Submission:
    """Reads a file, and computes its scores again; a file with other scores raises an InputError."""
    _check_name(path)
    submission = parse(Submission, read_toml(path, _MAX_FILE), str(path))
    for key, known in (("scenario", scenario_names()), ("observation", OBSERVATIONS)):
        if getattr(submission, key) not in known:
            unknown_name(str(path), key, getattr(submission, key), known)
    scenario, observation = load_scenario(submission.scenario), submission.observation
    model, rows, policy = compile_seen(scenario, observation), submission.rows, submission.policy
    if len(policy) != model.n_observations or not 0 <= min(policy) <= max(policy) < len(rows):
        accepted = f"{model.n_observations:,} numbers from 0 to {len(rows) - 1}, one for each observation"
        raise InputError(f"{path}: policy, of {len(policy):,} numbers: accepted: {accepted}.")
    table = np.array(rows)[list(policy)]
    assessment = Assessment(scenario, model, observation, table, evaluate(model, table, HORIZON), RESULTS)
    for key, value in _computed(assessment).items():
        found = getattr(submission, key)
        is_same = found == value if isinstance(value, str) else math.isclose(found, value, abs_tol=_TOLERANCE)
        if not is_same:
            raise InputError(f"{path}: {key} = {shortened(str(found))}: recomputed: {value}.")
    return submission.model_copy(update=_computed(assessment))


def _computed(assessment: Assessment) -> dict[str, Any]:
    content = assessment.scenario.model_dump(mode="json", exclude={"description"})
    return {
        "scenario": assessment.scenario.name,
        "scenario_sha256": hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest(),
        "observation": assessment.observation,
        "score": assessment.score,
        "success": assessment.success,
        "grid_return": float(assessment.evaluation.grid_return),
        "steps": float(assessment.evaluation.steps),
    }


def texts(results: Path, refused: Callable[[str], None]) -> dict[Path, str]:
    """Returns the leaderboard's README, by its path; calls `refused` with a sentence on each bad file."""
    folder, entries = results / "leaderboard", list[dict[str, object]]()
    paths = sorted(folder.glob("[!.]*.toml"))
    for path in paths:
        try:
            each = checked(path)
        except InputError as error:
            refused(f"left out of the leaderboard: {error.args[0]}")
            continue
        row = {
            "scenario": each.scenario,
            "behaviour": _behaviour(each),
            "name": f"[{path.stem}]({path.name})",
            "learner": each.learner,
            "observation": each.observation,
            "score": round(each.score, _DECIMALS),
            "success": round(each.success, _DECIMALS),
            "declared training steps": f"{each.training_steps:,}",
            "declared search trials": f"{each.search_trials:,}",
        }
        entries.append(row)
    frame = pd.DataFrame(entries)
    tables = {scenario: _table(rows) for scenario, rows in frame.groupby("scenario")} if entries else {}
    text = templates_in(_TEMPLATE.parent).get_template(_TEMPLATE.name).render(tables=tables)
    return {folder / "README.md": text} if paths else {}


def _table(rows: pd.DataFrame) -> str:
    """Returns the table of a scenario: the best first, each with the names of those with its behaviour."""
    ranked = rows.sort_values(["success", "score"], ascending=False, kind="stable")
    names = ranked["name"].groupby(ranked["behaviour"])
    others = names.transform(lambda same: same.map(lambda name: [name, *same[same != name]]))
    ranked["name"] = [Markup(", same policy as ".join(each)) for each in others]
    ranked[["score", "success"]] = ranked[["score", "success"]].apply(lambda column: _texts([*column]))
    return to_markdown(ranked.drop(columns=["scenario", "behaviour"]))


def _behaviour(submission: Submission) -> str:
    """Returns a digest of what a policy does in the states that it reaches, whatever it observes."""
    model = compile_seen(load_scenario(submission.scenario), submission.observation)
    policy = np.array(submission.rows)[list(submission.policy)].round(6) + 0.0
    is_reached, new = np.zeros(len(model.observation), bool), model.starts
    while new.size:
        is_reached[new] = True
        is_taken = (policy[model.observation[new]] > 0) & ~model.terminated[new]
        after = model.next_state[new][is_taken[:, :, None] & (model.probability[new] > 0)]
        new = np.unique(after[~is_reached[after]])
    return hashlib.sha256((policy[model.observation] * is_reached[:, None]).data).hexdigest()


def _texts(values: list[float]) -> list[str]:
    """Returns numbers with at least four decimals, as many as tell them apart from each other, 0 and 1.

    >>> _texts([1.0, 0.999996, 0.5]), _texts([1.0, 0.5])
    (['1.000000', '0.999996', '0.500000'], ['1.0000', '0.5000'])
    """
    different = {round(value, _DECIMALS) for value in (*values, 0.0, 1.0)}
    decimals = 4
    while len({f"{value:.{decimals}f}" for value in different}) < len(different):
        decimals += 1
    return [f"{value:.{decimals}f}" for value in values]
