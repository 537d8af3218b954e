"""The command `report`: redraws an experiment's results from its published runs, without training.

`report NAME` reads the two tables of runs and the experiment's file, and nothing else. It computes
the tables and figures of the experiment's study, a module as `benchmark.study` describes it, and
writes README from the tables. Without a name, it writes all published texts, and the page.
"""

import argparse
import hashlib
import json
import math
import shutil
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from importlib.machinery import SourceFileLoader
from importlib.util import find_spec
from inspect import getdoc, unwrap
from pathlib import Path
from types import ModuleType
from typing import Any, Final, cast

import pandas as pd
from matplotlib.figure import Figure

from benchmark import front, search, style, tables
from benchmark.experiment import PUBLISHED, Experiment, load_experiment
from benchmark.folder import (
    MANIFEST,
    MEANINGS,
    README,
    REPOSITORY,
    Folder,
    alone,
    committed,
    csv_text,
    replaced,
    write_csv,
    write_manifest,
    write_text,
)
from benchmark.page import build as page
from benchmark.scenes import shipped
from benchmark.study import Data, Report
from envs import InputError
from envs.inputs import check_all, parse, unknown_name
from envs.packages import contained, imported

STUDIES: Final = ("comparison", "map", "replication", "search")
MAX_WORDS: Final = 900  # of README
_MAX_ROWS: Final = 24  # of a table in README; longer ones are only linked
_PACKED: Final = (tables.RUNS, tables.CURVES, tables.AGENTS)  # which `run` publishes
_MADE_BY: Final = ("commit", "machine", "processor")
# What columns mean: of runs and curves, and of any other table. A star stands for part of a name.
RUN_COLUMNS: Final = {
    "scenario": "scenario",
    "grid": "grid of the experiment",
    "point": "point of the grid",
    "reading": "a way to read the paper, or a control",
    "trial": "number of the trial; 0 has the settings as declared",
    "learner": "an algorithm with its settings, and what it observes",
    "seed": "seed of the run",
    "run": "beginning of the run's digest; conditions that change nothing share runs",
    "policy": "policy that `success` and `score` are about",
    "budget": "environment steps of training",
    "step": "environment steps of training so far",
    "success": "probability that an episode ends with a correct PING, exact",
    "score": "return, with 0 for the random and 1 for the optimal policy, clipped to [0, 1]",
    "unbounded_score": "the same, not clipped",
    "steps": "steps of an episode",
    "wrong_pings": "wrong PINGs of an episode",
    "uncomfortable_steps": "steps of an episode in the uncomfortable region",
    "*_success": "success, by the * policy",
    "unseen_success": "success where the person never stood, when the run had certainly learned",
    "unseen_greedy": "the same, by the greedy policy",
    "unseen_stochastic": "the same, by the stochastic policy",
    "unseen_budget*": "the same at the budget",
    "training_wrong_pings": "wrong PINGs of training so far",
    "diverged_at": "step at which values were no longer finite; inf if never",
    "updates": "updates of the parameters",
    "parameters": "number of learned parameters",
    "cpu_time_s": "CPU seconds of training",
    "cpu_learned_s": "CPU seconds until the run had learned; inf if never",
    "peak_memory_mb": "peak memory of the process, in MB",
    "wall_time_s": "duration in seconds",
    "started_at": "time of the start",
    "commit": "commit of this project",
    "machine": "system and cores",
    "processor": "processor, and library of linear algebra",
    "versions": "versions of packages, as JSON",
}
COLUMNS: Final = {
    **RUN_COLUMNS,
    "n": "runs",
    "x": "the learner that is compared",
    "y": "the learner that it is compared with",
    "differs": "what else differs between x and y",
    "*_low": "lower end of the 95 % interval of *",
    "*_high": "upper end of the 95 % interval of *",
    "*_x": "* of x",
    "*_y": "* of y",
}
Function = Callable[[Data], Any]


class ClaimError(InputError):
    """The tables do not show what a finding claims."""


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    if options.experiment is None:
        if options.seeds is not None:
            raise InputError("--seeds: accepted only together with an experiment.")
        print(f"the page is {write_texts(options.results)}.")
        return 0
    experiment = load_experiment(options.experiment, smoke=options.smoke)
    seeds = other_seeds(experiment, tables.parse_seeds(options.seeds))
    folder = options.results / folder_name(experiment, seeds)
    write(experiment, folder, seeds)
    if experiment.declared.search is not None:
        search.write_chosen(experiment, folder)
    print(f"{experiment.name}: tables and figures are in {folder}.")
    if folder.name in PUBLISHED:
        where = page.write(options.results, _published(options.results))
    else:
        where = page.write(folder, [Folder(folder)])
    print(f"{experiment.name}: the page is {where}.")
    if text := certificate(folder):
        print(text)
    return 0


def other_seeds(experiment: Experiment, seeds: range | None) -> range | None:
    """Returns the given seeds, or None if they select exactly the declared runs."""
    is_same = all(each.taken(seeds) == each.seeds for each in experiment.populations)
    return None if is_same else seeds


def folder_name(experiment: Experiment, seeds: range | None) -> str:
    """Returns the name of an experiment's folder; other seeds have one of their own."""
    if seeds is None:
        return experiment.name
    ends = dict.fromkeys((seeds[0], seeds[-1]))
    return f"{experiment.name}_seeds_{'-'.join(map(str, ends))}"


def certificate(folder: Path) -> str:
    """Says whether a folder is as in the last commit; returns an empty text if this has none."""
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
    """A study, as an experiment declares it. An item may be a table or a figure."""

    experiment: Experiment
    module: ModuleType
    declared: Any
    items: dict[str, Function]

    @property
    def question(self) -> str:
        """The heading of the results."""
        return str(self.declared.question or first_line(self.module))

    def get(self, name: str) -> dict[str, Any]:
        """Returns one of the study's dicts, by default an empty one."""
        return {**getattr(self.module, name, {})}

    def functions(self) -> list[tuple[str, Function]]:
        """Returns the functions of tables, items and figures, by the names of their files."""
        groups = self.get("TABLES"), self.items, self.get("FIGURES")
        return [named for functions in groups for named in functions.items()]

    def text(self, name: str, data: Data) -> str:
        """Returns one of the study's texts; empty if there is none.

        Tables without runs are of an earlier version, which had other rules.
        """
        function = getattr(self.module, name, None)
        return str(_called(function, data)) if function and len(data.runs) else ""


def study_of(experiment: Experiment) -> Study:
    """Returns the study of an experiment; an InputError says if they do not fit."""
    given, where = experiment.declared.report, experiment.argument
    if given is None:
        raise InputError(f"{where}: report is missing; add a [report] table.")
    module = load_study(str(given.get("kind", "")), where)
    declared = parse(getattr(module, "Declared", Report), given, f"{where}: report")
    items = {name.partition(":")[2]: imported(name, where, "item") for name in declared.items}
    taken = {*items} & {*module.TABLES, *getattr(module, "FIGURES", ())}
    if taken or len(items) < len(declared.items) or not all(map(callable, items.values())):
        what = f"report.items: {', '.join(declared.items)}"
        raise InputError(f"{where}: {what}: accepted: functions, each with a new name.")
    if hasattr(module, "check"):
        module.check(experiment, declared)
    return Study(experiment, module, declared, cast("dict[str, Function]", items))


def load_study(name: str, source: str) -> ModuleType:
    """Returns a study of this project or any other module; an InputError begins with the source."""
    if name not in STUDIES and "." not in name and (not name or find_spec(name) is None):
        unknown_name(source, "report.kind", name, STUDIES, "a module")
    module = f"benchmark.{name}" if name in STUDIES else name
    imported(f"{module}:TABLES", source, "study")
    return sys.modules[module]


def first_line(named: object) -> str:
    """Returns the first line of the docstring of a module or a function."""
    return (getdoc(named) or "").partition("\n")[0]


def _called(function: Function, data: Data) -> Any:
    code = getattr(unwrap(function), "__code__", None)
    with mistakes_in(Path(code.co_filename if code else __file__)):
        return function(data)


@contextmanager
def mistakes_in(path: Path) -> Iterator[None]:
    """Turns whatever a file does wrong, such as dividing by zero, into an InputError."""
    try:
        with contained():
            yield
    except InputError:
        raise
    except Exception as error:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if frame.filename == str(path)]
        line = getattr(error, "lineno", None) or [0, *lines][-1]
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error).rstrip(".")
        kind = ClaimError if isinstance(error, AssertionError) else InputError
        raise kind(f"{path}, line {line}: {reason or type(error).__name__}.") from error


# The files of a folder


def write(experiment: Experiment, folder: Path, seeds: Sequence[int] | None = None) -> None:
    """Draws a folder from its tables of runs.

    New files replace the earlier ones when all are there, so a failure leaves the folder as it was.
    An InputError says if the runs are missing, or are not those that the experiment declares.
    """
    study = study_of(experiment)
    runs, curves = tables.read(folder)
    tables.check_declared(experiment, runs, seeds)
    keys = [key for key in tables.KEYS if key in runs]
    if experiment.declared.search is None and runs.groupby(keys).size().min() < 2:
        what = "too few runs (a single run has no interval)"
        raise InputError(f"{experiment.name}: {what}; accepted: at least two of every learner.")
    store = path if (path := folder.parent / "runs.db").is_file() else None
    data = Data(experiment, study.declared, runs, curves, store=store)
    with alone(folder.parent), replaced(folder, Folder(folder).files) as aside:
        for name in _PACKED:
            if (folder / name).is_file():
                shutil.copyfile(folder / name, aside / name)
        for name, function in study.functions():
            made = _called(function, data)
            if isinstance(made, pd.DataFrame):
                data.tables[name] = made
                write_csv(made, aside / f"{name}.csv")
            elif isinstance(made, Figure):
                style.save(made, aside / f"{name}.svg")
            elif made is not None:
                what = f"{name} returns {type(made).__name__}"
                raise InputError(f"{experiment.argument}: {what}; accepted: a table or a figure.")
        write_manifest(aside, _manifest(study, runs, seeds))
        _write_texts(study, Folder(aside), seeds)


def _manifest(study: Study, runs: pd.DataFrame, seeds: Sequence[int] | None) -> dict[str, object]:
    """Returns what made the results; drawing again gives the same."""
    experiment, ids = study.experiment, sorted({*runs["run"]})
    option = "" if seeds is None else f" --seeds {seeds[0]}-{seeds[-1]}"
    made_by = {f"{name}s": sorted({*runs[name].fillna("")}) for name in _MADE_BY}
    return {
        "experiment": experiment.name,
        "command": f"python -m benchmark run {experiment.argument}{option} --report",
        "question": study.question,
        "runs": len(ids),
        "digest": hashlib.sha256("".join(ids).encode()).hexdigest(),
        **made_by,
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
            _write_texts(study_of(load_experiment(folder.path.name)), folder)
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


def _write_texts(study: Study, folder: Folder, seeds: Sequence[int] | None = None) -> None:
    for name, text in texts(study, folder, seeds).items():
        write_text(folder.path / name, text)


def texts(study: Study, folder: Folder, seeds: Sequence[int] | None = None) -> dict[str, str]:
    """Returns the texts of a folder, which its manifest does not list, by their files."""
    has_runs = tables.RUNS in folder.files
    runs, curves = tables.read(folder.path) if has_runs else (pd.DataFrame(), pd.DataFrame())
    data = Data(study.experiment, study.declared, runs, curves, folder.tables())
    return {README: readme(study, folder, data, seeds), MEANINGS: csv_text(meanings(study, data))}


def meanings(study: Study, data: Data) -> pd.DataFrame:
    """Returns what the columns of each table mean."""
    known = COLUMNS | study.get("COLUMNS")
    files = {tables.RUNS: (data.runs, RUN_COLUMNS), tables.CURVES: (data.curves, RUN_COLUMNS)}
    files |= {f"{name}.csv": (table, known) for name, table in data.tables.items()}
    rows = [
        (file, column, meaning(str(column), about))
        for file, (table, about) in files.items()
        for column in table
    ]
    return pd.DataFrame(rows, columns=["file", "column", "meaning"])


def meaning(column: str, known: Mapping[str, str]) -> str:
    """Returns what a column means, by its name or a pattern of it; empty if that is not known.

    >>> meaning("steps_low", {"*_low": "lower end of the interval of *"})
    'lower end of the interval of steps'
    """
    for pattern in (column, *(name for name in known if "*" in name)):
        if pattern in known and fnmatchcase(column, pattern):
            before, _, after = pattern.partition("*")
            part = column.removeprefix(before).removesuffix(after)
            return known[pattern].replace("*", part)
    return ""


# README of a folder


def readme(study: Study, folder: Folder, data: Data, seeds: Sequence[int] | None = None) -> str:
    """Returns README of a folder; tables that would make it too long are left out."""
    answer, *others = answer_of(study, data, seeds).split("\n\n")
    figures = [
        f"![{name}]({name}.svg)\n\n*{first_line(function)}*"
        for name, function in (study.get("FIGURES") | study.items).items()
        if f"{name}.svg" in folder.files
    ]
    shown = [text for name in study.get("SHOWN") if (text := _shown(study, name, data))]
    reading = study.text("reading", data)
    ends = [f"## How to read this\n\n{reading}"] if reading else []
    ends += [_files(study, folder), _made(study, folder)]
    start = [f"# {study.question}", answer, *figures[:1], *others]
    while True:
        text = "\n\n".join([*start, *figures[1:], *shown, *ends]) + "\n"
        if len(text.split()) <= MAX_WORDS or not shown:
            return text
        shown.pop()


def answer_of(study: Study, data: Data, seeds: Sequence[int] | None = None) -> str:
    """Returns the finding of an experiment or, without one for these runs, its headline."""
    experiment, text = study.experiment, ""
    path = experiment.path.with_suffix(".py")
    if seeds is None and not experiment.declared.is_miniature and has_finding(path):
        try:
            text = finding(path, data.tables)
        except ClaimError as error:  # nets of Stable-Baselines3 depend on the processor
            print(f"{experiment.name}: the tables do not show a claim: {error}", file=sys.stderr)
    return text or study.text("headline", data) or experiment.declared.description.strip()


def has_finding(path: Path) -> bool:
    """Returns whether there is such a file with a finding; others are not run."""
    return path.is_file() and "def finding(" in path.read_text(encoding="utf-8")


def finding(path: Path, published: Mapping[str, pd.DataFrame]) -> str:
    """Returns the text of the function `finding` of a file, in Markdown.

    Raises:
      ClaimError: The tables do not show what it asserts.
      InputError: The file has a mistake.
    """
    module = ModuleType(path.stem)
    with mistakes_in(path):
        SourceFileLoader(path.stem, str(path)).exec_module(module)
        text = module.finding(published)
    if not isinstance(text, str):
        raise InputError(f"{path}: finding returns {type(text).__name__}; accepted: a text.")
    return text.strip()


def _shown(study: Study, name: str, data: Data) -> str:
    """Returns a table as README shows it; empty if it is long, or not there."""
    frame = data.tables.get(name, pd.DataFrame())
    names = [column for column in study.get("SHOWN")[name].split() if column in frame]
    columns = [column for column in names if not frame[column].isin(["", math.nan]).all()]
    if not columns or len(frame) > _MAX_ROWS:
        return ""
    titles = {key: learner.title for key, learner in study.experiment.learners.items()}
    rows = frame.to_dict("records")
    shown = {
        name.replace("_", " "): [_entry(row, name, titles) for row in rows] for name in columns
    }
    table = pd.DataFrame(shown).to_markdown(index=False, disable_numparse=True)
    return f"{first_line(study.get('TABLES').get(name))}\n\n{table}"


def _entry(row: Mapping[Any, Any], name: str, titles: Mapping[str, str]) -> str:
    """Returns an entry of a table: a learner's title, or a number with its interval."""
    ends = [row.get(f"{name}_{end}", math.nan) for end in ("low", "high")]
    interval = f" [{', '.join(map(show, ends))}]" if all(map(math.isfinite, ends)) else ""
    text = titles.get(row[name], show(row[name])) + interval
    return " ".join(text.split()).replace("|", "&#124;")


def show(value: object) -> str:
    """Returns a value as readers see it; a float has three significant digits.

    >>> [show(value) for value in (0.12345, 999.6, 52612345.0, math.inf, math.nan, 7000, "S1")]
    ['0.123', '1,000', '52,600,000', 'never', '-', '7,000', 'S1']
    """
    if not isinstance(value, float):
        return f"{value:,}" if type(value) is int else str(value)
    if not math.isfinite(value):
        return "-" if math.isnan(value) else "never"  # of steps until something happens
    text = f"{value:.3g}"
    return f"{float(text):,.0f}" if abs(float(text)) >= 1000 else text


def _files(study: Study, folder: Folder) -> str:
    """Returns what each file holds."""
    tabled = (study.get("TABLES") | study.items).items()
    about = {
        tables.RUNS: "a row per run",
        tables.CURVES: "a row per run and evaluation",
        tables.AGENTS: "what agents have learned, for the page",
        **{f"{name}.csv": first_line(function) for name, function in tabled},
    }
    names = [name for name in about | folder.files if name in folder.files]
    lines = [f"- [{name}]({name}): {about.get(name, '')}" for name in names if name[-4:] != ".svg"]
    lines += [
        f"- [{MEANINGS}]({MEANINGS}): what columns mean",
        f"- [{MANIFEST}]({MANIFEST}): what made the runs, digests of files",
    ]
    return "\n".join(["## Files\n", *lines])


def _made(study: Study, folder: Folder) -> str:
    """Returns the notes of an experiment, and what made its results."""
    manifest, note = folder.manifest, " ".join(study.experiment.declared.note.split())
    commits = ", ".join(commit[:10] or "unknown" for commit in manifest["commits"])
    made = (
        f"`{manifest['command']}` made these results ({manifest['runs']} runs, commit {commits})."
    )
    again = "Its runs are not published, so tables and verdicts are of an earlier version."
    if tables.RUNS in folder.files:
        source = "stored runs" if hasattr(study.module, "READS_STORE") else f"`{tables.RUNS}`"
        again = f"`report {study.experiment.argument}` draws them again from {source}."
    return "\n\n".join(["## How it was made", *filter(None, [note]), f"{made} {again}"])
