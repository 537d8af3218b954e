"""The command `verify`: every change of published files is named, and none of them runs code."""

import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from benchmark import runs
from benchmark.__main__ import main
from benchmark.commands import verify
from benchmark.execution import driver
from benchmark.execution.store import Record, Store
from benchmark.experiments import RunSpecification, all_specifications, load_experiment
from benchmark.experiments.finding import Tables
from benchmark.folder import MANIFEST, Folder
from benchmark.publish.document import Document
from benchmark.publish.templates import rendered
from benchmark.sealed import sealed
from envs import InputError
from tests.support import ROOT, reseal, small_experiment, variant
from tests.test_flips import NAME, flips


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    unlisted = shutil.ignore_patterns("index.html", ".*")
    return shutil.copytree(ROOT / "results" / NAME, tmp_path / NAME, ignore=unlisted)


def test_changed_and_missing_files_are_named_by_every_command(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "README.md").write_text("by hand", encoding="utf-8")  # is made of the others, and made again
    results = str(folder.parent)
    shutil.copytree(ROOT / "results" / "reproduce", folder.parent / "reproduce")  # of which the page is made
    n_runs = len(all_specifications(load_experiment(NAME)))
    assert main(["verify", NAME, "--results", results]) == 1
    said = capsys.readouterr()
    n_files = len(Folder(folder).manifest["files"])
    assert f"{NAME}: all files in its manifest are unchanged ({n_files})." in said.out
    assert f"{NAME}: not drawn again, as {n_runs:,} of {n_runs:,} runs are missing." in said.out
    assert f"{folder / 'README.md'}: different from what the tables make" in said.err
    assert main(["report", "--results", results]) == 0
    assert main(["verify", NAME, "--results", results]) == 0
    table = folder / "summary.csv"
    table.write_bytes(next(flips(table.read_bytes(), 1)))
    (folder / "curves.svg").unlink()
    before = {path: path.read_bytes() for path in folder.parent.rglob("*.*") if path.is_file()}
    for command, code in ((["verify", NAME], 1), (["report"], 2)):
        capsys.readouterr()
        assert main([*command, "--results", results]) == code
        said = capsys.readouterr()
        assert all(f"{NAME}/{file}: damaged" in said.err for file in ("summary.csv", "curves.svg"))
    assert before == {path: path.read_bytes() for path in folder.parent.rglob("*.*") if path.is_file()}


@pytest.mark.parametrize("name", [MANIFEST, "contrasts.csv"])
def test_what_is_gone_or_no_file_is_named(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / name).unlink()
    arguments = ["verify", NAME, "--runs", "0", "--results", str(folder.parent)]
    assert main(arguments) == 1
    os.mkfifo(folder / name)  # reading it would never end
    assert main(arguments) == 1
    said = capsys.readouterr().err
    assert len(re.findall(rf"^{folder}.*(?:{name}|there are no results)", said, re.MULTILINE)) == 2
    with pytest.raises(InputError, match=f"{folder}"):
        runs(NAME, folder.parent, "published") if name == MANIFEST else Document(folder).readme()


def test_results_of_another_experiment_are_not_taken_for_those_of_this_one(folder: Path) -> None:
    other = shutil.copytree(folder, folder.parent / "sb3")
    with pytest.raises(InputError, match=f"sb3/{MANIFEST}: damaged, .*it belongs to {NAME}"):
        Folder(other).check()


def test_chosen_settings_follow_from_published_trials(tmp_path: Path) -> None:
    experiment = load_experiment("tuning")
    assert [*verify.unfounded(experiment, ROOT / "results" / "tuning")] == []
    shutil.copytree(ROOT / "results" / "tuning", tmp_path / "tuning")
    trials = tmp_path / "tuning" / "trials.csv"
    trials.write_bytes(next(flips(trials.read_bytes(), 1)))
    reseal(tmp_path / "tuning")
    (problem,) = verify.unfounded(experiment, tmp_path / "tuning")
    assert re.match(r".*tuning\.chosen\.json: made from other trials than those in .*trials\.csv;", problem)


def test_the_seed_draws_the_runs_to_repeat(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[list[int]] = []

    def repeat(runs: list[RunSpecification], store: Store, *_: object) -> None:
        drawn.append([run.seed for run in runs])
        store.add([Record(run.digest, run.content, "done", {}, {}) for run in runs])

    text = small_experiment(algorithms={"table": variant(seeds=40)})
    (path := tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    with Store(tmp_path / "runs.db") as store:
        repeat(all_specifications(load_experiment(path)), store)
    monkeypatch.setattr(driver, "run", repeat)
    for seed in ("1", "1", "2"):
        command = ["verify", str(path), "--results", str(tmp_path), "--runs", "9", "--seed", seed]
        assert main(command) == 0
    _, first, again, other = drawn
    assert first == again != other
    assert len(first) == len(other) == 9


# Data that never runs

EVIL = "{{ cycler.__init__.__globals__.os.system('touch MARKER') }}"


@pytest.mark.parametrize(
    "changes",
    [
        {"report": {"kind": "marker_module:REPORT"}},
        {"report": {"kind": "comparison", "items": ["marker_module:item"]}},
        {"experiment": "../marker", "argument": "../marker.toml"},
        {"description": EVIL, "note": EVIL},
        {"files": {"../../secret.csv": "0"}},
    ],
    ids=str,
)
def test_data_never_runs(
    changes: dict[str, Any], folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever a manifest says, and though its digests are right."""
    folder = folder.rename(tmp_path / "theirs")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    marker = tmp_path / "MARKER"
    code = f"open({str(marker)!r}, 'w')\nREPORT = item = None\n"
    (tmp_path / "marker_module.py").write_text(code, encoding="utf-8")
    for name in ("marker", "theirs", NAME):
        (tmp_path / f"{name}.md.jinja").write_text(EVIL.replace("MARKER", str(marker)), encoding="utf-8")
    manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    changes = json.loads(json.dumps(changes).replace("MARKER", str(marker)))
    report = manifest["report"] | changes.pop("report", {})
    reseal(folder, **changes, report=report)
    if "files" in changes:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        text = sealed(manifest | {"files": changes["files"]}, 2)
        (folder / MANIFEST).write_text(text, encoding="utf-8")
    assert main(["report", "--results", str(tmp_path)]) in (0, 2)
    assert not marker.exists()


@pytest.mark.parametrize(
    "expression",
    [
        "cycler.__init__.__globals__",
        "lookups.rows.__self__",
        "frame.to_csv('FILE')",
        "frame.groupby('a').agg('to_csv')",
        "frame['a'].values.tofile('FILE')",
        "frame.eval('1')",
    ],
)
def test_templates_reach_neither_files_nor_code(expression: str, tmp_path: Path) -> None:
    file, template = tmp_path / "written", tmp_path / "mine.md.jinja"
    template.write_text(f"One.\n\n{{{{ {expression.replace('FILE', str(file))} }}}}", encoding="utf-8")
    lookups = Tables(Folder(ROOT / "results" / NAME))
    frame = lookups.rows("summary").assign(a=1.0)
    with pytest.raises(InputError, match=r"mine\.md\.jinja, line 3: .*(unsafe|undefined|not callable)"):
        rendered(template, {"frame": frame, "lookups": lookups})
    assert not file.exists()
