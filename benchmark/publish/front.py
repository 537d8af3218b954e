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
_GRIDS: Final = ["places", "rooms", "feedback"]  # each point of the map once
_PAPER: Final = "q_learning, index"
_SB3: Final = ["sb3_dqn, one_hot", "sb3_ppo, one_hot"]
_SHOWN: Final = {  # learners of the table, by what README calls them
    _PAPER: "the paper's table",
    "watkins_q_lambda, index": "Q(λ) table, tuned",
    "tile_coding, coordinates": "tile coding, tuned",
    _SB3[0]: "SB3's DQN, tuned",
    _SB3[1]: "SB3's PPO, tuned",
}


def front(results: Path) -> str:
    """Returns README; raises an InputError if a folder is damaged or does not show what README says."""

    def text(name: str, title: str = "") -> str:
        return prose.paragraphs(Folder(results / name), title)

    def figure(name: str, item: str) -> str:
        return f"results/{name}/{Folder(results / name).figure(item)}"

    for name in PUBLISHED:
        prose.written(Folder(results / name))  # also of those that README does not cite
    lookups = {name: Tables(Folder(results / name)) for name in PUBLISHED}
    with Folder(results / next(iter(PUBLISHED))).reading():
        names = {**_compared(lookups["compare_deep"], lookups["tuning"]), **_beyond(lookups)}
        template = templates_in(_TEMPLATE.parent).get_template(_TEMPLATE.name)
        rendered = template.render(figure=figure, text=text, **names)
    if failed := [claim for each in lookups.values() for claim in each.failed]:
        raise prose.ClaimError(*(f"README: tables do not show that {claim}." for claim in failed))
    return rendered


def _compared(tables: Tables, tuning: Tables) -> Names:
    """Checks what README claims of the paper's scenarios, and returns what it names."""
    claim, values = tables.claim, tables.values
    for name in _SHOWN:
        n_runs = 30 if name in _SB3 else 100
        claim(values("summary", "n", learner=name) == {n_runs}, f"{name} has {n_runs} runs")
    claim(values("summary", "budget") == {10_000}, "runs have 10,000 steps")
    nets = [*_SB3, "dqn, one_hot", "ppo, one_hot"]
    verdicts = values("contrasts", "success_verdict", x=nets, y=[*_SHOWN][1:3])
    claim(verdicts and "better" not in verdicts, "no net is better than a tuned table or tile coding")
    in_s2 = values("contrasts", "success_verdict", x=[*_SB3], y=_PAPER, scenario="S2")
    claim(in_s2 == {"better"}, "Stable-Baselines3's nets are better than the paper's table in S2")
    tuned = values("contrasts", "success_verdict", x="q_learning_tuned, index", y=_PAPER)
    claim(tuned == {"better"}, "the table is better with tuned constants")
    defaults = values("summary", "success", variant=["dqn_default", "sb3_dqn_default"])
    claim(defaults == {0.0}, "DQN never succeeds with its defaults")
    tried = tuning.rows("cost")["trials"]
    claim(tried.nunique() == 1, "all were searched equally long")
    success = tables.rows("summary").pivot(index="learner", columns="scenario", values="success")
    return {
        "successes": {title: [f"{n:.2f}" for n in success.loc[name]] for name, title in _SHOWN.items()},
        "n_tried": tried.iloc[0] + 1,
    }


def _beyond(tables: Mapping[str, Tables]) -> Names:
    """Checks what README claims of other scenes and of compiled nets, and returns what it names."""
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
        each.claim((rows["faster"] <= 0.5).all(), "no net wins more than half of the pairs")
    # `when.py` checks the verdicts on these.
    unseen = when.rows("cells", grid="forms", point="places 64").set_index("learner")["unseen_budget"]
    return {
        "unseen": lambda learner: f"{unseen[learner]:.2f}",
        "n_equivalent": verdicts.eq("equivalent").sum(),
        "n_undecided": verdicts.eq("undecided").sum(),
        "n_points": len(contrasts[["grid", "point"]].drop_duplicates()),
        "n_contrasts": len(contrasts),
        "n_slower": contrasts["verdict"].eq("slower").sum(),
        "n_groups": len(people),
        "n_slower_groups": people["verdict"].eq("slower").sum(),
    }
