"""Numbers and claims of the text on `beyond`."""

from functools import partial

from benchmark.experiments.finding import Names, Tables

TABLE, SOFTMAX = "watkins_q_lambda, offset", "softmax_table, offset_one_hot"
TILES = "tile_coding, offset_coordinates"
BASELINES = [TABLE, SOFTMAX, TILES]
NETS = ["dqn, coordinates", "dqn, one_hot", "ppo, one_hot"]


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    _check_contrasts(tables)
    _check_same_input(tables)
    names = partial(tables.names, "contrasts", "scenario", success_verdict="better")
    return {
        "better": lambda net, baseline: names(x=net, y=baseline),
        "anywhere": tables.numbers("summary", "success", "learner", ".2f", scenario="Anywhere"),
        "scenarios": lambda outcome: tables.names("outcomes", "scenario", outcome=outcome),
        "same_input": lambda verdict: tables.count("same_input", success_verdict=verdict),
    }


def _check_contrasts(tables: Tables) -> None:
    claim, contrasts, outcomes = tables.claim, tables.rows("contrasts"), tables.rows("outcomes")
    sides = [[*contrasts[side].unique()] for side in "xy"]
    claim(sides == [NETS, BASELINES], "three nets are compared with two tables and tile coding")
    is_declared = contrasts["n"].eq(160).all() and contrasts["success_margin"].eq(0.1).all()
    claim(is_declared, "there are 160 runs, and the margin is 0.1")
    budgets = tables.values("summary", "budget", learner=NETS + BASELINES)
    claim(budgets == {20_000}, "the budget is 20,000 steps")
    counts = outcomes["outcome"].value_counts().to_dict()
    is_never_won = counts == {"cannot be beaten": 15, "undecided": 1, "neither learned": 1}
    claim(is_never_won, "no net earns its keep")
    ahead = tables.rows("contrasts", x="ppo, one_hot", success_verdict="better")
    undecided = tables.row("outcomes", outcome="undecided")["scenario"]
    is_there = [*ahead["y"]] == [TABLE, TILES] and ahead["scenario"].eq(undecided).all()
    claim(is_there, "PPO beats Q(λ) and tile coding only where the outcome is undecided")
    full = [*tables.values("outcomes", "scenario", outcome="cannot be beaten")]
    lowest = tables.rows("contrasts", scenario=full).groupby("scenario")["success_y_low"].max()
    claim(lowest.gt(0.9).all(), "where nets cannot be beaten, some baseline leaves less room than 0.1")
    pairs = tables.rows("contrasts", success_verdict="better")[["x", "y"]].drop_duplicates()
    claim(len(pairs) == 3, "otherwise, only DQN on one-hot cells is better than the softmax table")


def _check_same_input(tables: Tables) -> None:
    claim, rows = tables.claim, tables.rows("same_input")
    wins = rows[rows["success_verdict"] == "better"].groupby(["scenario", "x"])["y"].nunique()
    winners = [*wins[wins == rows["y"].nunique()].index]
    is_alone = winners == [("Anywhere", "dqn, coordinates")]
    claim(is_alone, "with the same input, only DQN in Anywhere is better than all others")
    is_of_cells = not rows["y"].str.contains("offset").any() and rows["y"].nunique() == 5
    claim(is_of_cells, "four tables and tile coding observe cells")
    few = tables.values("same_input", "success_verdict", n=20)
    claim("equivalent" not in few, "with 20 runs, equivalence is not shown")
