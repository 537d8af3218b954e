"""The command line: parses arguments, runs a command, returns its exit code.

Every command but `list` has a module of its name, whose `main` takes the parsed options.
"""

import argparse
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

from benchmark import __version__
from envs.inputs import InputError
from envs.packages import contained, needed_by

_INTERRUPTED = "interrupted: what is stored is kept; repeat the command to go on."
_EPILOG = """\
examples:
  python -m benchmark list                         scenarios, algorithms, experiments
  python -m benchmark run reproduce --report       missing runs on all cores, then results/reproduce
  python -m benchmark bench sb3_contrib:TRPO --settings learning_rate=1e-3 --stochastic
  python -m benchmark report compare_deep          tables, figures and texts from published runs
  python -m benchmark report                       texts and page of all results, from their tables
  python -m benchmark verify reproduce             repeats 20 runs, and makes the results again
  python -m benchmark watch --scenario S2 --learner dqn --save film.webp
  python -m benchmark export compare_deep --learner ppo --seed 1000 ppo.zip
  python -m benchmark assess --agent module:act --scenario S1 --observation index

Runs are stored in RESULTS/runs.db, and a stored run is not repeated: interrupt at any time and
continue with the same command. Exit codes: 0 success, 1 a run failed or a problem was found,
2 invalid input, 130 interrupted.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command; returns the exit code."""
    _open_streams()
    try:
        if arguments is None:  # nothing else uses this process and its children
            _set_process()
        code = _run(_parser().parse_args(arguments))
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of the output, such as `head`, has closed it
        _silence_output()
        return 0
    except KeyboardInterrupt:
        print(_INTERRUPTED, file=sys.stderr)
        if arguments is None:
            sys.unraisablehook = lambda _: None  # half-built objects may fail again
        return 130
    except InputError as error:
        print(*(f"error: {line}" for line in str(error).split("\n")), sep="\n", file=sys.stderr)
        return 2
    except OSError as error:
        _silence_output()
        where = f"{error.filename}: " if error.filename else ""
        print(f"error: {where}{error.strerror or error}.", file=sys.stderr)
        return 2
    finally:
        if arguments is None and signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # there is nothing left to interrupt
    return code


def _set_process() -> None:
    """Sets up the process of a command."""
    os.environ["MPLBACKEND"] = "agg"  # a notebook's may not be installed
    # No child imports what lies in the current folder, and no file there says where numba has its
    # compiled code.
    os.environ["PYTHONSAFEPATH"] = "1"
    os.environ.setdefault("NUMBA_CACHE_DIR", "")
    sys.unraisablehook = _unraisable
    if signal.getsignal(signal.SIGINT) == signal.SIG_DFL:  # see `benchmark`
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _unraisable(unraisable: Any) -> None:
    """Interrupts again if an interrupt came where Python would only print it."""
    if issubclass(unraisable.exc_type, KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    else:
        sys.__unraisablehook__(unraisable)


def _run(options: argparse.Namespace) -> int:
    # Imported on demand: --help and mistakes do not wait for what a command needs.
    with contained(), needed_by(f"benchmark {options.command}"):
        if options.command == "list":
            return _list()
        code: int = _module_of(options.command).main(options)
        return code


def _module_of(command: str) -> ModuleType:
    """Imports the module of a command; an InputError says where that failed."""
    try:
        with needed_by(f"benchmark {command}"):
            return import_module(f"benchmark.{command}")
    except InputError:
        raise
    except Exception as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{frame.filename}, line {frame.lineno}: {type(error).__name__}: {error}"
        raise InputError(f"{what}; install this package again.") from error


def _open_streams() -> None:
    """Opens closed standard streams, since a file would otherwise get one of their descriptors."""
    while (descriptor := os.open(os.devnull, os.O_RDWR)) < 3:  # the lowest that is free
        pass
    os.close(descriptor)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115


def _silence_output() -> None:
    """Discards what is still to be printed, which Python would try to print when it exits."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _list() -> int:
    """Shows scenarios, algorithms and experiments."""
    from agents import ALGORITHMS
    from benchmark.experiment import experiment_names, read_experiment
    from envs import load_scenario, scenario_names

    listed = {
        "scenarios": {name: load_scenario(name).description for name in scenario_names()},
        "algorithms": ALGORITHMS,
        # To load them would import torch and resolve thousands of trials.
        "experiments": {name: read_experiment(name)[0].description for name in experiment_names()},
    }
    for title, abouts in listed.items():
        print(title)
        for name, about in abouts.items():
            print(f"  {name:24} {about}")
    return 0


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, as all others are."""

    def error(self, message: str) -> NoReturn:
        """Refuses the arguments."""
        raise InputError(f"{message}; '{self.prog} --help' says what is accepted.")


# What each command does, and its options: `!` marks those that must be given, `?` an argument that
# can be left out, `+` those that take several values, and `=` is followed by a default.
COMMANDS = {
    "list": ("show scenarios, algorithms and experiments", ""),
    "run": (
        "train the missing runs of an experiment, and publish all runs",
        "experiment --results=results --seeds --jobs --smoke --report --cluster",
    ),
    "bench": (
        "run an algorithm of your own in the suite's scenes, beside the published learners",
        "algorithm --settings+ --observation --stochastic --results=results --jobs --smoke",
    ),
    "report": (
        "make an experiment's tables, figures and texts from its published runs, and the page",
        "experiment? --results=results --seeds --smoke",
    ),
    "verify": (
        "check published files: make them again, and repeat some runs",
        "experiment? --results=results --runs=20 --seed --jobs --smoke",
    ),
    "watch": (
        "make a film of an agent that learns",
        "--scenario=S1 --learner=q_learning --observation --seed=0 --experiment=compare_deep "
        "--results=results --save!",
    ),
    "export": (
        "train a run again, and write its agent to a file",
        "experiment --learner! --seed=0 --scenario file",
    ),
    "assess": (
        "score an agent exactly",
        "--agent --model --algorithm --trust --stochastic --scenario=S1 --observation! --save",
    ),
    "speed": (
        "measure speed, relative to common alternatives in the same process",
        "--results=results --smoke",
    ),
}
# The value that each option takes, none if it is only given or not, and what it means
_OPTIONS = {
    "experiment": ("EXPERIMENT", "a name shown by 'list', or the path of a TOML file"),
    "algorithm": (
        "ALGO",
        "a class like those of Stable-Baselines3, as in sb3_contrib:TRPO or mine.py:Mine, or the "
        "path of a TOML file that extends the suite",
    ),
    "--settings": ("KEY=VALUE", "settings, with values as in TOML (default: the class's)"),
    "--results": ("DIR", "folder of results"),
    "--seeds": (
        "A-B",
        "seeds, for example 0-29 or 7 (default: as declared; not for searches and maps); learners "
        "with fewer runs get a proportional share; results are in EXPERIMENT_seeds_A-B",
    ),
    "--jobs": (
        "N",
        "number of jobs to run at a time; results do not depend on it (default: number of cores; "
        "in a cluster, twice the number of workers at the start)",
    ),
    "--smoke": ("", "use a miniature, EXPERIMENT_smoke, whose numbers mean nothing"),
    "--report": ("", "make tables, figures and texts at the end, as 'report' does"),
    "--cluster": ("tcp://HOST:PORT", "run all jobs on the workers of this Dask scheduler"),
    "--runs": ("N", "how many runs to repeat, drawn at random"),
    "--seed": ("N", "seed of the run; in 'verify', of the draw of runs"),
    "--experiment": ("EXPERIMENT", "experiment of the learner; a missing run is trained, stored"),
    "--scenario": ("NAME", "a name or a path"),
    "--learner": ("NAME", "a variant, or one with its form, as in 'ppo, one_hot'"),
    "--observation": (
        "FORM",
        "form of observation: index, one_hot, factored, tiles, coordinates, centred or planes; or, "
        "relative to the agent, offset, alone or followed by _one_hot and so on; with onlookers, "
        "relative_coordinates or relative_centred",
    ),
    "--agent": (
        "MODULE:FUNCTION",
        "a function of the observation that returns an action, five probabilities or, like predict "
        "of Stable-Baselines3, a pair of an action and None",
    ),
    "--model": ("FILE", "a model saved by Stable-Baselines3; needs --trust"),
    "--algorithm": ("MODULE:CLASS", "the saved model's class, as in stable_baselines3:PPO"),
    "--trust": ("", "load the model's file, which runs any code that is in it"),
    "--stochastic": ("", "let the policy sample its actions (default: greedy)"),
    "--save": ("FILE", "film of 'watch', .webp or .gif; map of 'assess', .png or .svg"),
    "file": (
        "FILE",
        "an .npz for NumPy; only nets: a .zip for Stable-Baselines3, or a .yml for rl_zoo3, which "
        "has the settings and needs no run",
    ),
}


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="python -m benchmark",
        description="Runs experiments on the proxemic gridworld and draws their results.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    version = f"proxemic-benchmark {__version__}"
    parser.add_argument("--version", action="version", version=version)
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for name, (summary, options) in COMMANDS.items():
        command = commands.add_parser(name, help=summary, description=f"{summary.capitalize()}.")
        command.set_defaults(command=name)
        for option in options.split():
            _add(command, option)
    return parser


def _add(command: argparse.ArgumentParser, option: str) -> None:
    """Adds an option as `COMMANDS` has it."""
    given, _, default = option.partition("=")
    name = given.rstrip("!?+")
    metavar, about = _OPTIONS[name]
    shown = ""
    if not metavar:
        command.add_argument(name, help=about, action="store_true")
        return
    more: dict[str, Any] = {"required": True} if given.endswith("!") else {}
    if given.endswith("?"):
        more["nargs"], shown = "?", "all results"
    if given.endswith("+"):
        more["nargs"] = "+"
    if default:
        more["default"], shown = default, default
    about += f" (default: {shown})" if shown else ""
    kind = Path if metavar in ("DIR", "FILE") else str
    command.add_argument(name, metavar=metavar, type=kind, help=about, **more)


if __name__ == "__main__":
    sys.exit(main())
