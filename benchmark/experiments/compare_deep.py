"""Numbers and claims of the text on `compare_deep`."""

from benchmark.experiments.finding import Names, Tables
from envs.words import listed

PAPER, TUNED = "q_learning, index", "q_learning_tuned, index"
TABLE, SOFTMAX, LINEAR = "watkins_q_lambda, index", "softmax_table, one_hot", "dqn_linear, one_hot"
TILES, DQN, PPO = "tile_coding, coordinates", "dqn, one_hot", "ppo, one_hot"
SB3_DQN, SB3_PPO = "sb3_dqn, one_hot", "sb3_ppo, one_hot"

VERDICTS = {
    "equivalent": [(DQN, TABLE), (TILES, TABLE), (LINEAR, TABLE), (DQN, LINEAR)],
    "worse": [(PPO, TABLE), (PPO, TILES), (SB3_PPO, TILES)],
    "undecided": [(DQN, TILES), (DQN, SB3_DQN), (SB3_DQN, TILES), (SB3_DQN, TABLE), (SB3_PPO, TABLE)],
    "better": [(DQN, "dqn, coordinates"), (PPO, "ppo, coordinates"), (TUNED, PAPER)],
}


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, summary = tables.claim, tables.rows("summary").set_index(["learner", "scenario"])
    runs = summary.loc[[DQN, PPO, TABLE, TILES, PAPER]]
    claim({*runs["n"]} == {100} and {*runs["budget"]} == {10_000}, "there are 100 runs of 10,000 steps")
    few = {*summary.loc[[SB3_DQN, SB3_PPO]]["n"]}
    few |= tables.values("summary", "n", variant=["dqn_forms", "ppo_forms"])
    claim(few == {30}, "there are 30 runs of Stable-Baselines3's own and of nets on further forms of input")
    lowest = tables.row("aggregate", learner=TILES)["success_low"]
    claim(1 - lowest < 0.1, "tile coding leaves less room than the margin")
    contrasts = tables.rows("contrasts")
    verdicts = contrasts[contrasts["declared"] != "later"].set_index(["x", "y"])["success_verdict"]
    for verdict, pairs in VERDICTS.items():
        claim({*verdicts[pairs]} == {verdict}, f"all of {pairs} are {verdict}")
    later = contrasts[contrasts["declared"] == "later"].fillna({"scenario": ""}).set_index(["x", "scenario"])
    for endpoint, expected in {
        "success": {(SB3_DQN, ""): "better", (SB3_DQN, "S2"): "better", (SB3_PPO, "S2"): "better"},
        "score": {(SB3_DQN, "S2"): "better", (SB3_PPO, "S1"): "worse"},
    }.items():
        decided = later[f"{endpoint}_verdict"].drop(later.index[later[f"{endpoint}_verdict"] == "undecided"])
        claim(decided.to_dict() == expected, f"by {endpoint}, only these differ from the paper's table")

    def each(learner: str) -> str:
        """Returns the success of a learner in each scenario."""
        return listed(f"{value:.2f}" for value in summary.loc[learner]["success"])

    return {
        "success": tables.numbers("aggregate", "success", "learner", ".2f"),
        "improvement": tables.numbers("rliable", "p_improvement", "learner endpoint", ".2f"),
        "each": each,
        "forms": lambda net, form: verdicts[f"{net}, {form}", f"{net}, coordinates"],
    }
