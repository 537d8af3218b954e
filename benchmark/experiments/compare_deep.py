"""Numbers and claims of the text on `compare_deep`."""

from benchmark.experiments.finding import Names, Tables
from envs.words import listed

PAPER, TUNED = "q_learning, index", "q_learning_tuned, index"
TABLE, SOFTMAX, LINEAR = "watkins_q_lambda, index", "softmax_table, one_hot", "dqn_linear, one_hot"
TILES, DQN, PPO = "tile_coding, coordinates", "dqn, one_hot", "ppo, one_hot"
SB3_DQN, SB3_PPO = "sb3_dqn, one_hot", "sb3_ppo, one_hot"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, compared = tables.claim, tables.rows("summary", learner=[DQN, PPO, TABLE, TILES])
    runs = compared["n"].eq(100).all() and compared["budget"].eq(10_000).all()
    claim(runs, "there are 100 runs of 10,000 steps")
    scenarios = [*tables.rows("summary")["scenario"].unique()]
    claim(scenarios == ["S1", "S2", "S3"], "the scenarios are S1, S2 and S3")
    n_others = tables.values("summary", "n", learner=[SB3_DQN, SB3_PPO])
    claim(n_others == {30}, "there are 30 runs of Stable-Baselines3's own in each scenario")
    n_forms = tables.values("summary", "n", variant=["dqn_forms", "ppo_forms"])
    claim(n_forms == {30}, "there are 30 runs of nets on further forms of input in each scenario")
    _check_verdicts(tables)
    verdicts = tables.rows("contrasts").set_index(["x", "y"])["success_verdict"]

    def forms(net: str, form: str) -> str:
        """Returns how a form of input compares with coordinates, for a net."""
        return str(verdicts[f"{net}, {form}", f"{net}, coordinates"])

    success = tables.numbers("summary", "success", "learner scenario", ".2f")

    def each(learner: str) -> str:
        """Returns the success of a learner in each scenario."""
        return listed(success(learner, scenario) for scenario in scenarios)

    return {
        "success": tables.numbers("aggregate", "success", "learner", ".2f"),
        "improvement": tables.numbers("rliable", "p_improvement", "learner endpoint", ".2f"),
        "each": each,
        "forms": forms,
    }


def _check_verdicts(tables: Tables) -> None:
    claim, against_tiles = tables.claim, tables.rows("contrasts", x=[DQN, PPO], y=TILES)
    contrasts = tables.rows("contrasts").set_index(["x", "y"])
    verdicts, scores = contrasts["success_verdict"].to_dict(), contrasts["score_verdict"].to_dict()
    claim(tables.row("outcomes")["outcome"] == "cannot be beaten", "no net can earn its keep")
    claim(against_tiles["success_y_low"].gt(0.9).all(), "tile coding leaves less room than 0.1")
    claim(against_tiles["success_margin"].eq(0.1).all(), "the margin is 0.1")
    exceptions = tables.values("contrasts", "success_except", x=[DQN, TILES], y=TABLE)
    claim("" not in exceptions, "no equivalence is shown in each scenario alone")
    alike = {
        "equivalent": [(DQN, TABLE), (TILES, TABLE), (LINEAR, TABLE), (DQN, LINEAR), (DQN, SOFTMAX)],
        "worse": [(PPO, TABLE), (PPO, TILES), (SB3_PPO, TILES)],
        "undecided": [(DQN, TILES), (DQN, SB3_DQN), (SB3_DQN, TILES), (SB3_DQN, TABLE), (SB3_PPO, TABLE),
                      (PPO, SB3_PPO), (PPO, SOFTMAX)],
        "better": [(DQN, "dqn, coordinates"), (PPO, "ppo, coordinates"), (TUNED, PAPER)],
    }  # fmt: skip
    for verdict, pairs in alike.items():
        for x, y in pairs:
            claim(verdicts[x, y] == verdict, f"{x} against {y} is {verdict}")
    for column, expected in {
        "success": {SB3_DQN: "better", f"{SB3_DQN} @ S2": "better", f"{SB3_PPO} @ S2": "better"},
        "score": {f"{SB3_DQN} @ S2": "better", f"{SB3_PPO} @ S1": "worse"},
    }.items():
        later = tables.rows("contrasts", declared="later").set_index("x")[f"{column}_verdict"]
        decided = later[later != "undecided"].to_dict()
        claim(decided == expected, f"by {column}, only these differ from the paper's table: {[*expected]}")
    by_score = [scores[DQN, SOFTMAX], scores[LINEAR, SOFTMAX], scores[DQN, PPO]]
    is_alone = by_score == ["undecided", "better", "undecided"]
    claim(is_alone, "by score, only the linear DQN is better than the softmax table")
