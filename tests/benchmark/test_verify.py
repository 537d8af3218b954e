"""The command `verify`: every change of published files is named, and none of them runs code."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from benchmark.__main__ import main
from benchmark.folder import MANIFEST, README, Folder, unsealed, write_manifest
from benchmark.tables import publish, read
from benchmark.trials import Choices, write_choices
from benchmark.verify import unfounded
from tests.support import ROOT, made, small_experiment, variant

EXPERIMENT = small_experiment(
    report={"kind": "comparison"},
    settings={"budget": 600},
    algorithms={"table": variant(seeds=4), "other": variant("watkins_q_lambda", seeds=4)},
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a small experiment, its stored runs and its results."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "mine.toml").write_text(EXPERIMENT, encoding="utf-8")
    assert main(["run", str(folder / "mine.toml"), "--results", str(folder), "--report"]) == 0
    return folder


@pytest.fixture
def results(whole: Path, tmp_path: Path) -> Path:
    return shutil.copytree(whole, tmp_path / "results")


def verify(results: Path, capsys: pytest.CaptureFixture[str], *more: str) -> tuple[int, str]:
    """Returns the exit code and what is printed."""
    capsys.readouterr()
    command = ["verify", str(results / "mine.toml"), "--results", str(results), "--runs", "2"]
    code = main([*command, *more])
    said = capsys.readouterr()
    return code, said.out + said.err


def test_what_is_as_it_was_made_is_verified(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {path: path.read_bytes() for path in results.rglob("*.*") if path.is_file()}
    code, said = verify(results, capsys, "--seed", "3")
    assert code == 0, said
    assert "2 of 8 runs were repeated, drawn with --seed 3; 2 are identical." in said
    assert before == {path: path.read_bytes() for path in results.rglob("*.*") if path.is_file()}


def test_changed_and_missing_files_are_named(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = results / "mine"
    (folder / README).write_text("by hand", encoding="utf-8")
    code, said = verify(results, capsys)
    assert (code, said.count("different from what its runs make: README.md;")) == (1, 1)
    (folder / "summary.csv").write_text("learner\n", encoding="utf-8")
    (folder / "cost.csv").unlink()
    code, said = verify(results, capsys)
    assert code == 1
    for file in ("summary.csv", "cost.csv"):
        assert f"{folder / file}: damaged" in said
    for name in (MANIFEST, README):
        (folder / name).unlink()
    code, said = verify(results, capsys)
    assert code == 1
    assert f"{folder}: there are no results" in said


def test_what_is_no_part_of_the_results_is_named(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (results / "mine" / "new.csv").write_text("x\n1\n", encoding="utf-8")
    (results / "mine" / "more").mkdir()
    (results / "mine" / "index.html").write_text("by hand", encoding="utf-8")
    os.mkfifo(results / "mine" / "pipe")
    code, said = verify(results, capsys)
    assert code == 1
    assert "manifest.json does not list more, new.csv, pipe; accepted: only what it lists." in said
    assert "different from what its runs make: index.html;" in said
    for name in (str(results / "mine.toml"), "reproduce"):
        nowhere = results / "typo" / "x"
        assert main(["verify", name, "--results", str(nowhere)]) == 2
        assert f"--results {nowhere}: nothing to verify; accepted: " in capsys.readouterr().err
    assert not nowhere.parent.exists()


def test_files_stay_as_they_are_when_git_checks_them_out() -> None:
    names = ("README.md", "results/when/cells.csv", "benchmark/verify.py")
    command = ["git", "check-attr", "text", "--", *names]
    said = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    assert said.splitlines() == [f"{name}: text: unset" for name in names]


def test_forged_files_with_right_digests_are_noticed(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A table that its runs do not make, and runs that were never trained."""
    folder = results / "mine"
    text = (folder / "summary.csv").read_text(encoding="utf-8")
    (folder / "summary.csv").write_text(re.sub(r",4,", ",5,", text, count=1), encoding="utf-8")
    write_manifest(folder, unsealed((folder / MANIFEST).read_bytes()))  # with its digest
    code, said = verify(results, capsys)
    assert code == 1
    assert re.search(r"different from what its runs make: .*summary\.csv", said)
    # A run's success is changed and everything is made again from it.
    runs, curves = read(folder)
    runs["steps"] += runs.index == 1
    publish(folder, runs, curves)
    assert main(["report", str(results / "mine.toml"), "--results", str(results)]) == 0
    code, said = verify(results, capsys, "--runs", "8")
    assert code == 1
    assert "mine: all " in said
    assert "the repeated run differs in steps." in said
    assert "7 are identical" in said


def test_chosen_settings_follow_from_published_trials(tmp_path: Path) -> None:
    searched = {"q": variant(search={"epsilon": {"low": 0, "high": 1}})}
    search = {"trials": 4, "finalists": 2, "first_seed": 10}
    text = small_experiment(search=search, algorithms=searched)
    experiment = made(tmp_path / "mine.toml", text)
    write_manifest(tmp_path, {})
    choices = Choices(search="", trials="of others", learners={})
    write_choices(experiment.path, choices)
    (problem,) = unfounded(experiment, Folder(tmp_path))
    assert re.match(r".*mine\.chosen\.json: made from other trials than those in .*csv;", problem)


def test_data_never_runs(results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever a manifest says, and though its digests are right."""
    marker = tmp_path / "MARKER"
    monkeypatch.syspath_prepend(str(tmp_path))
    folder = results / "mine"
    for path in (tmp_path / "marker.py", folder / "mine.py"):
        path.write_text(f"open({str(marker)!r}, 'w')\n", encoding="utf-8")
    changes = {"experiment": "../marker", "report": {"kind": "marker"}}
    write_manifest(folder, unsealed((folder / MANIFEST).read_bytes()) | changes)
    for command in ("report", "verify"):
        arguments = [command, str(results / "mine.toml"), "--results", str(results)]
        assert main(arguments) in (0, 1, 2)
    assert not marker.exists()
