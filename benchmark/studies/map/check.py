"""What a map demands of an experiment."""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import filterfalse

from agents.dynamic_programming import evaluate, largest_success
from agents.policy import uniform_policy
from benchmark.analysis.looks import compared
from benchmark.experiments import Experiment, Learner
from benchmark.experiments.schema import is_number
from benchmark.studies.map.crossings import leading, ranked, steps_grids
from benchmark.studies.map.results import name_of
from envs import InputError, Scenario, compile_scenario


def check(experiment: Experiment) -> None:
    """Refuses, by an InputError, a map without grids or looks, or contrasts of unequal seeds or budgets."""
    mistakes = [*_mistakes(experiment)] or [*_unreachable(experiment)]
    if mistakes:
        raise InputError(*(f"{experiment.argument}: {sentence}" for sentence in dict.fromkeys(mistakes)))


def _mistakes(experiment: Experiment) -> Iterator[str]:
    report, declared, known = experiment.report, experiment.declared, experiment.learners
    assert report is not None
    needed: dict[str, object] = {"[grids]": declared.grids, "[solved]": declared.solved}
    needed |= {"report.looks": report.looks, "report.contrasts": report.contrasts}
    yield from (f"{key} is missing; this report needs it." for key, value in needed.items() if not value)
    for key, names in {"scenarios": experiment.scenarios, "readings": declared.readings}.items():
        if len(names) > 1:
            yield f"{key}: {len(names)}: accepted: exactly one."
    if declared.grids and not leading(experiment):
        accepted = "at least one that has one axis, not named permuted, and a point without unseen places"
        yield f"grids: accepted: {accepted}, which the figure of the map draws."
    for name, grid in declared.grids.items():
        if not grid.question:
            yield f"grids.{name}.question is missing; this report needs it."
        for axis, values in grid.axes.items():
            for value in filterfalse(is_number, values):
                yield f'grids.{name}.axes.{axis}: {value}: accepted: a number, or two joined by "x".'
    if [*report.looks] != sorted({*report.looks}):
        yield f"report.looks = {[*report.looks]}: accepted: increasing numbers."
    for contrast in report.contrasts:
        yield from _mistakes_of_sides(contrast, report.looks, known)
    budgets = dict[str, int]()
    for population in (each for each in experiment.populations if not each.learner.reference_for):
        budget, where = population.first.settings.budget, population.condition.name.partition("/")[2]
        if budget != budgets.setdefault(where, budget):
            accepted = f"accepted: {budgets[where]}, as others have there"
            yield f"algorithms.{population.learner.variant}: budget = {budget} at {where}: {accepted}."
            break
    first, about_steps = leading(experiment), [*steps_grids(experiment)]
    for panel in report.panels if first else ():
        where = panel.grid or first
        if where not in about_steps:
            yield f"report.panels: grid = {where}: accepted: {', '.join(about_steps)}."
            continue
        ran = {it.learner.name for it in experiment.populations if it.condition.axes.get("grid") == where}
        shown = [name for name in ranked(experiment) if name in ran]
        for name in panel.learners:
            if name not in shown:
                yield f"report.panels: {name}: accepted: learners of the grid {where}: {', '.join(shown)}."
    yield from _mistakes_of_answer(experiment)


def _mistakes_of_answer(experiment: Experiment) -> Iterator[str]:
    ran = dict[tuple[str, ...], list[str]]()  # the learners at each point with unseen places
    for population in experiment.populations:
        if population.scenario.issuer.unseen:
            ran.setdefault(tuple(name_of(population).values()), []).append(population.learner.name)
    if experiment.report and (answer := experiment.report.answer):
        learners = ran.get((answer.grid, answer.point), ())
        if not learners:
            accepted = "; ".join(f'grid = "{grid}", point = "{point}"' for grid, point in ran)
            where = f'report.answer: grid = "{answer.grid}", point = "{answer.point}"'
            yield f"{where}: accepted: {accepted or 'none, since no point has unseen places'}."
        for name in [name for name in answer.learners if learners and name not in learners]:
            yield f"report.answer.learners: {name}: accepted: {', '.join(learners)}."


def _mistakes_of_sides(
    contrast: tuple[str, str], looks: Sequence[int], known: Mapping[str, Learner]
) -> Iterator[str]:
    for name in (name for name in contrast if name not in known):
        yield f"report.contrasts: {name}: accepted: {', '.join(known)}."
    if contrast[0] == contrast[1]:
        yield f"report.contrasts: {' and '.join(contrast)}: accepted: two different learners."
    sides = [known[name] for name in contrast if name in known]
    for side in sides:
        if looks and side.declared.seeds != min(looks):
            accepted = f"report.looks[0] = {looks[0]}, as report.contrasts names it"
            yield f"algorithms.{side.variant}.seeds = {side.declared.seeds}: accepted: {accepted}."
    if len({side.declared.first_seed for side in sides}) > 1:
        yield f"report.contrasts: {' and '.join(contrast)}: accepted: the same first_seed."


def _unreachable(experiment: Experiment) -> Iterator[str]:
    """Yields contrasts that no grid has, and the first point at which no policy succeeds often enough."""
    report, declared, pairs = experiment.report, experiment.declared, compared(experiment)
    assert report is not None
    assert declared.solved is not None
    for contrast in sorted(
        {*report.contrasts}.difference((x.learner.name, y.learner.name) for x, y in pairs)
    ):
        yield f"report.contrasts: {' and '.join(contrast)}: accepted: two in one compared grid."
    for population in {x.condition.name: x for x, _ in pairs}.values():
        random, most = _success_range(population.first.drawn_scenario, declared.horizon)
        where = f"in {population.scenario.name} at {population.condition.name.partition('/')[2]}"
        level = f"solved.success = {declared.solved.success:g}: {where}"
        if most < declared.solved.success:
            yield f"{level} no policy succeeds more often than {most:.3g}; accepted: at most that."
            return
        if random >= declared.solved.success:
            yield f"{level} the random policy succeeds in {random:.3g}; accepted: more than that."
            return


@lru_cache(maxsize=1024)
def _success_range(scenario: Scenario, horizon: int) -> tuple[float, float]:
    """Returns how often the random policy succeeds, and the best one."""
    model = compile_scenario(scenario)
    random = float(evaluate(model, uniform_policy(model), horizon).success)
    return random, largest_success(model, horizon)
