"""Folders of results are replaced whole or not at all, and whatever a killed process left is removed."""

import signal
import subprocess
import sys
import time
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


def replace(folder: Path, *names: str) -> None:
    with files.alone(folder.parent), files.replaced(folder, {"a.csv", "b.csv"}) as made:
        for name in names:
            (made / name).write_text(f"new {name}")


def test_new_files_replace_old_ones_and_others_stay(folder: Path) -> None:
    (folder / "link").symlink_to("nowhere")
    replace(folder, "a.csv", "d.md")
    others = {name: f"old {name}" for name in ("other.txt", "notes/c.txt")}
    assert content(folder) == {"a.csv": "new a.csv", "d.md": "new d.md"} | others
    assert (folder / "link").is_symlink()
    assert [path.name for path in folder.parent.iterdir()] == ["mine"]
    replace(folder.parent / "deep" / "new", "a.csv")  # a new folder
    assert content(folder.parent / "deep") == {"new/a.csv": "new a.csv"}


def replace_with_half(folder: Path, error: BaseException) -> None:
    with files.alone(folder.parent), files.replaced(folder, ()) as made:
        (made / "a.csv").write_text("half")
        raise error


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError("disk full")])
def test_failure_leaves_everything_as_it_was(folder: Path, error: BaseException) -> None:
    before = content(folder.parent)
    with pytest.raises(type(error)):
        replace_with_half(folder, error)
    assert content(folder.parent) == before


def test_leftovers_are_removed_and_a_folder_in_between_comes_back(folder: Path) -> None:
    (folder.parent / ".mine.making").mkdir()
    (folder.parent / ".mine.making" / "a.csv").write_text("half")
    (folder / ".README.md.making").write_text("half")
    folder.rename(folder.parent / ".mine.before")
    with files.alone(folder.parent):
        assert sorted(path.name for path in folder.parent.iterdir()) == ["mine"]
        assert sorted(path.name for path in folder.iterdir()) == ["a.csv", "b.csv", "notes", "other.txt"]


def start(folder: Path, code: str) -> subprocess.Popen[str]:
    """Starts a process that executes code after some imports."""
    imports = "import sys\nfrom pathlib import Path\nfrom benchmark.publish import files\n"
    command = [sys.executable, "-c", f"{imports}folder = Path(sys.argv[1])\n{code}", str(folder)]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, cwd=ROOT, text=True, stdin=pipe, stdout=pipe, stderr=pipe)


def test_reader_never_sees_a_mixture(folder: Path) -> None:
    """A process that replaces the folder again and again is killed at some moment, several times."""
    code = """
for i in range(1_000_000):
    with files.alone(folder.parent), files.replaced(folder, ()) as made:
        for j in range(20):
            (made / f"{j}.csv").write_text(f"{i}")
    print(i, flush=True)
"""
    replace(folder, *[f"{j}.csv" for j in range(20)])
    for i in range(3):
        process = start(folder, code)
        assert process.stdout is not None
        while int(process.stdout.readline()) < 3:
            pass
        time.sleep(0.005 * i)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        with files.alone(folder.parent):
            assert [path.name for path in folder.parent.iterdir()] == ["mine"]
        made = {path.read_text() for path in folder.glob("*.csv")}
        assert len(made) == 1
        assert len(list(folder.glob("*.csv"))) == 20


def test_one_process_at_a_time(folder: Path) -> None:
    code = "with files.alone(folder): print('in', flush=True); sys.stdin.read()"
    first = start(folder, code)
    assert first.stdout is not None
    assert first.stdout.readline() == "in\n"
    second = start(folder, code)
    assert second.stderr is not None
    assert "waiting for another command that writes there" in second.stderr.readline()
    assert first.communicate()[0] == ""
    assert second.communicate()[0] == "in\n"
