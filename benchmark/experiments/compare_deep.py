"""Numbers and claims of the text on `compare_deep`."""

from benchmark.experiments.finding import Names, Tables

TABLE, SOFTMAX, LINEAR = "watkins_q_lambda, index", "softmax_table, one_hot", "dqn_linear, one_hot"
TILES, DQN, PPO = "tile_coding, coordinates", "dqn, one_hot", "ppo, one_hot"
SB3_DQN, SB3_PPO = "sb3_dqn, one_hot", "sb3_ppo, one_hot"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    _check_runs(tables)
    _check_verdicts(tables)

    learners = {"table": TABLE, "linear": LINEAR, "tiles": TILES, "dqn": DQN, "ppo": PPO}
    success = tables.numbers("aggregate", "success", "learner", ".2f")
    return {"success": success, "sb3_dqn": SB3_DQN, "sb3_ppo": SB3_PPO, **learners}


def _check_runs(tables: Tables) -> None:
    claim, summary = tables.claim, tables.rows("summary")
    compared = tables.rows("summary", learner=[DQN, PPO, TABLE, TILES])
    runs = compared["n"].eq(100).all() and compared["budget"].eq(10_000).all()
    claim(runs, "there are 100 runs of 10,000 steps")
    claim([*summary["scenario"].unique()] == ["S1", "S2", "S3"], "the scenarios are S1, S2 and S3")
    claim(
        tables.rows("summary", learner=[SB3_DQN, SB3_PPO])["n"].eq(30).all(),
        "there are 30 runs of Stable-Baselines3's own in each scenario",
    )


def _check_verdicts(tables: Tables) -> None:
    claim, contrasts = tables.claim, tables.rows("contrasts").set_index(["x", "y"])
    verdicts, scores = contrasts["success_verdict"].to_dict(), contrasts["score_verdict"].to_dict()
    against_tiles = tables.rows("contrasts", x=[DQN, PPO], y=TILES)
    claim(tables.row("outcomes")["outcome"] == "cannot be beaten", "no net can earn its keep")
    claim(against_tiles["success_y_low"].gt(0.9).all(), "tile coding leaves less room than 0.1")
    claim(
        verdicts[DQN, TABLE] == verdicts[DQN, TILES] == verdicts[TILES, TABLE] == "equivalent",
        "DQN, tile coding and the Q(λ) table are equivalent",
    )
    margin = tables.row("contrasts", x=DQN, y=TILES)["success_margin"]
    claim(margin == 0.1, "the margin is 0.1")
    claim(
        tables.rows("contrasts", x=[DQN, TILES], y=[TABLE, TILES])["success_except"].ne("").all(),
        "none of these equivalences is shown in each scenario alone",
    )
    claim(
        verdicts[PPO, TABLE] == verdicts[PPO, TILES] == "worse",
        "PPO is worse than the Q(λ) table and tile coding",
    )
    undecided = [(SB3_DQN, TILES), (SB3_DQN, TABLE), (SB3_PPO, TABLE), (PPO, SB3_PPO)]
    claim(
        {verdicts[pair] for pair in undecided} == {"undecided"},
        "most contrasts of Stable-Baselines3's own are undecided",
    )
    claim(
        verdicts[SB3_PPO, TILES] == "worse" and verdicts[DQN, SB3_DQN] == "equivalent",
        "Stable-Baselines3's PPO is worse than tile coding, and its DQN is equivalent to the compiled one",
    )
    claim(
        verdicts[DQN, "dqn, coordinates"] == verdicts[PPO, "ppo, coordinates"] == "better",
        "DQN and PPO do better on one-hot cells than on coordinates",
    )
    claim(
        verdicts[LINEAR, TABLE] == verdicts[DQN, LINEAR] == "equivalent",
        "the linear DQN is equivalent to the Q(λ) table, and to DQN",
    )
    claim(
        verdicts[DQN, SOFTMAX] == "equivalent" and verdicts[PPO, SOFTMAX] == "mixed",
        "against the softmax table, DQN is equivalent, and PPO is mixed",
    )
    claim(
        [scores[DQN, SOFTMAX], scores[LINEAR, SOFTMAX], scores[DQN, PPO]]
        == ["undecided", "better", "undecided"],
        "by score, of the compiled nets against the softmax table, and DQN against PPO, only the linear "
        "DQN is better",
    )
