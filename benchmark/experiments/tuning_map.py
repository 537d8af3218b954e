"""Numbers and claims of the text on `tuning_map`."""

from benchmark.experiments.finding import Names, Tables


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, rows = tables.claim, tables.rows("chosen")
    is_net, other = rows["variant"].isin(["ppo", "dqn"]), rows[rows["trial"].gt(0)]
    claim(tables.values("cost", "trials") == {16}, "every learner has 16 trials")
    claim(rows["gain_low"].max() <= 0, "no gain over trial 0 is shown")
    is_wide = other["gain_low"].le(-0.2).all() and other["gain_high"].ge(0.2).all()
    claim(is_wide, "intervals of gains reach 0.2 to either side")
    picks = tables.rows("picks", variant=["ppo", "dqn"], observation="coordinates")
    steps = picks.groupby(["variant", "scenario"])["beats"].diff()
    is_against_tiles = picks["reference"].eq("tile_coding, coordinates").all()
    claim(is_against_tiles and steps.max() < 1e-9, "with more trials, nets beat tile coding less often")
    claim(rows[is_net]["chosen"].max() < rows[~is_net]["chosen"].min(), "all nets are below the others")
    beats = tables.numbers("picks", "beats", "learner trials", ".2f", scenario="ManyPlaces")
    return {
        "early": tables.numbers("chosen", "chosen", "learner", ".2f"),
        "beats": lambda learner: f"{beats(learner, 1)} to {beats(learner, 8)}",
    }
