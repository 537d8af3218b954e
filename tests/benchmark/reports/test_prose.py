"""Texts written by hand: their numbers are in the tables, whose rows show their claims."""

import shutil
from pathlib import Path

import pytest

from benchmark.experiments import EXPERIMENT_DIRECTORY
from benchmark.reports.document import Document
from envs import InputError
from tests.benchmark.reports.sentences import check_links
from tests.support import ROOT

NAMES = [path.name.partition(".")[0] for path in sorted(EXPERIMENT_DIRECTORY.glob("*.md.jinja"))]


@pytest.mark.parametrize("name", NAMES)
def test_numbers_of_published_texts_are_in_the_tables(name: str) -> None:
    document = Document(ROOT / "results" / name)
    assert document.headline == document.written is not None
    check_links(document, fewest=1)


def copied(folder: Path, **changes: str) -> Document:
    """Copies the published results of the search, with changes of texts in some files."""
    shutil.copytree(ROOT / "results" / "tuning", folder)
    for stem, change in changes.items():
        path = next(folder.glob(f"{stem}.*"))
        old, new = change.split(" -> ")
        text = path.read_text(encoding="utf-8")
        assert old in text
        path.write_text(text.replace(old, new), encoding="utf-8")
    return Document(folder)


def test_a_claim_that_tables_do_not_show_is_refused_and_not_published(tmp_path: Path) -> None:
    missing = copied(tmp_path / "missing", chosen="watkins_q_lambda,offset -> watkins_q_lambda,index")
    with pytest.raises(InputError, match=r"missing: .*chosen.csv has 0 rows with .*watkins_q_lambda"):
        _ = missing.headline
    false = copied(tmp_path / "false", chosen="0.808792,0.7315 -> 0.1,0.7315")
    with pytest.raises(InputError, match=r"do not show what the text claims: the best net is DQN"):
        _ = false.written
    assert false.headline == false.report.headline(false.folder)


@pytest.mark.parametrize(
    "change", ['"partial": "" -> "partial": "Few."', "tuning --rep -> tuning --seeds 0-9 --rep"]
)
def test_other_runs_have_generated_sentences(change: str, tmp_path: Path) -> None:
    document = copied(tmp_path / "tuning", manifest=change)
    assert document.written is None
    assert document.headline is not None
