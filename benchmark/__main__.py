"""The command line: arguments in, exit code out."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from envs import InputError

if TYPE_CHECKING:
    from benchmark.experiments.specification import Experiment

_MOST_SEEDS = 1_000_000
_EPILOG = """\
examples:
  python -m benchmark list                         what there is, and what is done
  python -m benchmark run reproduce                run what is missing, on all cores
  python -m benchmark run reproduce --report       and then draw results/reproduce
  python -m benchmark report reproduce             draw results/reproduce from the runs
  python -m benchmark report                       make results/index.html from what is drawn
  python -m benchmark run reproduce --seeds 0-9    ten agents only
  python -m benchmark run compare_deep --report    the table against DQN and PPO, about twelve minutes
  python -m benchmark report compare_deep --partial  what there is of it so far, into compare_deep_partial
  python -m benchmark watch --scenario S2 --algorithm dqn  see it learn
  python -m benchmark speed                        measure speed against the stock way

Runs are kept in RESULTS/runs.db. A run that is there is never repeated: interrupt at any moment, and
the same command goes on. Exit codes: 0 done, 1 a run failed, 2 a mistake in what was given, 130
interrupted.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command; returns the exit code."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.command(options))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # whoever read the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print("interrupted: finished runs are kept; the same command goes on.", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmark",
        description="Runs experiments on the proxemic gridworld and draws their results.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    def command(
        name: str, function: object, summary: str, *, experiment: bool, optional: bool = False
    ) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=summary, description=f"{summary[0].upper()}{summary[1:]}.")
        sub.set_defaults(command=function)
        sub.add_argument(
            "--results",
            type=Path,
            default=Path("results"),
            metavar="DIR",
            help="folder of results, made if missing (default: results)",
        )
        if experiment:
            sub.add_argument(
                "experiment",
                metavar="EXPERIMENT",
                nargs="?" if optional else None,
                help="a name that 'list' shows, or the path of a TOML file",
            )
            sub.add_argument(
                "--seeds",
                metavar="A-B",
                help="seeds of the runs, for example 0-29 or 7 (default: as the experiment declares)",
            )
        return sub

    command(
        "list", _list, "show scenarios, algorithms and experiments, and how much is done", experiment=False
    )
    run = command("run", _run, "execute the runs of an experiment that are not done yet", experiment=True)
    run.add_argument(
        "--jobs",
        type=int,
        default=os.cpu_count() or 1,
        metavar="N",
        help="jobs under way at a time; no result depends on it (default: one a core)",
    )
    run.add_argument(
        "--report", action="store_true", help="then draw the tables and figures, as 'report' does"
    )
    report = command(
        "report",
        _report,
        "draw an experiment's tables and figures from its runs, and the page; without one, the page alone",
        experiment=True,
        optional=True,
    )
    run.add_argument(
        "--tensorboard",
        type=Path,
        metavar="DIR",
        help="write TensorBoard logs of Stable-Baselines3's runs there; no result depends on it, only times",
    )
    report.add_argument(
        "--partial",
        action="store_true",
        help="of a comparison, draw what is there though runs are missing, into EXPERIMENT_partial",
    )
    watch = command("watch", _watch, "show an agent learn, in a window or in the terminal", experiment=False)
    watch.add_argument("--scenario", default="S1", help="a scenario of the experiment (default: S1)")
    watch.add_argument(
        "--algorithm",
        default="q_learning",
        help="an algorithm of the experiment, as it names it (default: q_learning)",
    )
    watch.add_argument("--observation", help="what it observes (default: the first that the experiment has)")
    watch.add_argument("--seed", default="0", metavar="N", help="the run's seed (default: 0)")
    watch.add_argument(
        "--experiment",
        default="compare_deep",
        help="whose settings it has; a run that is not done is done, and kept (default: compare_deep)",
    )
    watch.add_argument(
        "--terminal", action="store_true", help="in the terminal, also where there could be a window"
    )
    watch.add_argument(
        "--save", type=Path, metavar="FILE", help="write an animated .webp or .gif in place of showing it"
    )
    speed = command(
        "speed", _speed, "measure speed, each row against the stock way in the same run", experiment=False
    )
    speed.add_argument(
        "--smoke", action="store_true", help="a second only, into speed_smoke; the figures mean nothing"
    )
    return parser


def _list(options: argparse.Namespace) -> int:
    from agents import ALGORITHMS
    from benchmark.execution.driver import pending
    from benchmark.execution.store import Store
    from benchmark.experiments.specification import all_specifications, experiment_names, load_experiment
    from envs import load_scenario, scenario_names

    print("scenarios")
    for name in scenario_names():
        try:
            print(f"  {name:24} {load_scenario(name).description}")
        except InputError as error:
            print(f"  {name:24} not usable: {error}")
    print("algorithms")
    for name, module in ALGORITHMS.items():
        print(f"  {name:24} {module}")
    print("experiments")
    database = options.results / "runs.db"
    for name in experiment_names():
        try:
            experiment = load_experiment(name)
        except InputError as error:
            print(f"  {name:24} not usable: {error}")
            continue
        runs = all_specifications(experiment)
        done = 0
        if database.exists():
            with Store(database, read_only=True) as store:
                done = len(runs) - len(pending(runs, store))
        print(f"  {name:24} {done} of {len(runs)} runs done. {experiment.description}")
    return 0


def _run(options: argparse.Namespace) -> int:
    from benchmark.execution import driver as runner
    from benchmark.execution.progress import Display
    from benchmark.execution.store import Record, Store
    from benchmark.experiments.specification import all_specifications, load_experiment

    if options.jobs < 1:
        raise InputError(f"--jobs {options.jobs}: accepted: at least 1.")
    experiment = load_experiment(options.experiment)
    if options.tensorboard is not None:
        _check_logs(experiment, options.tensorboard)
    seeds = _seeds(options.seeds)
    fewest = min(arm.seeds if seeds is None else len(seeds) for arm in experiment.algorithms.values())
    if options.report and fewest < 2:
        raise InputError("--report: one seed has no interval; accepted: at least two of every algorithm.")
    runs = all_specifications(experiment, seeds)
    with Store(options.results / "runs.db") as store:
        todo = runner.pending(runs, store)
        if options.tensorboard is not None and len(todo) < len(runs):
            done = f"{len(runs) - len(todo)} of {len(runs)} runs are done already"
            print(f"{experiment.name}: {done}, and are not trained again for --tensorboard.")
        if not todo:
            print(f"{experiment.name}: all {len(runs)} runs are done already.")
            return _report(options) if options.report else 0
        with Display(experiment, seeds, store.ended(), runner.plan(todo)) as display:

            def advance(records: list[Record]) -> None:
                display.advance(records)
                diverged.extend(record.digest for record in records if record.status == "diverged")

            diverged: list[str] = []
            errors = runner.run(runs, store, options.jobs, advance, display.start, options.tensorboard)
    if errors:
        print(
            f"error: {len(errors)} runs failed, and will be tried again; the first: {errors[0]}",
            file=sys.stderr,
        )
        return 1
    told = f", {len(diverged)} of them diverged" if diverged else ""
    print(f"{experiment.name}: {len(todo)} runs done{told}, {len(runs) - len(todo)} were done already.")
    return _report(options) if options.report else 0


def _check_logs(experiment: "Experiment", directory: Path) -> None:
    """Refuses logs that nobody would write, or that cannot be written."""
    from importlib.util import find_spec

    from agents import load_algorithm

    if not any(load_algorithm(arm.algorithm).writes_logs for arm in experiment.algorithms.values()):
        raise InputError(
            f"--tensorboard: {experiment.name} trains tables alone, which write no logs; accepted: an "
            "experiment with algorithms of Stable-Baselines3."
        )
    if find_spec("tensorboard") is None:
        raise InputError(
            "--tensorboard: the package tensorboard is not installed; "
            ".venv/bin/pip install tensorboard installs it."
        )
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--tensorboard {directory}: cannot be made: {error.strerror}.") from error


def _report(options: argparse.Namespace) -> int:
    from benchmark.execution.store import Store
    from benchmark.experiments.specification import load_experiment
    from benchmark.page import build as page
    from benchmark.reports import draw as report

    partial = getattr(options, "partial", False)  # 'run --report' has no such option
    if options.experiment is None:
        if partial or options.seeds is not None:
            raise InputError("--partial and --seeds: accepted: with the name of an experiment.")
        print(f"the page is {page.write(options.results)}.")
        return 0
    experiment = load_experiment(options.experiment)
    directory = options.results / (f"{experiment.name}_partial" if partial else experiment.name)
    with Store(options.results / "runs.db", read_only=True) as store:
        report.draw(experiment, store, directory, _seeds(options.seeds), partial=partial)
    print(f"{experiment.name}: tables and figures are in {directory}.")
    print(f"{experiment.name}: the page is {page.write(options.results, directory.name)}.")
    return 0


def _watch(options: argparse.Namespace) -> int:
    from benchmark.execution.store import Store
    from benchmark.experiments.specification import load_experiment

    experiment = load_experiment(options.experiment)
    if not options.seed.isdecimal() or int(options.seed) >= _MOST_SEEDS:
        raise InputError(f"--seed {options.seed}: accepted: a whole number from 0 to {_MOST_SEEDS - 1:,}.")
    if options.save is not None and options.save.suffix.lower() not in (".webp", ".gif"):
        raise InputError(f"--save {options.save}: accepted: a name that ends in .webp or .gif.")
    if options.save is not None and not options.save.parent.is_dir():
        raise InputError(f"--save {options.save}: there is no folder {options.save.parent}.")
    from rich.console import Console

    from benchmark.commands import watch

    run = watch.specification(
        experiment, options.scenario, options.algorithm, options.observation, int(options.seed)
    )
    with Store(options.results / "runs.db") as store:
        film = watch.load_film(run, store)
    if options.save is not None:
        watch.to_file(film, options.save)
        print(f"{film.title}: {options.save}")
        return 0
    if watch.has_window() and not options.terminal:
        try:
            watch.in_window(film)
        except InputError as error:
            print(f"{error} Here is the terminal's picture.", file=sys.stderr)
        else:
            return 0
    watch.in_terminal(film, Console())
    return 0


def _speed(options: argparse.Namespace) -> int:
    from benchmark.page import build as page
    from benchmark.reports import speed

    speed.measure(options.results / ("speed_smoke" if options.smoke else "speed"), smoke=options.smoke)
    if not options.smoke and page.published(options.results):
        print(f"the page is {page.write(options.results)}.")
    return 0


def _seeds(text: str | None) -> range | None:
    """Reads `--seeds`."""
    if text is None:
        return None
    first, dash, last = text.partition("-")
    if not first.isdecimal() or (dash and not last.isdecimal()) or (dash and int(last) < int(first)):
        raise InputError(
            f"--seeds {text}: accepted: A-B with A not above B, as in 0-29, or one seed, as in 7."
        )
    seeds = range(int(first), int(last if dash else first) + 1)
    if seeds.stop > _MOST_SEEDS or len(seeds) > 100_000:
        raise InputError(f"--seeds {text}: accepted: seeds below {_MOST_SEEDS:,}, at most 100,000 of them.")
    return seeds


if __name__ == "__main__":
    sys.exit(main())
