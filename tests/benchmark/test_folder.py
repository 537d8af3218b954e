"""Folders of results: nothing changed is read, and nothing is lost while files are written."""

import gzip
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from pandas.testing import assert_frame_equal

from benchmark import folder as folders
from benchmark.folder import (
    MANIFEST,
    Folder,
    alone,
    csv_text,
    replaced,
    sealed,
    write_manifest,
    write_text,
)
from benchmark.tables import RUNS, read_table
from envs import InputError
from tests.support import ROOT

TABLE = pd.DataFrame(
    {
        "text": ["NA", "", "a, b"],
        "empty": [""] * 3,
        "whole": [1, 2, 3],
        "some": [0.5, float("nan"), float("inf")],
        "none": [float("nan")] * 3,
    }
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder of results with a table and a file that nobody made."""
    folder = tmp_path / "results" / "mine"
    folder.mkdir(parents=True)
    write_text(folder / "a.csv", csv_text(TABLE))
    write_manifest(folder, {"experiment": "mine"})
    (folder / "other.txt").write_text("mine")
    return folder


def content(folder: Path) -> dict[str, str]:
    return {str(p.relative_to(folder)): p.read_text() for p in folder.rglob("*") if p.is_file()}


def test_tables_are_read_as_they_were_written(folder: Path) -> None:
    assert_frame_equal(Folder(folder).tables()["a"], TABLE)


def change(folder: Path) -> None:
    (folder / "a.csv").write_text("text\nchanged\n")


def remove(folder: Path) -> None:
    (folder / "a.csv").unlink()


def reseal(folder: Path) -> None:
    manifest = json.loads((folder / MANIFEST).read_text())
    (folder / MANIFEST).write_text(json.dumps(manifest | {"experiment": "yours"}))


def escape(folder: Path) -> None:
    (folder / MANIFEST).write_text(sealed({"files": {"../secret": ""}}))


@pytest.mark.parametrize(
    ("damage", "fault"),
    [
        (change, r"a\.csv: damaged.*lists another digest"),
        (remove, r"a\.csv: damaged.*it is missing"),
        (reseal, r"manifest\.json: damaged.*not the digest"),
        (escape, r"manifest\.json: damaged.*outside its folder"),
    ],
)
def test_what_was_changed_is_refused(
    folder: Path, damage: Callable[[Path], None], fault: str
) -> None:
    damage(folder)
    with pytest.raises(InputError, match=fault):
        Folder(folder).tables()


def test_new_files_replace_old_ones_and_others_stay(folder: Path) -> None:
    (folder.parent / ".mine.making").mkdir()  # of a process that was killed
    (folder.parent / ".mine.making" / "half.csv").touch()
    with alone(folder.parent), replaced(folder, ["a.csv", MANIFEST]) as made:
        write_text(made / "b.csv", "new")
    assert content(folder) == {"b.csv": "new", "other.txt": "mine"}
    assert [path.name for path in folder.parent.iterdir()] == ["mine"]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError("disk full")])
def test_failure_leaves_everything_as_it_was(folder: Path, error: BaseException) -> None:
    def fail() -> None:
        with alone(folder.parent), replaced(folder, ["a.csv"]) as made:
            write_text(made / "a.csv", "new")
            raise error

    before = content(folder.parent)
    with pytest.raises(type(error)):
        fail()
    assert content(folder.parent) == before


def test_the_manifest_is_replaced_last(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So the manifest of a folder that was half replaced refuses its new files."""
    order = list[str]()
    with replaced(folder) as made:
        for name in (MANIFEST, "z.csv", "a.csv"):
            write_text(made / name, "new")
        monkeypatch.setattr(Path, "replace", lambda path, _: order.append(path.name))
    assert order == ["a.csv", "z.csv", MANIFEST]


def start(folder: Path) -> subprocess.Popen[str]:
    """Starts a process that has a folder alone until its input ends."""
    code = (
        "import sys\nfrom pathlib import Path\nfrom benchmark.folder import alone\n"
        "with alone(Path(sys.argv[1])): print('in', flush=True); sys.stdin.read()"
    )
    command, pipe = [sys.executable, "-c", code, str(folder)], subprocess.PIPE
    return subprocess.Popen(command, cwd=ROOT, text=True, stdin=pipe, stdout=pipe, stderr=pipe)


def test_one_process_at_a_time(folder: Path) -> None:
    first = start(folder)
    assert first.stdout is not None
    assert first.stdout.readline() == "in\n"
    second = start(folder)
    assert second.stderr is not None
    assert "waiting for another command that writes there" in second.stderr.readline()
    assert first.communicate()[0] == ""
    assert second.communicate()[0] == "in\n"


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (bytes(2000), "it unpacks to more than 1,000 bytes"),
        (b"," * 20, "it has 21 columns, more than 10"),
        (b"a,b\n1" + b",1" * 20, "it has 21 columns, more than 10"),
        (b"\n" * 20 + b",", "it has 20 rows, more than 10"),
    ],
)
def test_files_that_grow_when_they_are_read_are_refused(
    content: bytes, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folders, "MAX_UNPACKED", 1000)
    monkeypatch.setattr(folders, "MAX_ROWS", 10)
    monkeypatch.setattr(folders, "MAX_COLUMNS", 10)
    (tmp_path / RUNS).write_bytes(gzip.compress(content))
    (tmp_path / "wide.csv").write_bytes(content)
    write_manifest(tmp_path, {})
    with pytest.raises(InputError, match=expected):
        read_table(tmp_path, RUNS)
    if b"," in content:
        with pytest.raises(InputError, match=expected):
            Folder(tmp_path).tables()
