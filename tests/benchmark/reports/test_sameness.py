"""The certificate, in a repository made for it, and the stamps of what is up to date."""

from pathlib import Path

import pytest

from benchmark.reports import sameness
from tests.support import git

FILES = {"a.csv": "a\n", "b.csv": "b\n", "cost.csv": "1 s\n", "manifest.json": "{}"}


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkout with the published results of an experiment."""
    root = tmp_path / "checkout"
    folder = root / "results" / "mine"
    folder.mkdir(parents=True)
    for name, text in FILES.items():
        (folder / name).write_text(text)
    for arguments in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "published"]):
        git(root, *arguments)
    monkeypatch.setattr(sameness, "REPOSITORY", root)
    return root


@pytest.fixture
def made(tmp_path: Path) -> Path:
    """A folder with the same files, the times and the manifest aside."""
    folder = tmp_path / "made"
    folder.mkdir()
    for name, text in (FILES | {"cost.csv": "2 s\n", "manifest.json": "other"}).items():
        (folder / name).write_text(text)
    return folder


def certificate(made: Path, other: Path | None = None) -> sameness.Certificate:
    compared = sameness.compare(made, "mine", {"cost.csv"}, other)
    assert compared is not None
    return compared


def test_same_files_are_identical_to_what_is_committed(repository: Path, made: Path) -> None:
    (repository / "results" / "mine" / "b.csv").write_text("changed since\n")
    apart = "; files with measured times, not compared: 1"
    text = f"mine: identical to the published results (2 of 2 files{apart})."
    assert certificate(made) == (True, text)
    other = repository / "results" / "mine"  # against a folder instead of the commit
    text = f"mine: different from the files in {other}: 2 of 3 files: b.csv, manifest.json{apart}."
    assert certificate(made, other) == (False, text)


@pytest.mark.usefixtures("repository")
def test_changed_missing_and_new_files_differ(made: Path) -> None:
    (made / "b.csv").unlink()
    (made / "c.csv").write_text("new")
    other = certificate(made)
    assert not other.is_identical
    assert "different from the published results: 2 of 3 files: b.csv, c.csv;" in other.text


@pytest.mark.usefixtures("repository")
def test_nothing_published_gets_no_certificate(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert sameness.compare(made, "other", ()) is None
    monkeypatch.setattr(sameness, "REPOSITORY", tmp_path)  # no checkout
    assert sameness.compare(made, "mine", ()) is None


def test_stamp_sees_changed_inputs_and_files(tmp_path: Path) -> None:
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for file in files:
        file.write_text(file.name)
    inputs = sameness.digest_of_inputs("runs", "seeds")
    assert not sameness.is_up_to_date(tmp_path, inputs)
    sameness.write_stamp(tmp_path, inputs)
    (tmp_path / "other.csv").write_text("by somebody else")
    assert sameness.is_up_to_date(tmp_path, inputs)
    assert [*sameness.stamped(tmp_path)] == ["a.csv", "b.csv"]
    assert not sameness.is_up_to_date(tmp_path, sameness.digest_of_inputs("runs", "other seeds"))
    files[0].write_text("edited")
    assert not sameness.is_up_to_date(tmp_path, inputs)
    files[0].unlink()
    assert not sameness.is_up_to_date(tmp_path, inputs)
    (tmp_path / ".stamp").write_text("{")
    assert not sameness.is_up_to_date(tmp_path, inputs)
    assert [*sameness.stamped(tmp_path)] == []
