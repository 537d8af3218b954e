"""Executes the missing runs of an experiment."""

import argparse
import sys
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryFile

from benchmark.analysis.frames import Group, tables
from benchmark.analysis.records import check_scores
from benchmark.commands import parse_jobs, parse_seeds
from benchmark.execution import driver
from benchmark.execution.machine import usable_cores
from benchmark.execution.progress import Display, estimate
from benchmark.execution.store import Store
from benchmark.experiments import RunSpecification, all_specifications, load_experiment
from benchmark.studies import report_of, runs_of
from envs import InputError
from envs.packages import needed_by


def main(options: argparse.Namespace) -> int:
    """Runs the command; returns the exit code."""
    parse_jobs(options.jobs)
    experiment = load_experiment(options.experiment, smoke=options.smoke)
    name, seeds = experiment.name, parse_seeds(options.seeds)
    report = report_of(experiment).check(is_drawn=options.report)
    has_stages = report.study.stages is not None
    ranges = [each.seeds for each in experiment.populations] if seeds is None else [seeds]
    if options.report and min(map(len, ranges)) < 2 and experiment.declared.search is None:
        raise InputError("--report: one seed gives no interval; accepted: at least two for every variant.")
    check_scores(all_specifications(experiment, seeds))
    if options.log is not None:
        _check_log(options)
    with Store(options.results / "runs.db") as store:
        for stage, groups in enumerate(report.stages(store, seeds), start=1):
            runs = runs_of(groups)
            if options.log is not None:
                runs = [replace(run, log=str(options.log.absolute() / run.folder)) for run in runs]
            label = f"{name}, stage {stage}" if has_stages else name
            if code := _execute(label, runs, store, options):
                return code
            if options.log is not None:
                _log_curves(groups, store, options.log)
    return 0


def _execute(name: str, runs: Sequence[RunSpecification], store: Store, options: argparse.Namespace) -> int:
    """Executes the missing runs when no other command trains, and says how many; returns the exit code."""
    if n_damaged := store.discard_damaged(run.digest for run in runs):
        print(f"{name}: repeating runs whose records are damaged: {n_damaged}.", file=sys.stderr)
    with ExitStack() as stack:
        if driver.pending(runs, store):
            stack.enter_context(store.alone())
        todo = driver.pending(runs, store)  # another command may have trained some meanwhile
        n_done = len(runs) - len(todo)
        if not todo:
            print(f"{name}: all {len(runs)} runs are done already.")
            return 0
        jobs, cluster = parse_jobs(options.jobs), None
        if options.cluster is not None:
            with needed_by("--cluster"):
                from benchmark.execution.executors.cluster import Cluster
            cluster = Cluster(options.cluster, {run.algorithm for run in todo})
            stack.callback(cluster.cancel)
            jobs = jobs if options.jobs else 2 * cluster.workers  # a worker finds its next job waiting
        folder = options.results / Path(options.experiment).stem
        workers = cluster.workers if cluster else min(jobs, usable_cores())
        how_long, costs = estimate(todo, folder, workers)
        kept = "Ctrl-C keeps what is finished"
        print(f"{name}: {len(todo):,} runs to train, {how_long} ({kept}).", file=sys.stderr)
        with Display(name, costs, n_done) as display:
            errors = driver.run(runs, store, jobs, display.advance, cluster)
    if errors:
        failed = f"{len(errors)} runs failed; the same command tries them again. First error: {errors[0]}"
        print(f"error: {failed}", file=sys.stderr)
        return 1
    statuses = store.statuses()
    n_diverged = sum(statuses[run.digest] == "diverged" for run in todo)
    which = f", {n_diverged} of them diverged" if n_diverged else ""
    print(f"{name}: {len(todo)} runs done{which}, {n_done} were done already.")
    return 0


def _check_log(options: argparse.Namespace) -> None:
    """Refuses logs on a cluster, in a folder that cannot be written, and without Stable-Baselines3."""
    if options.cluster is not None:
        raise InputError("--log: not accepted with --cluster, whose workers may be on other machines.")
    with needed_by("--log"):
        import agents.sb3.training  # noqa: F401
    options.log.mkdir(parents=True, exist_ok=True)
    TemporaryFile(dir=options.log).close()


def _log_curves(groups: Iterable[Group], store: Store, folder: Path) -> None:
    """Logs the evaluations of each run, even if it was trained earlier."""
    from agents.sb3.training import log_curve

    for group in groups:
        curves = tables([group], store, ["success", "score", "training_wrong_pings"])[1].set_index("step")
        for run, (_, rows) in zip(group.runs, curves.groupby("seed", sort=False), strict=True):
            values = rows.loc[:, "seed":].drop(columns="seed").add_prefix("eval/")
            log_curve(str(folder / run.folder / "eval"), values.to_dict("index"))
