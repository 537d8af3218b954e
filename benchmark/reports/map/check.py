"""What a map demands of an experiment."""

from collections.abc import Iterator
from functools import lru_cache

from agents.dynamic_programming import largest_success
from benchmark.analysis.looks import compared
from benchmark.experiments import Experiment
from envs import InputError, Scenario, compile_scenario


def check(experiment: Experiment) -> None:
    """Refuses, by an InputError, an experiment without grids or looks, or with contrasts of unequal seeds."""
    report, declared = experiment.report, experiment.declared
    assert report is not None
    needed = {
        "[grids]": declared.grids,
        "[solved]": declared.solved,
        "report.looks": report.looks,
        "report.contrasts": report.contrasts,
    }
    mistakes = [f"{key} is missing; this report needs it." for key, value in needed.items() if not value]
    if len(experiment.scenarios) > 1:
        mistakes.append(f"scenarios: {len(experiment.scenarios)}: accepted: exactly one.")
    if [*report.looks] != sorted({*report.looks}):
        mistakes.append(f"report.looks = {[*report.looks]}: accepted: increasing numbers.")
    for contrast in report.contrasts:
        mistakes += _mistakes(experiment, contrast)
    if not mistakes and not compared(experiment):
        mistakes.append(
            "report.contrasts: no compared grid has both learners of a contrast; accepted: one or more."
        )
    mistakes = mistakes or [*_unreachable(experiment)]
    if mistakes:
        raise InputError(*(f"{experiment.argument}: {sentence}" for sentence in dict.fromkeys(mistakes)))


def _mistakes(experiment: Experiment, contrast: tuple[str, str]) -> Iterator[str]:
    """Yields what is wrong with a contrast: unknown learners, or other seeds than the first look needs."""
    assert experiment.report is not None
    known, looks = experiment.learners, experiment.report.looks
    for name in contrast:
        if name not in known:
            yield f"report.contrasts: {name}: accepted: {', '.join(known)}."
    sides = {known[name].variant: known[name].declared for name in contrast if name in known}
    for variant, declared in sides.items():
        if looks and declared.seeds != min(looks):
            accepted = f"report.looks[0] = {looks[0]}, as report.contrasts names it"
            yield f"algorithms.{variant}.seeds = {declared.seeds}: accepted: {accepted}."
    if len({declared.first_seed for declared in sides.values()}) > 1:
        yield f"report.contrasts: {' and '.join(contrast)}: accepted: the same first_seed."


def _unreachable(experiment: Experiment) -> Iterator[str]:
    """Yields the first point at which no policy succeeds often enough."""
    declared = experiment.declared
    assert declared.solved is not None
    for population in {x.condition.name: x for x, _ in compared(experiment)}.values():
        most = _largest_success(population.first.drawn_scenario, declared.horizon)
        if most < declared.solved.success:
            where = f"{population.scenario.name} at {population.condition.name.partition('/')[2]}"
            often = f"in {where} no policy succeeds more often than {most:.3g}; accepted: at most that"
            yield f"solved.success = {declared.solved.success:g}: {often}."
            return


@lru_cache(maxsize=1024)
def _largest_success(scenario: Scenario, horizon: int) -> float:
    return largest_success(compile_scenario(scenario), horizon)
