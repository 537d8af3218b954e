"""Numbers and claims of the text on `sb3`."""

from benchmark.experiments.finding import Names, Tables

TABLE = "q_learning, index"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, summary, contrasts = tables.claim, tables.rows("summary"), tables.rows("contrasts")
    runs = summary["n"].eq(10).all() and summary["budget"].eq(10_000).all()
    claim(runs, "there are 10 runs of 10,000 steps")
    claim([*summary["scenario"].unique()] == ["S1", "S2", "S3"], "the scenarios are S1, S2 and S3")
    is_undecided = contrasts["success_verdict"].eq("undecided").all()
    claim(
        contrasts["y"].eq(TABLE).all() and is_undecided and len(contrasts) == 4,
        "all four are undecided against the paper's table",
    )
    trpo = tables.rows("contrasts", x="sb3_trpo, one_hot")["score_verdict"]
    n_undecided = len(tables.rows("contrasts", score_verdict="undecided"))
    claim(trpo.eq("worse").all() and n_undecided == 3, "by score, only TRPO is worse")

    return {"success": tables.numbers("aggregate", "success", "learner", ".2f"), "table": TABLE}
