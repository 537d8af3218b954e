"""What `groups` has shown: who learns where to join people who talk."""

from collections.abc import Mapping
from typing import Any

from benchmark.map import needed

TABLE, REPLAY_TABLE = "watkins_q_lambda, offset", "replay_table, offset"
TILES, REPLAY_TILES = "tile_coding, offset_coordinates", "replay_tiles, offset_coordinates"
DQN, PPO = "dqn, offset_factored", "ppo, offset_factored"


def finding(tables: Mapping[str, Any]) -> str:
    """Checks every claim of the text, and returns the text, from data frames by name."""
    names = ["grid", "point", "learner"]
    cells, cpu = (tables[name].set_index(names).sort_index() for name in ("cells", "cpu"))
    contrasts = tables["contrasts"]
    two, three = cells.loc["two", "groups 128"], cells.loc["three", "groups 128"]
    many, strangers = cells.loc["two", "groups 1024"], cells.loc["strangers", "groups 128"]
    nets = contrasts[contrasts["x"].isin([DQN, PPO])].groupby("y")["verdict"]
    slower = nets.agg(lambda verdicts: (verdicts == "slower").sum())

    assert (cells[["budget", "n"]] == (60_000, 12)).all(axis=None), "60,000 steps and 12 runs"
    assert [*nets.size()] == [8] * 4, "both nets are compared with four alternatives at four points"
    for name, verdicts in nets:
        assert {*verdicts} <= {"slower", "undecided"}, f"nets against {name}: slower or undecided"
    assert slower[TABLE] == slower[REPLAY_TABLE] == 0, "no net is shown to be slower than a table"
    assert two["n_solved"][PPO] <= 6, "PPO does not learn 128 places of two in most runs"

    unseen, wrong_pings = two["unseen_budget"], two["wrong_pings"]
    seconds = cpu.loc["two", "groups 128"]["cpu_learned_s"]
    return f"""\
With 128 places for two people who talk, given their offsets from the agent, tile coding learns in
{needed(two.loc[TILES])} steps (median), a table in {needed(two.loc[TABLE])}, DQN in
{needed(two.loc[DQN])} ({two["n_solved"][DQN]} of 12 runs learn) and PPO in {needed(two.loc[PPO])}.
With 1,024 places, they need {needed(many.loc[TILES])}, {needed(many.loc[TABLE])},
{needed(many.loc[DQN])} ({many["n_solved"][DQN]} of 12) and {needed(many.loc[PPO])}. With 128 places
for three, they need {needed(three.loc[TILES])}, {needed(three.loc[TABLE])},
{needed(three.loc[DQN])} ({three["n_solved"][DQN]} of 12) and {needed(three.loc[PPO])}.

**Nets and tables.** At four points, both nets are compared with alternatives that are given
offsets, too, so in eight contrasts each. They are slower than tile coding in {slower[TILES]} and
than tile coding with replay in {slower[REPLAY_TILES]}; the others, and all with tables, are
undecided.

**Strangers.** With 128 places for two people who do not talk, tile coding needs
{needed(strangers.loc[TILES])} steps, a table {needed(strangers.loc[TABLE])}, DQN
{needed(strangers.loc[DQN])} and PPO {needed(strangers.loc[PPO])}.

**Replay.** A table that goes back over every finished episode needs {needed(two.loc[REPLAY_TABLE])}
steps with 128 places for two who talk, and {needed(many.loc[REPLAY_TABLE])} with 1,024; tile coding
with replay needs {needed(two.loc[REPLAY_TILES])} and {needed(many.loc[REPLAY_TILES])}.

**New places.** After 60,000 steps with 128 places for two who talk, success rates in places where
they never stood are {unseen[TILES]:.2f} (tile coding), {unseen[TABLE]:.2f} (table),
{unseen[DQN]:.2f} (DQN) and {unseen[PPO]:.2f} (PPO).

**Conditions and caveats.** No learner was tuned among several people: settings come from searches
with one person. Nets observe offsets as one-hot rows and columns, since several people have too
many tiles for DQN. Each learner has 12 runs per point, three with each of four picks of settings.

**Costs.** With 128 places of two who talk, learning takes {1000 * seconds[TILES]:.2g} ms of CPU
time and {wrong_pings[TILES]:,.0f} wrong PINGs with tile coding, {1000 * seconds[TABLE]:.2g} ms and
{wrong_pings[TABLE]:,.0f} with the table, and {seconds[DQN]:.2g} s and
{wrong_pings[DQN]:,.0f} with DQN (medians, not tested)."""
