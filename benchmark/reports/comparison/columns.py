"""What readers call the columns of a comparison's tables, and what these mean."""

from functools import partial
from typing import Final

from benchmark.analysis.contrasts import NEITHER, VERDICTS
from benchmark.reports.item import labelled_columns

ENDPOINTS: Final = ("success", "score")  # in the order in which they count
CELL: Final = "scenario condition learner"
DIFFERENCES: Final = "success_difference score_difference wrong_pings_difference"
EFFORT: Final = "settings_tried search_steps search_cpu_s"
WORDS: Final = {verdict: verdict for verdict in VERDICTS} | {NEITHER: "neither is shown to beat random"}
RATE: Final = "wrong PINGs per 1,000 steps of the whole training"
_LABELS: Final = {
    "budget": "steps of training",
    "cpu_time_s": "CPU time (s)",
    "every_cell_success": "success from any cell",
    "final_success": "final mean",
    "greedy_success": "of the greedy policy",
    "median_step": "median step of runs",
    "memoryless_return": "best return of a memoryless policy found",
    "memoryless_success": "success of that policy",
    "n": "runs",
    "peak_memory_mb": "peak memory (MB)",
    "score": "score, clipped",
    "score_difference": "difference in score",
    "score_verdict": "verdict on score",
    "search_cpu_s": "CPU seconds of the search",
    "search_steps": "steps of the search",
    "share": "share of runs",
    "step": "step of the mean over runs",
    "steps_per_cpu_s": "steps per CPU second",
    "success": "success probability",
    "success_difference": "difference in success",
    "success_except": "not in",
    "success_p_different": "p, no difference",
    "success_p_equivalent": "p, not equivalent",
    "success_verdict": "verdict on success",
    "training_wrong_pings": "wrong PINGs per 1,000 steps of training",
    "unbounded_score": "score without bounds",
    "wrong_pings": "wrong PINGs",
    "wrong_pings_difference": "difference in wrong PINGs",
}
columns: Final = partial(labelled_columns, _LABELS)
MEANINGS: Final = {
    "cells": "cells of the grid",
    "cells_marked": "cells in which PING is valued above 0, or, of a stochastic policy, the likeliest action",
    "cpu_time_s": "CPU seconds of training, median over runs",
    "cpu_time_s_max": "CPU seconds of the slowest run",
    "cpu_time_s_min": "CPU seconds of the fastest run",
    "description": "what the scenario is about",
    "diverged": "runs whose policy was no longer finite at some evaluation",
    "diverged_at": "first evaluation step at which the policy was no longer finite; inf if it always was",
    "effect": "what differs between x and y",
    "final_success": "success after training, mean over runs",
    "greedy_success": "success of the greedy policy, whichever policy counts",
    "hidden": "what varies and is not observed",
    "iqm": "interquartile mean of the unbounded scores of all runs and scenarios (rliable)",
    "kind": "table, tile coding, linear, net or other",
    "knowledge": "what is observed: cells, or the offset to the person",
    "learners": "learners of the class, the best of which this is",
    "memoryless_return": "best return of a policy over observations that the planner has found",
    "memoryless_score": "that return as a score",
    "memoryless_success": "success of that policy",
    "observations": "number of observations",
    "observed": "what is observed",
    "optimal_return": "expected return of the optimal policy of an agent that knows the state",
    "outcome": "what the contrasts with the baselines come to, see README",
    "p_random": "p-value of succeeding no more often than the random policy; of contrasts, adjusted",
    "parameters": "learned parameters",
    "peak_memory_mb": "peak memory of the process in MB, median over runs",
    "policy": "the evaluated policy, greedy or stochastic",
    "random_return": "expected return of the random policy",
    "random_success": "success of the random policy, exact",
    "region_overlap": "cells both marked and in the target region, per cell that is either",
    "restarts": "searches of the planner, each from a random start",
    "runs": "runs, over all scenarios",
    "search_cpu_s": "CPU seconds of the search for its settings; 0 without a search",
    "search_steps": "environment steps of the search for its settings; 0 without a search",
    "seed": "seed of the run",
    "settings_tried": "trials of the search for its settings; 0 without a search",
    "states": "number of states",
    "steps": "expected steps of an episode after training",
    "steps_per_cpu_s": "environment steps of training per CPU second",
    "target_cells_marked": "marked cells that are in the target region",
    "training_wrong_pings": RATE,
    "uncomfortable_steps": "expected steps of an episode in the uncomfortable region",
    "updates": "updates of a table, or gradient steps of a net, median over runs",
    "wrong_pings": "expected wrong PINGs of an episode after training",
}
