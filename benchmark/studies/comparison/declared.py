"""What a comparison decides, as its experiment declares it."""

from collections.abc import Mapping
from itertools import chain, product
from typing import Final, NamedTuple

from benchmark.experiments import Experiment, Reporting
from envs import InputError
from envs.inputs import unknown_name
from envs.scenario import RELATIVE

AXES: Final = ("learner", "scenario", "condition")  # columns, in the order in which a side names them

Side = Mapping[str, str]  # the columns that a side of a contrast names, with their values


class Pair(NamedTuple):
    """The two sides of a contrast or an effect, which name the same columns."""

    x: Side
    y: Side


def side_name(side: Side) -> str:
    """Returns the name of a side in tables, such as "dqn, one_hot @ S1"."""
    return " @ ".join(side[axis] for axis in AXES if axis in side)


def knowledge(learner: str) -> str:
    """Returns what a learner of this name observes of people: cells, or offsets from the agent."""
    return "offsets" if learner.partition(", ")[2].startswith(RELATIVE) else "cells"


def reporting_of(experiment: Experiment) -> Reporting:
    """Returns what is declared; if nothing is, deep learners have to beat all tables and linear learners."""
    reporting = experiment.report
    assert reporting is not None
    deep, baselines = own_learners(experiment, "deep"), own_learners(experiment, "tabular", "linear")
    is_declared = bool(reporting.contrasts or reporting.baseline or reporting.effects)
    if is_declared or not baselines or not deep:
        return reporting
    update = {"baseline": tuple(baselines), "contrasts": tuple(product(deep, baselines))}
    return reporting.model_copy(update=update)


def own_learners(experiment: Experiment, *families: str) -> list[str]:
    """Lists the learners of these families, by default of all but planners, without references."""
    own = [learner for learner in experiment.learners.values() if not learner.reference_for]
    return [one.name for one in own if one.family in (families or ("tabular", "linear", "deep", "other"))]


def contrasts_of(experiment: Experiment) -> list[Pair]:
    """Returns the contrasts with their sides resolved; an InputError says which side is wrong."""
    contrasts = enumerate(reporting_of(experiment).contrasts)
    return [_pair(experiment, f"contrasts.{i}", x, y) for i, (x, y) in contrasts]


def effects_of(experiment: Experiment) -> list[tuple[str, Pair]]:
    """Returns the effects, each with its name and its sides; an InputError says which side is wrong."""
    effects = enumerate(reporting_of(experiment).effects)
    return [(name, _pair(experiment, f"effects.{i}", x, y)) for i, (x, y, name) in effects]


def decisive_learners(experiment: Experiment) -> list[str]:
    """Lists the deep learners, except baselines, that are compared with baselines wherever both are."""
    reporting = reporting_of(experiment)
    baselines = reporting.baseline
    names = dict.fromkeys(x for x, y in reporting.contrasts if y in baselines and x not in baselines)
    return [name for name in names if experiment.learners[name].family == "deep"]


def drawn_learners(experiment: Experiment) -> list[str]:
    """Lists the learners that the outcome is about, or else those compared; undeclared, all but planners."""
    reporting, decisive = reporting_of(experiment), decisive_learners(experiment)
    named = {side.get("learner") for pair in contrasts_of(experiment) for side in pair}
    compared = [name for name in experiment.learners if name in named]
    names = [*reporting.baseline, *decisive] if decisive else compared
    return names if names and reporting is experiment.report else own_learners(experiment)


def check(experiment: Experiment) -> None:
    """Refuses, by an InputError, what cannot be compared, and baselines that deep learners need not beat."""
    source, reporting = experiment.argument, reporting_of(experiment)
    names = ((each.learner.name, each.scenario.name, each.condition.name) for each in experiment.populations)
    populations = [dict(zip(AXES, name, strict=True)).items() for name in names]
    for sides in (*contrasts_of(experiment), *(pair for _, pair in effects_of(experiment))):
        # What else names the populations of a side, which is the same of both sides
        first, second = (
            {frozenset(p - side.items()) for p in populations if p >= side.items()} for side in sides
        )
        if first.isdisjoint(second):
            found = " and ".join(map(side_name, sides))
            raise InputError(f"{source}: report: {found}: accepted: two with runs that are otherwise alike.")
    accepted = own_learners(experiment)
    for y in reporting.baseline:
        if y not in accepted:
            unknown_name(f"{source}: report.baseline", "baseline", y, accepted)
        for x in decisive_learners(experiment) or ["LEARNER"]:
            if (x, y) not in reporting.contrasts:
                why = f"{y} is a baseline, which every deep learner of these contrasts has to beat"
                one = f'one that is ["{x}", "{y}"]'
                raise InputError(f"{source}: report.contrasts: accepted: {one}, since {why}.")
    if {learner.family for learner in experiment.learners.values()} == {"planner"}:
        raise InputError(f"{source}: algorithms: accepted: at least one that is not a planner.")
    for population in experiment.populations:
        unit = getattr(population.first.settings, "budget_unit", "steps")
        if unit != "steps":
            where = f"algorithms.{population.learner.variant}.settings.budget_unit = {unit}"
            raise InputError(f"{source}: {where}: accepted: steps, in which a comparison counts.")


def _pair(experiment: Experiment, key: str, x: str, y: str) -> Pair:
    where = f"{experiment.argument}: report.{key}"
    pair = Pair(_side(experiment, where, x), _side(experiment, where, y))
    if pair.x == pair.y or pair.x.keys() != pair.y.keys():
        raise InputError(f"{where} = {[x, y]}: accepted: two different names of the same kind.")
    return pair


def _side(experiment: Experiment, where: str, text: str) -> Side:
    """Returns the columns that a side names: learner, scenario and condition, joined by " @ "."""
    names = (experiment.learners, experiment.scenarios, experiment.conditions)
    axis_of = {name: axis for axis, of_axis in zip(AXES, names, strict=True) for name in of_axis}
    side, every = dict[str, str](), [*chain(*names)]
    for part in text.split(" @ "):
        if part not in axis_of:
            accepted = [f'"{name}"' for name in axis_of]
            unknown_name(where, "learner, scenario or condition", f'"{part}"', accepted)
        axis = axis_of[part]
        if every.count(part) > 1:
            raise InputError(f'{where} = "{text}": {part} names a scenario and a condition; rename one.')
        if axis in side:
            raise InputError(f'{where} = "{text}": accepted: at most one {axis} on a side.')
        if axis == "learner" and experiment.learners[part].family == "planner":
            raise InputError(f'{where} = "{text}": it knows the model; accepted: learners.')
        side[axis] = part
    return side
