"""What a comparison decides, as its experiment declares it."""

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from benchmark.analysis.contrasts import runs_for_any_equivalence
from benchmark.analysis.frames import keys_of
from benchmark.experiments import Experiment, Learner, Reporting
from benchmark.experiments.schema import MOST_CONTRASTS
from envs import InputError
from envs.inputs import unknown_name

# Scenarios times conditions: curves of so many take minutes to draw, and are about 30,000 pixels high.
MOST_PANELS: Final = 300
MOST_ROWS: Final = 1_000  # of contrasts: 60,000 pixels, and Pillow reads no image that is much higher
AXES: Final = ("learner", "scenario", "condition")  # columns, in the order in which a side names them

Side = Mapping[str, str]  # the columns that a side of a contrast names, with their values


class Pair(NamedTuple):
    """The two sides of a contrast or an effect, which name the same columns."""

    x: Side
    y: Side


def side_name(side: Side) -> str:
    """Returns the name of a side in tables, such as "dqn, one_hot @ S1"."""
    return " @ ".join(side[axis] for axis in AXES if axis in side)


def reporting_of(experiment: Experiment) -> Reporting:
    """Returns what is declared; if that is nothing, every deep learner is compared with the first table.

    Raises:
      InputError: There are too many deep learners for that.
    """
    reporting = experiment.report
    assert reporting is not None
    if reporting.contrasts or reporting.baseline or reporting.effects:
        return reporting
    own = [learner for learner in experiment.learners.values() if not learner.reference_for]
    tables = [learner.name for learner in own if learner.family == "tabular"]
    deep = [learner.name for learner in own if learner.family == "deep"]
    if len(deep) > MOST_CONTRASTS:
        raise InputError(
            f"{experiment.argument}: report: there are {len(deep)} deep learners; accepted: a key "
            f"contrasts in [report], unless there are at most {MOST_CONTRASTS}."
        )
    if not tables:
        return reporting
    pairs = tuple((name, tables[0]) for name in deep)
    return reporting.model_copy(update={"baseline": (tables[0],) if deep else (), "contrasts": pairs})


def contrasts_of(experiment: Experiment) -> list[Pair]:
    """Returns the contrasts with their sides resolved.

    Raises:
      InputError: A side names something unknown, or the sides do not fit together.
    """
    reporting, pairs = reporting_of(experiment), list[Pair]()
    for i, (x, y) in enumerate(reporting.contrasts):
        where = f"{experiment.argument}: report.contrasts.{i}"
        pair = _pair(experiment, where, x, y)
        if pair in pairs or pair[::-1] in pairs:
            raise InputError(f"{where} = {[x, y]}: it is declared twice; remove one.")
        if x in reporting.baseline and experiment.learners[y].family == "deep":
            raise InputError(
                f"{where} = {[x, y]}: accepted: the baseline second, since the question is whether deep RL "
                "is better."
            )
        pairs.append(pair)
    return pairs


def effects_of(experiment: Experiment) -> dict[str, Pair]:
    """Returns the effects by name, with their sides resolved.

    Raises:
      InputError: A side names something unknown, the sides do not fit together, or a name is used twice.
    """
    effects: dict[str, Pair] = {}
    for i, (x, y, name) in enumerate(reporting_of(experiment).effects):
        if name in effects:
            raise InputError(
                f'{experiment.argument}: report.effects: "{name}" is the name of two; accepted: one each.'
            )
        effects[name] = _pair(experiment, f"{experiment.argument}: report.effects.{i}", x, y)
    return effects


def compared_learners(experiment: Experiment) -> list[str]:
    """Lists the learners of the contrasts."""
    named = {side.get("learner") for pair in contrasts_of(experiment) for side in pair}
    return [name for name in experiment.learners if name in named]


def decisive_learners(experiment: Experiment) -> list[str]:
    """Lists the deep learners that are compared with baselines wherever both are."""
    baselines = [{"learner": name} for name in reporting_of(experiment).baseline]
    names = dict.fromkeys(x["learner"] for x, y in contrasts_of(experiment) if y in baselines)
    return [name for name in names if experiment.learners[name].family == "deep"]


def is_own(learner: Learner) -> bool:
    """Returns whether it is neither a reference implementation nor a planner, which knows the model."""
    return not learner.reference_for and learner.family != "planner"


def check(experiment: Experiment) -> None:
    """Checks what an experiment declares to be compared.

    Raises:
      InputError: A side of a contrast or effect is wrong, the baseline is no table, a deep learner is
        compared with some baselines alone, all algorithms are planners, budgets are not in steps, or figures
        would be too high.
    """
    source, contrasts = experiment.argument, contrasts_of(experiment)
    effects_of(experiment)
    _check_baselines(experiment, contrasts)
    is_pooled = reporting_of(experiment).pool == "scenarios" and not any(
        "scenario" in x for x, _ in contrasts
    )
    n_scenarios, n_conditions = len(experiment.scenarios), len(experiment.conditions)
    most = min(MOST_PANELS, MOST_ROWS // max(0 if is_pooled else len(contrasts), 1))
    if n_scenarios * n_conditions > most:
        raise InputError(
            f"{source}: report: {n_scenarios} scenarios under {n_conditions} conditions with "
            f"{len(contrasts)} contrasts make figures that are too high; accepted: at most {most} scenarios "
            "times conditions."
        )
    if {learner.family for learner in experiment.learners.values()} == {"planner"}:
        raise InputError(f"{source}: algorithms: accepted: at least one that is not a planner.")
    for population in experiment.populations:
        unit = getattr(population.first.settings, "budget_unit", "steps")
        if unit != "steps":
            raise InputError(
                f"{source}: algorithms.{population.learner.variant}.settings.budget_unit = {unit}: "
                "accepted: steps, in which a comparison counts."
            )


def _check_baselines(experiment: Experiment, contrasts: Sequence[Pair]) -> None:
    source, baselines = experiment.argument, reporting_of(experiment).baseline
    tables = [name for name, learner in experiment.learners.items() if learner.family == "tabular"]
    for name in baselines:
        if name not in tables:
            unknown_name(f"{source}: report.baseline", "table", name, tables)
        if baselines.count(name) > 1:
            raise InputError(f"{source}: report.baseline: {name} is named twice; remove one.")
        decisive = decisive_learners(experiment)
        if not decisive:
            raise InputError(
                f"{source}: report.contrasts: none compares a deep learner with {name}; "
                f'accepted: at least one like ["LEARNER", "{name}"].'
            )
        for learner in decisive:
            if ({"learner": learner}, {"learner": name}) not in contrasts:
                raise InputError(
                    f"{source}: report.contrasts: {learner} is compared with another baseline and not "
                    f"with {name}; accepted: contrasts with all or none."
                )


def forecast(experiment: Experiment) -> str:
    """Says before any run if the declared runs cannot show equivalence, even if all succeed; else empty."""
    reporting, contrasts = reporting_of(experiment), contrasts_of(experiment)
    if not contrasts:
        return ""
    n = min(
        len(population.seeds)
        for population in experiment.populations
        if population.learner.family != "planner"
        and any(side.items() <= keys_of(population).items() for pair in contrasts for side in pair)
    )
    is_pooled, n_scenarios = reporting.pool == "scenarios", len(experiment.scenarios)
    sizes = {
        "learner": sum(map(is_own, experiment.learners.values())),
        "scenario": 1 if is_pooled else n_scenarios,
        "condition": len(experiment.conditions),
    }
    n_tests = sum(math.prod(sizes[axis] for axis in AXES if axis not in x) for x, _ in contrasts)
    margin, n_adjusted = reporting.margins.success, n_tests if reporting.adjust == "holm" else 1
    n_averaged = n_scenarios if is_pooled and not any("scenario" in x for x, _ in contrasts) else 1
    needed = runs_for_any_equivalence(margin, n_averaged, n_adjusted)
    if n >= needed:
        return ""
    among = f" and {n_adjusted} contrasts" if n_adjusted > 1 else ""
    return (
        f"With {n} runs{among}, equivalence within {margin:g} cannot be shown, even if all runs succeed: "
        f"that takes {needed:,} runs per scenario and learner."
    )


def _pair(experiment: Experiment, where: str, x: str, y: str) -> Pair:
    pair = Pair(_side(experiment, where, x), _side(experiment, where, y))
    if pair.x == pair.y or pair.x.keys() != pair.y.keys():
        raise InputError(f"{where} = {[x, y]}: accepted: two different names of the same kind.")
    return pair


def _side(experiment: Experiment, where: str, text: str) -> Side:
    """Returns the columns that a side names: learner, scenario and condition, joined by " @ "."""
    known = {
        "learner": [*experiment.learners],
        "scenario": [*experiment.scenarios],
        "condition": [*experiment.conditions],
    }
    side: dict[str, str] = {}
    for part in text.split(" @ "):
        axes = [axis for axis, names in known.items() if part in names]
        if not axes:
            names = [f'"{name}"' for names in known.values() for name in names]
            unknown_name(where, "learner, scenario or condition", f'"{part}"', names)
        axis = next((axis for axis in axes if axis not in side), None)
        if axis is None:
            raise InputError(f'{where} = "{text}": accepted: at most one {axes[0]} on a side.')
        if axis == "learner" and experiment.learners[part].family == "planner":
            raise InputError(f'{where} = "{text}": it knows the model; accepted: learners.')
        side[axis] = part
    return side
