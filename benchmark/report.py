"""The command `report`: redraws an experiment's results from its published runs, without training.

`report NAME` reads the two tables of runs and the experiment's file, and nothing else. It computes
the tables and figures of the experiment's study, a module as `benchmark.study` describes it, and
writes README from the tables. Without a name, it writes all published texts, and the page.
"""

import argparse
import hashlib
import json
import math
import re
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.machinery import SourceFileLoader
from inspect import getdoc
from pathlib import Path
from types import ModuleType
from typing import Any

import pandas as pd

from benchmark import front, style, tables
from benchmark.experiment import PUBLISHED, Experiment, is_from_bench, load_experiment
from benchmark.folder import (
    MANIFEST,
    MEANINGS,
    README,
    REPOSITORY,
    Folder,
    alone,
    committed,
    csv_text,
    damaged,
    replaced,
    write_manifest,
    write_text,
)
from benchmark.page import build as page
from benchmark.scenes import shipped
from benchmark.study import Data, Functions, Report, described
from envs import InputError
from envs.inputs import check_all, parse, shortened, unknown_name
from envs.sources import find_module, imported

STUDIES = ("comparison", "map", "replication", "search", "suite")
_MAX_WORDS = 900  # of README of a folder
_MAX_ROWS = 24  # of a table in README; longer ones are only linked
_PACKED = (tables.RUNS, tables.CURVES, tables.AGENTS)  # which `run` publishes
# What columns mean: of runs and curves, and of any other table. A star stands for part of a name.
RUN_COLUMNS = described("""\
scenario: scenario
grid: grid of the experiment
point: point of the grid
reading: a way to read the paper, or a control
trial: number of the trial; 0 has the settings as declared
learner: an algorithm with its settings, and what it observes
seed: seed of the run
run: beginning of the run's digest; conditions that change nothing share runs
policy: policy that `success` and `score` are about
budget: environment steps of training
step: environment steps of training so far
success: probability that an episode ends with a correct PING, exact
score: return, with 0 for the random policy or giving up at once, 1 for the optimum, in [0, 1]
unbounded_score: the same, not clipped
steps: steps of an episode
wrong_pings: wrong PINGs of an episode
uncomfortable_steps: steps of an episode in the uncomfortable region
*_success: success, by the * policy
unseen_success: success where the person never stood
new_way_success: success among onlookers who stand as they never did
training_wrong_pings: wrong PINGs of training so far
diverged_at: step at which values were no longer finite; inf if never
updates: updates of the parameters
parameters: number of learned parameters
cpu_time_s: CPU seconds of training
cpu_learned_s: CPU seconds until the run had learned; inf if never
peak_memory_mb: peak memory of the process, in MB
wall_time_s: duration in seconds
started_at: time of the start
commit: commit of this project
machine: system and cores
processor: processor, and library of linear algebra
versions: versions of packages, as JSON
""")
COLUMNS = RUN_COLUMNS | described("""\
n: runs
x: the learner that is compared
y: the learner that it is compared with
differs: what else differs between x and y
*_low: lower end of the 95 % interval of *
*_high: upper end of the 95 % interval of *
*_x: * of x
*_y: * of y
""")


class ClaimError(InputError):
    """The tables do not show what a finding claims."""


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    results = options.results
    if options.experiment is None:
        if options.seeds is not None:
            raise InputError("--seeds: accepted only together with an experiment.")
        print(f"open {write_texts(results)}.")
        return 0
    experiment = load_experiment(options.experiment, smoke=options.smoke)
    seeds = other_seeds(experiment, options.seeds)
    folder = results / folder_name(experiment, seeds)
    write(experiment, folder, seeds)
    if experiment.declared.search is not None:
        load_study("search", experiment.argument).write_chosen(experiment, folder)
    is_published = folder.name in PUBLISHED
    folders = _published(results) if is_published else [Folder(folder)]
    where = page.write(results if is_published else folder, folders)
    print(f"{experiment.name}: open {where}, or {folder / README}.")
    if text := certificate(folder):
        print(text)
    return 0


def other_seeds(experiment: Experiment, text: str | None) -> range | None:
    """Returns the seeds that `--seeds` names; None if it names none, or exactly those declared."""
    if text is None:
        return None
    match = re.fullmatch(r"([0-9]{1,6})(?:-([0-9]{1,6}))?", text)
    seeds = range(int(match[1]), int(match[2] or match[1]) + 1) if match else range(0)
    if not seeds:
        accepted = "A-B with A at most B, as in 0-29, or one seed, as in 7; below 1,000,000"
        raise InputError(f"--seeds {shortened(text)}: accepted: {accepted}.")
    is_same = all(each.seeds == seeds for each in experiment.populations)
    return None if is_same else seeds


def folder_name(experiment: Experiment, seeds: range | None) -> str:
    """Returns the name of an experiment's folder; other seeds have one of their own."""
    if seeds is None:
        return experiment.name
    ends = dict.fromkeys((seeds[0], seeds[-1]))
    return f"{experiment.name}_seeds_{'-'.join(map(str, ends))}"


def certificate(folder: Path) -> str:
    """Says whether a folder is as in the last commit; returns an empty text if this has none.

    Published runs are kept if only what was measured of them, such as times, is another.
    """
    name, published = folder.name, committed(folder.name, MANIFEST)
    if published is None:
        return ""
    files = {*Folder(folder).files, *json.loads(published)["files"], README, MEANINGS, MANIFEST}
    there = {file: (folder / file).read_bytes() for file in files if (folder / file).is_file()}
    if different := sorted(file for file in files if there.get(file) != committed(name, file)):
        return f"{name}: different from the published results: {', '.join(different)}."
    return f"{name}: identical to the published results."


# The study of an experiment


@dataclass(frozen=True)
class Study:
    """A study, as an experiment declares it."""

    experiment: Experiment
    module: ModuleType
    declared: Any
    seeds: Sequence[int] | None  # those that were given, if not those declared

    def dict_of(self, name: str) -> dict[str, Any]:
        """Returns one of the module's dicts, such as its tables; empty if it has none."""
        return dict(getattr(self.module, name, {}))

    @property
    def files(self) -> Functions:
        """The functions that make its tables and figures, by their files."""
        return {
            f"{name}.{ending}": function
            for kind, ending in (("TABLES", "csv"), ("FIGURES", "svg"))
            for name, function in self.dict_of(kind).items()
        }

    @property
    def question(self) -> str:
        """The heading of the results."""
        return self.declared.question or first_line(self.module) or self.experiment.name

    def text(self, name: str, data: Data) -> str:
        """Returns one of the study's texts; empty if there is none."""
        function = getattr(self.module, name, None)
        return str(function(data)) if function else ""


def study_of(experiment: Experiment, seeds: Sequence[int] | None = None) -> Study:
    """Returns the study of an experiment; an InputError says if they do not fit."""
    given, where = experiment.declared.report, experiment.argument
    if given is None:
        raise InputError(f"{where}: report is missing; add a [report] table.")
    module = load_study(str(given.get("kind", "")), where)
    with mistakes_in(module.__file__):
        declared = parse(getattr(module, "Declared", Report), given, f"{where}: report")
        if hasattr(module, "check"):
            module.check(experiment, declared)
    return Study(experiment, module, declared, seeds)


def load_study(name: str, source: str) -> ModuleType:
    """Returns a study of this project or any other module; an InputError begins with the source."""
    if name not in STUDIES and "." not in name and (not name or not find_module(name)):
        unknown_name(source, "report.kind", name, STUDIES, "a module")
    module = f"benchmark.{name}" if name in STUDIES else name
    imported(f"{module}:TABLES", source, "study")
    return sys.modules[module]


def first_line(named: object) -> str:
    """Returns the first line of the docstring of a module or a function."""
    return (getdoc(named) or "").partition("\n")[0]


@contextmanager
def mistakes_in(path: str | Path | None) -> Iterator[None]:
    """Turns whatever a file does wrong, such as dividing by zero, into an InputError."""
    try:
        yield
    except (InputError, KeyboardInterrupt):
        raise
    except BaseException as error:  # such as SystemExit
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if frame.filename == str(path)]
        line = getattr(error, "lineno", None) or [None, *lines][-1]
        where = f"{path}, line {line}" if line else path
        if isinstance(error, AssertionError):
            raise ClaimError(f"{where}: {error}.") from error
        raise InputError(f"{where}: {type(error).__name__}: {error}.") from error


# The files of a folder


def write(experiment: Experiment, folder: Path, seeds: Sequence[int] | None = None) -> None:
    """Draws a folder from its tables of runs.

    New files replace the earlier ones when all are there, so a failure leaves the folder as it was.
    An InputError says if the runs are missing, or are not those that the experiment declares.
    """
    study = study_of(experiment, seeds)
    runs, curves = tables.read(folder)
    tables.check_declared(experiment, runs, seeds)
    keys = [key for key in tables.KEYS if key in runs]
    if experiment.declared.search is None and runs.groupby(keys).size().min() < 2:
        what = "too few runs (a single run has no interval)"
        raise InputError(f"{experiment.name}: {what}; accepted: at least two of every learner.")
    store = path if (path := folder.parent / "runs.db").is_file() else None
    data = Data(experiment, study.declared, runs, curves, store=store)
    published = Folder(folder)
    with damaged(folder / tables.RUNS):
        manifest = _manifest(study, runs)
    with alone(folder.parent), replaced(folder, published.files) as aside:
        for name in {*_PACKED} & {*published.files}:
            (aside / name).write_bytes(published.content(name))
        with mistakes_in(study.module.__file__):
            for name, function in study.files.items():
                made = function(data)
                if isinstance(made, pd.DataFrame):
                    data.tables[name.removesuffix(".csv")] = made
                    (aside / name).write_text(csv_text(made), encoding="utf-8")
                elif made is not None:
                    style.save(made, aside / name)
        write_manifest(aside, manifest)
        for name, text in texts(study, Folder(aside)).items():
            write_text(aside / name, text)


def _manifest(study: Study, runs: pd.DataFrame) -> dict[str, object]:
    """Returns what made the results; drawing again gives the same."""
    experiment, seeds, ids = study.experiment, study.seeds, sorted({*runs["run"]})
    option = "" if seeds is None else f" --seeds {seeds[0]}-{seeds[-1]}"
    return {
        "experiment": experiment.name,
        "command": f"python -m benchmark run {experiment.argument}{option} --report",
        "question": study.question,
        "runs": len(ids),
        "digest": hashlib.sha256("".join(ids).encode()).hexdigest(),
        **{f"{name}s": sorted({*runs[name]}) for name in ("commit", "machine", "processor")},
        "versions": [json.loads(text) for text in sorted({*runs["versions"]})],
        "first_started_at": runs["started_at"].min(),
        "last_started_at": runs["started_at"].max(),
        "busy_time_s": round(runs.drop_duplicates("run")["wall_time_s"].sum(), 1),
    }


def write_texts(results: Path) -> Path:
    """Writes the texts of all published results from their tables; returns the page's path."""
    folders = _published(results)
    if not folders:
        raise InputError(f"{results}: there are no published results; make reproduce makes some.")
    with alone(results):
        check_all(*(folder.check for folder in folders))
        for folder in folders:
            study = study_of(load_experiment(folder.path.name))
            for name, text in texts(study, folder).items():
                write_text(folder.path / name, text)
        write_text(results / README, front.index(results))
        write_text(results / "scenes.svg", style.svg(shipped()))
        if results.resolve() == REPOSITORY / "results":
            write_text(REPOSITORY / README, front.readme(results))
        return page.write(results, folders)


def _published(results: Path) -> list[Folder]:
    """Returns the folders of published results that have been drawn, in the order of README."""
    paths = [results / name for name in PUBLISHED]
    folders = [Folder(path) for path in paths if (path / MANIFEST).is_file()]
    return [folder for folder in folders if "experiment" in folder.manifest]


def texts(study: Study, folder: Folder) -> dict[str, str]:
    """Returns the texts of a folder, which its manifest does not list, by their files."""
    data = Data(study.experiment, study.declared, *tables.read(folder.path), folder.tables())
    with mistakes_in(study.module.__file__):
        meant = csv_text(meanings(study, data))  # before a finding can change a table
        return {MEANINGS: meant, README: readme(study, folder, data)}


def meanings(study: Study, data: Data) -> pd.DataFrame:
    """Returns what the columns of each table mean."""
    files = {tables.RUNS: data.runs, tables.CURVES: data.curves}
    files |= {f"{name}.csv": table for name, table in data.tables.items()}
    rows = [
        (file, column, meaning(str(column), about))
        for file, table in files.items()
        for about in [RUN_COLUMNS if file in _PACKED else COLUMNS | study.dict_of("COLUMNS")]
        for column in table
    ]
    return pd.DataFrame(rows, columns=["file", "column", "meaning"])


def meaning(column: str, known: Mapping[str, str]) -> str:
    """Returns what a column means, by its name or a pattern of it; empty if that is not known.

    >>> meaning("steps_low", {"*_low": "lower end of the interval of *"})
    'lower end of the interval of steps'
    """
    for pattern, text in sorted(known.items(), key=lambda each: "*" in each[0]):
        if match := re.fullmatch(re.escape(pattern).replace(r"\*", "(.*)"), column):
            return text.replace("*", match[match.lastindex or 0])
    return ""


# README of a folder


def readme(study: Study, folder: Folder, data: Data) -> str:
    """Returns README of a folder; tables that would make it too long are left out."""
    tables_shown = (_shown(study, *each, data) for each in study.dict_of("SHOWN").items())
    shown = [*filter(None, tables_shown)]
    answer, *others = answer_of(study, data).strip().split("\n\n")
    figures = [
        f"![{file[:-4]}]({file})\n\n*{first_line(function)}*"
        for file, function in study.files.items()
        if file.endswith(".svg") and file in folder.files
    ]
    ends = [_files(study, folder), _made(study, folder)]
    if reading := study.text("reading", data):
        ends = [f"## How to read this\n\n{reading}", *ends]
    start = [f"# {study.question}", answer, *figures[:1], *others]
    while True:
        text = "\n\n".join([*start, *figures[1:], *shown, *ends]) + "\n"
        if len(text.split()) <= _MAX_WORDS or not shown:
            return text
        shown.pop()


def answer_of(study: Study, data: Data) -> str:
    """Returns the finding of an experiment or, without one for these runs, its headline.

    A finding is what the function `finding` of a file returns, in Markdown, if it has one.
    """
    experiment, text = study.experiment, ""
    path = experiment.path.with_suffix(".py")
    is_whole = study.seeds is None and not experiment.declared.is_miniature
    if is_whole and path.is_file() and not is_from_bench(path):
        try:
            module = ModuleType(path.stem)
            with mistakes_in(path):
                find_module(path.stem)  # and so what it imports
                SourceFileLoader(path.stem, str(path)).exec_module(module)
                text = str(module.finding(data.tables)) if hasattr(module, "finding") else ""
        except ClaimError as error:  # nets of Stable-Baselines3 depend on the processor
            print(f"{experiment.name}: the tables do not show a claim: {error}", file=sys.stderr)
    return text or study.text("headline", data) or experiment.declared.description


def _shown(study: Study, name: str, named: str, data: Data) -> str:
    """Returns a table as README shows it; empty if it is long, or not there."""
    frame = data.tables.get(name, pd.DataFrame())
    columns = [
        column
        for column in named.split()
        if column in frame and not frame[column].isin(["", math.nan]).all()
    ]
    if not columns or len(frame) > _MAX_ROWS:
        return ""
    titles = {key: learner.title for key, learner in study.experiment.learners.items()}
    rows = [[_entry(row, key, titles) for key in columns] for row in frame.to_dict("records")]
    heads = [column.replace("_", " ") for column in columns]
    table = pd.DataFrame(rows, columns=heads).to_markdown(index=False, disable_numparse=True)
    return f"{first_line(study.files[f'{name}.csv'])}\n\n{table}"


def _entry(row: Mapping[Any, Any], name: str, titles: Mapping[str, str]) -> str:
    """Returns an entry of a table: a learner's title, or a number with its interval."""
    text = titles.get(row[name], show(row[name]))
    ends = [row.get(f"{name}_{end}", math.nan) for end in ("low", "high")]
    if all(map(math.isfinite, ends)):
        text += f" [{', '.join(map(show, ends))}]"
    return " ".join(text.split()).replace("|", "&#124;")


def show(value: object) -> str:
    """Returns a value as readers see it; a float has three significant digits.

    >>> [show(value) for value in (0.12345, 999.6, 52612345.0, math.inf, math.nan, 7000, "S1")]
    ['0.123', '1,000', '52,600,000', 'never', '-', '7,000', 'S1']
    """
    if isinstance(value, float):
        if not math.isfinite(value):
            return "-" if math.isnan(value) else "never"  # of steps until something happens
        value = float(f"{value:.3g}")
    return f"{value:,.12g}" if type(value) in (int, float) else str(value)


def _files(study: Study, folder: Folder) -> str:
    """Returns what each file holds."""
    about = {
        tables.RUNS: "a row per run",
        tables.CURVES: "a row per evaluation",
        tables.AGENTS: "learned policies, for the page",
        **{file: first_line(each) for file, each in study.files.items() if file.endswith(".csv")},
        MEANINGS: "what columns mean",
        MANIFEST: "versions, machines, digests",
    }
    there = {*folder.files, MEANINGS, MANIFEST}
    lines = [f"- [{name}]({name}): {text}" for name, text in about.items() if name in there]
    return "\n".join(["## Files\n", *lines])


def _made(study: Study, folder: Folder) -> str:
    """Returns the notes of an experiment, and what made its results."""
    manifest, note = folder.manifest, " ".join(study.experiment.declared.note.split())
    commits = ", ".join(commit[:10] or "unknown" for commit in manifest["commits"])
    source = "stored runs" if hasattr(study.module, "READS_STORE") else f"`{tables.RUNS}`"
    parts = (
        "## Origin",
        note,
        f"""\
`{manifest["command"]}` made these results ({manifest["runs"]} runs, commit {commits}).
`report {study.experiment.argument}` redraws them from {source}.""",
    )
    return "\n\n".join(filter(None, parts))
