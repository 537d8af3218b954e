"""What a replication found, in sentences and as the table of claims; from published files alone."""

import re
from typing import Final

import pandas as pd

from benchmark.drawing.tables import link
from benchmark.experiments import DEFAULT_CONDITION
from benchmark.reports import independent
from benchmark.reports.published import Published
from benchmark.reports.replication.claims import CLAIMS, VERDICTS
from benchmark.reports.view import Entry, Table, number_cell

_SIGNS: Final = dict(zip(VERDICTS, ("✓", "(✓)", "✗"), strict=True))
_VERBS: Final = dict(
    zip(
        VERDICTS,
        (("holds", "hold"), ("holds in part", "hold in part"), ("fails as a whole", "fail as a whole")),
        strict=True,
    )
)
_STATE: Final = re.compile(r", (passes|fails|undecided)(?:: no number)?(?=; |$)")  # of a part


def headline(published: Published) -> str:
    """Counts the verdicts on the claims, and the parts that fail; empty without claims."""
    if "claims.csv" not in published:
        return ""
    claims = published.frame("claims")
    counts = []
    for verdict in VERDICTS:
        rows = claims[claims["verdict"] == verdict]
        singular, plural = _VERBS[verdict]
        shown = link(str(len(rows)), "claims", rows) if len(rows) else "none"
        counts.append(f"{shown} {plural if len(rows) > 1 else singular}")
    text = f"Of the {len(claims)} claims of the paper, {', '.join(counts[:-1])} and {counts[-1]}."
    failing = _failing_parts(claims[claims["verdict"] == "holds in part"])
    if failing:
        text += f" Of those that hold in part, {failing}."
    shaky = _shaky(published)
    return f"{text} Of those that hold, {shaky}." if shaky else text


def sentences(published: Published) -> list[str]:
    """Says what the numbers alone do not: how many agents there are, and what independent checks found."""
    rows = published.frame("optimal")
    texts = [f"Every scenario has {link(str(rows['agents'].iloc[0]), 'optimal', rows)} agents."]
    if "claims.csv" in published:
        claims = published.frame("claims")
        texts += [
            f"Claim `{claim.id}` {link(row['verdict'], 'claims', row)} here. {claim.note}"
            for claim in CLAIMS
            if claim.note
            for _, row in claims[claims["claim"] == claim.id].iterrows()
        ]
    (arm,) = published.manifest["algorithms"].values()
    learning = published.frame("learning")
    last = learning[(learning["scenario"] == "S2") & (learning["step"] == learning["step"].max())]
    note = independent.of_papers_table(arm["settings"])
    if note and len(last):
        row = last.iloc[0]
        texts.append(
            "After training the table succeeds in S2 with probability "
            f"{link(f'{row.success:.2f}', 'learning', row)} [{row.success_low:.2f}, {row.success_high:.2f}]. "
            f"{note}"
        )
    return texts


def claims_table(published: Published) -> Table:
    """Returns the paper's claims, each with the readings under which its verdict is another one."""
    claims, sensitivity = published.frame("claims"), published.frame("sensitivity")
    notes = {claim.id: claim.note for claim in CLAIMS}
    rows = []
    for _, row in claims.iterrows():
        same_claim = sensitivity[sensitivity["claim"] == row["claim"]]
        others = same_claim[same_claim["verdict"] != row["verdict"]]
        depends = "; ".join(
            f"`{other['reading']}`: {link(other['verdict'], 'sensitivity', other)}"
            for _, other in others.iterrows()
        )
        note = notes.get(row["claim"], "")
        rows.append(
            [
                Entry(
                    f"`{row['claim']}`",
                    order=row["claim"],
                    note=f"{row['says']} {note}".strip(),
                    details=f"{row['measure']}. {row['because']} Parts: {row['parts']}.",
                    details_title="How it is measured",
                ),
                Entry(
                    f"{_SIGNS[row['verdict']]} {row['verdict']}",
                    order=row["verdict"],
                    kind=f"verdict {row['verdict'].replace(' ', '-')}",
                ),
                number_cell("claims.csv", row, "value", ("low", "high")),
                Entry(row["threshold"]),
                Entry(depends or "no reading changes it"),
            ]
        )
    columns = [
        ("claim", False),
        ("verdict", False),
        ("value", True),
        ("must be", False),
        ("other verdicts under", False),
    ]
    return Table("The paper's claims, measured", "claims.csv", columns, rows)


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


def _failing_parts(claims: pd.DataFrame) -> str:
    """Says how many parts of claims fail; empty if none does."""
    texts = []
    for _, row in claims.iterrows():
        states = _STATE.findall(row["parts"])
        n_failing = states.count("fails")
        if n_failing:
            verb = "fails" if n_failing == 1 else "fail"
            shown = link(f"{n_failing} of the {len(states)} parts", "claims", row)
            texts.append(f"{shown} of `{row['claim']}` {verb}")
    return " and ".join(filter(None, [", ".join(texts[:-1]), *texts[-1:]]))


def _shaky(published: Published) -> str:
    """Says which of the claims that hold do not under another reading or a control; empty if none."""
    claims, sensitivity = published.frame("claims"), published.frame("sensitivity")
    holding = claims.loc[claims["verdict"] == "holds", "claim"]
    fallen = sensitivity[sensitivity["claim"].isin(holding) & (sensitivity["verdict"] == "does not hold")]
    texts = []
    for reading, rows in fallen.groupby("reading", sort=False):
        names = ", ".join(f"`{claim}`" for claim in rows["claim"])
        verb = "fails" if len(rows) == 1 else "fail"
        texts.append(f"{link(str(len(rows)), 'sensitivity', rows)} ({names}) {verb} under `{reading}`")
    return "; ".join(texts)
