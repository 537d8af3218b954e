"""The certificate, in a repository made for it."""

from pathlib import Path

import pytest

from benchmark.folder import write_manifest
from benchmark.publish import sameness
from tests.support import git

FILES = {"a.csv": "a\n", "b.csv": "b\n", "cost.csv": "1 s\n", "README.md": "."}
KEPT = {"experiment": "mine", "report": {"kind": "comparison"}, "scenarios": {}}


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkout with the published results of an experiment."""
    root = tmp_path / "checkout"
    folder = root / "results" / "mine"
    folder.mkdir(parents=True)
    for name, text in FILES.items():
        (folder / name).write_text(text)
    write_manifest(folder, KEPT)
    for arguments in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "published"]):
        git(root, *arguments)
    monkeypatch.setattr(sameness, "REPOSITORY", root)
    return root


@pytest.fixture
def made(tmp_path: Path) -> Path:
    """A folder with the same files, the times and the manifest aside."""
    folder = tmp_path / "made"
    folder.mkdir()
    for name, text in (FILES | {"cost.csv": "2 s\n"}).items():
        (folder / name).write_text(text)
    write_manifest(folder, KEPT | {"runs": 5})
    return folder


def certificate(made: Path) -> sameness.Certificate:
    compared = sameness.compare(made, "mine", {"cost.csv"})
    assert compared is not None
    return compared


def test_same_files_are_identical_to_what_is_committed(repository: Path, made: Path) -> None:
    (repository / "results" / "mine" / "b.csv").write_text("changed since\n")
    aside = " (measured times are not compared: cost.csv)"
    assert certificate(made) == (True, f"mine: identical to the published results{aside}.")


@pytest.mark.usefixtures("repository")
def test_changed_missing_and_new_files_differ(made: Path) -> None:
    (made / "b.csv").unlink()
    (made / "c.csv").write_text("new")
    other = certificate(made)
    assert not other.is_identical
    assert "different from the published results: b.csv, c.csv (" in other.text


@pytest.mark.usefixtures("repository")
def test_nothing_published_gets_no_certificate(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert sameness.compare(made, "other", ()) is None
    monkeypatch.setattr(sameness, "REPOSITORY", tmp_path)  # no checkout
    assert sameness.compare(made, "mine", ()) is None
