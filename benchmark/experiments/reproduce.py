"""Numbers and claims of the text on `reproduce`."""

from benchmark.experiments.finding import Names, Tables


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    variability = tables.values("claims", "verdict", claim="variability-S2")
    undecided = tables.values("claims", "claim", agents=1000, verdict="undecided")
    holding = [*tables.values("claims", "claim", agents=100, verdict="holds")]
    tables.claim(variability == {"holds"}, "variability-S2 holds")
    tables.claim(len(undecided) == 1, "one claim is undecided with 1,000 agents")
    broken = {"reading": "equal_pay", "claim": holding, "verdict": ["undecided", "does not hold"]}
    variability_of = {"claim": "variability-S2", "part": "S2/S1", "agents": 1000}
    return {
        "judged": lambda agents, verdict: tables.count("claims", "claim", agents=agents, verdict=verdict),
        "variability": tables.number("claims", "value", ".2f", **variability_of),
        "n_sets": tables.number("claims", "sets", "", **variability_of),
        "n_agreeing": tables.number("claims", "sets_agreeing", "", **variability_of),
        "not_with_equal_pay": tables.count("sensitivity", "claim", **broken),
        "n_holding": len(holding),
    }
