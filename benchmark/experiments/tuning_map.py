"""Numbers and claims of the text on `tuning_map`."""

from benchmark.experiments.finding import Names, Tables


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, rows = tables.claim, tables.rows("chosen")
    is_net = rows["variant"].isin(["ppo", "dqn"])
    claim(tables.rows("cost")["trials"].eq(16).all(), "every learner has 16 trials")
    claim(rows["gain_low"].max() <= 0, "no gain over trial 0 is shown")
    other = rows[rows["trial"].gt(0)]
    claim(
        not (other["gain_low"].gt(-0.2).any() or other["gain_high"].lt(0.2).any()),
        "intervals of gains reach 0.2 to either side",
    )
    picks = tables.rows("picks", variant=["ppo", "dqn"], observation="coordinates")
    steps = picks.groupby(["variant", "scenario"])["beats"].diff()
    is_against_tiles = picks["reference"].eq("tile_coding, coordinates").all()
    claim(is_against_tiles and steps.max() < 1e-9, "with more trials, nets beat tile coding less often")
    claim(rows[is_net]["chosen"].max() < rows[~is_net]["chosen"].min(), "all nets are below the others")

    def beats(learner: str) -> str:
        where = {"learner": learner, "scenario": "ManyPlaces"}
        one, eight = (tables.number("picks", "beats", ".2f", **where, trials=n) for n in (1, 8))
        return f"{one} to {eight}"

    return {"early": tables.numbers("chosen", "chosen", "learner", ".2f"), "beats": beats}
