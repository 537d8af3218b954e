"""README of the repository, whose numbers and verdicts are those of published tables."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from benchmark.experiments import PUBLISHED
from benchmark.experiments.finding import Names, Tables
from benchmark.folder import Folder
from benchmark.publish import prose
from benchmark.publish.templates import templates_in

_TEMPLATE: Final = Path(__file__).with_suffix(".md.jinja")
_NETS: Final = ["ppo, coordinates", "dqn, coordinates", "ppo, offset_coordinates", "dqn, offset_coordinates"]
_TILINGS: Final = ["tile_coding, coordinates", "tile_coding, offset_coordinates"]
_TABLES: Final = ["watkins_q_lambda, index", "watkins_q_lambda, offset"]


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
        answer = prose.SENTENCES.split(text(next(iter(PUBLISHED))))
        names = _names(lookups)
        template = templates_in(_TEMPLATE.parent).get_template(_TEMPLATE.name)
        rendered = template.render(figure=figure, text=text, answer=answer, **names)
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
    contrasts = when.rows("contrasts", x=_NETS, y=_TILINGS)
    are_known = {*contrasts["verdict"]} <= {"slower", "undecided"}
    when.claim(are_known, "all contrasts of nets with tile coding are slower or undecided")
    runs = when.rows("cells", grid="places", places=64, learner=[*_NETS, *_TILINGS, *_TABLES])
    expected = np.where(runs["learner"].isin([_NETS[1], _TABLES[0]]), 30, 15)
    has_as_many = (runs["n"] == expected).all()
    when.claim(has_as_many, "with 64 places, two learners have 30 runs, and the others 15")
    with_people = groups.values("contrasts", "verdict", x=_NETS[2:], y=_TILINGS[1])
    groups.claim(with_people == {"slower"}, "nets are slower than tile coding with several people")
    ppo, dqn = (when.row("crossings", x=net, y=_TILINGS[0])["x_later"] for net in _NETS[:2])
    return {
        "n_equivalent": verdicts.eq("equivalent").sum(),
        "n_undecided": verdicts.eq("undecided").sum(),
        "n_points": len(contrasts) // 4,
        "n_contrasts": len(contrasts),
        "n_slower": contrasts["verdict"].eq("slower").sum(),
        "n_ppo_ahead": ppo,
        "n_dqn_ahead": dqn,
    }
