"""The replication in miniature, through the real commands; and what the command line refuses."""

import dataclasses
import json
import os
import re
import shutil
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.__main__ import main
from benchmark.execution.store import Record, Store
from benchmark.experiments import all_specifications, load_experiment
from benchmark.reports import draw
from tests.support import ROOT, command, make, mistyped_columns

PARTS = 19  # of the nine claims


def contents(directory: Path, *, manifest: bool = False) -> dict[str, bytes]:
    files = {path.name: path.read_bytes() for path in directory.iterdir() if not path.name.startswith(".")}
    if not manifest:
        for name in ("manifest.json", "index.html"):  # times and machine
            files.pop(name, None)
    return files


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of `make reproduce` in miniature."""
    directory = tmp_path_factory.mktemp("results")
    done = make("reproduce", "EXPERIMENT=reproduce_smoke", f"RESULTS={directory}")
    assert done.returncode == 0, done.stderr
    assert "156 runs done, 0 were done already" in done.stdout
    return directory


def test_everything_is_there(results: Path) -> None:
    names = set(contents(results / "reproduce_smoke", manifest=True))
    tables = {
        f"{t}.{end}" for t in ("claims", "sensitivity", "learning", "optimal") for end in ("csv", "md", "tex")
    }
    figures = {
        f"{f}.{end}"
        for f in ("figure", "claims", "learning", "optimal", "sensitivity")
        for end in ("png", "svg")
    }
    others = {"q_values.csv", "max_q.csv", "optimal_cells.csv", "README.md", "manifest.json", "index.html"}
    others |= {
        "success.csv",
        "claim_sets.csv",
        "agent.csv",
        "agents.csv",
        "agent_S1.csv",
        "agent_S2.csv",
        "agent_S3.csv",
        "optimum.csv",
    }
    assert names == tables | figures | others


def test_csv_files_have_the_published_form(results: Path) -> None:
    folder = results / "reproduce_smoke"
    q_values = pd.read_csv(folder / "q_values.csv")
    assert list(q_values) == ["scenario", "row", "column", "action", "mean", "std", "min", "max"]
    assert len(q_values) == 1800
    max_q = pd.read_csv(folder / "max_q.csv")
    assert list(max_q) == [
        "scenario", "step", "mean", "std", "min", "max", "table_mean", "table_min", "table_max",
    ]  # fmt: skip
    assert max_q[max_q["scenario"] == "S2"]["step"].tolist() == list(range(0, 600, 10))
    claims = pd.read_csv(folder / "claims.csv")
    assert list(claims) == [
        "claim", "part", "agents", "value", "low", "high", "right_side", "threshold", "state", "verdict",
        "effect", "agents_needed", "note", "sets", "sets_agreeing", "share", "share_low", "share_high",
        "says", "measure", "because",
    ]  # fmt: skip
    assert len(claims) == 2 * PARTS
    assert claims["agents"].value_counts().to_dict() == {6: PARTS, 12: PARTS}
    assert set(claims["sets"]) == {2}
    sensitivity = pd.read_csv(folder / "sensitivity.csv")
    assert len(sensitivity) == 9 * PARTS
    assert set(sensitivity["agents"]) == {6}
    sets = pd.read_csv(folder / "claim_sets.csv")
    assert sets.groupby("first_seed")["last_seed"].agg(["size", "max"]).to_dict("index") == {
        0: {"size": PARTS, "max": 5},
        6: {"size": PARTS, "max": 11},
    }
    # The first set is that of the figures, and of the default reading among the others.
    same = ["claim", "part", "value", "low", "high", "state", "verdict"]
    first = sets.loc[sets["first_seed"] == 0, same].reset_index(drop=True)
    assert first.equals(sensitivity.loc[sensitivity["reading"] == "default", same])
    assert first.equals(claims.loc[claims["agents"] == 6, same].reset_index(drop=True))
    agreeing = sets.drop_duplicates(["claim", "first_seed"]).merge(claims, on=["claim", "verdict"])
    counts = agreeing.drop_duplicates(["claim", "first_seed", "agents"]).groupby(["claim", "agents"]).size()
    for row in claims.itertuples():
        assert row.sets_agreeing == counts.get((row.claim, row.agents), 0)
    success = pd.read_csv(folder / "success.csv")
    assert success["agents"].tolist() == [6, 6, 6, 12, 12, 12]
    learning = pd.read_csv(folder / "learning.csv")
    assert success["success"].tolist()[:3] == learning[learning["step"] == 600]["success"].tolist()
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["runs"] == 156
    assert manifest["versions"][0]["numpy"]


def test_results_do_not_depend_on_how_the_work_was_split(results: Path, tmp_path: Path) -> None:
    for arguments in (["--seeds", "4-5", "--jobs", "3"], ["--seeds", "1"], ["--jobs", "1"]):
        assert main(["run", "reproduce_smoke", "--results", str(tmp_path), *arguments]) == 0
    with Store(tmp_path / "runs.db") as store, Store(results / "runs.db") as other:
        digests = sorted(store.ended())
        assert digests == sorted(other.ended())
        for x, y in zip(store.get(digests), other.get(digests), strict=True):
            assert x.arrays.keys() == y.arrays.keys()
            assert all(x.arrays[name].tobytes() == y.arrays[name].tobytes() for name in x.arrays)


def test_report_of_fewer_seeds(results: Path, tmp_path: Path) -> None:
    with Store(results / "runs.db", read_only=True) as store:
        draw.draw(load_experiment("reproduce_smoke"), store, tmp_path / "fewer", range(2))
    assert pd.read_csv(tmp_path / "fewer" / "optimal.csv")["agents"].tolist() == [2, 2, 2]
    assert "**Partial: 2 of the 12 agents" in (tmp_path / "fewer" / "README.md").read_text()


def test_results_are_verified(results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(results, tmp_path, dirs_exist_ok=True)
    (tmp_path / "reproduce_smoke" / "notes.txt").write_text("a reader's own")
    verify = ["verify", "reproduce_smoke", "--results", str(tmp_path), "--jobs", "2", "--seed", "3"]
    assert main([*verify, "--runs", "40"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "checksums: correct in all 156 records.",
        "runs: 40 of 40 repeated runs are identical (drawn from 156 with --seed 3).",
        f"reproduce_smoke: identical to the files in {tmp_path / 'reproduce_smoke'} (34 of 34 files).",
    ]
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {path.name for path in results.iterdir()}  # nothing is left aside
    # Another value in a record, with the right checksum; a damaged record; an edited table.
    with Store(tmp_path / "runs.db") as store:
        forged, *_ = store.get(sorted(store.ended()))
        arrays = dict(forged.arrays) | {"q": np.nextafter(forged.arrays["q"], 1)}
        store.add([dataclasses.replace(forged, arrays=arrays)])
    (tmp_path / "reproduce_smoke" / "success.csv").write_text("success\n1.0\n")
    assert main([*verify, "--runs", "156"]) == 1
    problems = capsys.readouterr()
    assert f"({forged.digest[:12]}): differs in q." in problems.err
    assert f"differ from the files in {tmp_path / 'reproduce_smoke'}: " in problems.err
    assert "success.csv" in problems.err
    assert problems.out.splitlines()[1:] == [
        "runs: 155 of 156 repeated runs are identical (drawn from 156 with --seed 3).",
        "problems found: 2.",
    ]
    connection = sqlite3.connect(tmp_path / "runs.db")
    with connection:
        connection.execute("UPDATE runs SET provenance = '{}' WHERE digest = ?", (forged.digest,))
    connection.close()
    assert main([*verify, "--runs", "0"]) == 1
    assert f"1 of 156 records are damaged (the first: {forged.digest[:12]})" in capsys.readouterr().err
    # Running the experiment again repeats what is damaged, and nothing else.
    assert main(["run", "reproduce_smoke", "--results", str(tmp_path)]) == 0
    repeated = capsys.readouterr()
    assert "reproduce_smoke: repeating runs whose records are damaged: 1." in repeated.err
    assert "1 runs done, 155 were done already" in repeated.out
    with Store(tmp_path / "runs.db") as store, Store(results / "runs.db") as other:
        (mended,), (original,) = store.get([forged.digest]), other.get([forged.digest])
        assert mended.arrays.keys() == original.arrays.keys()
        assert all(
            values.tobytes() == original.arrays[name].tobytes() for name, values in mended.arrays.items()
        )


def test_damaged_record_of_a_failed_run_is_repeated_like_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    failed = all_specifications(load_experiment("reproduce_smoke"))[0].digest
    with Store(tmp_path / "runs.db") as store:
        store.add([Record(digest, "{}", "failed", {}, {}, "error") for digest in (failed, "other")])
    connection = sqlite3.connect(tmp_path / "runs.db")
    with connection:
        connection.execute("UPDATE runs SET provenance = '1'")
    connection.close()
    assert main(["verify", "--results", str(tmp_path)]) == 1
    message = capsys.readouterr().err
    assert "2 of 2 records are damaged" in message
    assert "1 of them are of none that 'list' shows" in message


def test_readers_infer_the_types_of_all_columns(results: Path) -> None:
    for path in (results / "reproduce_smoke").glob("*.csv"):
        assert mistyped_columns(path) == [], path.name


def test_other_seeds_do_not_overwrite_the_declared_ones(results: Path, tmp_path: Path) -> None:
    shutil.copytree(results, tmp_path, dirs_exist_ok=True)
    n_declared = len(load_experiment("reproduce_smoke").declared_seeds("q_learning", "default"))
    assert main(["report", "reproduce_smoke", "--seeds", "0-1", "--results", str(tmp_path)]) == 0
    made = contents(tmp_path / "reproduce_smoke", manifest=True)
    assert made == contents(results / "reproduce_smoke", manifest=True)  # of the declared seeds
    other = tmp_path / "reproduce_smoke_seeds_0-1"
    assert set(pd.read_csv(other / "optimal.csv")["agents"]) == {2}
    assert f"2 of the {n_declared} agents" in (other / "index.html").read_text(encoding="utf-8")
    manifest = json.loads((other / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["command"] == "python -m benchmark run reproduce_smoke --seeds 0-1 --report"
    assert "_seeds_" not in (tmp_path / "README.md").read_text(encoding="utf-8")


def test_results_of_shipped_experiments_are_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "reproduce.toml").write_text("")
    done = command("run", tmp_path / "reproduce.toml", "--results", tmp_path)
    assert done.returncode == 2
    assert "reproduce is a shipped one; rename it" in done.stderr


def test_list_tells_what_is_done(results: Path, tmp_path: Path) -> None:
    done = command("list", "--results", results)
    assert done.returncode == 0, done.stderr
    assert re.search(r"reproduce_smoke +156 of 156 runs done", done.stdout)
    assert re.search(r"reproduce +0 of 5000 runs done", done.stdout)
    assert re.search(r"S2 +The issuer gives random feedback", done.stdout)
    assert command("list", "--results", tmp_path / "nowhere").returncode == 0
    assert not (tmp_path / "nowhere").exists()


def unwritable(tmp_path: Path) -> Path:
    """Returns a folder that cannot be written even by root."""
    (tmp_path / "file").write_text("")
    return tmp_path / "file" / "results"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["run", "reproduct"], "unknown experiment reproduct (did you mean reproduce?)"),
        (["report", "nothing.toml"], "nothing.toml: cannot be read"),
        (["run", "reproduce", "--jobs", "0"], "--jobs 0: accepted: a whole number from 1 to 1024"),
        (["run", "reproduce", "--seeds", "9-2"], "--seeds 9-2: accepted: A-B"),
        (["run", "reproduce", "--seeds", "x"], "--seeds x: accepted: A-B"),
        (["run", "reproduce", "--seeds", ""], "--seeds : accepted: A-B"),
        (["report", "reproduce"], "there are no runs yet; run the experiment first"),
        (
            ["run", "reproduce", "--seeds", "7-2000000"],
            "--seeds 7-2000000: accepted: A-B with A at most B, as in 0-29, or one seed, as in 7; seeds b",
        ),
    ],
)
def test_mistakes_get_one_sentence_and_exit_code_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], expected: str
) -> None:
    assert main([*arguments, "--results", str(tmp_path)]) == 2
    stderr = capsys.readouterr().err
    assert expected in stderr
    assert stderr.startswith("error: ")
    assert stderr.count("\n") == 1


@pytest.mark.parametrize("arguments", [["run", "reproduce"], ["speed", "--smoke"], ["growth", "--smoke"]])
def test_unwritable_results_are_refused_before_any_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    assert main([*arguments, "--results", str(unwritable(tmp_path))]) == 2
    stderr = capsys.readouterr().err
    assert re.fullmatch(r"error: .*file/results.*: cannot be (created|written): .*--results\.\n", stderr)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_read_only_results_are_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    done = command("run", "reproduce", "--results", tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1


def test_failed_drawing_leaves_the_old_results(results: Path, tmp_path: Path) -> None:
    folder = tmp_path / "reproduce_smoke"
    shutil.copytree(results, tmp_path, dirs_exist_ok=True)
    (folder / ".stamp").unlink()  # else it is up to date, and not drawn
    before = contents(folder, manifest=True)
    code = (
        "import sys; from benchmark import __main__ as m; from benchmark.drawing import tables\n"
        "def broken(*_): raise OSError('disk full')\n"
        "tables.write_csv = broken\n"
        f"sys.exit(m.main(['report', 'reproduce_smoke', '--results', {str(tmp_path)!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2
    assert "cannot be written: disk full" in done.stderr
    assert "Traceback" not in done.stderr
    assert contents(folder, manifest=True) == before
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]  # nothing is left aside
