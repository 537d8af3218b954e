"""What a comparison decides, as its experiment declares it, and the answer that its contrasts give."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple, Self

import pandas as pd

from agents import load_algorithm
from benchmark.analysis.contrasts import BETTER, EQUIVALENT, NO_VERDICT, VERDICTS, WORSE
from benchmark.experiments import Experiment
from benchmark.experiments.schema import MOST_CONTRASTS
from benchmark.experiments.schema import Protocol as Declared
from envs import InputError
from envs.inputs import unknown_name

Outcome = Literal["earns", "does not earn", "undecided", "no verdict"]
_ANSWERS: Final[dict[Outcome, str]] = {
    "earns": "Deep RL earns its keep over the table here",
    "does not earn": "Deep RL does not earn its keep over the table here",
    "undecided": "Undecided: does deep RL earn its keep over the table here?",
    "no verdict": "No verdict on whether deep RL earns its keep over the table",
}


class Learner(NamedTuple):
    """An arm of the experiment with one observation."""

    algorithm: str  # the arm; columns of tables are named so
    observation: str

    @classmethod
    def of(cls, name: str) -> Self:
        """Returns the learner of this name, as `str` gives it."""
        algorithm, _, observation = name.partition(", ")
        return cls(algorithm, observation)

    @property
    def is_default(self) -> bool:
        """Whether it has Stable-Baselines3's own settings, by its name."""
        return self.algorithm.endswith("_default")

    def __str__(self) -> str:
        """Its name for readers."""
        return f"{self.algorithm}, {self.observation}"


@dataclass(frozen=True)
class Protocol:
    """What is decided, and how; see `benchmark.experiments.schema.Protocol`."""

    reference: Learner | None
    decisive: Sequence[Learner]  # deep learners that are compared with the reference
    contrasts: Sequence[tuple[Learner, Learner]]
    success_margin: float
    score_margin: float
    fewest_runs: int
    is_declared: bool  # else it follows from the arms, by the rule of `protocol_of`

    @property
    def compared(self) -> set[Learner]:
        """The learners of the contrasts."""
        return {learner for pair in self.contrasts for learner in pair}

    @property
    def margins(self) -> dict[str, float]:
        """By endpoint: smaller differences do not matter."""
        return {"success": self.success_margin, "score": self.score_margin}

    def as_json(self) -> dict[str, object]:
        """Returns it for the manifest."""
        return vars(self) | {
            "reference": "" if self.reference is None else str(self.reference),
            "decisive": [str(learner) for learner in self.decisive],
            "contrasts": [[str(x), str(y)] for x, y in self.contrasts],
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """Returns it as read from the manifest."""
        return cls(
            **dict(data)
            | {
                "reference": Learner.of(data["reference"]) if data["reference"] else None,
                "decisive": [Learner.of(name) for name in data["decisive"]],
                "contrasts": [(Learner.of(x), Learner.of(y)) for x, y in data["contrasts"]],
            }
        )


def protocol_of(experiment: Experiment) -> Protocol | None:
    """Returns what an experiment decides.

    If it declares no protocol, its first tabular learner is the reference, and every deep learner that is no
    check is compared with it, in the order declared.

    Returns:
      The protocol; None if it declares none and has no table, or no deep learner.

    Raises:
      InputError: A declared name is unknown, a contrast is of a learner with itself or is declared twice, the
        reference is no table, or more deep learners than a protocol may have contrasts call for one.
    """
    families = {name: load_algorithm(arm.algorithm).family for name, arm in experiment.algorithms.items()}
    learners = {
        Learner(name, observation): families[name]
        for name, arm in experiment.algorithms.items()
        for observation in arm.observations
        if not arm.check_of
    }
    if experiment.protocol is not None:
        return _checked(experiment.protocol, learners, experiment.argument)
    reference = next((learner for learner, family in learners.items() if family == "tabular"), None)
    deep = [learner for learner, family in learners.items() if family == "deep"]
    if reference is None or not deep:
        return None
    if len(deep) > MOST_CONTRASTS:
        raise InputError(
            f"{experiment.argument}: protocol: there are {len(deep)} deep learners; accepted: a table "
            f"[protocol] that names at most {MOST_CONTRASTS} contrasts."
        )
    by_default = Declared(reference=str(reference), contrasts=tuple((str(x), str(reference)) for x in deep))
    return _checked(by_default, learners, experiment.argument, is_declared=False)


def _checked(
    declared: Declared, learners: Mapping[Learner, str], source: str, *, is_declared: bool = True
) -> Protocol:
    """Returns a protocol whose names are those of learners."""
    names = {str(learner): learner for learner in learners}
    pairs: list[tuple[Learner, Learner]] = []
    for place, contrast in enumerate(declared.contrasts):
        where = f"{source}: protocol.contrasts.{place}"
        for name in contrast:
            if name not in names:
                unknown_name(where, "learner", name, names)
        x, y = (names[name] for name in contrast)
        if x == y:
            raise InputError(f"{where} = {list(contrast)}: accepted: two different learners.")
        if learners[y] == "deep" and str(x) == declared.reference:
            raise InputError(
                f'{where} = {list(contrast)}: accepted: the reference second, ["{y}", "{x}"], since the '
                "question is whether deep RL is better."
            )
        if {(x, y), (y, x)} & set(pairs):
            raise InputError(f"{where} = {list(contrast)}: it is declared twice; remove one.")
        pairs.append((x, y))
    if declared.reference:
        tables = [str(learner) for learner, family in learners.items() if family == "tabular"]
        if declared.reference not in tables:
            unknown_name(f"{source}: protocol.reference", "table", declared.reference, tables)
    decisive = [x for x, y in pairs if learners[x] == "deep" and str(y) == declared.reference]
    if declared.reference and not decisive:
        raise InputError(
            f"{source}: protocol.contrasts: none compares a deep learner with {declared.reference}; "
            f'accepted: at least one like ["LEARNER", "{declared.reference}"].'
        )
    return Protocol(
        reference=Learner.of(declared.reference) if declared.reference else None,
        decisive=decisive,
        contrasts=pairs,
        success_margin=declared.success_margin,
        score_margin=declared.score_margin,
        fewest_runs=declared.fewest_runs,
        is_declared=is_declared,
    )


def outcome(protocol: Protocol, contrasts: pd.DataFrame) -> Outcome:
    """Decides whether deep RL earns its keep over a table, by the contrasts with the reference.

    It *earns* its keep if some deep learner is better than the reference in success. It *does not earn* it if
    every one of them is worse or equivalent. There is *no verdict* if some have none, because runs are
    missing or too few, or if the reference hardly ever succeeds and no deep learner is better: then nothing
    has been learned. Everything else is *undecided*.

    Args:
      protocol: With a reference.
      contrasts: See `benchmark.reports.comparison.tables.contrasts`.
    """
    rows = decisive_rows(protocol, contrasts)
    found = set(rows["success_verdict"])
    if NO_VERDICT in found or len(rows) < len(protocol.decisive):
        return "no verdict"
    if BETTER in found:
        return "earns"
    if has_failed(protocol, rows):
        return "no verdict"
    return "does not earn" if found <= {WORSE, EQUIVALENT} else "undecided"


def has_failed(protocol: Protocol, rows: pd.DataFrame) -> bool:
    """Returns whether the reference succeeds less often than the margin, by its decisive rows."""
    return bool((rows["success_y"] < protocol.success_margin).any())


def decisive_rows(protocol: Protocol, contrasts: pd.DataFrame) -> pd.DataFrame:
    """Returns the contrasts of deep learners with the reference."""
    is_deep = contrasts["x"].isin([str(learner) for learner in protocol.decisive])
    return contrasts[is_deep & (contrasts["y"] == str(protocol.reference))]


def answer(protocol: Protocol, contrasts: pd.DataFrame) -> str:
    """Returns the answer in a few words; without a reference, how the contrasts ended."""
    if protocol.reference is None:
        return f"Of {len(contrasts)} contrasts, {counted(contrasts)}"
    return _ANSWERS[outcome(protocol, contrasts)]


def counted(contrasts: pd.DataFrame) -> str:
    """Counts the verdicts on success in words."""
    counts = []
    for verdict in VERDICTS:
        n = int((contrasts["success_verdict"] == verdict).sum())
        if n and verdict == NO_VERDICT:
            counts.append(f"{n} {'has' if n == 1 else 'have'} no verdict")
        elif n:
            counts.append(f"{n} {'is' if n == 1 else 'are'} {verdict}")
    *others, last = counts or ["none is there"]
    return f"{', '.join(others)} and {last}" if others else last
