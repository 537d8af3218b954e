"""Numbers and claims of the text on `tuning_noise`."""

from benchmark.experiments.finding import Names, Tables, gain_of


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    rows = tables.rows("chosen")
    tables.claim(tables.values("cost", "trials") == {16}, "every learner has 16 trials")
    tables.claim(rows["trial"].gt(0).all(), "no learner keeps trial 0")
    tables.claim(rows["gain_low"].max() <= 0, "no gain over trial 0 is shown")
    return {"gain": gain_of(tables)}
