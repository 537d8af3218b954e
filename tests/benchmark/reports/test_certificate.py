"""The certificate, in a repository made for it, and the stamps of what is up to date."""

import subprocess
from pathlib import Path

import pytest

from benchmark.reports import certificate, stamp

SUMMARY = """scenario,algorithm,n,score,score_low,score_high,success,success_low,success_high
S1,a,10,0.5,0.4,0.6,1,1,1
S2,a,10,0.2,0.1,0.3,,,
S2,b,10,0.7,0.6,0.9,0.4,0.2,0.6
"""


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A checkout with the published results of an experiment."""
    root = tmp_path / "checkout"
    folder = root / "results" / "mine"
    folder.mkdir(parents=True)
    for name, text in (
        ("summary.csv", SUMMARY),
        ("b.csv", "b\n"),
        ("cost.csv", "1 s\n"),
        ("manifest.json", "{}"),
    ):
        (folder / name).write_text(text)
    git = ["git", "-C", str(root), "-c", "user.name=a", "-c", "user.email=a@b.c"]
    for arguments in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "published"]):
        subprocess.run([*git, *arguments], check=True)
    return root


@pytest.fixture
def made(repository: Path, tmp_path: Path) -> Path:
    """A folder with the same files, the times and the manifest aside."""
    folder = tmp_path / "made"
    folder.mkdir()
    for path in (repository / "results" / "mine").iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "cost.csv").write_text("2 s\n")
    (folder / "manifest.json").write_text("other")
    return folder


def test_same_files_are_identical(repository: Path, made: Path) -> None:
    found = certificate.compare(made, "mine", {"cost.csv"}, repository)
    assert found is not None
    assert found.is_identical
    assert str(found) == (
        "mine: identical to the published results (2 of 2 files; files with measured times, not compared: 1)."
    )


def test_published_means_committed(repository: Path, made: Path) -> None:
    (repository / "results" / "mine" / "b.csv").write_text("changed since\n")
    found = certificate.compare(made, "mine", {"cost.csv"}, repository)
    assert found is not None
    assert found.is_identical


def test_changed_missing_and_new_files_differ(repository: Path, made: Path) -> None:
    (made / "b.csv").unlink()
    (made / "c.csv").write_text("new")
    found = certificate.compare(made, "mine", {"cost.csv"}, repository)
    assert found is not None
    assert (found.identical, found.differing) == (("summary.csv",), ("b.csv", "c.csv"))
    assert str(found).startswith("mine: 2 of 3 files differ from the published results")
    assert ": b.csv, c.csv; files" in str(found)


def test_distance_of_the_summary_by_hand(repository: Path, made: Path) -> None:
    # Equal: two successes (the third is missing in both). Within its interval: the score in S1.
    # Outside: the score of b in S2, two half-widths of 0.15 above, and that of a, by one and a half of 0.1.
    text = SUMMARY.replace("10,0.5,", "10,0.55,").replace("10,0.7,", "10,1,").replace("10,0.2,", "10,0.35,")
    (made / "summary.csv").write_text(text)
    found = certificate.compare(made, "mine", {"cost.csv"}, repository)
    assert found is not None
    assert found.distance is not None
    assert (found.distance.equal, found.distance.within, found.distance.outside) == (2, 1, 2)
    assert found.distance.farthest == "score of S2, b: 1, published 0.7 [0.6, 0.9]"
    assert str(found).endswith(
        "summary.csv: of 5 numbers with a 95 % interval, equal to the published ones: 2; "
        "different, but within the published interval: 1; "
        "outside it: 2 (the farthest: score of S2, b: 1, published 0.7 [0.6, 0.9])."
    )


def test_nothing_published_gets_no_certificate(repository: Path, made: Path, tmp_path: Path) -> None:
    assert certificate.compare(made, "other", (), repository) is None
    assert certificate.compare(made, "mine", (), tmp_path) is None  # no checkout
    assert certificate.compare(made, "mine", (), repository / "results") is None  # not its top


def test_stamp_sees_changed_inputs_and_files(tmp_path: Path) -> None:
    path, files = tmp_path / ".stamp", [tmp_path / "a.csv", tmp_path / "b.csv"]
    for file in files:
        file.write_text(file.name)
    inputs = stamp.digest_of("runs", "seeds")
    assert not stamp.is_up_to_date(path, inputs)
    stamp.write(path, inputs, files)
    assert stamp.is_up_to_date(path, inputs)
    assert not stamp.is_up_to_date(path, stamp.digest_of("runs", "other seeds"))
    files[0].write_text("edited")
    assert not stamp.is_up_to_date(path, inputs)
    files[0].write_text("a.csv")
    assert stamp.is_up_to_date(path, inputs)
    files[1].unlink()
    assert not stamp.is_up_to_date(path, inputs)
    path.write_text("{")
    assert not stamp.is_up_to_date(path, inputs)
