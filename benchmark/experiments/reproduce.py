"""Numbers and claims of the text on `reproduce`."""

from benchmark.experiments.finding import Names, Tables


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    variability = tables.values("claims", "verdict", claim="variability-S2")
    undecided = tables.values("claims", "claim", agents=1000, verdict="undecided")
    holding = [*tables.values("claims", "claim", agents=100, verdict="holds")]
    tables.claim(variability == {"holds"}, "variability-S2 holds")
    tables.claim(len(undecided) == 1, "one claim is undecided with 1,000 agents")
    failed = tables.values("claims", "claim", verdict="does not hold")
    tables.claim(failed == {"identifies", "identifies-S1", "max-near-1"}, "these claims do not hold")
    broken = {"reading": "equal_pay", "claim": holding, "verdict": ["undecided", "does not hold"]}
    variability_of = {"claim": "variability-S2", "part": "S2/S1", "agents": 1000}
    sets = tables.rows("claim_sets").drop_duplicates(["first_seed", "claim"])

    def in_sets(verdict: str) -> str:
        """Returns how many claims have a verdict: the fewest and the most of any set of agents."""
        of_sets = (sets["verdict"] == verdict).groupby(sets["first_seed"]).sum()
        return " to ".join(map(str, sorted({of_sets.min(), of_sets.max()})))

    return {
        "in_sets": in_sets,
        "judged": lambda agents, verdict: tables.count("claims", "claim", agents=agents, verdict=verdict),
        "variability": tables.number("claims", "value", ".2f", **variability_of),
        "n_sets": tables.number("claims", "sets", "", **variability_of),
        "n_agreeing": tables.number("claims", "sets_agreeing", "", **variability_of),
        "not_with_equal_pay": tables.count("sensitivity", "claim", **broken),
        "n_holding": len(holding),
    }
