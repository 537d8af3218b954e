"""What a comparison decides, as its experiment declares it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

from agents import load_algorithm
from benchmark.analysis.contrasts import runs_for_any_equivalence
from benchmark.experiments import Experiment, Reporting, family_of
from benchmark.experiments.schema import MOST_CONTRASTS
from envs import InputError
from envs.inputs import unknown_name

# Scenarios times conditions: curves of so many take minutes to draw, and are about 30,000 pixels high.
MOST_PLACES: Final = 300
MOST_ROWS: Final = 1_000  # of contrasts: 60,000 pixels, and Pillow reads no image that is much higher


class Learner(NamedTuple):
    """An algorithm with settings, as the experiment names it, with one form of observation."""

    algorithm: str
    observation: str

    @classmethod
    def of(cls, name: str) -> Self:
        """Returns the learner of this name, as `str` gives it."""
        algorithm, _, observation = name.partition(", ")
        return cls(algorithm, observation)

    def __str__(self) -> str:
        """Its name for readers."""
        return f"{self.algorithm}, {self.observation}"


class Side(NamedTuple):
    """Cells of the table of scenarios, conditions and learners: those with the names that are not None."""

    scenario: str | None = None
    condition: str | None = None
    learner: Learner | None = None

    @property
    def axes(self) -> frozenset[str]:
        """The axes on which it names a cell."""
        return frozenset(axis for axis, name in self._asdict().items() if name is not None)


@dataclass(frozen=True)
class Declared:
    """The contrasts and effects of a comparison."""

    reporting: Reporting  # as declared; by default every deep learner against the first table
    contrasts: Sequence[tuple[Side, Side]]
    effects: Sequence[tuple[Side, Side, str]]
    families: Mapping[Learner, str]

    @property
    def baselines(self) -> list[Learner]:
        """The tables that deep learners have to beat; none if the question is another."""
        return [Learner.of(name) for name in self.reporting.baseline]

    @property
    def decisive(self) -> list[Learner]:
        """The deep learners that are compared with the baselines wherever both are."""
        sides = [Side(learner=baseline) for baseline in self.baselines]
        found = [x.learner for x, y in self.contrasts if y in sides and x.learner]
        return [learner for learner in dict.fromkeys(found) if self.families[learner] == "deep"]

    @property
    def compared(self) -> list[Learner]:
        """The learners of the contrasts."""
        sides = [side.learner for pair in self.contrasts for side in pair]
        return [learner for learner in self.families if learner in sides]

    def n_pooled(self, n_scenarios: int) -> int:
        """Returns over how many scenarios every verdict is at least."""
        is_pooled = self.reporting.pool == "scenarios" and not any(x.scenario for x, _ in self.contrasts)
        return n_scenarios if is_pooled else 1

    @classmethod
    def from_manifest(cls, manifest: Mapping[str, Any]) -> Self:
        """Returns it as a manifest has it.

        Raises:
          LookupError: The manifest is one of another version of this project.
        """
        facts = manifest["facts"]
        reporting = Reporting.model_validate_json(facts["declared"])
        families = {Learner.of(name): family for name, family in facts["learners"].items()}
        return cls._resolved(reporting, families, facts["axes"], manifest["experiment"])

    @classmethod
    def of(cls, experiment: Experiment) -> Self:
        """Returns what an experiment decides.

        Raises:
          InputError: A name is unknown, a contrast is of a cell with itself or is declared twice, the
            baseline is no table, a deep learner is compared with some baselines alone, or there are too many
            deep learners to compare each with a table.
        """
        assert experiment.report is not None
        families = {
            Learner(name, observation): family_of(experiment, name)
            for name, declared in experiment.algorithms.items()
            for observation in declared.observations
        }
        axes = {
            "scenarios": [Path(name).stem for name in experiment.scenarios],
            "conditions": [*experiment.conditions],
        }
        reporting = experiment.report
        if not reporting.contrasts and not reporting.baseline and not reporting.effects:
            references = {name for name, declared in experiment.algorithms.items() if declared.reference_for}
            own = [learner for learner in families if learner.algorithm not in references]
            table = next((learner for learner in own if families[learner] == "tabular"), None)
            deep = [learner for learner in own if families[learner] == "deep"]
            if len(deep) > MOST_CONTRASTS:
                raise InputError(
                    f"{experiment.argument}: report: there are {len(deep)} deep learners; accepted: a key "
                    f"contrasts in [report], unless there are at most {MOST_CONTRASTS}."
                )
            if table is not None and deep:
                pairs = tuple((str(learner), str(table)) for learner in deep)
                reporting = reporting.model_copy(update={"baseline": (str(table),), "contrasts": pairs})
        return cls._resolved(reporting, families, axes, experiment.argument)

    @classmethod
    def _resolved(
        cls,
        reporting: Reporting,
        families: Mapping[Learner, str],
        axes: Mapping[str, Sequence[str]],
        source: str,
    ) -> Self:
        """Returns what is declared, with the cells that it names."""
        scenarios, conditions, learners = axes["scenarios"], axes["conditions"], [*map(str, families)]
        known = {"scenario": scenarios, "condition": conditions, "learner": learners}

        def side(where: str, name: str) -> Side:
            found: dict[str, Any] = {}
            for part in name.split(" @ "):
                axes = [axis for axis in known if part in known[axis]]
                if not axes:
                    names = [f'"{each}"' for each in (*learners, *scenarios, *conditions)]
                    unknown_name(where, "learner, scenario or condition", f'"{part}"', names)
                axis = next((axis for axis in axes if axis not in found), None)
                if axis is None:
                    raise InputError(f'{where} = "{name}": accepted: at most one {axes[0]} on a side.')
                if axis == "learner" and families[Learner.of(part)] == "planner":
                    raise InputError(f'{where} = "{name}": it knows the model; accepted: learners.')
                found[axis] = Learner.of(part) if axis == "learner" else part
            return Side(**found)

        def sides(where: str, x: str, y: str, others: Sequence[tuple[Side, Side]]) -> tuple[Side, Side]:
            pair = side(where, x), side(where, y)
            if pair[0] == pair[1] or pair[0].axes != pair[1].axes:
                raise InputError(f"{where} = {[x, y]}: accepted: two different names of the same kind.")
            if pair in others or pair[::-1] in others:
                raise InputError(f"{where} = {[x, y]}: it is declared twice; remove one.")
            return pair

        contrasts: list[tuple[Side, Side]] = []
        for i, (x, y) in enumerate(reporting.contrasts):
            contrasts.append(sides(f"{source}: report.contrasts.{i}", x, y, contrasts))
            if x in reporting.baseline and families[Learner.of(y)] == "deep":
                raise InputError(
                    f"{source}: report.contrasts.{i} = {[x, y]}: accepted: the baseline second, since the "
                    "question is whether deep RL is better."
                )
        effects = [
            (*sides(f"{source}: report.effects.{i}", x, y, []), name)
            for i, (x, y, name) in enumerate(reporting.effects)
        ]
        names = [name for _, _, name in reporting.effects]
        if repeated := next((name for name in names if names.count(name) > 1), None):
            raise InputError(
                f'{source}: report.effects: "{repeated}" is the name of two; accepted: one each.'
            )
        made = cls(reporting, contrasts, effects, families)
        tables = [str(learner) for learner, family in families.items() if family == "tabular"]
        for name in reporting.baseline:
            if name not in tables:
                unknown_name(f"{source}: report.baseline", "table", name, tables)
            if reporting.baseline.count(name) > 1:
                raise InputError(f"{source}: report.baseline: {name} is named twice; remove one.")
            if not made.decisive:
                raise InputError(
                    f"{source}: report.contrasts: none compares a deep learner with {name}; "
                    f'accepted: at least one like ["LEARNER", "{name}"].'
                )
            for learner in made.decisive:
                if (Side(learner=learner), Side(learner=Learner.of(name))) not in contrasts:
                    raise InputError(
                        f"{source}: report.contrasts: {learner} is compared with another baseline and not "
                        f"with {name}; accepted: contrasts with all or none."
                    )
        return made


def check(experiment: Experiment) -> None:
    """Checks what an experiment declares to be compared.

    Raises:
      InputError: See `Declared.of`; or all algorithms are planners, budgets are not in steps, or figures
        would be too high.
    """
    compared = Declared.of(experiment)
    n_rows = len(compared.contrasts) if compared.n_pooled(2) == 1 else 0  # for each of the places
    n_places = len(experiment.scenarios) * len(experiment.conditions)
    most = min(MOST_PLACES, MOST_ROWS // max(n_rows, 1))
    if n_places > most:
        raise InputError(
            f"{experiment.argument}: report: {len(experiment.scenarios)} scenarios under "
            f"{len(experiment.conditions)} conditions with {len(compared.contrasts)} contrasts make figures "
            f"that are too high; accepted: at most {most} scenarios times conditions."
        )
    families = {load_algorithm(declared.algorithm).family for declared in experiment.algorithms.values()}
    if families == {"planner"}:
        raise InputError(f"{experiment.argument}: algorithms: accepted: at least one that is not a planner.")
    for name, declared in experiment.algorithms.items():
        unit = (experiment.settings | declared.settings).get("budget_unit", "steps")
        if unit != "steps":
            raise InputError(
                f"{experiment.argument}: algorithms.{name}.settings.budget_unit = {unit}: accepted: steps, "
                "in which a comparison counts."
            )


def forecast(experiment: Experiment) -> str:
    """Says before any run if the declared runs cannot show equivalence, even if all succeed; else empty."""
    declared = Declared.of(experiment)
    reporting = declared.reporting
    if not declared.contrasts:
        return ""
    sides = [side for pair in declared.contrasts for side in pair]
    n = min(
        len(experiment.declared_seeds(learner.algorithm, condition))
        for side in sides
        for learner in ([side.learner] if side.learner else declared.families)
        for condition in ([side.condition] if side.condition else experiment.conditions)
    )
    n_scenarios = len(experiment.scenarios)
    n_pooled = declared.n_pooled(n_scenarios)
    own = [name for name, each in experiment.algorithms.items() if not each.reference_for]
    n_learners = sum(learner.algorithm in own for learner in declared.families)
    n_tests = sum(
        (1 if x.scenario or reporting.pool == "scenarios" else n_scenarios)
        * (1 if x.condition else len(experiment.conditions))
        * (1 if x.learner else n_learners)
        for x, _ in declared.contrasts
    )
    return cannot_show(n, n_pooled, n_tests, reporting)


def cannot_show(n: int, n_pooled: int, n_tests: int, reporting: Reporting) -> str:
    """Says if n runs per scenario and learner cannot show equivalence, even if all succeed; else empty.

    A mean is over so many pooled scenarios, and p-values may be adjusted for so many tests.
    """
    margin, n_adjusted = reporting.margins.success, n_tests if reporting.adjust == "holm" else 1
    needed = runs_for_any_equivalence(margin, n_pooled, n_adjusted)
    if n >= needed:
        return ""
    among = f" and {n_adjusted} contrasts" if n_adjusted > 1 else ""
    return (
        f"With {n} runs{among}, equivalence within {margin:g} cannot be shown, even if all runs succeed: "
        f"that takes {needed:,} runs per scenario and learner."
    )
