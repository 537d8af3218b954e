"""What a replication found, in sentences and as tables of claims; from published files alone."""

from typing import Final

import pandas as pd

from benchmark.drawing import tables
from benchmark.drawing.tables import link
from benchmark.experiments import DEFAULT_CONDITION
from benchmark.reports.published import Published
from benchmark.reports.replication.claims import STATES, VERDICTS, weakest
from benchmark.reports.view import Entry, Table, number_cell, number_text

SIGNS: Final = dict(zip(VERDICTS, ("✓", "?", "✗"), strict=True))
_STATE_SIGNS: Final = dict(zip(STATES, SIGNS.values(), strict=True))
_VERBS: Final = dict(
    zip(
        VERDICTS,
        (("holds", "hold"), ("is undecided", "are undecided"), ("does not hold", "do not hold")),
        strict=True,
    )
)


def headline(published: Published) -> str:
    """Counts the verdicts on the claims, with all agents and with as many as the paper has."""
    if "claims.csv" not in published:
        return ""
    claims = published.frame("claims")
    few, many = claims["agents"].min(), claims["agents"].max()
    n_claims = claims["claim"].nunique()
    text = f"With {many:,} agents per scenario, of the paper's {n_claims} claims {_counts(_of(claims, many))}"
    if few < many:
        text += f"; with {few:,} agents, as many as the paper has, {_counts(_of(claims, few))}"
    return f"{text}."


def sentences(published: Published) -> list[str]:
    """Says which verdicts depend on the agents or on the reading, and how often agents succeed in S2."""
    rows = published.frame("optimal")
    n_agents = rows["agents"].iloc[0]
    texts = [
        f"Tables and figures show {link(f'{n_agents:,}', 'optimal', rows)} agents per scenario, unless they "
        "name another number."
    ]
    if "claims.csv" in published:
        texts += [*_by_agents(published), *_failing_parts(published), *_by_reading(published)]
    return [*texts, *_success(published)]


def claims_table(published: Published) -> Table:
    """Returns every part of the claims, with all agents and with as many as the paper has."""
    claims = published.frame("claims")
    few, many = claims["agents"].min(), claims["agents"].max()
    sizes = [many] if few == many else [many, few]
    rows = []
    for claim in claims["claim"].unique():
        here = {size: _of(claims[claims["claim"] == claim], size) for size in sizes}
        for place in range(len(here[many])):
            part = here[many].iloc[place]
            row = [_claim_entry(part) if place == 0 else Entry("", order=claim)]
            for size in sizes:
                first = here[size].iloc[0]
                row.append(
                    _verdict_entry(first["verdict"]) if place == 0 else Entry("", order=first["verdict"])
                )
            if few < many:
                row.append(_share_entry(part) if place == 0 else Entry("", order=str(part["share"])))
            row += [Entry(part["part"]), Entry(_must_be(part))]
            row += [_value_entry(here[size].iloc[place]) for size in sizes]
            row += [
                number_cell("claims.csv", part, "effect"),
                number_cell("claims.csv", part, "agents_needed"),
            ]
            rows.append(row)
    n_sets = claims["sets"].iloc[0]
    columns = [("claim", False)]
    columns += [(f"verdict, {size:,}", False) for size in sizes]
    columns += [(f"of {n_sets} sets", True)] if few < many else []
    columns += [("part", False), ("must be", False)]
    columns += [(f"value, {size:,}", True) for size in sizes]
    columns += [("effect", True), ("agents needed", True)]
    caption = f"The paper's claims, measured with {' and with '.join(f'{size:,}' for size in sizes)} agents"
    return Table(caption, "claims.csv", columns, rows)


def sensitivity_table(published: Published) -> Table:
    """Returns the claims with the readings under which the verdict is another one."""
    sensitivity = published.frame("sensitivity")
    rows = []
    for claim, parts in weakest(sensitivity, "reading").groupby("claim", sort=False):
        default = parts[parts["reading"] == DEFAULT_CONDITION].iloc[0]
        others = parts[parts["verdict"] != default["verdict"]]
        depends = "; ".join(
            f"`{other['reading']}`: {link(other['verdict'], 'sensitivity', other)}"
            for _, other in others.iterrows()
        )
        rows.append(
            [
                Entry(f"`{claim}`", order=str(claim)),
                _verdict_entry(default["verdict"]),
                Entry(depends or "no reading changes it"),
            ]
        )
    columns = [("claim", False), ("verdict by default", False), ("other verdicts under", False)]
    n_agents = sensitivity["agents"].iloc[0]
    return Table(
        f"Readings that change a verdict, with {n_agents:,} agents each", "sensitivity.csv", columns, rows
    )


def readings(published: Published) -> list[tuple[str, str]]:
    """Returns every reading of the paper with its question and answer."""
    equal = published.manifest.get("facts", {}).get("learned_as_default", ())
    terms = []
    for name, reading in published.manifest["readings"].items():
        answer = reading["answer"]
        text = f"{reading['question']} {answer[:1].upper()}{answer[1:]}."
        if name != DEFAULT_CONDITION and name in equal:
            text += " (Every agent learns the same values as by default.)"
        terms.append((name, text))
    return terms


# Entries of the tables


def _claim_entry(row: pd.Series) -> Entry:
    """Returns a claim, what it says, and on demand how it is measured."""
    return Entry(
        f"`{row['claim']}`",
        order=row["claim"],
        note=row["says"],
        details=f"{row['measure']}. {row['because']}",
        details_title="How it is measured",
    )


def _verdict_entry(verdict: str) -> Entry:
    """Returns a verdict with its sign."""
    return Entry(f"{SIGNS[verdict]} {verdict}", order=verdict, kind=f"verdict {verdict.replace(' ', '-')}")


def _share_entry(row: pd.Series) -> Entry:
    """Returns in how many sets of agents the verdict is this row's."""
    text = f"{row['sets_agreeing']} [{row['share_low']:.0%}, {row['share_high']:.0%}]"
    return Entry(text, str(row["share"]), _place(row), "number")


def _value_entry(row: pd.Series) -> Entry:
    """Returns a part's value with its interval and the sign of its state."""
    text = number_text(row["value"], row["low"], row["high"])
    return Entry(f"{text} {_STATE_SIGNS[row['state']]}", str(row["value"]), _place(row), "number")


def _place(row: pd.Series) -> str:
    """Returns where a row of `claims.csv` stands."""
    return f"claims.csv#row={int(str(row.name)) + 2}"


def _must_be(row: pd.Series) -> str:
    """Returns where a part must lie."""
    return f"{row['right_side']} {row['threshold']:g}"


def _of(claims: pd.DataFrame, n_agents: int) -> pd.DataFrame:
    """Returns the rows with so many agents."""
    return claims[claims["agents"] == n_agents]


# Parts of sentences


def _counts(claims: pd.DataFrame) -> str:
    """Counts the verdicts, for example `6 hold, 2 are undecided and 1 does not hold`."""
    rows = weakest(claims)
    texts = []
    for verdict in VERDICTS:
        found = rows[rows["verdict"] == verdict]
        if len(found):
            texts.append(f"{link(str(len(found)), 'claims', found)} {_VERBS[verdict][len(found) > 1]}")
    return _listed(texts)


def _by_agents(published: Published) -> list[str]:
    """Says which verdicts differ between the numbers of agents, and which are not those of all sets."""
    claims = published.frame("claims")
    few, many = claims["agents"].min(), claims["agents"].max()
    if few == many:
        return []
    before, after = (weakest(_of(claims, size)) for size in (few, many))
    changed = [
        f"`{claim}` ({old} with {few:,}, {new} with {many:,})"
        for claim, old, new in zip(after["claim"], before["verdict"], after["verdict"], strict=True)
        if old != new
    ]
    if changed:
        text = f"The verdict depends on the number of agents for {_listed(changed)}."
    else:
        text = f"No verdict with {many:,} agents differs from that with {few:,}."
    rows = weakest(_of(claims, many))
    every = rows[rows["sets_agreeing"] == rows["sets"]]
    n_sets = rows["sets"].iloc[0]
    seeds = published.frame("claim_sets")[["first_seed", "last_seed"]].drop_duplicates()
    names = [f"{first}-{last}" for first, last in seeds.to_numpy()]
    shown = f"{', '.join(names[:2])}, ..., {names[-1]}" if len(names) > 3 else _listed(names)
    some = [
        f"`{row['claim']}` {'has the same verdict ' if i == 0 else ''}in "
        f"{link(str(row['sets_agreeing']), 'claims', row)} of {n_sets} (a share of "
        f"{row['share']:.2g} [{row['share_low']:.2g}, {row['share_high']:.2g}])"
        for i, (_, row) in enumerate(rows[rows["sets_agreeing"] < rows["sets"]].iterrows())
    ]
    verb = "is" if len(every) == 1 else "are"
    used = n_sets * few
    whole = f"The {many:,} agents are" if used == many else f"Of the {many:,} agents, {used:,} are"
    share = (
        f"{whole} {n_sets} disjoint sets of {few:,}: seeds {shown}. {len(every)} of the "
        f"{len(rows)} verdicts with {many:,} agents {verb} the same in every set"
    )
    return [text, f"{share}; {_listed(some)}." if some else f"{share}."]


def _failing_parts(published: Published) -> list[str]:
    """Says how many parts of each claim fail with all agents."""
    claims = published.frame("claims")
    claims = _of(claims, claims["agents"].max())
    texts = []
    for claim, parts in claims.groupby("claim", sort=False):
        failing = parts[parts["state"] == "fails"]
        if len(failing):
            verb = "fails" if len(failing) == 1 else "fail"
            texts.append(f"{link(f'{len(failing)} of {len(parts)}', 'claims', failing)} of `{claim}` {verb}")
    return [f"Of the parts of claims, {_listed(texts)}."] if texts else []


def _by_reading(published: Published) -> list[str]:
    """Says which claims that hold by default have another verdict under another reading or control."""
    rows = weakest(published.frame("sensitivity"), "reading")
    default = rows[rows["reading"] == DEFAULT_CONDITION]
    holding = default.loc[default["verdict"] == "holds", "claim"]
    fallen = rows[rows["claim"].isin(holding) & (rows["verdict"] != "holds")]
    texts = []
    for reading, others in fallen.groupby("reading", sort=False):
        parts = []
        for verdict in VERDICTS[1:]:
            found = others[others["verdict"] == verdict]
            names = _listed([f"`{claim}`" for claim in found["claim"]])
            if len(found):
                count = link(str(len(found)), "sensitivity", found)
                parts.append(f"{count} {_VERBS[verdict][len(found) > 1]} ({names})")
        texts.append(f"under `{reading}`, {_listed(parts)}")
    if not texts:
        return []
    n_agents, n_holding = rows["agents"].iloc[0], len(holding)
    text = f"Of the {n_holding} claims that hold by default with {n_agents:,} agents: {'; '.join(texts)}."
    if "equal_pay" in set(fallen["reading"]):
        text += (
            " In the control `equal_pay` a right PING pays as little in S1 and S2 as it can in S3. S3 pays "
            "at least as much, so the control cannot separate the issuer's information from the pay."
        )
    return [text]


def _success(published: Published) -> list[str]:
    """Says how often agents succeed in S2."""
    success = published.frame("success")
    rows = success[success["scenario"] == "S2"].sort_values("agents", ascending=False)
    if rows.empty:
        return []
    texts = [
        f"{link(tables.show(row['success']), 'success', row)} [{tables.show(row['success_low'])}, "
        f"{tables.show(row['success_high'])}] with {row['agents']:,} agents"
        for _, row in rows.iterrows()
    ]
    text = f"After training the success probability in S2 is {_listed(texts)}."
    return [text]


def _listed(texts: list[str]) -> str:
    """Joins texts as a sentence does."""
    return " and ".join(filter(None, [", ".join(texts[:-1]), *texts[-1:]]))
