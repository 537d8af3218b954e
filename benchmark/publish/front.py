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
_BEST_NETS: Final = "ppo, offset_factored", "dqn, offset_tiles"  # of a search, with and without defaults
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
        answer = prose.SENTENCES.split(text(next(iter(PUBLISHED))))
        names = _names(lookups)
        template = templates_in(_TEMPLATE.parent).get_template(_TEMPLATE.name)
        rendered = template.render(figure=figure, text=text, answer=answer, **names)
    if failed := [claim for each in lookups.values() for claim in each.failed]:
        raise prose.ClaimError(*(f"README: tables do not show that {claim}." for claim in failed))
    return rendered


def _names(tables: Mapping[str, Tables]) -> Names:
    """Checks what README claims, and returns the numbers that it names."""
    when, groups, equivalence, search = (
        tables[name] for name in ("when", "groups", "equivalence", "tuning_map")
    )
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
    cells = when.rows("cells", grid="forms", point="places 64")
    when.claim(cells["n"].eq(16).all(), "with 64 places, all learners have 16 runs")
    effort = search.rows("effort", scenario="all").set_index("learner")
    nets = effort[effort.index.str.match("(?:dqn|ppo), offset")]
    search.claim(nets["total"].idxmin() == _BEST_NETS[0], "with defaults first, the best net is PPO")
    search.claim(nets["drawn"].idxmin() == _BEST_NETS[1], "without defaults, the best net is DQN")

    def steps(column: str, learner: str) -> str:
        return f"{effort[column].to_dict()[learner]:,.0f}"

    return {
        "n_equivalent": verdicts.eq("equivalent").sum(),
        "n_undecided": verdicts.eq("undecided").sum(),
        "n_points": len(contrasts[["grid", "point"]].drop_duplicates()),
        "n_contrasts": len(contrasts),
        "n_slower": contrasts["verdict"].eq("slower").sum(),
        "n_groups": len(people),
        "n_slower_groups": people["verdict"].eq("slower").sum(),
        "tiles_first": steps("total", _TILINGS[1]),
        "net_first": steps("total", _BEST_NETS[0]),
        "tiles_drawn": steps("drawn", _TILINGS[1]),
        "net_drawn": steps("drawn", _BEST_NETS[1]),
    }
