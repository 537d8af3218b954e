"""Folders of results are replaced when all files are there, and what a killed process left is removed."""

import subprocess
import sys
from pathlib import Path

import pytest

from benchmark.publish import files
from tests.support import ROOT


def content(folder: Path) -> dict[str, str]:
    return {str(p.relative_to(folder)): p.read_text() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with files that were made before, and some that were not."""
    folder = tmp_path / "results" / "mine"
    (folder / "notes").mkdir(parents=True)
    for name in ("a.csv", "b.csv", "other.txt", "notes/c.txt"):
        (folder / name).write_text(f"old {name}")
    return folder


def replace(folder: Path, *names: str, error: BaseException | None = None) -> None:
    with files.alone(folder.parent), files.replaced(folder, {"a.csv", "b.csv"}) as made:
        for name in names:
            (made / name).write_text(f"new {name}")
        if error is not None:
            raise error


def test_new_files_replace_old_ones_and_others_stay(folder: Path) -> None:
    (folder.parent / ".mine.making").mkdir()  # of a process that was killed
    (folder.parent / ".mine.making" / "half.csv").touch()
    replace(folder, "a.csv", "d.md")
    others = {name: f"old {name}" for name in ("other.txt", "notes/c.txt")}
    assert content(folder) == {"a.csv": "new a.csv", "d.md": "new d.md"} | others
    assert [path.name for path in folder.parent.iterdir()] == ["mine"]
    replace(folder.parent / "deep" / "new", "a.csv")  # a new folder
    assert content(folder.parent / "deep") == {"new/a.csv": "new a.csv"}


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError("disk full")])
def test_failure_leaves_everything_as_it_was(folder: Path, error: BaseException) -> None:
    before = content(folder.parent)
    with pytest.raises(type(error)):
        replace(folder, "a.csv", error=error)
    assert content(folder.parent) == before


def test_the_manifest_is_replaced_last(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So the manifest of a folder that was half replaced refuses its new files."""
    order = list[str]()
    monkeypatch.setattr(Path, "replace", lambda path, _: order.append(path.name))
    replace(folder, "manifest.json", "z.csv", "a.csv")
    assert order == ["a.csv", "z.csv", "manifest.json"]


def start(folder: Path) -> subprocess.Popen[str]:
    """Starts a process that has a folder alone until its input ends."""
    code = (
        "import sys\nfrom pathlib import Path\nfrom benchmark.publish import files\n"
        "with files.alone(Path(sys.argv[1])): print('in', flush=True); sys.stdin.read()"
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
