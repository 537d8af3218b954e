"""Numbers and claims of the text on `equivalence`."""

from benchmark.experiments.finding import Names, Tables

DQN = "dqn, coordinates"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    contrasts, budgets = tables.rows("contrasts"), tables.rows("summary")["budget"]
    verdicts = contrasts.set_index(["scenario", "x"])["success_verdict"]
    counts = verdicts.value_counts().to_dict()
    tables.claim(
        counts == {"equivalent": 7, "undecided": 1} and verdicts.to_dict()["S2", DQN] == "undecided",
        "all are equivalent but DQN on coordinates in S2",
    )
    tables.claim(
        contrasts["success_margin"].eq(0.15).all() and budgets.eq(10_000).all(),
        "the margin is 0.15, and the budget 10,000 steps",
    )

    def success(side: str, learner: str) -> str:
        return tables.number("contrasts", f"success_{side}", ".2f", scenario="S2", x=learner)

    return {"success": success, "dqn": DQN, "ppo_again": "ppo_again, coordinates"}
