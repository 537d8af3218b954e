"""Writes the page: one HTML file with tables, figures and the explorer, made of published files alone.

Nothing is computed here. A number on the page is a cell of a CSV file beside it, and links to its row,
counted as by RFC 7111; the finding is the text of `findings.csv`. So the page can be made from a folder of
results without a single run.
"""

import base64
import gzip
import html
import io
import json
import math
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import jinja2
import matplotlib as mpl
import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib.colors import to_hex
from numpy.typing import NDArray
from PIL import Image

from benchmark.analysis import snapshots as explorer
from benchmark.analysis.population import GOOD_SCORE
from benchmark.drawing.tables import LINK, link, show
from envs import ACTIONS, EVENTS, ZONES, InputError, Model, Scenario, compile_scenario

PUBLISHED: Final = ("reproduce", "compare_deep")  # the experiments of which `results/index.html` tells
_TEMPLATES: Final = Path(__file__).parent / "templates"
_FIGURE_COLOURS: Final = 128  # of a figure's palette on the page; more cannot be told from these
_NO_NUMBER: Final = -(2**31)  # among a map's values
_OF_ANOTHER_FORM: Final = (OSError, ValueError, LookupError, TypeError, AttributeError)

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


@dataclass
class _Folder:
    """A folder of results: its CSV files as read, and how the page links to them."""

    path: Path
    prefix: str
    manifest: dict[str, Any]
    embedded: dict[str, str] = field(default_factory=dict)  # link to text of the files whose rows are shown

    def __contains__(self, name: str) -> bool:
        return (self.path / name).exists()

    def read(self, name: str, *, embed: bool = True, as_text: str = "") -> pd.DataFrame:
        """Reads a CSV file, as it stands; one column may be left as it is written."""
        text = (self.path / name).read_text(encoding="utf-8")
        if embed:
            self.embedded[self.link(name)] = text
        return pd.read_csv(io.StringIO(text), dtype={as_text: str} if as_text else None)

    def link(self, name: str, row: int | None = None) -> str:
        """Returns the link to a file, or to the row of a data frame's index in it."""
        return f"{self.prefix}{name}" + ("" if row is None else f"#row={row + 2}")


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
        folders = [_open(results / name, f"{name}/") for name in published(results)]
        target = results / "index.html"
    else:
        folders = [_open(results / experiment, "")]
        target = results / experiment / "index.html"
    if not folders:
        others = ", ".join(sorted(path.parent.name for path in results.glob("*/manifest.json")))
        told = f"; of {others} there is a page in the folder" if others else ""
        raise InputError(
            f"{results}: there are no results of {' or '.join(PUBLISHED)} to report; make reproduce and make "
            f"compare-deep make them{told}."
        )
    is_measured = target.parent == results and (results / "speed" / "speed.csv").exists()
    speed = _Folder(results / "speed", "speed/", {"command": "make speed"}) if is_measured else None
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


def _open(path: Path, prefix: str) -> _Folder:
    """Opens a folder of results."""
    try:
        manifest = json.loads((path / "manifest.json").read_text(encoding="utf-8"))
        manifest["report"], manifest["scenarios"]
    except _OF_ANOTHER_FORM as error:
        raise InputError(
            f"{path / 'manifest.json'}: is damaged, or was made by another version of this project; make the "
            f"results of {path.name} again: python -m benchmark run {path.name} --report"
        ) from error
    return _Folder(path, prefix, manifest)


def _render(folders: Sequence[_Folder], speed: _Folder | None) -> str:
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
        "replication": _read(replication, _replication) if replication else None,
        "comparison": _read(compared, _comparison) if compared else None,
        "made": [_read(folder, _made) for folder in folders],
        "speed": None,
        "partial": [note for note in (folder.manifest.get("partial") for folder in folders) if note],
        "scenarios": {
            name: declared["description"] for name, declared in explored.manifest["scenarios"].items()
        },
    }
    if speed is not None:
        folders = [*folders, speed]
        content["speed"] = _read(speed, _speed)["table"]
    data = _read(explored, _explorer)
    data["csv"] = {name: text for folder in folders for name, text in folder.embedded.items()}
    return environment.get_template("page.html").render(
        **content,
        data=_packed_json(data),
        horizon=explored.manifest["horizon"],
        maps_link=explored.link("maps.png" if explored is compared else "figure.png"),
        css=(_TEMPLATES / "page.css").read_text(encoding="utf-8"),
        js=(_TEMPLATES / "page.js").read_text(encoding="utf-8"),
        ramp=", ".join(data["colours"]),
    )


def _read(folder: _Folder, section: Callable[[_Folder], dict[str, Any]]) -> dict[str, Any]:
    """Returns what a section tells of a folder, or says that the folder is none of today's."""
    try:
        return section(folder)
    except _OF_ANOTHER_FORM as error:
        if isinstance(error, FileNotFoundError):
            told = f"{Path(error.filename).name} is missing"
        else:
            told = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise InputError(
            f"{folder.path}: damaged, or made by another version of this project ({told}); make these "
            f"results again: {folder.manifest.get('command')}"
        ) from error


def _packed_json(data: object) -> str:
    """Returns data as JSON, compressed to less than half, in base64."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode("ascii")


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


def _cell(folder: _Folder, file: str, row: pd.Series, key: str) -> Cell:
    """Returns a number of a row, with its interval if the row has one."""
    value = float(row[key])
    low, high = (row.get(f"{key}_{end}") for end in ("low", "high"))
    text = _number(value, low, high)
    href = "" if text == "-" else folder.link(file, int(str(row.name)))
    return Cell(text, str(value).replace("inf", "Infinity"), href, "number")


def _with_ends(frame: pd.DataFrame, key: str) -> pd.DataFrame:
    """Returns a frame whose columns `low` and `high` are called the ends of a number's interval."""
    return frame.rename(columns={"low": f"{key}_low", "high": f"{key}_high"})


def _table(
    folder: _Folder,
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


def _replication(folder: _Folder) -> dict[str, Any]:
    """Returns what the page says of the replication."""
    section: dict[str, Any] = {
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
        section |= _claims(folder)
    return section


def _claims(folder: _Folder) -> dict[str, Any]:
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
                "depends": _marked(depends or "no reading changes it", folder),
            }
        )
    counts = []
    for verdict in _VERDICTS:
        own = claims[claims["verdict"] == verdict]
        counts.append((verdict, len(own), _href(link("", "claims", own), folder) if len(own) else ""))
    return {
        "claims": rows,
        "claims_source": folder.link("claims.csv"),
        "counts": counts,
        "shaky": _marked(_shaky(claims, sensitivity), folder),
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


def _comparison(folder: _Folder) -> dict[str, Any]:
    """Returns what the page says of the comparison."""
    who = ["algorithm", "observation"]
    found = folder.read("findings.csv", embed=False)["text"].tolist()
    folder.read("curves.csv")
    return {
        "description": folder.manifest["description"],
        "note": folder.manifest["note"],
        "readme": folder.link("README.md"),
        "headline": _marked(found[0], folder) if found else "",
        "sentences": [_marked(one, folder) for one in found[1:]],
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


def _speed(folder: _Folder) -> dict[str, Any]:
    """Returns the project's own speed."""
    caption = "Speed of this project against the stock way, measured in one run"
    numbers = {"per_second": "per second", "baseline": "stock way, per second", "ratio": "ratio"}
    return {"table": _table(folder, "speed.csv", caption, ["name", "unit", "against"], numbers)}


def _aggregate(folder: _Folder) -> Table:
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


def _figure(folder: _Folder, name: str, caption: str) -> Figure:
    """Returns a figure small enough to stand in the page; the link leads to the drawing itself."""
    with Image.open(folder.path / f"{name}.png") as image:
        small = image.convert("RGB").quantize(_FIGURE_COLOURS, dither=Image.Dither.NONE).convert("RGB")
    buffer = io.BytesIO()
    small.save(buffer, "WEBP", lossless=True, method=4)
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    return Figure(name, caption, folder.link(f"{name}.svg"), data, *small.size)


def _made(folder: _Folder) -> dict[str, Any]:
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


def _href(text: str, folder: _Folder) -> str:
    """Returns where a link of `benchmark.drawing.tables` leads on the page."""
    return LINK.sub(rf"{folder.prefix}\2#row=\3", text)


def _marked(text: str, folder: _Folder) -> Markup:
    """Returns a sentence as HTML: `code`, and numbers with links to their rows."""
    escaped = re.sub(r"(?<![\w-])-(?=\d)", "−", html.escape(text, quote=False))
    escaped = LINK.sub(lambda m: f'<a class="n" href="{_href(m[0], folder)}">{m[1]}</a>', escaped)
    parts = escaped.split("`")
    return Markup("".join(f"<code>{part}</code>" if i % 2 else part for i, part in enumerate(parts)))


# The explorer


def _explorer(folder: _Folder) -> dict[str, Any]:
    """Returns what the explorer shows; a map's values are in thousandths."""
    agents = folder.read("agent.csv", as_text="discount")
    if agents.empty:
        raise ValueError("agent.csv is empty")
    scenarios = {
        name: compile_scenario(Scenario.model_validate_json(json.dumps(declared)))
        for name, declared in folder.manifest["scenarios"].items()
    }
    curves_file = "curves.csv" if "curves.csv" in folder else "learning.csv"
    curves = folder.read(curves_file)
    maps = {name: folder.read(f"agent_{name}.csv", embed=False) for name in scenarios}
    best = folder.read("optimum.csv", embed=False, as_text="discount")
    settings = {arm: one["settings"] for arm, one in folder.manifest["algorithms"].items()}
    blocks = []
    for key, own in agents.groupby(["scenario", "algorithm", "observation"], sort=False):
        scenario, algorithm, observation = map(str, key)
        n_cells = scenarios[scenario].n_observations
        frame = maps[scenario]
        frame = frame[(frame["algorithm"] == algorithm) & (frame["observation"] == observation)]
        if len(frame) != len(own) * n_cells:
            raise ValueError(f"agent_{scenario}.csv has not as many rows as agent.csv says")
        if not ((best["scenario"] == scenario) & (best["discount"] == own["discount"].iloc[0])).any():
            raise ValueError(f"optimum.csv has no {scenario} with discount {own['discount'].iloc[0]}")
        curve = curves[curves["scenario"] == scenario]
        if "algorithm" in curve:
            curve = curve[(curve["algorithm"] == algorithm) & (curve["observation"] == observation)]
        mean = "score_mean" if "score_mean" in curve else "score"
        blocks.append(
            {
                "scenario": scenario,
                "algorithm": algorithm,
                "observation": observation,
                "kind": own["kind"].iloc[0],
                "discount": own["discount"].iloc[0],
                "seed": int(own["seed"].iloc[0]),
                "unit": settings[algorithm].get("budget_unit", "steps"),
                "steps": own["step"].tolist(),
                "score": _listed(own["score"]),
                "success": _listed(own["success"]),
                "agent_row": int(str(own.index[0])) + 2,
                "values": _packed(frame[list(ACTIONS)].to_numpy()),
                "greedy": _masks(frame["greedy"]),
                "map_row": int(str(frame.index[0])) + 2,
                "curve": {
                    "row": int(str(curve.index[0])) + 2,
                    "step": curve["step"].tolist(),
                    **{end: _listed(curve[f"{mean}{end}"]) for end in ("", "_low", "_high")},
                },
            }
        )
    optima = {
        f"{scenario} {discount}": {
            "row": int(str(own.index[0])) + 2,
            "values": _packed(own[list(ACTIONS)].to_numpy()),
            "optimal": _masks(own["optimal"]),
        }
        for (scenario, discount), own in best.groupby(["scenario", "discount"], sort=False)
    }
    return {
        "prefix": folder.prefix,
        "curves_file": curves_file,
        "horizon": folder.manifest["horizon"],
        "actions": list(ACTIONS),
        "events": list(EVENTS),
        "zones": list(ZONES),
        "decimals": explorer.DECIMALS,
        "no_number": _NO_NUMBER,
        "colours": [to_hex(mpl.colormaps["cividis"](i / 32)) for i in range(33)],
        "scenarios": {name: _scene(model) for name, model in scenarios.items()},
        "blocks": blocks,
        "optima": optima,
    }


def _listed(values: pd.Series) -> list[float | None]:
    """Returns numbers for JSON, which has none that is not finite."""
    return [None if math.isnan(value) else value for value in values.tolist()]


def _packed(values: NDArray[np.float64]) -> str:
    """Returns values in thousandths as 32-bit integers, little-endian, in base64."""
    scaled = np.rint(values * 10**explorer.DECIMALS)
    # Beyond two million there are only nets on their way to diverging, whose every digit is noise.
    packed = np.where(np.isnan(scaled), _NO_NUMBER, np.clip(scaled, _NO_NUMBER + 1, -_NO_NUMBER - 1))
    return base64.b64encode(packed.astype("<i4").tobytes()).decode("ascii")


def _masks(names: Iterable[str]) -> str:
    """Returns sets of actions, `UP|PING`, as one byte each, in base64."""
    bit = {action: 1 << i for i, action in enumerate(ACTIONS)}
    masks = bytes(sum(bit[action] for action in one.split("|")) for one in names)
    return base64.b64encode(masks).decode("ascii")


def _scene(model: Model) -> dict[str, Any]:
    """Returns a compiled scenario for the page: all that a walk looks up, (S * A) lists."""
    scenario = model.scenario
    return {
        "rows": scenario.grid.rows,
        "columns": scenario.grid.columns,
        "start": model.start,
        "issuer": list(scenario.issuer.position),
        "radii": [scenario.regions.uncomfortable_radius, scenario.regions.target_radius],
        "zone": model.zone_of_cell.tolist(),
        "next": model.next_state.ravel().tolist(),
        "terminated": model.terminated.ravel().astype(int).tolist(),
        "event": model.event.ravel().tolist(),
        "grid_reward": model.grid_reward.ravel().tolist(),
        "issuer_reward": np.round(model.issuer_reward, 6).ravel().tolist(),
        "issuer_noise": float(model.issuer_noise.max()),
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
