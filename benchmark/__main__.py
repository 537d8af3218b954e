"""The command line: parses arguments, runs a command of `benchmark.commands`, returns its exit code."""

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, Final, NoReturn

from benchmark import __version__

_CORE: Final = ("gymnasium", "numpy", "pydantic")  # packages without which nothing works
_INTERRUPTED: Final = "interrupted: what is stored is kept; repeat the command to go on."


try:
    from envs.inputs import InputError
    from envs.packages import contained, needed_by
    from envs.sources import VARIABLES
except KeyboardInterrupt:  # imports take a second
    print(_INTERRUPTED, file=sys.stderr)
    sys.exit(130)
except ModuleNotFoundError as error:
    if error.name not in _CORE:
        raise
    installer = f"pip install {error.name} installs it (in a checkout: make .venv/.base)"
    print(f"error: the package {error.name} is not installed; {installer}.", file=sys.stderr)
    sys.exit(2)

_EPILOG = """\
examples:
  python -m benchmark list                         scenarios, algorithms, experiments
  python -m benchmark run reproduce --report       execute missing runs on all cores, draw results/reproduce
  python -m benchmark run when --cluster tcp://HOST:8786  on the machines of a Dask cluster
  python -m benchmark report                       texts and page of results, from their tables
  python -m benchmark verify reproduce             checksums, 20 runs repeated, results drawn again
  python -m benchmark watch --scenario S2 --learner dqn --save film.webp  a film of an agent that learns
  python -m benchmark export compare_deep --learner ppo --seed 400 ppo.zip  a trained agent, for SB3
  python -m benchmark assess --agent module:act --scenario S1 --observation index  score an agent exactly

Runs are stored in RESULTS/runs.db, and a stored run is not repeated: interrupt at any time and continue
with the same command. Exit codes: 0 success, 1 a run failed or a problem was found, 2 invalid input, 130
interrupted.
"""


def script() -> int:
    """Runs one command, as `python -m benchmark` does; returns the exit code."""
    sys.path.append(str(Path.cwd()))  # last, so that users' modules hide no others
    return main()


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command; returns the exit code."""
    _open_streams()
    if arguments is None:  # nothing else uses this process and its children
        os.environ["MPLBACKEND"] = VARIABLES["MPLBACKEND"]  # a notebook's backend might not be installed
    try:
        options = _parser().parse_args(arguments)
        if [] in vars(options).values():  # argparse takes the -- of --save=-- away
            raise InputError("an option has the value --; accepted: another value.")
        # Imported on demand: --help and mistakes do not wait for what a command needs.
        with contained(), needed_by(f"benchmark {options.command}"):
            code: int = import_module(f"benchmark.commands.{options.command}").main(options)
            if not code and getattr(options, "report", False):
                code = import_module("benchmark.commands.report").main(options)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of the output, such as `head`, has closed it
        _silence_output()
        return 0
    except KeyboardInterrupt:
        print(_INTERRUPTED, file=sys.stderr)
        return 130
    except (InputError, OSError) as error:
        message = str(error)
        if not isinstance(error, InputError):
            _silence_output()
            message = f"{f'{error.filename}: ' if error.filename else ''}{error.strerror or error}."
        print(*(f"error: {line}" for line in message.split("\n")), sep="\n", file=sys.stderr)
        return 2
    return code


def _open_streams() -> None:
    """Opens closed standard streams, since a file would otherwise get one of their descriptors."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest that is free
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115


def _silence_output() -> None:
    """Discards what is still to be printed, which Python would try to print when it exits."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, as all others are."""

    def error(self, message: str) -> NoReturn:
        """Refuses the arguments."""
        raise InputError(f"{message}; '{self.prog} --help' says what is accepted.")


def _add(
    command: argparse._ActionsContainer, name: str, metavar: str, about: str, kind: type = str, **more: Any
) -> None:
    """Adds an option, or one without a value if it has no metavar."""
    if metavar:
        command.add_argument(name, metavar=metavar, help=about, type=kind, **more)
    else:
        command.add_argument(name, action="store_true", help=about)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="python -m benchmark",
        description="Runs experiments on the proxemic gridworld and draws their results.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"proxemic-benchmark {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    named = "a name shown by 'list', or the path of a TOML file"
    seeds = "seeds, for example 0-29 or 7 (default: as declared; not for searches and maps); "
    seeds += "reference implementations get a proportional share; tables and figures of other seeds go into "
    seeds += "EXPERIMENT_seeds_A-B"
    jobs = "number of jobs to run at a time; results do not depend on it (default: number of cores"

    def command(name: str, summary: str, *, has_results: bool = True) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=summary, description=f"{summary[0].upper()}{summary[1:]}.")
        sub.set_defaults(command=name)
        if has_results:
            about = "folder of results (default: results)"
            _add(sub, "--results", "DIR", about, Path, default=Path("results"))
        return sub

    command("list", "show scenarios, algorithms and experiments", has_results=False)

    smoke = (
        "do it in miniature, to check that everything works, as EXPERIMENT_smoke; its numbers mean nothing"
    )

    run = command("run", "execute the missing runs of an experiment")
    _add(run, "experiment", "EXPERIMENT", named)
    _add(run, "--seeds", "A-B", seeds)
    _add(run, "--jobs", "N", f"{jobs}; with --cluster: twice the number of its workers at the start)")
    _add(run, "--smoke", "", smoke)
    _add(run, "--report", "", "draw tables and figures when all runs are done, as 'report' does")
    _add(run, "--cluster", "tcp://HOST:PORT", "run all jobs on the workers of this Dask scheduler")
    about = "log runs in folders below DIR: progress.csv, which is overwritten, and events of TensorBoard"
    _add(run, "--log", "DIR", about, Path)

    report = command("report", "draw an experiment's tables and figures, and build the page")
    about = f"{named}; without one, only the texts of all results and the page are written"
    _add(report, "experiment", "EXPERIMENT", about, nargs="?")
    _add(report, "--seeds", "A-B", seeds)
    _add(report, "--smoke", "", smoke)

    summary = "verify checksums, repeat some runs, and make tables, figures, texts and page again"
    verify = command("verify", summary)
    _add(verify, "experiment", "EXPERIMENT", f"{named}; by default all that 'list' shows", nargs="?")
    _add(verify, "--smoke", "", smoke)
    _add(verify, "--runs", "N", "how many runs to repeat, drawn at random (default: 20)", int, default=20)
    _add(verify, "--seed", "N", "seed that selects the runs to repeat (default: random)", int)
    _add(verify, "--jobs", "N", f"{jobs})")

    watch = command("watch", "make a film of an agent that learns")
    _add(watch, "--scenario", "NAME", "a name or a path (default: S1)", default="S1")
    about = "a variant, or one with its form, as in 'ppo, one_hot' (default: q_learning)"
    _add(watch, "--learner", "NAME", about, default="q_learning")
    _add(watch, "--observation", "FORM", "a form of observation of a variant (default: its first)")
    _add(watch, "--seed", "N", "the run's seed (default: 0)", default="0")
    about = "the learner's experiment; a missing run is trained and stored (default: compare_deep)"
    _add(watch, "--experiment", "EXPERIMENT", about, default="compare_deep")
    _add(watch, "--save", "FILE", "the film, an animated .webp or .gif", Path, required=True)

    export = command("export", "repeat a run, and write its trained agent to a file")
    _add(export, "experiment", "EXPERIMENT", named)
    _add(export, "--learner", "NAME", "a variant, or one with its form, as in 'ppo, one_hot'", required=True)
    _add(export, "--seed", "N", "the run's seed", required=True)
    _add(export, "--scenario", "NAME", "a name or a path (default: the experiment's first)")
    _add(export, "--condition", "NAME", "a condition of the experiment (default: the learner's first)")
    about = "a .zip for Stable-Baselines3 (only nets), or an .npz for NumPy (every learner)"
    _add(export, "file", "FILE", about, Path)

    assess = command("assess", "score an agent exactly", has_results=False)
    agent = assess.add_mutually_exclusive_group(required=True)
    about = "a function of the observation that returns an action, five probabilities or what predict returns"
    _add(agent, "--agent", "MODULE:FUNCTION", about)
    about = "a model saved by Stable-Baselines3; its file runs no code, and is refused if it needs any"
    _add(agent, "--model", "FILE", about, Path)
    _add(assess, "--algorithm", "MODULE:CLASS", "the saved model's class, as in stable_baselines3:PPO")
    _add(assess, "--stochastic", "", "let a saved model sample its actions (default: greedy)")
    _add(assess, "--scenario", "NAME", "a name or a path (default: S1)", default="S1")
    about = "form of observation that the agent takes: index, one_hot, factored, tiles, coordinates, "
    about += "centred or planes; or, relative to the agent, offset, alone or followed by _one_hot and so on"
    _add(assess, "--observation", "FORM", about, required=True)
    _add(assess, "--save", "FILE", "draw a map of the agent, .png or .svg", Path)

    speed = command("speed", "measure speed, relative to common alternatives in the same process")
    _add(speed, "--smoke", "", "measure very little, into speed_smoke; the numbers mean nothing")
    return parser


if __name__ == "__main__":
    sys.exit(main())
