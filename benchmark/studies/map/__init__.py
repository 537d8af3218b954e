"""The report of a map: at which points one learner needs fewer steps than another."""

from pathlib import Path
from typing import Final

from benchmark.analysis import looks
from benchmark.analysis.looks import EQUAL, FASTER, SLOWER, VERDICTS
from benchmark.drawing.tables import inert, link
from benchmark.folder import Folder
from benchmark.studies.interim import Interim
from benchmark.studies.map import figures, results
from benchmark.studies.map.check import check
from benchmark.studies.map.crossings import crossings
from benchmark.studies.study import Study

_WORDS: Final = {"steps": {}, "wrong PINGs": {FASTER: "fewer", SLOWER: "more", EQUAL: "equally many"}}


def headline(folder: Folder) -> str:
    """Says how the contrasts of the first grid ended, in steps and in wrong PINGs."""
    table = folder.frame("verdicts")
    grid, level, sentences = table["grid"].iloc[0], folder.manifest["solved"]["success"], []
    for unit, of_unit in table[table["grid"] == grid].groupby("unit", sort=False):
        parts = []
        for _, row in of_unit.iterrows():
            counts = [
                f"{_WORDS[unit].get(verdict, verdict)} at {link(str(row[verdict]), 'verdicts', row)}"
                for verdict in VERDICTS
                if row[verdict]
            ]
            sides = " compared with ".join(inert(folder.phrase(row[side])) for side in "xy")
            parts.append(f"{sides}: {', '.join(counts)}")
        sentences.append(f"In {unit}, {'; '.join(parts)}.")
    until = f"until exact success stays at or above {level} for as long again, in the grid `{grid}`"
    return " ".join([f"What runs take {until}.", *sentences])


STUDY: Final = Study(
    name="map",
    question="When does a net earn its keep over a table?",
    declared=Interim,
    check=lambda experiment, _: check(experiment),
    analyse=lambda data: data,
    stages=lambda experiment, _, store: looks.stages(experiment, store),
    items=(
        figures.answer,
        figures.picture,
        results.cells,
        results.contrasts,
        results.verdicts,
        results.looks,
        results.levels,
        crossings,
        results.success,
        results.reference,
        results.pairs,
        results.runs,
        results.unseen,
        results.cpu,
    ),
    document=Path(__file__).parent / "document.md.jinja",
    headline=headline,
    lead="answer",
    reads_curves=True,
    can_be_partial=True,
)
