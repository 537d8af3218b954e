"""Writes the page: one HTML file with tables, figures and the explorer, made of published files alone.

Nothing is computed here. A number on the page is a cell of a CSV file beside it, and links to its row,
counted as by RFC 7111; the finding is the text of `findings.csv`. So the page can be made from a folder of
results without a single run.
"""

import base64
import io
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import jinja2
import pandas as pd
from PIL import Image

from benchmark.analysis.population import GOOD_SCORE
from benchmark.drawing.tables import link, show
from benchmark.page import explorer, script
from benchmark.page.sources import Folder, open_folder, section
from envs import InputError

PUBLISHED: Final = ("reproduce", "compare_deep")  # the experiments of which `results/index.html` tells
_TEMPLATES: Final = Path(__file__).parent / "templates"
_FIGURE_COLOURS: Final = 128  # of a figure's palette on the page; more cannot be told from these

_VERDICTS: Final = {"holds": "✓", "holds in part": "(✓)", "does not hold": "✗"}
_REPLICATION_FIGURES: Final = {
    "learning": "Exact score of the greedy policy, and share of optimal agents, over training.",
    "optimal": "The exact optimum, what learning made of it, and where agents act optimally.",
}
_COMPARISON_FIGURES: Final = {
    "curves": "Mean score of the greedy policy over training, with its 95 % interval.",
    "aggregate": "Aggregates over all scenarios, with their 95 % intervals.",
    "improvement": "Probability that a run of one learner scores higher than one of another.",
    "profile": "Performance profiles: the share of runs that score above a number.",
    "threshold": f"How many runs reach a score of {GOOD_SCORE:g}, and when.",
    "disagreements": "The issuer's disagreements per 1,000 steps while agents learn.",
    "region": "How well the cells where an agent values PING match the target region.",
    "maps": "Mean final Q of PING, of tables and nets.",
    "maps_probability": "Mean final probability of PING where the policy is stochastic.",
}


@dataclass(frozen=True)
class Cell:
    """One place of a table."""

    text: str
    order: str = ""  # what it is sorted by; its text if empty
    href: str = ""  # the row that it comes from
    kind: str = ""  # a CSS class


@dataclass(frozen=True)
class Table:
    """A table as the page shows it."""

    caption: str
    source: str  # the CSV file, as the page links to it
    columns: Sequence[tuple[str, bool]]  # label, and whether it holds numbers
    rows: Sequence[Sequence[Cell]]


@dataclass(frozen=True)
class Figure:
    """A picture in the page."""

    name: str
    caption: str
    source: str  # the SVG file, as the page links to it
    data: str
    width: int
    height: int


def published(results: Path) -> list[str]:
    """Lists the published experiments whose results are there."""
    return [name for name in PUBLISHED if (results / name / "manifest.json").exists()]


def write(results: Path, experiment: str | None = None) -> Path:
    """Writes the page of the published experiments, or of another one, and the list of all results.

    Args:
      results: The folder of results.
      experiment: One that is published, or None: the page tells of all of these that are there, and is
        `index.html` of `results`. Another one: it tells of that alone, and lies in its folder.

    Returns:
      The page's path.

    Raises:
      InputError: There is nothing to tell of, or the page cannot be written.
    """
    if experiment is None or experiment in PUBLISHED:
        folders = [open_folder(results / name, f"{name}/") for name in published(results)]
        target = results / "index.html"
    else:
        folders = [open_folder(results / experiment, "")]
        target = results / experiment / "index.html"
    if not folders:
        others = ", ".join(sorted(path.parent.name for path in results.glob("*/manifest.json")))
        told = f"; of {others} there is a page in the folder" if others else ""
        raise InputError(
            f"{results}: there are no results of {' or '.join(PUBLISHED)} to report; make reproduce and make "
            f"compare-deep make them{told}."
        )
    is_measured = target.parent == results and (results / "speed" / "speed.csv").exists()
    speed = Folder(results / "speed", "speed/", {"command": "make speed"}) if is_measured else None
    _write(target, _render(folders, speed))
    _write(results / "README.md", _index(results))
    return target


def _write(path: Path, text: str) -> None:
    """Writes a file, whole or not at all."""
    aside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        aside.write_text(text, encoding="utf-8")
        aside.replace(path)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written: {error.strerror or error}; choose another folder with --results."
        ) from error
    finally:
        aside.unlink(missing_ok=True)


def _render(folders: Sequence[Folder], speed: Folder | None) -> str:
    """Returns the page, with the project's own speed if that was measured."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    replication = next((one for one in folders if one.manifest["report"] == "replication"), None)
    compared = next((one for one in folders if one.manifest["report"] == "comparison"), None)
    explored = compared or replication
    assert explored is not None
    content = {
        "replication": section(replication, _replication) if replication else None,
        "comparison": section(compared, _comparison) if compared else None,
        "made": [section(folder, _made) for folder in folders],
        "speed": None,
        "partial": [note for note in (folder.manifest.get("partial") for folder in folders) if note],
        "scenarios": {
            name: declared["description"] for name, declared in explored.manifest["scenarios"].items()
        },
    }
    explored_data = explorer.collect([explored, *(one for one in folders if one is not explored)])
    if speed is not None:
        folders = [*folders, speed]
        content["speed"] = section(speed, _speed)["table"]
    files = {name: text for folder in folders for name, text in folder.embedded.items()}
    return environment.get_template("page.html").render(
        **content,
        data=script.pack({"explorer": explored_data, "csv": files}),
        has_explorer=explored_data is not None,
        horizon=explored.manifest["horizon"],
        maps_link=explored.link("maps.png" if explored is compared else "figure.png"),
        css=(_TEMPLATES / "page.css").read_text(encoding="utf-8"),
        js=script.read(),
        ramp=", ".join(explorer.COLOURS),
    )


# Tables


def _number(value: float, low: float | None = None, high: float | None = None) -> str:
    """Returns a number as readers see it, with its interval if it has one.

    >>> _number(0.7, 0.123, 1.0), _number(math.nan)
    ('0.7 [0.123, 1]', '-')
    """
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "never"  # of steps until something happens
    text = show(value) + ("" if low is None or high is None else f" [{show(low)}, {show(high)}]")
    return text.replace("-", "−")


def _cell(folder: Folder, file: str, row: pd.Series, key: str) -> Cell:
    """Returns a number of a row, with its interval if the row has one."""
    value = float(row[key])
    low, high = (row.get(f"{key}_{end}") for end in ("low", "high"))
    text = _number(value, low, high)
    href = "" if text == "-" else folder.link(file, row.name)
    return Cell(text, str(value).replace("inf", "Infinity"), href, "number")


def _with_ends(frame: pd.DataFrame, key: str) -> pd.DataFrame:
    """Returns a frame whose columns `low` and `high` are called the ends of a number's interval."""
    return frame.rename(columns={"low": f"{key}_low", "high": f"{key}_high"})


def _table(
    folder: Folder,
    file: str,
    caption: str,
    keys: Sequence[str],
    numbers: Mapping[str, str],
    where: Callable[[pd.DataFrame], pd.DataFrame] = lambda frame: frame,
) -> Table:
    """Makes a table of a CSV file's columns, a row of the file each.

    Args:
      folder: Of the file.
      file: Its name.
      caption: What the table is.
      keys: Columns that say what a row is about.
      numbers: Columns with numbers, and what readers see them called.
      where: Takes the rows that are shown.
    """
    frame = where(folder.read(file))
    shown = {key: label for key, label in numbers.items() if key in frame}
    rows = [
        [*(Cell(str(row[key])) for key in keys), *(_cell(folder, file, row, key) for key in shown)]
        for _, row in frame.iterrows()
    ]
    columns = [(key.replace("_", " "), False) for key in keys]
    return Table(caption, folder.link(file), [*columns, *((label, True) for label in shown.values())], rows)


# Sections


def _replication(folder: Folder) -> dict[str, Any]:
    """Returns what the page says of the replication."""
    content: dict[str, Any] = {
        "description": folder.manifest["description"],
        "figure": _figure(
            folder, "figure", "The paper's figure: maximum Q over training, final Q of the moves and of PING."
        ),
        "figures": [_figure(folder, *one) for one in _REPLICATION_FIGURES.items()],
        "learning": _table(
            folder,
            "learning.csv",
            "After training: exact evaluation of the agents' greedy policies",
            ["scenario"],
            {
                "score": "mean score",
                "score_iqm": "score, interquartile mean",
                "success": "success probability",
                "optimal_share": "share of optimal agents",
            },
            lambda frame: frame[frame["step"] == frame["step"].max()],
        ),
    }
    if "claims.csv" in folder:
        content |= _claims(folder)
    return content


def _claims(folder: Folder) -> dict[str, Any]:
    """Returns the paper's claims, with what they depend on."""
    claims = _with_ends(folder.read("claims.csv"), "value")
    sensitivity = folder.read("sensitivity.csv")
    rows = []
    for _, row in claims.iterrows():
        own = sensitivity[sensitivity["claim"] == row["claim"]]
        others = own[own["verdict"] != row["verdict"]]
        depends = "; ".join(
            f"`{other['reading']}`: {link(other['verdict'], 'sensitivity', other)}"
            for _, other in others.iterrows()
        )
        rows.append(
            {
                "claim": row["claim"],
                "says": row["says"],
                "measure": row["measure"],
                "because": row["because"],
                "value": _cell(folder, "claims.csv", row, "value"),
                "threshold": row["threshold"],
                "verdict": row["verdict"],
                "sign": _VERDICTS[row["verdict"]],
                "depends": folder.as_html(depends or "no reading changes it"),
            }
        )
    counts = []
    for verdict in _VERDICTS:
        own = claims[claims["verdict"] == verdict]
        counts.append((verdict, len(own), folder.target(link("", "claims", own)) if len(own) else ""))
    return {
        "claims": rows,
        "claims_source": folder.link("claims.csv"),
        "counts": counts,
        "shaky": folder.as_html(_shaky(claims, sensitivity)),
        "n_claims": len(claims),
        "readings": folder.manifest["readings"],
        "sensitivity": _figure(folder, "sensitivity", "Verdict on every claim under every reading."),
    }


def _shaky(claims: pd.DataFrame, sensitivity: pd.DataFrame) -> str:
    """Says which of the claims that hold do not under another reading or a control; empty if none."""
    holding = claims.loc[claims["verdict"] == "holds", "claim"]
    fallen = sensitivity[sensitivity["claim"].isin(holding) & (sensitivity["verdict"] == "does not hold")]
    parts = []
    for reading, own in fallen.groupby("reading", sort=False):
        names = ", ".join(f"`{claim}`" for claim in own["claim"])
        verb = "fails" if len(own) == 1 else "fail"
        parts.append(f"{link(str(len(own)), 'sensitivity', own)} ({names}) {verb} under `{reading}`")
    return "; ".join(parts)


def _comparison(folder: Folder) -> dict[str, Any]:
    """Returns what the page says of the comparison."""
    who = ["algorithm", "observation"]
    found = folder.read("findings.csv", embed=False)["text"].tolist()
    folder.read("curves.csv")
    return {
        "description": folder.manifest["description"],
        "note": folder.manifest["note"],
        "readme": folder.link("README.md"),
        "headline": folder.as_html(found[0]) if found else "",
        "sentences": [folder.as_html(one) for one in found[1:]],
        "aggregate": _aggregate(folder),
        "summary": _table(
            folder,
            "summary.csv",
            "Each scenario and learner, by its greedy policy after training",
            ["scenario", *who],
            {
                "n": "runs",
                "score_mean": "mean score",
                "score_iqm": "score, interquartile mean",
                "success": "success probability",
                "steps": "steps",
                "wrong_pings": "wrong PINGs",
                "uncomfortable_steps": "uncomfortable steps",
                "every_cell_success": "success from any cell",
                "stochastic_success": "success, stochastic policy",
            },
        ),
        "improvement": _table(
            folder,
            "improvement.csv",
            "Probability that a run of x scores higher than one of y",
            ["x", "y"],
            {"probability": "probability"},
            lambda frame: _with_ends(frame, "probability"),
        ),
        "threshold": _table(
            folder,
            "threshold.csv",
            f"Runs that score {GOOD_SCORE:g} at some time, and those that stay there; median step of each",
            ["scenario", *who],
            {
                "reached_share": "share that reaches it",
                "reached_step_median": "median step",
                "stays_share": "share that stays",
                "stays_step_median": "median step to stay",
            },
        ),
        "region": _table(
            folder,
            "region.csv",
            "Who knows the personal space: cells where an agent values PING, against the target region",
            ["scenario", *who],
            {
                "cells_marked": "cells marked",
                "precision": "precision",
                "recall": "recall",
                "overlap": "overlap",
            },
        ),
        "cost": _table(
            folder,
            "cost.csv",
            "What a run costs: medians over all runs, measured",
            who,
            {
                "cpu_time_s": "CPU time (s)",
                "steps_per_cpu_s": "steps per CPU second",
                "updates": "updates",
                "parameters": "learned numbers",
                "peak_memory_mb": "peak memory (MB)",
            },
        ),
        "figures": {
            name: _figure(folder, name, caption)
            for name, caption in _COMPARISON_FIGURES.items()
            if f"{name}.png" in folder
        },
        "cpu_figure": _figure(folder, "curves_cpu", "Mean score against the CPU time spent on training."),
    }


def _speed(folder: Folder) -> dict[str, Any]:
    """Returns the project's own speed."""
    caption = "Speed of this project against the stock way, measured in one run"
    numbers = {"per_second": "per second", "baseline": "stock way, per second", "ratio": "ratio"}
    return {"table": _table(folder, "speed.csv", caption, ["name", "unit", "against"], numbers)}


def _aggregate(folder: Folder) -> Table:
    """Makes the table of aggregates, one row a learner: each number is a row of the file."""
    frame = folder.read("aggregate.csv")
    frame = _with_ends(frame[(frame["policy"] == "greedy") & (frame["evaluated_from"] == "start")], "value")
    metrics = list(frame["metric"].unique())
    rows = []
    for learner, own in frame.groupby(["algorithm", "observation"], sort=False):
        cells = [_cell(folder, "aggregate.csv", row, "value") for _, row in own.iterrows()]
        rows.append([*(Cell(str(name)) for name in learner), *cells])
    labels = {"iqm": "interquartile mean", "optimality_gap": "optimality gap"}
    columns = [("algorithm", False), ("observation", False)]
    columns += [(labels.get(metric, metric), True) for metric in metrics]
    caption = "Score over all scenarios, by the greedy policy after training"
    return Table(caption, folder.link("aggregate.csv"), columns, rows)


def _figure(folder: Folder, name: str, caption: str) -> Figure:
    """Returns a figure small enough to stand in the page; the link leads to the drawing itself."""
    with Image.open(folder.path / f"{name}.png") as image:
        small = image.convert("RGB").quantize(_FIGURE_COLOURS, dither=Image.Dither.NONE).convert("RGB")
    buffer = io.BytesIO()
    small.save(buffer, "WEBP", lossless=True, method=4)
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    return Figure(name, caption, folder.link(f"{name}.svg"), data, *small.size)


def _made(folder: Folder) -> dict[str, Any]:
    """Returns what made a folder of results."""
    manifest = folder.manifest
    return {
        "name": manifest["experiment"],
        "description": manifest["description"],
        "command": manifest["command"],
        "link": folder.link("manifest.json"),
        "readme": folder.link("README.md"),
        "commits": [commit or "unknown" for commit in manifest["commits"]],
        "machines": manifest["machines"],
        "versions": manifest["versions"],
        "runs": manifest["runs"],
        "digest": manifest["digest"],
        "first": manifest["first_started_at"],
        "last": manifest["last_started_at"],
        "settings": {
            name: {key: value for key, value in arm["settings"].items() if value is not None}
            for name, arm in manifest["algorithms"].items()
        },
    }


# The list of all results


def _index(results: Path) -> str:
    """Returns the page that says what all the folders of results are."""
    lines = []
    for path in sorted(results.iterdir()):
        if path.name.startswith(".") or path.name.endswith(("_smoke", "_partial")):
            continue
        if not (path / "README.md").exists():
            continue
        paragraphs = (path / "README.md").read_text(encoding="utf-8").split("\n\n")
        told = (
            next((one for one in paragraphs if not one.startswith("#")), "")
            .replace("\n", " ")
            .replace("|", r"\|")
            .strip()
        )
        if (path / "index.html").exists():
            told += f" On a page of its own: [index.html]({path.name}/index.html)."
        lines.append(f"| [{path.name}]({path.name}/README.md) | {told} |")
    folders = "\n".join(lines)
    page = """
[index.html](index.html) shows it on one page: download it, or open it from a clone. It needs no server and no
network; every number leads to the row of the CSV file that it comes from, and its explorer shows what one
agent of every learner knows over training, cell by cell, and lets it walk.
"""
    return f"""# Results
{page if (results / "index.html").exists() else ""}
| folder | what it holds |
|---|---|
{folders}

A folder's own page says what each of its files is, what made it, and with what command. Tables are `.csv`
(six digits, all columns), and for reading `.md` and `.tex`; figures `.png` and `.svg`. `manifest.json` holds
versions, commit, machine and times. `runs.db`, which is not in the repository, holds every run made here.
"""
