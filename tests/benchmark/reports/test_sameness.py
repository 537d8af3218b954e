"""The certificate, in a repository made for it, and the stamps of what is up to date."""

from pathlib import Path

import pytest

from benchmark.reports import sameness
from tests.support import git

SUMMARY = """scenario,algorithm,n,score,score_low,score_high,success,success_low,success_high
S1,a,10,0.5,0.4,0.6,1,1,1
S2,a,10,0.2,0.1,0.3,,,
S2,b,10,0.7,0.6,0.9,0.4,0.2,0.6
"""
FILES = {"summary.csv": SUMMARY, "b.csv": "b\n", "cost.csv": "1 s\n", "manifest.json": "{}"}


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
    same = certificate(made)
    assert (same.is_identical, same.compared, same.measured) == (
        True,
        ("b.csv", "summary.csv"),
        ("cost.csv",),
    )
    assert "2 of 2 files" in str(same)
    against = certificate(made, repository / "results" / "mine")  # against a folder instead of the commit
    assert against.differing == ("b.csv", "manifest.json")
    assert against.compared == ("b.csv", "manifest.json", "summary.csv")


@pytest.mark.usefixtures("repository")
def test_changed_missing_and_new_files_differ(made: Path) -> None:
    (made / "b.csv").unlink()
    (made / "c.csv").write_text("new")
    other = certificate(made)
    assert (other.compared, other.differing) == (("b.csv", "c.csv", "summary.csv"), ("b.csv", "c.csv"))
    assert all(part in str(other) for part in ("2 of 3 files", "b.csv, c.csv"))


@pytest.mark.usefixtures("repository")
def test_distance_of_the_summary_by_hand(made: Path) -> None:
    # Equal: two successes (the third is missing in both). Within its interval: the score in S1.
    # Outside: the score of b in S2, two half-widths of 0.15 above, and that of a, by one and a half of 0.1.
    text = SUMMARY.replace("10,0.5,", "10,0.55,").replace("10,0.7,", "10,1,").replace("10,0.2,", "10,0.35,")
    (made / "summary.csv").write_text(text)
    counts = ("of 5 numbers", "equal to the published ones: 2;", "within the published interval: 1;",
              "outside it: 2;", "missing: 0.")  # fmt: skip
    distance = certificate(made).distance
    assert [count for count in counts if count not in distance] == []


def test_nothing_published_gets_no_certificate(
    repository: Path, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert sameness.compare(made, "other", ()) is None
    for root in (tmp_path, repository / "results"):  # no checkout, and not the top of one
        monkeypatch.setattr(sameness, "REPOSITORY", root)
        assert sameness.compare(made, "mine", ()) is None


def test_stamp_sees_changed_inputs_and_files(tmp_path: Path) -> None:
    path, files = tmp_path / ".stamp", [tmp_path / "a.csv", tmp_path / "b.csv"]
    for file in files:
        file.write_text(file.name)
    inputs = sameness.digest_of_inputs("runs", "seeds")
    assert not sameness.is_up_to_date(path, inputs)
    sameness.write_stamp(path, inputs, files)
    assert sameness.is_up_to_date(path, inputs)
    assert sameness.stamped(path) == ["a.csv", "b.csv"]
    assert not sameness.is_up_to_date(path, sameness.digest_of_inputs("runs", "other seeds"))
    files[0].write_text("edited")
    assert not sameness.is_up_to_date(path, inputs)
    files[0].unlink()
    assert not sameness.is_up_to_date(path, inputs)
    path.write_text("{")
    assert not sameness.is_up_to_date(path, inputs)
    assert sameness.stamped(path) == []
