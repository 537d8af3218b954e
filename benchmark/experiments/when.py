"""What `when` has shown: which learners need fewer steps, given which input."""

from collections.abc import Mapping
from typing import Any

from benchmark.map import needed

TABLE, REPLAY_TABLE = "watkins_q_lambda, index", "replay_table, index"
TILES, REPLAY_TILES = "tile_coding, coordinates", "replay_tiles, coordinates"
DQN, PPO, FACTORED_PPO = "dqn, coordinates", "ppo, centred", "ppo, factored"
OFFSET_TABLE, REPLAY_OFFSET_TABLE = "watkins_q_lambda, offset", "replay_table, offset"
OFFSET_TILES = "tile_coding, offset_coordinates"
REPLAY_OFFSET_TILES = "replay_tiles, offset_coordinates"
OFFSET_DQN, OFFSET_PPO = "dqn, offset_tiles", "ppo, offset_factored"
PLAIN_OFFSET_DQN, PLAIN_OFFSET_PPO = "dqn, offset_coordinates", "ppo, offset_coordinates"
FACTORED_OFFSET_DQN = "dqn, offset_factored"
LINEAR_DQN, LINEAR_Q = "dqn_linear, offset_factored", "linear_q_lambda, offset_factored"
TILED_LINEAR_DQN, TILED_LINEAR_Q = "dqn_linear, offset_tiles", "linear_q_lambda, offset_tiles"
CELL_LINEAR_DQN, CELL_LINEAR_Q = "dqn_linear, tiles", "linear_q_lambda, tiles"
NETS, OFFSET_NETS = [DQN, PPO, FACTORED_PPO], [OFFSET_DQN, OFFSET_PPO]

# What the text says of contrasts at the point with 64 places
EXPECTED = {
    "faster": [
        (OFFSET_DQN, PLAIN_OFFSET_DQN),
        (REPLAY_TABLE, TABLE),
        (OFFSET_DQN, TILED_LINEAR_DQN),
        (TILES, TABLE),
        (OFFSET_TILES, OFFSET_TABLE),
    ],
    "slower": [
        (TILED_LINEAR_DQN, TILED_LINEAR_Q),
        (OFFSET_PPO, OFFSET_TILES),
        (CELL_LINEAR_DQN, CELL_LINEAR_Q),
    ],
    "undecided": [
        (OFFSET_PPO, PLAIN_OFFSET_PPO),
        (OFFSET_DQN, OFFSET_TABLE),
        (OFFSET_PPO, OFFSET_TABLE),
        (OFFSET_DQN, OFFSET_TILES),
        (FACTORED_OFFSET_DQN, LINEAR_DQN),
        (LINEAR_DQN, LINEAR_Q),
    ],
}


def finding(tables: Mapping[str, Any]) -> str:
    """Checks every claim of the text, and returns the text, from data frames by name."""
    cells, cpu = (
        tables[name].set_index(["grid", "point", "learner"]).sort_index()
        for name in ("cells", "cpu")
    )
    contrasts = tables["contrasts"]
    of_map = contrasts[contrasts["grid"].isin(["places", "rooms", "feedback"])]  # each point once
    here, seconds = cells.loc["forms", "places 64"], cpu.loc["forms", "places 64"]["cpu_time_s"]
    compared = contrasts[(contrasts["grid"] == "forms") & (contrasts["point"] == "places 64")]
    decided = compared.set_index(["x", "y"]).sort_index()

    main = cells.loc[["places", "rooms", "feedback", "forms"]]
    assert (main[["n", "budget"]] == (16, 60_000)).all(axis=None), "16 runs of 60,000 steps"
    for verdict, pairs in EXPECTED.items():
        for pair in pairs:
            assert decided.loc[pair, "verdict"] == verdict, f"{' against '.join(pair)}: {verdict}"
    failures = decided["failures_verdict"]
    others = [TABLE, REPLAY_TABLE, TILES, REPLAY_TILES]
    assert all(failures[DQN, y] == "faster" for y in others), "given cells, DQN fails less often"
    assert failures[OFFSET_PPO, OFFSET_TILES] == "slower", "given offsets, PPO fails more often"
    assert failures[OFFSET_DQN, OFFSET_TILES] == "undecided", "DQN's failures are undecided"
    nets = of_map[of_map["x"].isin(NETS + OFFSET_NETS)]
    beaten = {*nets[nets["verdict"] == "faster"]["y"]}
    assert beaten == {TABLE}, "nets learn faster only than the table of cells without replay"
    assert not here.loc[["dqn, factored", FACTORED_PPO], "n_solved"].any(), "no net learns these"
    assert here["unseen_budget"][[TABLE, REPLAY_TABLE]].nunique() == 1, "tables act at random there"

    def steps(learner: str) -> str:
        return needed(here.loc[learner])

    def count(x: list[str], y: str, verdict: str) -> int:
        rows = of_map[of_map["x"].isin(x) & (of_map["y"] == y)]
        return int((rows["verdict"] == verdict).sum())

    unseen, shuffled = here["unseen_budget"].map("{:.2f}".format), cells.loc["code", "permuted 100"]
    few, wrong_pings = cells.loc["unseen", "places 4"]["unseen_budget"], here["disagreements"]
    beside = cells.loc["reference", "room 10x12, places 16"]
    return f"""\
**Features:** with 64 places, given the person's offset from the agent, DQN learns faster with tiles
({steps(OFFSET_DQN)} steps, median) than with coordinates ({steps(PLAIN_OFFSET_DQN)}); PPO needs
{steps(OFFSET_PPO)} with one-hot rows and columns and {steps(PLAIN_OFFSET_PPO)} with coordinates
(undecided). **Replay:** given both cells, a table learns faster with replay ({steps(REPLAY_TABLE)})
than without ({steps(TABLE)}). **Depth:** with the same tiles of offsets, DQN reaches a success rate
of 0.9 faster with hidden layers ({steps(OFFSET_DQN)}) than without ({steps(TILED_LINEAR_DQN)}),
which says nothing about lower rates; linear Q(λ) needs {steps(TILED_LINEAR_Q)}. **Nets and
tables:** given offsets, tile coding ({steps(OFFSET_TILES)}) learns faster than a table
({steps(OFFSET_TABLE)}) and PPO; undecided: tile coding against DQN, nets against the table. **New
places:** given both cells, after 60,000 steps, DQN succeeds more often where the person never stood
({unseen[DQN]}) than tile coding ({unseen[TILES]}; other settings, tried later, come much closer) or
a table ({unseen[TABLE]}, the rate of the random policy).

**What replay does.** A learner with replay goes through every finished episode again. Over all
points, a table learns faster with replay than without in {count([REPLAY_TABLE], TABLE, "faster")}
contrasts given cells and in {count([REPLAY_OFFSET_TABLE], OFFSET_TABLE, "faster")} given offsets,
and tile coding in {count([REPLAY_TILES], TILES, "faster")} and
{count([REPLAY_OFFSET_TILES], OFFSET_TILES, "faster")}; the others are undecided.

**What depth does.** Given offsets as one-hot rows and columns, DQN, linear DQN and linear Q(λ) need
{steps(FACTORED_OFFSET_DQN)}, {steps(LINEAR_DQN)} and {steps(LINEAR_Q)} steps (undecided). Given
cells as tiles, linear Q(λ) needs {steps(CELL_LINEAR_Q)} and linear DQN {steps(CELL_LINEAR_DQN)},
while DQN learns from coordinates in {steps(DQN)}. No net learns from one-hot rows and columns of
cells.

**Nets and tables.** At {of_map["point"].groupby(of_map["grid"]).nunique().sum()} points, nets with
their best forms of input are compared with alternatives that are given the same cells or offsets,
in other forms. Given offsets, DQN and PPO are slower than a table in
{count(OFFSET_NETS, OFFSET_TABLE, "slower")} contrasts
({count(OFFSET_NETS, OFFSET_TABLE, "undecided")} undecided) and than tile coding in
{count(OFFSET_NETS, OFFSET_TILES, "slower")}. Given cells, DQN and two forms of PPO are faster than
a table in {count(NETS, TABLE, "faster")} and slower in {count(NETS, TABLE, "slower")}; they are
slower than a table with replay in {count(NETS, REPLAY_TABLE, "slower")} and than tile coding in
{count(NETS, TILES, "slower")}. No net is shown to be faster than a table with replay or than tile
coding at any point. With 16 pairs of runs, a contrast is decided only if nearly all pairs agree.

**Unseen places.** After 64 places, given offsets, success is {unseen[OFFSET_TILES]} with tile
coding, {unseen[OFFSET_DQN]} with DQN (undecided), {unseen[OFFSET_PPO]} with PPO, which fails more
often than tile coding, and {unseen[OFFSET_TABLE]} with a table. After 4 places, it is
{few[OFFSET_TILES]:.2f} with tile coding and {few[OFFSET_DQN]:.2f} with DQN given offsets, and
{few[DQN]:.2f} with DQN given cells. To overturn the verdict on tile coding given cells, 96 other
settings were tried by hand later (8 runs each, not published): the best has 0.84 there, which is
biased upwards, since it was picked by this number.

**A control.** If coordinates of the 64 places are shuffled, near places no longer have near
coordinates. Then tile coding needs {needed(shuffled.loc[TILES])} steps, and DQN
{needed(shuffled.loc[DQN])}.

**Conditions and caveats.** Each learner has 16 runs per point, four with each of four picks of
settings. DQN and PPO have at most two layers of 128 units. Settings known before this search may be
better than its picks (not tested): tile coding needs {steps("tile_coding_earlier, coordinates")}
steps with them, given cells, DQN {steps("dqn_earlier, coordinates")}. With 16 places, given
offsets, Stable-Baselines3's DQN (8 runs) needs {needed(beside.loc["sb3_dqn, offset_tiles"])} steps
(compiled: {needed(beside.loc[OFFSET_DQN])}), its PPO
{needed(beside.loc["sb3_ppo, offset_factored"])} (compiled: {needed(beside.loc[OFFSET_PPO])}).

**Costs.** Learning 64 places given offsets takes {1000 * seconds[OFFSET_TABLE]:.2g} ms of CPU time
and {wrong_pings[OFFSET_TABLE]:.0f} wrong PINGs with a table, {1000 * seconds[OFFSET_TILES]:.2g} ms
and {wrong_pings[OFFSET_TILES]:.0f} with tile coding, {1000 * seconds[OFFSET_PPO]:.2g} ms and
{wrong_pings[OFFSET_PPO]:.0f} with PPO, and {seconds[OFFSET_DQN]:.2g} s and
{wrong_pings[OFFSET_DQN]:.0f} with DQN (medians, not tested)."""
