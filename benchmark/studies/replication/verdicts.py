"""The items on the paper's claims: judged with few agents and many, in disjoint sets, under each reading."""

from functools import lru_cache, partial
from textwrap import fill
from typing import Final

import pandas as pd
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from benchmark.analysis.frames import RecordsOf
from benchmark.drawing.style import COLOURS, WIDTH, draw_cells, figure_of
from benchmark.drawing.tables import link
from benchmark.experiments import DEFAULT_CONDITION, Experiment
from benchmark.folder import Folder
from benchmark.studies.item import COLUMNS, entry, item, no_rows
from benchmark.studies.replication.agents import agents_of, is_of_paper
from benchmark.studies.replication.claims import CLAIMS, SCENARIOS, VERDICTS, agreement, judge, weakest

_item: Final = partial(item, meanings=COLUMNS["replication"])
_CURVES: Final = {"visited": "max_q", "table": "table_max_q"}  # array of each curve that claims can be about
_SIGNS: Final = dict(zip(VERDICTS, ("✓", "?", "✗"), strict=True))
_COLOURS: Final = dict(zip(VERDICTS, (COLOURS[9], "#f7ecc3", COLOURS[3]), strict=True))  # by brightness, too
_JUDGED: Final = [
    *("claim", "part", "agents", "value", "low", "high", "right_side", "threshold", "state", "verdict"),
    *("effect", "agents_needed", "note", "drawn"),
]
_SHOWN: Final = (
    *("claim", "agents", "verdict", "sets", "agreeing", "part", "right_side", "threshold", "value", "state"),
    *("drawn", "effect", "agents_needed"),
)


@lru_cache(maxsize=1)  # three tables are of them
def _all_parts(experiment: Experiment, records: RecordsOf) -> pd.DataFrame:
    """Judges the claims by all sets of agents by default, and by the first one under other readings."""
    frames = []
    for name, reading in experiment.declared.readings.items():
        sets = agents_of(experiment, records, name)
        for agents in sets if name == DEFAULT_CONDITION else sets[:1]:
            seeds = agents[SCENARIOS[0]].seeds
            frame = judge(agents, _CURVES[reading.curve])
            frames.append(frame.assign(reading=name, first_seed=seeds[0], last_seed=seeds[-1]))
    return pd.concat(frames, ignore_index=True)


def _default_parts(experiment: Experiment, records: RecordsOf, least: str) -> pd.DataFrame:
    # Those for which a column has its smallest value.
    parts = _all_parts(experiment, records)
    parts = parts.loc[parts["reading"] == DEFAULT_CONDITION]
    return parts.loc[parts[least].eq(parts[least].min())]


@_item("claims", "every part of every claim, with its 95 % interval, its state and the verdict, by agents")
def claims(experiment: Experiment, records: RecordsOf) -> pd.DataFrame:
    """Tabulates the parts of every claim, with as many agents as the paper has and with all."""
    few_and_all, sets = (_default_parts(experiment, records, key) for key in ("first_seed", "agents"))
    by_claim = [rows for _, rows in few_and_all.groupby("claim", sort=False)]
    return agreement(pd.concat(by_claim, ignore_index=True)[_JUDGED], sets)


@claims.shown
def _(frame: pd.DataFrame) -> pd.DataFrame:
    frame = frame.rename(columns={"low": "value_low", "high": "value_high", "sets_agreeing": "agreeing"})
    keys = [key for key in _SHOWN if key in frame]  # one that no part has is left out of files
    rows = [{key: entry(row, key, "claims") for key in keys} for _, row in frame.iterrows()]
    return pd.DataFrame(rows).rename(columns=lambda key: key.replace("_", " "))


def headline(folder: Folder) -> str | None:
    """Counts the verdicts on the claims, with all agents."""
    if "claims.csv" not in folder:
        return None
    frame = folder.frame("claims")
    n_agents = frame["agents"].max()
    rows = weakest(frame[frame["agents"] == n_agents])
    parts = [(name, rows[rows["verdict"] == name]) for name in VERDICTS]
    counts = [f"{link(str(len(judged)), 'claims', judged)} × {name}" for name, judged in parts if len(judged)]
    like = f"{len(rows)} claims like the paper's, in scenes or with settings that are not the paper's"
    scope = f"the paper's {len(rows)} claims" if is_of_paper(folder.manifest) else like
    return f"Verdicts on {scope}, with {n_agents:,} agents per scenario: {', '.join(counts)}."


@_item("claim_sets", "every part of every claim in each of the disjoint sets of agents, and the verdicts")
def claim_sets(experiment: Experiment, records: RecordsOf) -> pd.DataFrame:
    """Tabulates the parts of every claim in each set."""
    columns = ["first_seed", "last_seed", "claim", "part", "value", "low", "high", "state", "verdict"]
    return _default_parts(experiment, records, "agents")[columns]


@_item(
    "sensitivity",
    "every part of every claim, its state and the verdict, under every reading of the paper",
    where=no_rows,
)
def sensitivity(experiment: Experiment, records: RecordsOf) -> pd.DataFrame:
    """Tabulates the parts of every claim under each reading, with as many agents as the paper has."""
    first = _all_parts(experiment, records).drop_duplicates(["reading", "claim", "part"])
    return first[["claim", "reading", *_JUDGED[1:10]]]


@sensitivity.figure("Whether the claims hold, by how the paper is read.")
def _(table: pd.DataFrame, experiment: Experiment) -> Figure:
    readings = {name: experiment.declared.readings[name].title or name for name in table["reading"].unique()}
    verdicts = weakest(table, "reading").set_index(["claim", "reading"])["verdict"]
    rows = [claim for claim in CLAIMS if claim.id in {*table["claim"]}]
    looks = {verdict: (_SIGNS[verdict], to_hex(_COLOURS[verdict])) for verdict in VERDICTS}
    cells = [[looks[verdicts[claim.id, name]] for name in readings] for claim in rows]
    with figure_of(1, 1, (WIDTH, 0.3 * len(rows) + 1.1)) as (figure, axes):
        titles = [fill(title, 9) for title in readings.values()]
        draw_cells(axes[0, 0], cells, [claim.title for claim in rows], titles)
        text = ", ".join(f"{sign} {verdict}" for verdict, sign in _SIGNS.items())
        figure.supxlabel(f"{text}, with {table['agents'].iloc[0]} agents per scenario", fontsize="small")
    return figure
