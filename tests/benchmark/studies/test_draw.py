"""Folders of results: what is in them, that drawing again gives the same, and what marks them."""

import hashlib
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from benchmark.execution.store import Record, Store
from benchmark.experiments import Experiment, all_specifications
from benchmark.experiments.search import Chosen
from benchmark.folder import SCORES
from benchmark.publish import document, draw
from benchmark.publish.document import Document
from benchmark.studies import report_of
from benchmark.studies.comparison.analysis import ComparisonAnalysis
from envs import InputError
from tests.benchmark.execution.test_processes import PATIENCE_S, until
from tests.benchmark.studies.conftest import EXPERIMENT, Drawn, experiment_of, trained
from tests.support import ROOT, mistyped_columns, specifications

PUBLISHED = [
    path.parent
    for path in sorted((ROOT / "results").glob("*/manifest.json"))
    if json.loads(path.read_text())["report"]["kind"] == "comparison"
]


def without(path: Path, *names: str, text: str = EXPERIMENT, **reporting: object) -> Experiment:
    """Loads the experiment without some algorithms, and with other keys in its report."""
    text = f'stream = "small"\n{text}'
    for name in names:
        text = re.sub(rf"^{name} = .*\n|^\[algorithms.{name}\]\n(.+\n)*", "", text, flags=re.MULTILINE)
    for key, value in reporting.items():
        text = re.sub(rf"^{key} = .*$", f"{key} = {json.dumps(value)}", text, flags=re.MULTILINE)
    return experiment_of(path / "changed.toml", text)


def analysis_of(experiment: Experiment, store: Store) -> ComparisonAnalysis:
    report = report_of(experiment)
    found: ComparisonAnalysis = report.study.analyse(report.data(store))
    return found


@pytest.mark.slow
def test_killed_report_leaves_no_process_behind(drawn: Drawn, tmp_path: Path) -> None:
    for name in ("small.toml", "runs.db"):
        shutil.copy(drawn.results / name, tmp_path)
    arguments = ["report", str(tmp_path / "small.toml"), "--results", str(tmp_path)]
    process = subprocess.Popen(
        [sys.executable, "-m", "benchmark", *arguments],
        cwd=ROOT,
        stdout=subprocess.PIPE,  # whatever it starts has it, too
    )
    until(lambda: [*tmp_path.glob(".small.making/*.csv")])
    assert process.poll() is None
    process.kill()
    process.communicate(timeout=PATIENCE_S)  # returns when none of them is left


def test_folder_has_what_items_say_and_readers_infer_the_types_of_all_columns(drawn: Drawn) -> None:
    names = {path.name for path in drawn.folder.iterdir()}
    drawn_names = ["contrasts", "summary", "curves", "rliable"]
    tables = [*drawn_names, "aggregate", "outcomes", "steps", "cost"]
    expected = {f"{name}.csv" for name in tables} | {f"{name}.svg" for name in (*drawn_names, "profiles")}
    assert names == expected | {"README.md", "manifest.json", SCORES}
    assert [mistyped_columns(drawn.folder / f"{name}.csv") for name in tables] == [[]] * len(tables)
    assert mistyped_columns(drawn.folder / SCORES) == []
    scores = pd.read_csv(drawn.folder / SCORES)
    assert len(scores) == len(all_specifications(drawn.experiment))
    assert scores["score"].between(0, 1).all()
    assert (scores["policy"] == "stochastic").equals(scores["variant"] == "ppo")
    readme = (drawn.folder / "README.md").read_text(encoding="utf-8")
    for name in expected | {SCORES}:
        assert f"| {name.removesuffix('.svg').removesuffix('.csv')}" in readme, name
    manifest = json.loads((drawn.folder / "manifest.json").read_text())
    digests = sorted(run.digest for run in all_specifications(drawn.experiment))
    assert manifest["digest"] == hashlib.sha256("".join(digests).encode()).hexdigest()
    assert manifest["algorithms"]["check"]["reference_for"] == "table"


def test_two_learners_with_the_same_title_are_refused(tmp_path: Path) -> None:
    text = EXPERIMENT.replace("sarsa = { ", 'sarsa = { title = "check on the cells\' index", ')
    with pytest.raises(
        InputError, match='"check on the cells\' index" is the name of sarsa, index and of check, index; '
    ):
        experiment_of(tmp_path / "twice.toml", text)


def test_checks_have_rows_but_no_verdicts(drawn: Drawn) -> None:
    for name in ("summary", "aggregate", "curves", "cost"):
        assert "check" in {*pd.read_csv(drawn.folder / f"{name}.csv")["variant"]}, name
    summary = pd.read_csv(drawn.folder / "summary.csv")
    assert [*summary["variant"].unique()] == ["table", "check", "sarsa", "ppo", "net"]
    with Store(drawn.results / "runs.db", read_only=True) as store:
        assert analysis_of(drawn.experiment, store).plan.drawn == ["table, index", "net, one_hot"]


@pytest.mark.parametrize("folder", ["drawn", *PUBLISHED], ids=str)
def test_sentences_say_what_their_tables_say(drawn: Drawn, folder: str | Path) -> None:
    found = Document(drawn.folder if isinstance(folder, str) else folder)
    if "aggregate.csv" not in found.folder:  # nothing is pooled
        return
    aggregate, scores = (pd.read_csv(found.folder.path / name) for name in ("aggregate.csv", SCORES))
    keys = ["variant", "observation"]
    alone: Any = scores.groupby([*keys, "scenario"])[["success", "score"]].mean()
    means: Any = alone.groupby(keys).mean()
    for row in aggregate.to_dict("records"):
        expected = means.loc[(row["variant"], row["observation"])]
        assert [row["success"], row["score"]] == pytest.approx(expected.tolist(), abs=1e-5)
    if "scenario" not in (contrasts := found.folder.frame("contrasts")):
        for row in contrasts.to_dict("records"):
            sides = [re.split(", | @ ", row[side]) for side in "xy"]
            x, y = ((means if len(side) == 2 else alone).loc[tuple(side)] for side in sides)
            assert row["success_difference"] == pytest.approx(x["success"] - y["success"], abs=2e-5)


# Identity


def test_drawing_again_gives_the_same_bytes(drawn: Drawn, tmp_path: Path) -> None:
    report = report_of(drawn.experiment).check()
    with Store(drawn.results / "runs.db", read_only=True) as store:
        draw.draw(report, store, tmp_path / "small")
    for path in drawn.folder.iterdir():
        assert path.read_bytes() == (tmp_path / "small" / path.name).read_bytes(), path.name
    (tmp_path / "small" / "README.md").unlink()
    document.write(tmp_path / "small")  # from the files alone
    assert (tmp_path / "small" / "README.md").read_bytes() == (drawn.folder / "README.md").read_bytes()


def test_what_searches_took_is_in_the_tables(drawn: Drawn) -> None:
    chosen = Chosen(trial=3, settings={}, score=0.7, trials=8, runs=80, steps=32_000, cpu_time_s=1.0)
    learners = dict(drawn.experiment.learners)
    learners["sarsa, index"] = replace(learners["sarsa, index"], chosen=chosen)
    with Store(drawn.results / "runs.db", read_only=True) as store:
        rows = analysis_of(replace(drawn.experiment, learners=learners), store).aggregate
    assert {row["variant"]: row["search_steps"] for row in rows} == {
        name: 32_000 if name == "sarsa" else 0 for name in ("table", "check", "sarsa", "ppo", "net")
    }


# Runs that are missing


def test_missing_runs_are_refused_or_marked(drawn: Drawn, tmp_path: Path) -> None:
    pairs = [["net, one_hot", "table, index"]]
    small = without(tmp_path, "sarsa", contrasts=pairs)
    runs = all_specifications(small)
    failed = specifications(small, "default", "S1", "net", "one_hot", [1])[0]
    absent = specifications(small, "default", "S3", "ppo", "one_hot", [0, 1])
    lost = {run.digest for run in (failed, *absent)}
    report = report_of(small).check()
    with Store(drawn.results / "runs.db", read_only=True) as store, Store(tmp_path / "runs.db") as other:
        other.add(store.get([run.digest for run in runs if run.digest not in lost]))
        other.add([Record(failed.digest, failed.content, "failed", {}, {}, "RuntimeError: oh")])
        with pytest.raises(InputError) as caught:
            draw.draw(report, other, tmp_path / "whole")
        assert f"3 of {len(runs)} runs are missing, 1 of them failed" in str(caught.value)
        assert "net, one_hot in S1 has 11 of 12; ppo, one_hot in S3 has 0 of 2" in str(caught.value)
        assert not (tmp_path / "whole").exists()


def test_divergence_is_shown(tmp_path: Path) -> None:
    text = EXPERIMENT.replace("batch_size = 8,", "batch_size = 8, learning_rate = 1e38,")
    experiment = without(tmp_path, "ppo", "check", text=text)
    with Store(tmp_path / "runs.db") as store:
        trained(experiment, store)
        found = analysis_of(experiment, store)
        nets = [cell for cell in found.cells if cell["variant"] == "net"]
        assert [cell["diverged"] for cell in nets] == [12, 12]
        assert [cell["unbounded_score"] for cell in nets] == pytest.approx([0, 0], abs=1e-9)  # as random
        assert np.isfinite(found.runs["diverged_at"]).equals(found.runs["variant"] == "net")
