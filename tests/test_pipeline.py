"""The replication in miniature, through the real commands; and what the command line refuses."""

import dataclasses
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.__main__ import main
from benchmark.execution.store import Store
from benchmark.experiments import load_experiment, schema
from tests.benchmark.execution.test_processes import arrays_of
from tests.benchmark.execution.test_store import execute
from tests.support import mistyped_columns, specifications

PARTS = 20  # of the nine claims


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of the replication in miniature."""
    directory = tmp_path_factory.mktemp("results")
    assert main(["run", "reproduce", "--smoke", "--results", str(directory), "--report"]) == 0
    return directory


def test_tables_agree_with_each_other(results: Path) -> None:
    folder = results / "reproduce_smoke"
    assert [path.name for path in folder.glob("*.csv") if mistyped_columns(path)] == []
    claims, optimal, learning = (
        pd.read_csv(folder / f"{name}.csv") for name in ("claims", "optimal", "learning")
    )
    assert claims["agents"].value_counts().to_dict() == {2: PARTS, 4: PARTS}
    assert optimal["agents"].tolist() == [2, 2, 2, 4, 4, 4]
    assert optimal["success"].tolist()[:3] == learning[learning["step"] == 400]["success"].tolist()


def test_results_do_not_depend_on_how_the_work_was_split(results: Path, tmp_path: Path) -> None:
    for arguments in (["--seeds", "0-1", "--jobs", "3"], ["--seeds", "1"], ["--jobs", "1"]):
        assert main(["run", "reproduce", "--smoke", "--results", str(tmp_path), *arguments]) == 0
    with Store(tmp_path / "runs.db") as store, Store(results / "runs.db") as other:
        digests = sorted(store.ended())
        assert digests == sorted(other.ended())
        for x, y in zip(store.get(digests), other.get(digests), strict=True):
            assert arrays_of([x]) == arrays_of([y])


def test_results_are_verified(results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A forged record with the right checksum, an edited table and a damaged record are all found."""
    shutil.copytree(results, tmp_path, dirs_exist_ok=True)
    command = ["verify", "reproduce", "--smoke", "--results", str(tmp_path), "--jobs", "2", "--seed", "3"]
    run, *_ = specifications(load_experiment("reproduce", smoke=True), "ties", "S3", "q_learning", "index")
    with Store(tmp_path / "runs.db") as store:
        (forged,) = store.get([run.digest])
        arrays = dict(forged.arrays) | {"q": np.nextafter(forged.arrays["q"], 1)}
        store.add([dataclasses.replace(forged, arrays=arrays)])
    (tmp_path / "reproduce_smoke" / "optimal.csv").write_text("success\n1.0\n")
    for name in ("README.md", "manifest.json"):  # the last number
        changed = re.sub(r"\d(?=\D*$)", "x", (file := tmp_path / "reproduce_smoke" / name).read_text())
        file.write_text(changed)
    (tmp_path / "reproduce_smoke" / "notes.txt").write_text("a reader's own")
    names = {path.name for path in tmp_path.iterdir()}
    assert main([*command, "--runs", "52"]) == 1
    said = capsys.readouterr()
    assert f"({forged.digest[:12]}): differs in q." in said.err
    changed = r"4 of \d+ files: README\.md, manifest\.json, optimal\.csv, sensitivity\.csv\."
    assert re.search(changed, said.err)
    assert "notes.txt" not in said.err
    assert said.out.splitlines() == [
        "checksums: correct in all 52 records.",
        "runs: 51 of 52 repeated runs are identical (drawn from 52 with --seed 3).",
        "problems found: 3.",  # the page cannot be made of that table
    ]
    assert names == {path.name for path in tmp_path.iterdir()}  # nothing is left aside
    execute(tmp_path / "runs.db", f"UPDATE runs SET provenance = '' WHERE digest = '{forged.digest}'")
    assert main([*command, "--runs", "2"]) == 1
    said = capsys.readouterr()
    assert f"1 of 52 records are damaged (the first: {forged.digest[:12]})" in said.err
    assert "runs: 2 of 2 repeated runs are identical" in said.out
    # Running the experiment again repeats what is damaged, and nothing else.
    assert main(["run", "reproduce", "--smoke", "--results", str(tmp_path)]) == 0
    assert "1 runs done, 51 were done already" in capsys.readouterr().out
    with Store(tmp_path / "runs.db") as store, Store(results / "runs.db") as other:
        assert arrays_of(store.get([forged.digest])) == arrays_of(other.get([forged.digest]))


def test_list_describes_everything(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    description = schema.read_experiment("reproduce")[0].description
    shutil.copy(schema.EXPERIMENT_DIRECTORY / "reproduce.toml", tmp_path)
    (tmp_path / "mine.toml").write_text('about = "Mine."', encoding="utf-8")
    monkeypatch.setattr(schema, "EXPERIMENT_DIRECTORY", tmp_path)
    assert main(["list"]) == 0
    listed = capsys.readouterr().out
    assert f"  reproduce                {description}\n" in listed
    assert re.search(r"S2 +The issuer gives random feedback", listed)
    assert re.search(r"sb3_dqn +agents\.sb3\.algorithms:DQN", listed)
    assert re.search(r"mine +not usable: .*mine\.toml: ", listed)
