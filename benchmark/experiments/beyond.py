"""Numbers and claims of the text on `beyond`."""

from benchmark.experiments.finding import Names, Tables

TABLE, SOFTMAX = "watkins_q_lambda, offset", "softmax_table, offset_one_hot"
TILES = "tile_coding, offset_coordinates"
NETS = ["dqn, coordinates", "dqn, one_hot", "ppo, one_hot"]


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    _check_contrasts(tables)
    _check_same_input(tables)

    def better(net: str, baseline: str) -> str:
        return tables.names("contrasts", "scenario", x=net, y=baseline, success_verdict="better")

    def scenarios(outcome: str) -> str:
        return tables.names("outcomes", "scenario", outcome=outcome)

    def same_input(verdict: str) -> str:
        return tables.count("same_input", success_verdict=verdict)

    return {
        "better": better,
        "anywhere": tables.numbers("summary", "success", "learner", ".2f", scenario="Anywhere"),
        "scenarios": scenarios,
        "same_input": same_input,
        **{"table": TABLE, "softmax": SOFTMAX, "tiles": TILES},
    }


def _check_contrasts(tables: Tables) -> None:
    claim, contrasts, outcomes = tables.claim, tables.rows("contrasts"), tables.rows("outcomes")
    baselines = [TABLE, SOFTMAX, TILES]
    claim(
        [*contrasts["x"].unique()] == NETS and [*contrasts["y"].unique()] == baselines,
        "three nets are compared with two tables and tile coding",
    )
    is_declared = contrasts["n"].eq(160).all() and contrasts["success_margin"].eq(0.1).all()
    claim(is_declared, "there are 160 runs, and the margin is 0.1")
    budgets = tables.rows("summary", learner=NETS + baselines)["budget"]
    claim(budgets.eq(20_000).all(), "the budget is 20,000 steps")
    counts = outcomes["outcome"].value_counts().to_dict()
    is_never_won = counts == {"cannot be beaten": 15, "undecided": 1, "neither learned": 1}
    claim(is_never_won, "no net earns its keep")
    ahead = tables.rows("contrasts", x="ppo, one_hot", success_verdict="better")
    undecided = tables.row("outcomes", outcome="undecided")["scenario"]
    claim(
        [*ahead["y"]] == [TABLE, TILES] and ahead["scenario"].eq(undecided).all(),
        "PPO is better than the Q(λ) table and tile coding where the outcome is undecided, and nowhere else",
    )
    full = [*outcomes[outcomes["outcome"] == "cannot be beaten"]["scenario"]]
    lowest = tables.rows("contrasts", scenario=full).groupby("scenario")["success_y_low"].max()
    claim(lowest.gt(0.9).all(), "where nets cannot be beaten, some baseline leaves less room than 0.1")
    claim(
        len(contrasts[contrasts["success_verdict"] == "better"][["x", "y"]].drop_duplicates()) == 3,
        "otherwise, only DQN on one-hot cells is better than the softmax table",
    )


def _check_same_input(tables: Tables) -> None:
    claim, rows = tables.claim, tables.rows("same_input")
    wins = rows[rows["success_verdict"] == "better"].groupby(["scenario", "x"])["y"].nunique()
    claim(
        [*wins[wins == rows["y"].nunique()].index] == [("Anywhere", "dqn, coordinates")],
        "with the same input, only DQN on coordinates in Anywhere is better than all others",
    )
    is_of_cells = not rows["y"].str.contains("offset").any() and rows["y"].nunique() == 5
    claim(is_of_cells, "four tables and tile coding observe cells")
    few = rows[rows["n"] == 20]["success_verdict"]
    claim(few.ne("equivalent").all(), "with 20 runs, equivalence is not shown")
