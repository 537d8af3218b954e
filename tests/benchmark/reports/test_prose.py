"""Texts written by hand: their numbers are in the tables, whose rows show their claims."""

import shutil
from pathlib import Path

import pytest

from benchmark.experiments import EXPERIMENT_DIRECTORY
from benchmark.reports import prose
from benchmark.reports.document import Document
from benchmark.reports.folder import Folder
from envs import InputError
from tests.benchmark.reports.sentences import check_links
from tests.support import ROOT

NAMES = [path.name.partition(".")[0] for path in sorted(EXPERIMENT_DIRECTORY.glob("*.md.jinja"))]


@pytest.mark.parametrize("name", NAMES)
def test_numbers_of_published_texts_are_in_the_tables(name: str) -> None:
    check_links(Document(ROOT / "results" / name), fewest=6)


def copied(folder: Path, **changes: str) -> Path:
    """Copies the published results of the search, with changes of texts in two of its files."""
    shutil.copytree(ROOT / "results" / "tuning", folder)
    for stem, change in changes.items():
        path = next(folder.glob(f"{stem}.*"))
        old, new = change.split(" -> ")
        text = path.read_text(encoding="utf-8")
        assert old in text
        path.write_text(text.replace(old, new), encoding="utf-8")
    return folder


def test_a_claim_that_tables_do_not_show_is_refused(tmp_path: Path) -> None:
    assert Document(copied(tmp_path / "as_it_is" / "tuning")).headline is not None
    path = copied(tmp_path / "tuning", chosen="watkins_q_lambda,offset -> watkins_q_lambda,index")
    with pytest.raises(InputError, match=r"tuning: .*chosen.csv has 0 rows with .*watkins_q_lambda"):
        _ = Document(path).headline
    path = copied(tmp_path / "other" / "tuning", chosen="0.808792,0.7315 -> 0.1,0.7315")
    with pytest.raises(InputError, match=r"do not show what the text claims: the best net is DQN"):
        _ = Document(path).headline


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("tuning_seeds_0-9", '"partial": "" -> "partial": ""'),
        ("tuning", '"partial": "" -> "partial": "Few."'),
    ],
)
def test_other_runs_have_generated_sentences(name: str, change: str, tmp_path: Path) -> None:
    folder = copied(tmp_path / name, manifest=change)
    assert prose.text_of(Folder(folder)) is None
    assert Document(folder).headline is not None
