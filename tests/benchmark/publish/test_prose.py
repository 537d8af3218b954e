"""Texts written by hand: their numbers are in the tables, which show their claims."""

import shutil
from pathlib import Path

import pytest

from benchmark.experiments import EXPERIMENT_DIRECTORY
from benchmark.folder import Folder
from benchmark.publish import front, prose
from benchmark.publish.document import Document
from benchmark.studies import load_study
from envs import InputError
from tests.support import ROOT, reseal

FILES = ("claims.csv", "manifest.json")
NAMES = [path.name.partition(".")[0] for path in sorted(EXPERIMENT_DIRECTORY.glob("*.md.jinja"))]


@pytest.mark.parametrize("name", NAMES)
def test_published_tables_show_what_texts_claim(name: str) -> None:
    assert prose.written(Folder(ROOT / "results" / name))


def copied(folder: Path, change: str) -> Folder:
    """Copies the published replication, with a change of text in its claims or in its manifest."""
    shutil.copytree(ROOT / "results" / "reproduce", folder)
    old, new = change.split(" -> ")
    (file,) = [file for file in map(folder.joinpath, FILES) if old in file.read_text(encoding="utf-8")]
    file.write_text(file.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    reseal(folder)
    return Folder(folder)


def test_a_claim_that_tables_do_not_show_is_not_published(tmp_path: Path) -> None:
    folder = copied(tmp_path / "false", "holds,,1.31094 -> undecided,,1.31094")
    with pytest.raises(prose.ClaimError, match=r"reproduce\.md\.jinja claims, that variability-S2 holds"):
        prose.written(folder)
    document = Document(folder.path)
    assert document.headline == load_study("replication").headline(folder)


def test_a_number_that_tables_do_not_have_is_refused(tmp_path: Path) -> None:
    folder = copied(tmp_path / "missing", "S2/S1,1000 -> S2/S9,1000")
    with pytest.raises(InputError, match=r"reproduce\.py, line \d+: claims.csv has 0 rows with"):
        prose.written(folder)


def test_a_finding_of_ones_own_has_its_claims_in_python(tmp_path: Path) -> None:
    """Mistakes are named by file and line; without a function, the text has the look-ups alone."""
    template, module = tmp_path / "mine.md.jinja", tmp_path / "mine.py"
    folder = Folder(ROOT / "results" / "reproduce")
    template.write_text('Of {{ count("claims", "claim") }} claims, {{ n }} hold.\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"mine\.md\.jinja, line 1: 'n' is undefined"):
        prose.written(folder, template)
    start = "def finding(tables):\n    n = tables.rows('claims', verdict='holds')['claim'].nunique()\n"
    end = "\n    return {'n': n}\n"
    module.write_text(f"{start}    tables.claim(n > 0, 'some hold'){end}", encoding="utf-8")
    text = prose.written(folder, template)
    assert text == "Of 11 claims, 7 hold."
    module.write_text(f"{start}    tables.claim(n > 9, 'most hold'){end}", encoding="utf-8")
    with pytest.raises(prose.ClaimError, match="most hold"):
        prose.written(folder, template)
    module.write_text(f"{start}    return {{'n': n / 0}}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"mine\.py, line 3: division by zero"):
        prose.written(folder, template)


def test_other_runs_have_no_text(tmp_path: Path) -> None:
    change = "reproduce --rep -> reproduce --seeds 0-9 --rep"
    assert prose.written(copied(tmp_path / "other", change)) is None


def test_paragraphs_are_found_by_their_title() -> None:
    folder = Folder(ROOT / "results" / "when")
    assert prose.paragraphs(folder).startswith("**Features:** with 64 places")
    assert prose.paragraphs(folder, "Unseen places").startswith("**Unseen places.** ")
    with pytest.raises(KeyError, match="nothing"):
        prose.paragraphs(folder, "nothing")


def test_readme_checks_its_claims(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(front, "_TEMPLATE", tmp_path / "front.md.jinja")
    (tmp_path / "front.md.jinja").write_text("{{ n_slower }} of {{ n_contrasts }}", encoding="utf-8")
    assert front.front(ROOT / "results") == "18 of 35"
    tables = ["watkins_q_lambda, index", "watkins_q_lambda, offset"]  # than which DQN is faster somewhere
    monkeypatch.setattr(front, "_TILINGS", tables)
    with pytest.raises(prose.ClaimError, match="README: tables do not show that "):
        front.front(ROOT / "results")
