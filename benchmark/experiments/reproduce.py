"""What `reproduce` has shown of the paper's claims."""

from collections.abc import Mapping

import pandas as pd

from benchmark.replication import verdicts_of


def finding(tables: Mapping[str, pd.DataFrame]) -> str:
    """Checks every claim of the text, and returns the text."""
    claims = tables["claims"]
    n_few, n_many = sorted({*claims["agents"]})
    assert (n_few, n_many) == (100, 1000), "100 agents, as in the paper, and 1,000"
    verdicts = verdicts_of(claims)
    sets, many = verdicts.loc["default", n_few], verdicts.loc["default", n_many].iloc[0]
    few, equal_pay = sets.iloc[0], verdicts.loc["equal_pay"].iloc[0]
    n_sets, n_holding = len(sets), (sets["variability-S2"] == "holds").sum()
    held, refuted = ((sets == name).sum(axis=1) for name in ("holds", "does not hold"))
    failed = {"identifies", "identifies-S1", "max-near-1"}
    for verdicts in (few, many):
        found = {*verdicts.index[verdicts == "does not hold"]}
        assert found == failed, f"exactly these claims do not hold: {sorted(failed)}"
    assert (refuted == len(failed)).all(), "as many do not hold in each set"
    assert (tables["optimal"]["step"] == 10_000).all(), "agents are trained for 10,000 steps"
    assert (many == "undecided").sum() == 1, "with 1,000 agents, one claim is undecided"
    assert few["variability-S2"] == many["variability-S2"] == "holds", "max Q varies most in S2"

    of_spread = claims[(claims["claim"] == "variability-S2") & (claims["agents"] == n_many)]
    ratio = of_spread[of_spread["part"] == "S2/S1"].iloc[0]
    assert ratio["low"] > 1, "max Q varies more in S2 than in S1"
    holding = few.index[few == "holds"]
    kept = (equal_pay[holding] == "holds").sum()
    assert kept < len(holding), "some claims do not survive equal pay"
    return f"""\
Of the paper's {len(few)} claims, {len(failed)} do not hold. With {n_few} agents per scenario, as in
the paper, {held.min()} to {held.max()} hold, depending on the agents ({n_sets} sets), and with
{n_many:,}, {(many == "holds").sum()}. The others are undecided. All agents are Q-learning tables
after 10,000 steps, under the default reading of the paper; verdicts are by 95 % intervals.

**Conditions and caveats.** A claim can hold narrowly, or for a reason other than the paper's. With
{n_many:,} agents, max Q varies most in S2, but only {ratio["value"]:.2f} times as much as in S1;
the claim holds in {n_holding} of {n_sets} sets of {n_few} agents. And if a correct PING in S1 and
S2 pays only the least that it pays in S3 (the control `equal_pay`), {len(holding) - kept} of the
{len(holding)} claims that hold with the first {n_few} agents fail or become undecided."""
