"""Numbers and claims of the text on `sb3`."""

from benchmark.experiments.finding import Names, Tables

TABLE = "q_learning, index"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, summary, contrasts = tables.claim, tables.rows("summary"), tables.rows("contrasts")
    runs = summary["n"].eq(10).all() and summary["budget"].eq(10_000).all()
    claim(runs, "there are 10 runs of 10,000 steps")
    claim([*summary["scenario"].unique()] == ["S1", "S2", "S3"], "the scenarios are S1, S2 and S3")
    four = [*contrasts["success_verdict"]] == ["undecided"] * 4 and contrasts["y"].eq(TABLE).all()
    claim(four, "all four are undecided against the paper's table")
    by_score = contrasts.set_index("x")["score_verdict"].value_counts().to_dict()
    trpo = tables.values("contrasts", "score_verdict", x="sb3_trpo, one_hot")
    is_alone = trpo == {"worse"} and by_score == {"undecided": 3, "worse": 1}
    claim(is_alone, "by score, only TRPO is worse")
    return {"success": tables.numbers("aggregate", "success", "learner", ".2f")}
