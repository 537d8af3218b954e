"""Maps: at which points one learner needs fewer steps than another."""

from pathlib import Path
from typing import Final

from benchmark.folder import Folder
from benchmark.studies.map import figures, tables
from benchmark.studies.map.analysis import analyse
from benchmark.studies.map.declared import MapDeclared, check
from benchmark.studies.study import Study


def headline(folder: Folder) -> str:
    """Says how the contrasts of the first grid ended."""
    table, level = folder.frame("contrasts"), folder.manifest["solved"]["success"]
    grid, parts = table["grid"].iloc[0], []
    for sides, rows in table[table["grid"] == grid].groupby(["x", "y"], sort=False):
        counts = [f"{verdict} at {n}" for verdict, n in rows["verdict"].value_counts().items()]
        parts.append(f"{' compared with '.join(map(folder.phrase, sides))}: {', '.join(counts)}")
    until = f"until they have learned (success at or above {level}), in the grid `{grid}`"
    return f"By the steps that runs need {until}, {'; '.join(parts)}."


STUDY: Final = Study(
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
        tables.runs,
        tables.unseen,
        tables.cpu,
    ),
    document=Path(__file__).parent / "document.md.jinja",
    headline=headline,
    lead="answer",
    reads_curves=True,
)
