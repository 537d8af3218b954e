"""Numbers and claims of the text on `tuning_noise`."""

from benchmark.experiments.finding import Names, Tables


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    rows = tables.rows("chosen")
    tables.claim(tables.rows("cost")["trials"].eq(16).all(), "every learner has 16 trials")
    tables.claim(rows["trial"].gt(0).all(), "no learner keeps trial 0")
    tables.claim(rows["gain_low"].max() <= 0, "no gain over trial 0 is shown")

    def gain(learner: str) -> str:
        before, after = (
            tables.number("chosen", column, ".2f", learner=learner) for column in ("default", "chosen")
        )
        return f"from {before} to {after}"

    return {"gain": gain}
