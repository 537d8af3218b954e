"""What the columns of published tables mean, by kind of report: the only place that says so.

A column that is not listed is another one with an affix, see `AFFIXES`: `success_low` belongs to `success`.
"""

import re
from collections.abc import Mapping
from typing import Final

# Of all reports.
_EVERYWHERE: Final[Mapping[str, str]] = {
    "algorithm": "variant: an algorithm with settings, as the experiment names it",
    "budget": "environment steps of training",
    "condition": "named changes of scenario and settings",
    "n": "runs",
    "observation": "form of observation",
    "scenario": "scenario",
    "success": "probability that an episode ends with a PING in the target region",
    "unbounded_score": "score that may lie outside [0, 1]: the return, with 0 for the random and 1 for the "
    "optimal policy",
    "x": "the learner, scenario or condition that is compared",
    "y": "what it is compared with",
}

# By kind of report, a column of all its tables, or TABLE.COLUMN; `*` is any other column.
_BY_REPORT: Final[Mapping[str, Mapping[str, str]]] = {
    "comparison": {
        "ahead.first_step": "first evaluation step at which x is ahead, that is, the 95 % interval of the "
        "difference in mean success, not adjusted, lies above 0; inf if it never is",
        "ahead.largest_at": "evaluation step of the largest difference in mean success",
        "ahead.largest_difference": "largest difference in mean success, x minus y",
        "ahead.largest": "mean success at the step of the largest difference",
        "ahead.last_step": "last evaluation step at which x is ahead; inf if it never is",
        "ahead.n": "runs of x or y, the smaller number",
        "ahead.steps_ahead": "number of evaluation steps at which x is ahead",
        "cells_marked": "cells in which the action value of PING is above 0, or, of a stochastic policy, "
        "PING is the likeliest action; mean over runs",
        "classes.kind": "table or net",
        "classes.learner": "the learner of this class with the largest `search_area`",
        "classes.search_area": "mean area under its curve of success on fresh runs of the search",
        "classes.sees": "whether it observes cells or the offset",
        "cost.cpu_time_s": "CPU seconds of training, median over runs",
        "cost.cpu_time_s_max": "CPU seconds of the slowest run",
        "cost.cpu_time_s_min": "CPU seconds of the fastest run",
        "cost.parameters": "learned parameters",
        "cost.peak_memory_mb": "peak memory of the process in MB, median over runs",
        "cost.steps_per_cpu_s": "environment steps of training per CPU second",
        "cost.updates": "updates of a table, or gradient steps of a net, median over runs",
        "curves.wrong_pings": "wrong PINGs per 1,000 steps of training since the evaluation before",
        "diverged": "runs whose policy was no longer finite at some evaluation",
        "diverged_at": "first evaluation step at which the policy was no longer finite; inf if it always was",
        "effect": "what differs between x and y",
        "greedy_success": "success of the greedy policy, whichever policy counts",
        "iqm": "interquartile mean of the unbounded scores of all runs and scenarios",
        "contrasts.n": "runs per scenario, the smallest number",
        "contrasts.p_random": "p-value of not succeeding more often than the random policy, adjusted as "
        "declared",
        "p_random": "p-value of not succeeding more often than the random policy",
        "policy": "the evaluated policy, greedy or stochastic",
        "random_success": "success of the random policy, exact",
        "region.n_marking": "runs that mark at least one cell",
        "region.overlap": "cells both marked and in the target region, per cell that is either, mean over "
        "runs",
        "region.precision": "share of the marked cells that is in the target region, mean over runs that "
        "mark any",
        "region.recall": "share of the target region that is marked, mean over runs",
        "region_overlap": "cells both marked and in the target region, per cell that is either",
        "runs": "runs, over all scenarios",
        "scenarios.cells": "cells of the grid",
        "scenarios.description": "what the scenario is about",
        "scenarios.hidden": "what varies and is not observed",
        "scenarios.memoryless_return": "best return of a policy over observations that the planner has found",
        "scenarios.memoryless_score": "that return as a score",
        "scenarios.memoryless_success": "success of that policy",
        "scenarios.observations": "number of observations",
        "scenarios.observed": "what is observed",
        "scenarios.optimal_return": "expected return of the optimal policy of an agent that knows the state",
        "scenarios.random_return": "expected return of the random policy",
        "scenarios.restarts": "searches of the planner, each from a random start",
        "scenarios.states": "number of states",
        "score": "return, with 0 for the random and 1 for the optimal policy, clipped to [0, 1]",
        "search_cpu_s": "CPU seconds of the search for its settings; 0 without a search",
        "search_steps": "environment steps of the search for its settings; 0 without a search",
        "seed": "seed of the run",
        "settings_tried": "trials of the search for its settings; 0 without a search",
        "speedups.ratio": "steps of y divided by those of x; where half of the runs never learn, their "
        "budget "
        "counts, and the ratio is a bound",
        "speedups.step": "median step of runs from which success stays at or above 0.9; inf if most never "
        "learn",
        "step": "environment steps of training so far",
        "steps": "expected steps of an episode after training",
        "steps.below_at": "last evaluation before `step`; empty if there is none",
        "steps.final_success": "success after training, mean over runs",
        "steps.median_step": "median over runs of the evaluation step from which success stays at or above "
        "0.9; "
        "inf if most never reach it",
        "steps.share": "share of runs whose success stays at or above 0.9",
        "steps.step": "evaluation step from which the mean success over runs stays at or above 0.9; inf if "
        "there "
        "is none",
        "target_cells_marked": "marked cells that are in the target region",
        "training_wrong_pings": "wrong PINGs per 1,000 steps of the whole training",
        "scores.training_wrong_pings": "wrong PINGs of the whole training",
        "uncomfortable_steps": "expected steps of an episode in the uncomfortable region",
        "wrong_pings": "expected wrong PINGs of an episode after training",
        "contrasts.wrong_pings": "wrong PINGs per 1,000 steps of the whole training",
        "effects.wrong_pings": "wrong PINGs per 1,000 steps of the whole training",
        "verdicts.better": "contrasts with this verdict",
        "verdicts.equivalent": "contrasts with this verdict",
        "verdicts.mixed": "contrasts with this verdict",
        "verdicts.n": "contrasts",
        "verdicts.no verdict": "contrasts with this verdict",
        "verdicts.undecided": "contrasts with this verdict",
        "verdicts.worse": "contrasts with this verdict",
    },
    "map": {
        "columns": "columns of the room",
        "contrasts": "contrasts that ended with so many pairs of runs",
        "cpu_time_s": "CPU seconds of training until a run has solved its scenario, median; inf if most "
        "never do",
        "disagreements": "wrong PINGs until a run has solved its scenario, median; inf if most never do",
        "equally fast": "contrasts with this verdict",
        "faster": "probability that a run of x needs fewer steps than one of y; its interval holds for all "
        "contrasts and looks at once",
        "grid": "grid of the experiment",
        "looks.faster": "contrasts with this verdict",
        "looks.n": "pairs of runs",
        "contrasts.n": "pairs of runs",
        "learner": "variant and form of observation",
        "measures.covering_steps": "steps in which the random policy has tried nine tenths of what it can "
        "reach",
        "measures.solvable_k": "smallest k for which the scenario is k-QVI-solvable",
        "n_solved": "runs that solve their scenario",
        "budget too short": "contrasts with this verdict",
        "feedback": "kind of the issuer's feedback",
        "neither learns": "contrasts with this verdict",
        "noise": "half the width of the interval from which the noise of feedback is drawn; 0 without",
        "permuted": "share of the issuer's cells whose coordinates are permuted",
        "places": "cells in which the issuer may stand",
        "point": "point of the grid",
        "ratio": "median steps of y divided by those of x; where one never solves, its budget counts",
        "ratio_disagreements": "the same of wrong PINGs",
        "reference.faster": "probability that a run of x needs fewer steps than one of y",
        "reference.n": "runs of x",
        "reference.n_reference": "runs of y, the reference implementation",
        "reference.steps": "steps until a run of x has solved its scenario, median; inf if most never do",
        "reference.steps_reference": "the same of y",
        "rows": "rows of the room",
        "run": "number of the run, from 0, in the order of seeds",
        "runs.disagreements": "wrong PINGs until the run has solved its scenario; empty if it never does",
        "runs.steps": "steps until the run has solved its scenario; empty if it never does",
        "pairs.steps": "steps until the run has solved its scenario, within the smaller budget; empty if it "
        "does not",
        "slower": "contrasts with this verdict",
        "solved": "share of runs that solve their scenario",
        "steps": "steps until a run has solved its scenario, median; inf if most never do",
        "success": "success at the end of training, mean over runs",
        "undecided": "contrasts with this verdict",
        "unseen": "further cells of the issuer, never met in training",
        "unseen_success": "success with the issuer in these cells, mean over runs; empty without any",
        "verdict": "verdict on x",
    },
    "replication": {
        "agents": "agents per scenario",
        "action": "action",
        "agents_needed": "agents that would decide an undecided part with a probability of 80 %, if its "
        "effect is "
        "the true one",
        "cells_differing": "share of cells in which a greedy action is not optimal, mean over agents",
        "claim": "claim of the paper",
        "column": "column of the cell",
        "difference": "`mean` minus `optimal`",
        "differs": "share of agents whose greedy action in the cell is not optimal",
        "drawn": "what the paper's figure shows instead of `value`",
        "effect": "distance from the threshold in standard deviations of a single agent, positive where "
        "the claim "
        "says",
        "first_seed": "seed of the first agent",
        "grid_return": "expected sum of the grid's rewards of an episode",
        "high": "upper end of the 95 % interval of `value`",
        "is_optimal": "whether the action is optimal in the cell",
        "largest_learned": "largest Q in the cell, mean over agents",
        "last_seed": "seed of the last agent",
        "low": "lower end of the 95 % interval of `value`",
        "max": "largest over agents",
        "mean": "mean over agents: in `max_q`, of the largest Q of the visited cell; in `q_values`, of the "
        "final Q",
        "min": "smallest over agents",
        "note": "more about the part",
        "optimal": "optimal action value",
        "optimal_share": "share of agents whose greedy policy is optimal",
        "part": "which number of the claim",
        "reading": "reading of the paper",
        "right_side": "on which side of the threshold the part must lie",
        "row": "row of the cell",
        "scenario_return": "expected sum of all rewards of an episode, with the issuer's",
        "score": "return, with 0 for the random and 1 for the optimal policy, clipped to [0, 1], mean over "
        "agents",
        "sets": "disjoint sets of as many agents as the paper has",
        "sets_agreeing": "sets with the same verdict on the claim",
        "share": "`sets_agreeing` / `sets`",
        "start_value_learned": "largest Q in the start cell, mean over agents",
        "start_value_optimal": "optimal value of the start cell",
        "state": "whether the part passes, fails or is undecided",
        "std": "standard deviation over agents",
        "step": "environment steps of training so far",
        "success": "probability that an episode ends with a PING in the target region, mean over agents",
        "table_max": "largest over agents of the largest Q of the whole table",
        "table_mean": "mean over agents of the largest Q of the whole table",
        "table_min": "smallest over agents of the largest Q of the whole table",
        "threshold": "threshold",
        "value": "the number",
        "verdict": "verdict on the claim",
    },
    "search": {
        "area": "mean area under the curve of success, over scenarios and the first runs",
        "around.area": "mean area under the curve of success, over scenarios and runs of their own",
        "around.difference": "area minus that of the chosen settings",
        "around.n": "runs, over all scenarios",
        "around.value": "value of that setting",
        "best_of.steps": "environment steps of these trials",
        "best_of.trials": "number of trials, b",
        "chosen": "mean area of the chosen settings, on fresh runs",
        "cost.cpu_ms": "CPU milliseconds of training per run of the search",
        "cost.cpu_time_s": "CPU seconds of training, sum over all runs of the search",
        "cost.runs": "runs of the search",
        "cost.steps": "environment steps of all runs of the search",
        "cost.trials": "trials, without trial 0",
        "default": "mean area of the default settings, on fresh runs",
        "expected": "expected area of the best of b trials",
        "found": "mean area of the best trial on its first runs",
        "fresh_area": "the same on fresh runs; empty if the trial was not run again",
        "gain": "`chosen` minus `default`",
        "per_scenario": "mean area if the best trial could be chosen in each scenario",
        "range": "declared range",
        "sensitivity": "`per_scenario` minus `chosen`",
        "setting": "setting, by dotted key",
        "settings": "settings that the trial changes, as JSON",
        "share": "share of the variance between trials that is due to this setting by itself, by "
        "functional ANOVA",
        "spaces.default": "default value",
        "trial": "number of the trial; 0 has the default settings",
        "trials.*": "mean area in the scenario of this name, on the first runs",
        "why": "the reason for the range",
    },
    "speed": {
        "against": "the alternative",
        "baseline": "units per second of the alternative",
        "name": "what is measured",
        "of_limit": "share of the speed that products of matrices alone would allow; empty where it does "
        "not apply",
        "per_second": "units per second of this project",
        "ratio": "`per_second` / `baseline`",
        "unit": "what is counted",
    },
}

# What a name is made of besides that of another column, `{name}`, which means `{base}`; and what it means.
AFFIXES: Final[Mapping[str, str]] = {
    "(.+)_low": "lower end of the 95 % interval of `{name}`",
    "(.+)_high": "upper end of the 95 % interval of `{name}`",
    "(.+)_low_90": "lower end of the 90 % interval of `{name}`",
    "(.+)_high_90": "upper end of the 90 % interval of `{name}`",
    "every_cell_(.+)": "{base}, of episodes that start in any cell",
    "(.+)_x|x_(.+)": "{base}, of x",
    "(.+)_y|y_(.+)": "{base}, of y",
    "(.+)_difference": "`{name}` of x minus that of y",
    "(.+)_p_different": "p-value of no difference in `{name}`, adjusted as declared",
    "(.+)_p_equivalent": "p-value of a difference in `{name}` of at least the margin, adjusted as declared",
    "(.+)_verdict": "verdict on x, by `{name}`",
    "(.+)_margin": "difference in `{name}` that is too small to matter",
    "(.+)_largest": "largest difference in `{name}` in a scenario, x minus y",
    "(.+)_except": "scenarios that contradict the verdict by `{name}`, or for which it is not shown "
    "separately",
    "(.+)_random": "{base}, by the random policy",
    "(.+)_optimal": "{base}, by the optimal policy",
    "(.+)_learned": "{base}, by the greedy policy after training, mean over agents",
    "(.+)_regret": "`{name}_optimal` minus `{name}_learned`",
}


def meaning(report: str, table: str, column: str) -> str | None:
    """Returns what a column of a table means, in a report of this name; None if nothing says so.

    >>> meaning("comparison", "summary", "every_cell_success_low")
    'lower end of the 95 % interval of `every_cell_success`'
    """
    known = {**_EVERYWHERE, **_BY_REPORT.get(report, {})}
    for key in (f"{table}.{column}", column):
        if key in known:
            return known[key]
    for pattern, text in AFFIXES.items():
        if found := re.fullmatch(pattern, column):
            name = next(filter(None, found.groups()))
            if base := meaning(report, table, name):
                return text.format(name=name, base=base)
    return known.get(f"{table}.*")
