"""What a map demands of an experiment."""

from functools import lru_cache

from agents.dynamic_programming import largest_success
from benchmark.analysis.looks import compared
from benchmark.experiments import Experiment
from envs import InputError, Scenario, compile_scenario


def check(experiment: Experiment) -> None:
    """Refuses, by an InputError, an experiment without grids or looks, or with contrasts of unequal seeds."""
    report, where = experiment.report, experiment.argument
    assert report is not None
    found = []
    if len(experiment.scenarios) > 1:
        found.append(f"scenarios: {len(experiment.scenarios)}: accepted: exactly one.")
    for key, is_there in (
        ("[grids]", bool(experiment.grids)),
        ("[solved]", experiment.solved is not None),
        ("report.looks", bool(report.looks)),
        ("report.contrasts", bool(report.contrasts)),
    ):
        if not is_there:
            found.append(f"{key} is missing; this report needs it.")
    if [*report.looks] != sorted({*report.looks}):
        found.append(f"report.looks = {[*report.looks]}: accepted: increasing numbers.")
    known = {f"{name}, {observation}": name for _, name, observation in experiment.populations}
    for contrast in report.contrasts:
        found += [
            f"report.contrasts: {side}: accepted: {', '.join(known)}."
            for side in contrast
            if side not in known
        ]
        compared = {known[side]: experiment.algorithms[known[side]] for side in contrast if side in known}
        for name, declared in compared.items():
            if report.looks and declared.seeds != min(report.looks):
                accepted = f"report.looks[0] = {report.looks[0]}, as report.contrasts names it"
                found.append(f"algorithms.{name}.seeds = {declared.seeds}: accepted: {accepted}.")
        if len({declared.first_seed for declared in compared.values()}) > 1:
            found.append(f"report.contrasts: {' and '.join(contrast)}: accepted: the same first_seed.")
    if not found and not pairs(experiment):
        found.append(
            "report.contrasts: no compared grid has both learners of a contrast; accepted: one or more."
        )
    if found:
        raise InputError(*(f"{where}: {sentence}" for sentence in found))
    assert experiment.solved is not None
    for cell in {pair[0].place: pair[0] for pair in pairs(experiment)}.values():
        scenario = specifications(experiment, *cell)[0].drawn_scenario
        if (most := _largest_success(scenario, experiment.horizon)) < experiment.solved.success:
            raise InputError(
                f"{where}: solved.success = {experiment.solved.success:g}: in {cell.scenario} at "
                f"{cell.condition.split('/', 1)[1]} no policy succeeds more often than {most:.3g}; "
                "accepted: at most that."
            )


@lru_cache(maxsize=1024)
def _largest_success(scenario: Scenario, horizon: int) -> float:
    return largest_success(compile_scenario(scenario), horizon)
