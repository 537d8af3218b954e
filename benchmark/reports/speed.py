"""Speed: each row compares this project with a common alternative, or a large size with a small one.

Machines are noisy: the two sides of a row take turns, as do the rows, and the best turn of each side counts.
Training whole nets takes too long for that: rates by CPU time are the units of all turns per second.
"""

import json
import time
from collections import defaultdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, NoReturn

import numpy as np
import pandas as pd
from rich.console import Console
from rich.progress import track

from benchmark.drawing.tables import write_csv
from benchmark.execution import provenance
from benchmark.experiments import Experiment, Reporting
from benchmark.reports import document, files
from benchmark.reports.folder import MANIFEST, Folder
from benchmark.reports.item import Item, Report, entry
from benchmark.reports.speed_rows import Row, Work, all_rows
from envs import InputError


def measure(results: Path, *, smoke: bool) -> None:
    """Measures and prints the rates of all rows, and writes a folder of results.

    Other commands that write to the folder wait meanwhile, as they would disturb the measurement.

    Args:
      results: The folder of all results.
      smoke: Whether to measure very little, to try the code; it has a folder of its own.

    Raises:
      InputError: The folder cannot be written; then nothing is measured.
    """
    directory = results / (f"{REPORT.name}_smoke" if smoke else REPORT.name)
    with files.alone(results), files.replaced(directory, is_stale=lambda _: False) as aside:
        with TemporaryDirectory() as scratch:
            frame = _measured(all_rows(smoke, Path(scratch)), n_turns=2 if smoke else 16)
        for _, row in frame.iterrows():
            rate = "{name:24} {per_second:14,.0f} {unit}/s, {ratio:8.3g} times {against}"
            print(rate.format_map(row))
        manifest = {
            "experiment": REPORT.name,
            "description": "The speed of this project against common alternatives.",
            "command": "make speed",
            "argument": "",  # none: the command `report` does not draw it
            "report": Reporting(kind=f"{__name__}:REPORT").model_dump(mode="json"),
            "partial": "",
            "note": "Measured with `--smoke`: the numbers mean nothing." if smoke else "",
            "scenarios": {},
            "algorithms": {},
            "commits": [provenance.commit(Path(__file__))],
            "machines": [provenance.machine()],
            "processors": [provenance.processor()],
            "versions": [provenance.versions("q_learning")],
        }
        (aside / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
        write_csv(frame, aside / "speed.csv")
        document.write(aside)
    print(f"written to {directory}")


def _measured(rows: list[Row], n_turns: int) -> pd.DataFrame:
    """Lets the sides of all rows take turns, fewer of them by CPU time, and tabulates their rates.

    The first turn of a side, which compiles, imports and fills caches, does not count.
    """
    turns = defaultdict[Work, list[tuple[float, float]]](list)  # units and seconds
    order = [
        (row, side)
        for turn in range(n_turns)
        for row in rows
        for side in row.sides
        if turn < 5 or not row.is_by_cpu_time
    ]
    for row, side in track(order, "measuring", console=Console(stderr=True)):
        clock = time.process_time if row.is_by_cpu_time else time.perf_counter
        started_s = clock()
        turns[side].append((side(), clock() - started_s))

    def rate(row: Row, side: Work) -> float:
        units, seconds = np.array(turns[side][1:]).T
        return float(units.sum() / seconds.sum() if row.is_by_cpu_time else (units / seconds).max())

    rates = {row.name: [rate(row, side) for side in row.sides] for row in rows}
    limit = max(rates["matrix_products"])
    return pd.DataFrame(
        {
            "name": row.name,
            "per_second": ours,
            "baseline": other,
            "ratio": ours / other,
            "of_limit": ours * row.products / limit or None,
            "unit": row.unit,
            "against": row.against,
        }
        for row, (ours, other) in zip(rows, rates.values(), strict=True)
    )


def _headline(folder: Folder) -> str:
    frame = folder.frame("speed")
    nets = frame[frame["name"].str.startswith("net_")].sort_values("ratio")
    rows = frame[frame["name"] == "q_learning_kernel"].iloc[0], nets.iloc[0], nets.iloc[-1]
    q_learning, low, high = (entry(row, "ratio", "speed") for row in rows)
    return (
        f"Tabular Q-learning is {q_learning} times as fast as a tuned Python loop over Gymnasium. Nets train "
        f"{low} to {high} times as fast as with Stable-Baselines3, per second of CPU time."
    )


def _refuse(experiment: Experiment) -> NoReturn:
    raise InputError(f"{experiment.argument}: report: accepted: a report that can be drawn of an experiment.")


_SPEED: Final = Item(
    "speed",
    "rates of this project and of common alternatives, from the same run",
    is_measured=True,
    meanings={
        "against": "the alternative",
        "baseline": "units per second of the alternative",
        "name": "what is measured",
        "of_limit": "share of the speed that products of matrices alone would allow; empty where it does not "
        "apply",
        "per_second": "units per second of this project",
        "ratio": "`per_second` / `baseline`",
        "unit": "what is counted",
    },
)
REPORT: Final = Report(
    name="speed",
    question="How fast is this project?",
    check=_refuse,
    items=(_SPEED,),
    document=Path(__file__).with_name("speed.md.jinja"),
    headline=_headline,
)
