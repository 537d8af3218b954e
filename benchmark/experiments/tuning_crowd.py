"""Numbers and claims of the text on `tuning_crowd`."""

from benchmark.experiments.finding import Names, Tables

TILES, PAIRS = "tile_coding, coordinates", "tile_pairs, coordinates"
AGENT_PAIRS, DQN = "tile_agent_pairs, coordinates", "dqn, coordinates"
PPO, CENTRED_PPO = "ppo, coordinates", "ppo, centred"


def finding(tables: Tables) -> Names:
    """Checks all claims, and returns what the text names."""
    claim, by_learner = tables.claim, tables.rows("chosen").groupby("learner")["chosen"]
    effort = tables.rows("effort", scenario="all").set_index("learner")
    low, high = by_learner.min(), by_learner.max()
    claim(effort["learned"].idxmax() == PPO, "most first runs learn with PPO on coordinates")
    claim(effort["trials"].nunique() == 1, "all have as many trials")
    for column in ("total", "drawn"):
        claim(effort[column].idxmin() == PPO, "PPO on coordinates needs the fewest steps, tuning included")
    claim(by_learner.mean()[PPO] > by_learner.mean()[CENTRED_PPO], "PPO's picks are better on coordinates")

    return {
        "picks": lambda learner: f"{low[learner]:.2f} to {high[learner]:.2f}",
        "trials": f"{effort['trials'].iloc[0]}",
        "learned": tables.numbers("effort", "learned", "learner", "", scenario="all"),
        "total": tables.numbers("effort", "total", "learner", scenario="all"),
        "drawn": tables.numbers("effort", "drawn", "learner", scenario="all"),
        "cpu": tables.numbers("cost", "cpu_time_s", "learner", "time"),
    }
