"""Numbers and claims of the text on `reproduce`."""

from benchmark.experiments.finding import Names, Tables


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    variability = tables.rows("claims", claim="variability-S2")["verdict"]
    undecided = tables.rows("claims", agents=1000, verdict="undecided")["claim"]
    holding = [*tables.rows("claims", agents=100, verdict="holds")["claim"].unique()]
    tables.claim(variability.eq("holds").all(), "variability-S2 holds")
    tables.claim(undecided.nunique() == 1, "one claim is undecided with 1,000 agents")

    def judged(agents: int, verdict: str) -> str:
        return tables.count("claims", "claim", agents=agents, verdict=verdict)

    variability_of = {"claim": "variability-S2", "part": "S2/S1", "agents": 1000}
    broken = ["undecided", "does not hold"]
    return {
        "judged": judged,
        "variability": tables.number("claims", "value", ".2f", **variability_of),
        "n_sets": tables.number("claims", "sets", "", **variability_of),
        "n_agreeing": tables.number("claims", "sets_agreeing", "", **variability_of),
        "not_with_equal_pay": tables.count(
            "sensitivity", "claim", reading="equal_pay", claim=holding, verdict=broken
        ),
        "n_holding": len(holding),
    }
