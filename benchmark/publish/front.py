"""README of the repository, whose numbers and verdicts are those of published tables."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from benchmark.experiments import PUBLISHED
from benchmark.experiments.finding import Names, Tables
from benchmark.folder import Folder
from benchmark.publish import prose
from benchmark.publish.templates import templates_in

_TEMPLATE: Final = Path(__file__).with_suffix(".md.jinja")
_NETS: Final = [
    "dqn, coordinates",
    "ppo, factored",
    "ppo, centred",
    "dqn, offset_tiles",
    "ppo, offset_factored",
]
_TILINGS: Final = ["tile_coding, coordinates", "tile_coding, offset_coordinates"]
_ALONE: Final = "**New places:** "  # how a sentence on learners without onlookers begins
_GRIDS: Final = ["places", "rooms", "feedback"]  # each point of the map once


def front(results: Path) -> str:
    """Returns README; raises an InputError if a folder is damaged or does not show what README says."""

    def text(name: str, title: str = "") -> str:
        return prose.paragraphs(Folder(results / name), title)

    def figure(name: str, item: str) -> str:
        return f"results/{name}/{Folder(results / name).figure(item)}"

    for name in PUBLISHED:
        prose.written(Folder(results / name))  # also of those that README does not cite
    lookups = {name: prose.Lookups(Folder(results / name)) for name in PUBLISHED}
    with Folder(results / next(iter(PUBLISHED))).reading():
        answer, others = (prose.SENTENCES.split(text(name)) for name in ("crowd", "when"))
        alone = [each.removeprefix(_ALONE) for each in others if each.startswith(_ALONE)]
        lookups["when"].claim(len(alone) == 1, "the answer has a sentence on new places")
        names = {
            **_names(lookups),
            "answer": answer,
            "alone": "".join(each[0].upper() + each[1:] for each in alone),
        }
        template = templates_in(_TEMPLATE.parent).get_template(_TEMPLATE.name)
        rendered = template.render(figure=figure, text=text, **names)
    if failed := [claim for each in lookups.values() for claim in each.failed]:
        raise prose.ClaimError(*(f"README: tables do not show that {claim}." for claim in failed))
    return rendered


def _names(tables: Mapping[str, Tables]) -> Names:
    """Checks what README claims, and returns the numbers that it names."""
    when, groups, equivalence = (tables[name] for name in ("when", "groups", "equivalence"))
    verdicts = equivalence.rows("contrasts")["success_verdict"]
    is_small = equivalence.values("contrasts", "success_margin") == {0.15}
    are_known = len(verdicts) == 8 and {*verdicts} <= {"equivalent", "undecided"}
    equivalence.claim(is_small and are_known, "nets are equivalent within 0.15 or undecided")
    contrasts = when.rows("contrasts", x=_NETS, y=_TILINGS, grid=_GRIDS)
    people = groups.rows("contrasts", y=_TILINGS[1])
    people = people[people["x"].str.match("dqn|ppo")]
    for each, rows in ((when, contrasts), (groups, people)):
        are_known = {*rows["verdict"]} <= {"slower", "undecided"}
        each.claim(are_known, "all contrasts of nets with tile coding are slower or undecided")
    return {
        "n_equivalent": verdicts.eq("equivalent").sum(),
        "n_undecided": verdicts.eq("undecided").sum(),
        "n_points": len(contrasts[["grid", "point"]].drop_duplicates()),
        "n_contrasts": len(contrasts),
        "n_slower": contrasts["verdict"].eq("slower").sum(),
        "n_groups": len(people),
        "n_slower_groups": people["verdict"].eq("slower").sum(),
    }
