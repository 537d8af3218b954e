"""What a map declares of its report, and what it demands of its experiment."""

from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import chain
from math import prod
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from agents.dynamic_programming import evaluate, largest_success
from agents.policy import uniform_policy
from benchmark.experiments import Experiment, Population
from benchmark.experiments.choices import check_seeds
from benchmark.studies.study import Declared
from envs import InputError, Scenario, compile_scenario
from envs.inputs import Label, Names, Table, distinct, require


class Margins(Table):
    """Differences that are too small to matter."""

    faster: Annotated[float, Field(gt=0, le=0.2)] = 0.2
    """Distance of the probability of being faster from 1/2."""


LearnerNames = dict[str, Annotated[Label, Field(min_length=1)]]


class Panel(Table):
    """A panel of a map."""

    grid: str = ""
    """The grid with one axis that it shows; by default the first."""
    title: Annotated[Label, Field(min_length=1)]
    """Its heading."""
    learners: Annotated[Names, Field(min_length=1)]
    """Names of the learners that it shows."""
    shows: Literal["steps", "unseen"] = "steps"
    """What is drawn: "steps" until they have learned, or success in "unseen" places after training."""


class AnswerGroup(Table):
    """Rows of the figure of a map's answer, under a heading."""

    title: Label
    """The heading."""
    learners: Annotated[LearnerNames, Field(min_length=1)]
    """What the figure calls each learner, by its name: "ppo, coordinates" = "PPO (net)"."""


class Answer(Table):
    """A map's answer at one point: steps until learners have learned, and success in unseen places."""

    grid: str
    """The grid with the point."""
    point: str
    """The point, as in tables: "places 64". The person must have unseen places there."""
    learners: LearnerNames = Field(default={})
    """What the figure calls each learner, by its name, if it has no groups."""
    groups: tuple[AnswerGroup, ...] = ()
    """The learners under headings, instead of `learners`."""

    @property
    def headed(self) -> dict[str, LearnerNames]:
        """The learners by heading; without groups, there is one empty heading."""
        return {group.title: group.learners for group in self.groups} or {"": self.learners}


class MapDeclared(Declared):
    """The contrasts that a map decides, and what its figures show."""

    contrasts: Annotated[tuple[tuple[str, str], ...], Field(min_length=1)]
    """Pairs of learners x, y that are compared, with verdicts, wherever there are both."""
    looks: Annotated[tuple[Annotated[int, Field(ge=2, le=10**12)], ...], Field(min_length=1)]
    """Numbers of runs at which contrasts are looked at; a contrast that is decided gets no more runs."""
    margins: Margins = Margins()
    """Differences between x and y that are too small to matter."""
    panels: tuple[Panel, ...] = ()
    """Panels in which a map draws grids with one axis; by default, one of the first with all learners."""
    answer: Answer | None = None
    """What the figure of a map's answer shows; without it, there is no figure."""

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        looks, answer = [*self.looks], self.answer
        require(looks == sorted({*looks}), f"looks = {looks}", "increasing numbers")
        for x, y in self.contrasts:
            require(x != y, f"contrasts: {x} and {y}", "two different learners")
        pairs = (" and ".join(sorted(contrast)) for contrast in self.contrasts)
        distinct(tuple(pairs), "contrasts: ")
        distinct(tuple(panel.title for panel in self.panels), "panels: title ")
        if answer:
            is_one = bool(answer.learners) != bool(answer.groups)
            require(is_one, "answer", "either learners or groups")
            distinct(tuple(group.title for group in answer.groups), "answer.groups: title ")
            for learners in answer.headed.values():
                distinct(tuple(learners.values()), "answer: ")
        return self


def name_of(population: Population) -> dict[str, str]:
    """Returns the columns that name a population's point: its grid, and its name there."""
    grid, *values = population.condition.name.split("/")
    return {"grid": grid, "point": ", ".join(values).replace("=", " ")}


def curve_grids(experiment: Experiment, *, unseen: bool = False) -> list[str]:
    """Lists grids with one axis, not named permuted, about steps or about success in unseen places.

    A grid is about steps if it has a point without unseen places. If no grid has one, each grid with
    several points is about both.
    """
    seen = {p.condition.axes.get("grid") for p in experiment.populations if not p.scenario.issuer.unseen}
    grids = {
        name: len(*grid.axes.values())
        for name, grid in experiment.declared.grids.items()
        if len(grid.axes) == 1 and "permuted" not in grid.axes
    }
    if not seen & {*grids}:
        return [name for name, n_points in grids.items() if n_points > 1]
    return [name for name in grids if (name not in seen) == unseen]


def axis_of(experiment: Experiment, grid: str) -> tuple[str, dict[str, float]]:
    """Returns the only axis of a grid, and its values as numbers by name, ascending; 5x6 is 30."""
    ((axis, names),) = experiment.declared.grids[grid].axes.items()
    values = {name: prod(map(float, name.split("x"))) for name in names}
    return axis, dict(sorted(values.items(), key=lambda pair: pair[1]))


def panels_of(experiment: Experiment, declared: MapDeclared) -> list[Panel]:
    """Returns the declared panels with their grids; by default, the first grid with all learners."""
    first = curve_grids(experiment)[0]
    learners = shown_in(experiment, first)
    title = experiment.declared.grids[first].question
    default = Panel.model_construct(title=title, learners=tuple(learners))
    panels = declared.panels or (default,)
    return [panel.model_copy(update={"grid": panel.grid or first}) for panel in panels]


def shown_in(experiment: Experiment, grid: str) -> list[str]:
    """Lists the learners that run in a grid, without reference implementations."""
    ran = {p.learner.name for p in experiment.populations if p.condition.axes["grid"] == grid}
    return [name for name, each in experiment.learners.items() if name in ran and not each.reference_for]


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


def most_runs(experiment: Experiment, declared: MapDeclared) -> int:
    """Returns the maximum number of runs over all looks; one that conditions share counts for each."""
    sides = {side for pair in compared(experiment, declared.contrasts) for side in pair}
    last = declared.looks[-1]
    return sum(max(len(p.seeds), last * (p in sides)) for p in experiment.populations)


def check(experiment: Experiment, declared: MapDeclared) -> None:
    """Raises an InputError if grids, contrasts, budgets, seeds or figures do not fit a map."""
    _refuse(experiment, *_of_grids(experiment))
    runs = [*_of_contrasts(experiment, declared), *_of_budgets(experiment)]
    _refuse(experiment, *runs, *_of_panels(experiment, declared), *_of_answer(experiment, declared))
    for variant in experiment.declared.algorithms:
        check_seeds(experiment.declared, variant, experiment.path, declared.looks[-1])
    _refuse(experiment, *_unreachable(experiment, declared))


def _refuse(experiment: Experiment, *mistakes: str) -> None:
    if mistakes:
        raise InputError(*(f"{experiment.argument}: {sentence}" for sentence in mistakes))


def _of_grids(experiment: Experiment) -> Iterator[str]:
    declared = experiment.declared
    for key, value in {"[grids]": declared.grids, "[solved]": declared.solved}.items():
        if not value:
            yield f"{key} is missing; this report needs it."
    for key, names in {"scenarios": experiment.scenarios}.items():
        if len(names) > 1:
            yield f"{key}: {len(names)}: accepted: exactly one."
    if declared.grids and not curve_grids(experiment):
        accepted = "at least one that has one axis, not named permuted, and a point without unseen places"
        yield f"grids: accepted: {accepted}, which the figure of the map draws."
    for name, grid in declared.grids.items():
        if not grid.question:
            yield f"grids.{name}.question is missing; this report needs it."


def _of_contrasts(experiment: Experiment, declared: MapDeclared) -> Iterator[str]:
    known, first = experiment.learners, declared.looks[0]
    names = dict.fromkeys(name for contrast in declared.contrasts for name in contrast)
    for name in names:
        if name not in known:
            yield f"report.contrasts: {name}: accepted: {', '.join(known)}."
    variants = {known[name].variant: known[name].declared.seeds for name in names if name in known}
    for variant, seeds in variants.items():
        if seeds != first:
            accepted = f"report.looks[0] = {first}, as report.contrasts names it"
            yield f"algorithms.{variant}.seeds = {seeds}: accepted: {accepted}."
    for contrast in declared.contrasts:
        starts = {known[name].declared.first_seed for name in contrast if name in known}
        if len(starts) > 1:
            found = f"{' and '.join(contrast)}: first_seed is {' and '.join(map(str, sorted(starts)))}"
            yield f"report.contrasts: {found}: accepted: the same first_seed."


def _of_budgets(experiment: Experiment) -> Iterator[str]:
    budgets = dict[str, int]()
    for population in experiment.populations:
        budget, where = population.first.settings.budget, population.condition.name
        if not population.learner.reference_for and budget != budgets.setdefault(where, budget):
            accepted = f"accepted: {budgets[where]}, as others have there"
            yield f"algorithms.{population.learner.variant}: budget = {budget} at {where}: {accepted}."
            return


def _of_panels(experiment: Experiment, declared: MapDeclared) -> Iterator[str]:
    for panel in panels_of(experiment, declared):
        grids = curve_grids(experiment, unseen=panel.shows == "unseen")
        if panel.grid not in grids:
            yield f"report.panels: grid = {panel.grid}: accepted: {', '.join(grids) or 'none'}."
            continue
        shown = shown_in(experiment, panel.grid)
        for name in panel.learners:
            if name not in shown:
                accepted = f"learners of the grid {panel.grid}: {', '.join(shown)}"
                yield f"report.panels: {name}: accepted: {accepted}."


def _of_answer(experiment: Experiment, declared: MapDeclared) -> Iterator[str]:
    ran = dict[tuple[str, ...], list[str]]()  # the learners at each point with unseen places
    for population in experiment.populations:
        if population.scenario.issuer.unseen:
            ran.setdefault(tuple(name_of(population).values()), []).append(population.learner.name)
    if answer := declared.answer:
        learners = ran.get((answer.grid, answer.point), [])
        if not learners:
            accepted = "; ".join(f'grid = "{grid}", point = "{point}"' for grid, point in ran)
            where = f'report.answer: grid = "{answer.grid}", point = "{answer.point}"'
            yield f"{where}: accepted: {accepted or 'none, since no point has unseen places'}."
        for name in chain(*answer.headed.values()):
            if learners and name not in learners:
                yield f"report.answer: {name}: accepted: {', '.join(learners)}."


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
