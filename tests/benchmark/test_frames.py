"""Runs as data frames, stored and published."""

from pathlib import Path

import pytest

from benchmark import curves, runs
from benchmark.__main__ import main
from envs import InputError
from tests.support import small_experiment, variant

EXPERIMENT = small_experiment(
    map_every=300,
    report="comparison",
    settings={"budget": 300, "time_limit": 50},
    algorithms={"one": variant(seeds=3), "two": variant("expected_sarsa", seeds=3)},
)


def test_frames_are_of_all_runs_stored_or_else_published(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    file, store = Path("mine.toml"), tmp_path / "results" / "runs.db"
    file.write_text(EXPERIMENT, encoding="utf-8")
    with pytest.raises(InputError, match=r"runs.db has no runs; \S+ has no scores.csv.gz or runs.csv"):
        runs(file, "results")
    assert main(["run", "mine.toml", "--report"]) == 0
    capsys.readouterr()
    stored, learned = runs(file), curves("mine.toml", "results")
    assert stored.groupby("learner")["seed"].agg(list).to_dict() == {
        f"{n}, index": [0, 1, 2] for n in ("one", "two")
    }
    assert stored.attrs["source"].startswith("stored")
    last = learned[learned["step"] == 300].reset_index()
    assert len(learned) == 4 * len(stored)
    assert (last["success"] == stored["success"]).all()
    store.rename(tmp_path / "kept.db")
    published = runs("mine.toml")
    assert published.attrs["source"].startswith("published")
    assert published["learner"].tolist() == stored["learner"].tolist()
    assert published["score"].tolist() == pytest.approx(stored["score"].tolist(), rel=1e-5)
    with pytest.raises(InputError, match=r'no runs; run .* first, or take source="published" for'):
        curves(file, "results")
    means = curves(file, source="published").query("step == 300").set_index("variant")
    assert means["success"].to_dict() == pytest.approx(stored.groupby("variant")["success"].mean().to_dict())

    # More seeds are declared: neither what is stored nor published is whole.
    (tmp_path / "kept.db").rename(store)
    file.write_text(EXPERIMENT.replace("seeds = 3", "seeds = 4"), encoding="utf-8")
    with pytest.raises(InputError, match=r"has 6 of 8 runs; \S+ is of other runs than .* declares now"):
        runs(file, "results")
    for source in ("stored", "published"):
        assert runs(file, source=source)["seed"].tolist() == [0, 1, 2] * 2
    (tmp_path / "results" / "mine" / "scores.csv.gz").write_bytes(b"\x1f\x8b damaged")
    with pytest.raises(InputError, match=r"scores\.csv\.gz: damaged"):
        runs(file, source="published")
    with pytest.raises(InputError, match="source = 'all': accepted: stored, published"):
        runs(file, source="all")
    assert capsys.readouterr() == ("", "")
