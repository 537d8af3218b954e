"""Numbers and claims of the text on `ablation`."""

from benchmark.experiments.finding import Names, Tables

DEFAULT, TARGET, RATE = "default, one_hot", "target, one_hot", "rate, one_hot"
BOTH = "target_and_rate, one_hot"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, summary = tables.claim, tables.rows("summary")
    contrasts = tables.rows("contrasts").set_index(["x", "y"])
    verdicts, scores = contrasts["success_verdict"].to_dict(), contrasts["score_verdict"].to_dict()
    runs = summary["n"].eq(100).all() and summary["budget"].eq(10_000).all()
    claim(runs, "there are 100 runs of 10,000 steps")
    claim([*summary["scenario"].unique()] == ["S1", "S2", "S3"], "the scenarios are S1, S2 and S3")
    claim(verdicts[TARGET, DEFAULT] == "neither learned", "target and default do not beat random")
    claim(scores[TARGET, DEFAULT] == "better", "with the target network alone, the score is better")
    claim(verdicts[RATE, DEFAULT] == "better", "the higher learning rate alone is better than the default")
    with_both = {verdicts[BOTH, other] for other in (DEFAULT, TARGET, RATE)}
    claim(with_both == {"better"}, "both changes are better than none and than each alone")
    highest = tables.rows("aggregate", learner=[TARGET, RATE])["success_high"].max()
    claim(highest < 0.15, "with either change alone, success stays rare")
    return {
        "success": tables.numbers("aggregate", "success", "learner", ".2f"),
        "with_both": tables.numbers("summary", "success", "scenario", ".2f", learner=BOTH),
    }
