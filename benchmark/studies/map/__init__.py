"""Maps: at which points one learner needs fewer steps than another."""

from pathlib import Path
from typing import Final

from benchmark.folder import Folder
from benchmark.studies.map import figures, tables
from benchmark.studies.map.analysis import MapAnalysis, analyse
from benchmark.studies.map.contrasts import FASTER, SLOWER, VERDICTS
from benchmark.studies.map.declared import MapDeclared, check
from benchmark.studies.study import Study

_WORDS: Final = {FASTER: "fewer", SLOWER: "more"}  # in wrong PINGs


def headline(folder: Folder) -> str:
    """Says how the contrasts of the first grid ended, in steps and in wrong PINGs."""
    table = folder.frame("verdicts")
    grid, level, sentences = table["grid"].iloc[0], folder.manifest["solved"]["success"], []
    for unit, rows in table[table["grid"] == grid].groupby("unit", sort=False):
        parts = []
        for _, row in rows.iterrows():
            words = {
                verdict: _WORDS.get(verdict, verdict) if unit != "steps" else verdict for verdict in VERDICTS
            }
            counts = [f"{words[v]} at {row[v]}" for v in VERDICTS if row[v]]
            sides = " compared with ".join(folder.phrase(row[side]) for side in "xy")
            parts.append(f"{sides}: {', '.join(counts)}")
        sentences.append(f"In {unit}, {'; '.join(parts)}.")
    until = f"until they have learned (success at or above {level}), in the grid `{grid}`"
    return " ".join([f"Contrasts compare what runs need {until}.", *sentences])


STUDY: Final = Study[MapDeclared, MapAnalysis](
    name="map",
    question="When does a net earn its keep over a table?",
    declared=MapDeclared,
    check=check,
    analyse=analyse,
    items=(
        figures.answer,
        figures.picture,
        tables.cells,
        tables.contrasts,
        tables.verdicts,
        tables.runs,
        tables.unseen,
        tables.cpu,
    ),
    document=Path(__file__).parent / "document.md.jinja",
    headline=headline,
    lead="answer",
    reads_curves=True,
)
