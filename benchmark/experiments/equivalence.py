"""Numbers and claims of the text on `equivalence`."""

from benchmark.experiments.finding import Names, Tables

DQN, PPO_AGAIN = "dqn, coordinates", "ppo_again, coordinates"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    undecided = tables.row("contrasts", success_verdict="undecided")[["scenario", "x"]]
    counts = tables.rows("contrasts")["success_verdict"].value_counts().to_dict()
    is_alone = counts == {"equivalent": 7, "undecided": 1} and [*undecided] == ["S2", DQN]
    tables.claim(is_alone, "all are equivalent but DQN on coordinates in S2")
    tables.claim(tables.values("contrasts", "success_margin") == {0.15}, "the margin is 0.15")
    tables.claim(tables.values("summary", "budget") == {10_000}, "the budget is 10,000 steps")

    def success(side: str, learner: str) -> str:
        return tables.number("contrasts", f"success_{side}", ".2f", scenario="S2", x=learner)

    return {"success": success}
