"""What the report on scenarios found, in sentences from its published tables; see `comparison.findings`.

Words that judge (better, worse, equivalent) are verdicts on the protocol's contrasts in one scenario; all
other sentences describe.
"""

import math
from collections.abc import Sequence
from typing import Final

import pandas as pd

from benchmark.analysis.contrasts import BETTER
from benchmark.drawing.tables import link
from benchmark.reports.comparison.protocol import Learner, Outcome, Protocol, outcome
from benchmark.reports.published import Published
from benchmark.reports.scenarios.tables import ENOUGH

_NEARLY: Final = 0.005  # short of the optimum, that is not worth a mention
_OUTCOMES: Final[dict[Outcome, str]] = {
    "earns": "deep RL earns its keep in",
    "does not earn": "it does not in",
    "undecided": "it is undecided in",
    "no verdict": "there is no verdict in",
}


def table(published: Published) -> pd.DataFrame:
    """Returns the headline and the sentences after it, one per row."""
    texts = [text for text in _sentences(published) if text]
    return pd.DataFrame({"finding": range(len(texts)), "text": pd.Series(texts, dtype=object)})


def headline(published: Published) -> str:
    """Returns the headline as published; empty if there is none."""
    return "".join(str(text) for text in published.frame("findings")["text"].iloc[:1])


def sentences(published: Published) -> list[str]:
    """Returns the sentences after the headline as published."""
    return [str(text) for text in published.frame("findings")["text"].iloc[1:]]


def _sentences(published: Published) -> list[str]:
    """Returns the headline and the sentences after it."""
    found = published.manifest["facts"].get("protocol")
    written = []
    if found is not None and "contrasts.csv" in published:
        protocol = Protocol.from_json(found)
        if protocol.reference is not None:
            written += [_headline(published, protocol), *_where_better(published, protocol)]
    if not written:
        written = [
            "There are no verdicts: no protocol compares a deep learner with a table, or learners are "
            "missing. All results are exploratory."
        ]
    return [*written, *_learned(published), *_effects(published), *_hidden(published)]


def _headline(published: Published, protocol: Protocol) -> str:
    """Answers in how many scenarios deep RL earns its keep, and in which."""
    contrasts = published.frame("contrasts")
    by_outcome: dict[Outcome, list[str]] = {}
    for scenario, rows in contrasts.groupby("scenario", sort=False):
        by_outcome.setdefault(outcome(protocol, rows), []).append(str(scenario))
    parts = []
    for key, text in _OUTCOMES.items():
        if names := by_outcome.get(key):
            rows = contrasts[contrasts["scenario"].isin(names)]
            parts.append(f"{text} {link(str(len(names)), 'contrasts', rows)} ({_and(names)})")
        elif key == "earns":
            parts.append("deep RL is not shown to earn its keep in any")
    budgets = published.frame("summary").groupby(["algorithm", "observation"])["budget"].first()
    steps = {int(budgets.loc[each]) for each in protocol.compared if each in budgets.index}
    budget = f"after {steps.pop():,} steps of training" if len(steps) == 1 else "after training"
    n, n_nets = contrasts["scenario"].nunique(), len(protocol.decisive)
    nets = "the deep learner" if n_nets == 1 else f"at least one of the {n_nets} deep learners"
    scenarios = "1 scenario" if n == 1 else f"{n} scenarios"
    rule = ""
    if "no verdict" in by_outcome:
        rule = (
            f" There is no verdict where runs are missing or fewer than {protocol.fewest_runs}, or where "
            f"`{protocol.reference}` has a success below {protocol.success_margin:g} and no deep learner is "
            "better."
        )
    return (
        f"Of {scenarios}, by success alone and {budget}, {'; '.join(parts)}. Deep RL earns its keep in a "
        f"scenario if {nets} of the protocol is better there than `{protocol.reference}`; for differences "
        f"in success, the familywise error rate over all scenarios is at most about 5 %.{rule}"
    )


def _where_better(published: Published, protocol: Protocol) -> list[str]:
    """Says by how much, and from which step on, each deep learner is better than the reference."""
    contrasts, ahead = published.frame("contrasts"), published.frame("ahead")
    written = []
    for _, row in contrasts[contrasts["success_verdict"] == BETTER].iterrows():
        if row["y"] != str(protocol.reference) or Learner.of(row["x"]) not in protocol.decisive:
            continue
        text = (
            f"In {row['scenario']}, `{row['x']}` is better than `{row['y']}` in success: "
            f"{link(_two(row['success_x']), 'contrasts', row)} against "
            f"{link(_two(row['success_y']), 'contrasts', row)}, a difference of "
            f"{link(_signed(row['success_difference']), 'contrasts', row)} "
            f"[{_signed(row['success_difference_low'])}, {_signed(row['success_difference_high'])}] with "
            f"{row['n']} runs each"
        )
        when = ahead[
            (ahead["scenario"] == row["scenario"]) & (ahead["x"] == row["x"]) & (ahead["y"] == row["y"])
        ]
        for _, each in when.iterrows():
            if math.isfinite(each["first_step"]):
                text += (
                    f"; the interval of the difference first lies above 0 at step "
                    f"{link(f'{each.first_step:,.0f}', 'ahead', each)}"
                )
        written.append(f"{text}.")
    return written


def _learned(published: Published) -> list[str]:
    """Says after how many steps a scenario is learned, where some net needs fewer than every table."""
    steps, arms = published.frame("steps"), published.manifest["algorithms"]
    family = steps["algorithm"].map(lambda name: arms[name].get("family", ""))
    written = []
    for scenario in steps["scenario"].unique():
        here = steps[steps["scenario"] == scenario]
        nets, tables = (
            here[family[here.index] == each].sort_values("step", kind="stable")
            for each in ("deep", "tabular")
        )
        if nets.empty or tables.empty:
            continue
        net, best = nets.iloc[0], tables.iloc[0]
        if not math.isfinite(net["step"]) or net["step"] >= best["step"]:
            continue
        text = (
            f"In {scenario} (exploratory), the mean success of `{_name(net)}` stays at or above "
            f"{ENOUGH:g} from step {link(f'{net.step:,.0f}', 'steps', net)} on"
        )
        if math.isfinite(best["step"]):
            text += (
                f", that of the fastest table, `{_name(best)}`, from step "
                f"{link(f'{best.step:,.0f}', 'steps', best)} on"
            )
            if net["step"] > 0:
                ratio = _times(best["below_at"] / net["step"])
                if net["below_at"] > 0:
                    ratio += f" to {_times(best['step'] / net['below_at'])}"
                else:
                    ratio = f"at least {ratio}"
                text += (
                    f". Between evaluations the steps are not known, so the table needs {ratio} times as many"
                )
        else:
            longest = tables.loc[tables["budget"].idxmax()]
            text += (
                f"; no table reaches this, not even `{_name(longest)}` with "
                f"{link(f'{longest.budget:,.0f}', 'steps', longest)} steps"
            )
        written.append(f"{text}.")
    return written


def _effects(published: Published) -> list[str]:
    """Says what each difference between two scenarios does to the learners that the protocol compares."""
    if "effects.csv" not in published:
        return []
    frame, found = published.frame("effects"), published.manifest["facts"].get("protocol")
    if found is not None:
        compared = Protocol.from_json(found).compared
        frame = frame[[Learner.of(_name(row)) in compared for _, row in frame.iterrows()]]
    written = []
    for name, rows in frame.groupby("effect", sort=False):
        parts = [
            f"`{_name(row)}` {link(_signed(row['success']), 'effects', row)} "
            f"[{_signed(row['success_low'])}, {_signed(row['success_high'])}] and "
            f"{link(_signed(row['disagreements'], 0), 'effects', row)} "
            f"[{_signed(row['disagreements_low'], 0)}, {_signed(row['disagreements_high'], 0)}]"
            for _, row in rows.iterrows()
        ]
        first = rows.iloc[0]
        title = str(name)[0].upper() + str(name)[1:]
        written.append(
            f"{title}: {first['scenario']} minus {first['against']}, in success and in disagreements per "
            f"1,000 steps of training (exploratory): {'; '.join(parts)}."
        )
    return written


def _hidden(published: Published) -> list[str]:
    """Says what is possible where something is hidden."""
    frame = published.frame("scenarios")
    if "memoryless_score" not in frame:
        return []
    n = int(frame["restarts"].max())
    short = frame[frame["memoryless_score"] < 1 - _NEARLY]
    rest = len(frame) - len(short)
    searches = f"in {n} search{'' if n == 1 else 'es'} per scenario"
    if short.empty:
        return [
            f"The best memoryless policy found {searches} scores {1 - _NEARLY:g} or more in "
            f"{'the only scenario' if rest == 1 else f'all {rest} scenarios'}."
        ]
    parts = [
        f"{row['scenario']} {link(_two(row['memoryless_score']), 'scenarios', row)} with a success of "
        f"{link(_two(row['memoryless_success']), 'scenarios', row)} (hidden: {row['hidden']})"
        for _, row in short.iterrows()
    ]
    others = f" In the other {'scenario' if rest == 1 else f'{rest} scenarios'}"
    others = f"{others} it scores {1 - _NEARLY:g} or more." if rest else ""
    return [
        f"Scores of the best memoryless policy found {searches} (1: the optimum of an agent that knows the "
        f"state): {'; '.join(parts)}.{others} Each search is local and of limited length, so better "
        "policies may exist."
    ]


def _name(row: pd.Series) -> str:
    """Returns the learner of a row as readers see it."""
    return str(Learner(row["algorithm"], row["observation"]))


def _times(ratio: float) -> str:
    """Returns a ratio with at least two digits."""
    return f"{ratio:.2g}" if ratio < 10 else f"{ratio:,.0f}"


def _two(value: float) -> str:
    """Returns a number with two decimals."""
    return f"{value:.2f}"


def _signed(value: float, decimals: int = 2) -> str:
    """Returns a difference with its sign; zero has none."""
    text = f"{value:+.{decimals}f}"
    return text[1:] if not text.strip("+-0.") else text


def _and(names: Sequence[str], separator: str = ", ") -> str:
    """Returns names in a list with "and" before the last."""
    *others, last = names
    return f"{separator.join(others)} and {last}" if others else last
