"""Folders of results: what is in them, that drawing again gives the same, and what is refused."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from benchmark.execution.store import Record, Store
from benchmark.experiments import Experiment, all_specifications
from benchmark.folder import SCORES, Folder
from benchmark.publish import document, draw
from benchmark.studies import report_of
from benchmark.studies.comparison.analysis import ComparisonAnalysis
from envs import InputError
from tests.benchmark.studies.conftest import EXPERIMENT, Drawn, experiment_of, trained
from tests.support import ROOT, mistyped_columns, specifications

PUBLISHED = [
    path.parent
    for path in sorted((ROOT / "results").glob("*/manifest.json"))
    if json.loads(path.read_text())["report"]["kind"] == "comparison"
]


def analysis_of(experiment: Experiment, store: Store) -> ComparisonAnalysis:
    report = report_of(experiment)
    found: ComparisonAnalysis = report.study.analyse(report.data(store))
    return found


def test_folder_has_what_items_say_and_readers_infer_the_types_of_all_columns(drawn: Drawn) -> None:
    names = {path.name for path in drawn.folder.iterdir()}
    drawn_names = ["contrasts", "curves", "rliable"]
    tables = [*drawn_names, "summary", "aggregate", "cost"]
    expected = {f"{name}.csv" for name in tables} | {f"{name}.svg" for name in drawn_names}
    assert names == expected | {"README.md", "manifest.json", SCORES, "agents.json.gz"}
    assert [mistyped_columns(drawn.folder / f"{name}.csv") for name in tables] == [[]] * len(tables)
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


def test_checks_have_rows_but_no_verdicts(drawn: Drawn) -> None:
    for name in ("aggregate", "curves", "cost"):
        assert "check" in {*pd.read_csv(drawn.folder / f"{name}.csv")["variant"]}, name
    summary = pd.read_csv(drawn.folder / "summary.csv")
    assert [*summary["variant"].unique()] == ["table", "check", "sarsa", "ppo", "net"]
    with Store(drawn.results / "runs.db", read_only=True) as store:
        assert analysis_of(drawn.experiment, store).drawn == {"table, index", "net, one_hot"}


@pytest.mark.parametrize("path", [None, *PUBLISHED], ids=str)
def test_tables_say_what_the_runs_say(drawn: Drawn, path: Path | None) -> None:
    folder = Folder(path or drawn.folder)
    if SCORES not in folder:
        pytest.skip("its runs are not published")
    scores = folder.frame(SCORES)
    scores["learner"] = scores["variant"] + ", " + scores["observation"]
    alone: Any = scores.groupby(["learner", "scenario"])[["success", "score"]].mean()
    means: Any = alone.groupby("learner").mean()
    for row in folder.frame("aggregate").to_dict("records"):
        expected = means.loc[f"{row['variant']}, {row['observation']}"]
        assert [row["success"], row["score"]] == pytest.approx(expected.tolist(), abs=1e-5)
    for row in folder.frame("contrasts").to_dict("records"):
        is_alone = isinstance(row.get("scenario"), str)
        x, y = (alone.loc[row[side], row["scenario"]] if is_alone else means.loc[row[side]] for side in "xy")
        assert row["success_difference"] == pytest.approx(x["success"] - y["success"], abs=2e-5)


def test_drawing_again_gives_the_same_bytes(drawn: Drawn, tmp_path: Path) -> None:
    report = report_of(drawn.experiment).check()
    with Store(drawn.results / "runs.db", read_only=True) as store:
        draw.draw(report, store, tmp_path / "small")
    for path in drawn.folder.iterdir():
        assert path.read_bytes() == (tmp_path / "small" / path.name).read_bytes(), path.name
    (tmp_path / "small" / "README.md").unlink()
    document.write(tmp_path / "small")  # from the files alone
    assert (tmp_path / "small" / "README.md").read_bytes() == (drawn.folder / "README.md").read_bytes()


def test_missing_runs_are_refused(drawn: Drawn, tmp_path: Path) -> None:
    runs = all_specifications(drawn.experiment)
    failed = specifications(drawn.experiment, "default", "S1", "net", "one_hot", [1])[0]
    absent = specifications(drawn.experiment, "default", "S3", "ppo", "one_hot", [0, 1])
    lost = {run.digest for run in (failed, *absent)}
    report = report_of(drawn.experiment).check()
    with Store(drawn.results / "runs.db", read_only=True) as store, Store(tmp_path / "runs.db") as other:
        other.add(store.get([run.digest for run in runs if run.digest not in lost]))
        other.add([Record(failed.digest, failed.content, "failed", {}, {}, "RuntimeError: oh")])
        with pytest.raises(InputError) as caught:
            draw.draw(report, other, tmp_path / "whole")
        assert f"3 of {len(runs)} runs are missing, 1 of them failed" in str(caught.value)
        assert not (tmp_path / "whole").exists()


def test_divergence_is_shown(tmp_path: Path) -> None:
    text = EXPERIMENT.replace("batch_size = 8,", "batch_size = 8, learning_rate = 1e38,")
    experiment = experiment_of(tmp_path / "changed.toml", f'stream = "small"\n{text}')
    with Store(tmp_path / "runs.db") as store:
        trained(experiment, store)
        found = analysis_of(experiment, store)
    nets = [cell for cell in found.cells.values() if cell["variant"] == "net"]
    assert [cell["unbounded_score"] for cell in nets] == pytest.approx([0, 0], abs=1e-9)  # as random
    assert np.isfinite(found.runs["diverged_at"]).equals(found.runs["variant"] == "net")
