"""What a map declares of its report, and what it demands of its experiment."""

from collections.abc import Iterable, Iterator
from functools import lru_cache
from math import prod
from typing import Annotated, Self

from pydantic import Field, model_validator

from agents.dynamic_programming import evaluate, largest_success
from agents.policy import uniform_policy
from benchmark.experiments import Experiment, Population
from benchmark.studies.study import Declared
from envs import InputError, Scenario, compile_scenario
from envs.inputs import Label, Names, Table, distinct, require


class Panel(Table):
    """A panel of a map: steps until learners have learned, along the axis of a grid."""

    grid: str
    """The grid that it shows, with one axis."""
    title: Annotated[Label, Field(min_length=1)]
    """Its heading."""
    learners: Annotated[Names, Field(min_length=1)]
    """Names of the learners that it shows."""


class AnswerGroup(Table):
    """Rows of the figure of a map's answer."""

    title: Label = ""
    """Their heading, if they have one."""
    learners: Annotated[dict[str, Annotated[Label, Field(min_length=1)]], Field(min_length=1)]
    """What the figure calls each learner, by its name: "ppo, coordinates" = "PPO (net)"."""


class Answer(Table):
    """A map's answer at one point: steps until learners have learned, and success in unseen places."""

    grid: str
    """The grid with the point."""
    point: str
    """The point, as in tables: "places 64". The person must have unseen places there."""
    unseen: str = ""
    """A grid with one axis, along which another figure shows success in unseen places."""
    groups: Annotated[tuple[AnswerGroup, ...], Field(min_length=1)]
    """The learners."""


class MapDeclared(Declared):
    """The contrasts that a map decides, and what its figures show."""

    contrasts: Annotated[tuple[tuple[str, str], ...], Field(min_length=1)]
    """Pairs of learners x, y that are compared, with verdicts, wherever there are both."""
    panels: Annotated[tuple[Panel, ...], Field(min_length=1)]
    """What the figure of the map shows."""
    answer: Answer | None = None
    """What the figure of a map's answer shows; without it, there is no figure."""

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        for x, y in self.contrasts:
            require(x != y, f"contrasts: {x} and {y}", "two different learners")
        pairs = (" and ".join(sorted(contrast)) for contrast in self.contrasts)
        distinct(tuple(pairs), "contrasts: ")
        return self


def name_of(population: Population) -> dict[str, str]:
    """Returns the columns that name a population's point: its grid, and its name there."""
    grid, *values = population.condition.name.split("/")
    return {"grid": grid, "point": ", ".join(values).replace("=", " ")}


def axis_of(experiment: Experiment, grid: str) -> tuple[str, dict[str, float]]:
    """Returns the only axis of a grid, and its values as numbers by name, ascending; 5x6 is 30."""
    ((axis, names),) = experiment.declared.grids[grid].axes.items()
    values = {name: prod(map(float, name.split("x"))) for name in names}
    return axis, dict(sorted(values.items(), key=lambda pair: pair[1]))


def compared(
    experiment: Experiment, contrasts: Iterable[tuple[str, str]]
) -> list[tuple[Population, Population]]:
    """Lists the two populations of each contrast at each point that has both."""
    points: dict[str, dict[str, Population]] = {}
    for population in experiment.populations:
        if experiment.declared.grids[population.condition.axes["grid"]].is_compared:
            points.setdefault(population.condition.name, {})[population.learner.name] = population
    return [
        (sides[x], sides[y]) for sides in points.values() for x, y in contrasts if x in sides and y in sides
    ]


def check(experiment: Experiment, declared: MapDeclared) -> None:
    """Raises an InputError if grids, contrasts, budgets, seeds or figures do not fit a map."""
    _refuse(experiment, *_of_grids(experiment))
    runs = [*_of_contrasts(experiment, declared), *_of_budgets(experiment)]
    _refuse(experiment, *runs, *_of_figures(experiment, declared))
    _refuse(experiment, *_unreachable(experiment, declared))


def _refuse(experiment: Experiment, *mistakes: str) -> None:
    if mistakes:
        raise InputError(*(f"{experiment.argument}: {sentence}" for sentence in mistakes))


def _of_grids(experiment: Experiment) -> Iterator[str]:
    declared = experiment.declared
    for key, value in {"[grids]": declared.grids, "[solved]": declared.solved}.items():
        if not value:
            yield f"{key} is missing; this report needs it."
    if len(experiment.scenarios) > 1:
        yield f"scenarios: {len(experiment.scenarios)}: accepted: exactly one."


def _of_contrasts(experiment: Experiment, declared: MapDeclared) -> Iterator[str]:
    known = experiment.learners
    for contrast in declared.contrasts:
        for name in contrast:
            if name not in known:
                yield f"report.contrasts: {name}: accepted: {', '.join(known)}."
        variants = [known[name].declared for name in contrast if name in known]
        seeds = {(variant.first_seed, variant.seeds) for variant in variants}
        if len(seeds) > 1:
            yield f"report.contrasts: {' and '.join(contrast)}: accepted: two with the same seeds."


def _of_budgets(experiment: Experiment) -> Iterator[str]:
    budgets = dict[str, int]()
    for population in experiment.populations:
        budget, where = population.first.settings.budget, population.condition.name
        if budget != budgets.setdefault(where, budget):
            accepted = f"accepted: {budgets[where]}, as others have there"
            yield f"algorithms.{population.learner.variant}: budget = {budget} at {where}: {accepted}."
            return


def _of_figures(experiment: Experiment, declared: MapDeclared) -> Iterator[str]:
    # The learners of each grid with one axis, and at each point with unseen places
    ran = dict[tuple[str, ...], list[str]]()
    for population in experiment.populations:
        grid, point = name_of(population).values()
        if len(experiment.declared.grids[grid].axes) == 1:
            ran.setdefault((grid,), []).append(population.learner.name)
        if population.scenario.issuer.unseen:
            ran.setdefault((grid, point), []).append(population.learner.name)
    answer = declared.answer
    shown: list[tuple[str, tuple[str, ...], list[str]]]  # key, a grid or a point, and learners
    shown = [("report.panels", (panel.grid,), [*panel.learners]) for panel in declared.panels]
    if answer:
        where = answer.grid, answer.point
        shown += [("report.answer", where, [*group.learners]) for group in answer.groups]
        shown += [("report.answer.unseen", (answer.unseen,), [])] if answer.unseen else []
    for key, names, learners in shown:
        if names not in ran:
            accepted = "; ".join(", ".join(known) for known in ran if len(known) == len(names))
            yield f"{key}: {', '.join(names)}: accepted: {accepted or 'none here'}."
        for name in {*learners} - {*ran.get(names, learners)}:
            yield f"{key}: {name}: accepted: {', '.join(dict.fromkeys(ran[names]))}."


def _unreachable(experiment: Experiment, declared: MapDeclared) -> Iterator[str]:
    """Yields contrasts that no grid has, and the first point whose level is unreachable or trivial."""
    pairs, solved = compared(experiment, declared.contrasts), experiment.declared.solved
    assert solved is not None
    for contrast in sorted({*declared.contrasts} - {(x.learner.name, y.learner.name) for x, y in pairs}):
        yield f"report.contrasts: {' and '.join(contrast)}: accepted: two in one compared grid."
    for population in {x.condition.name: x for x, _ in pairs}.values():
        random, most = _success_range(population.first.drawn_scenario, experiment.declared.horizon)
        where = f"in {population.scenario.name} at {population.condition.name}"
        level = f"solved.success = {solved.success:g}: {where}"
        if most < solved.success:
            yield f"{level} no policy succeeds more often than {most:.3g}; accepted: at most that."
            return
        if random >= solved.success:
            yield f"{level} the random policy succeeds in {random:.3g}; accepted: more than that."
            return


@lru_cache(maxsize=1024)
def _success_range(scenario: Scenario, horizon: int) -> tuple[float, float]:
    """Returns the success of the random policy and of the best one."""
    model = compile_scenario(scenario)
    random = float(evaluate(model, uniform_policy(model), horizon).success)
    return random, largest_success(model, horizon)
