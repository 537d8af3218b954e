"""Texts written by hand: their numbers are in the tables, which show their claims."""

import shutil
from pathlib import Path

import pandas as pd
import pytest

from benchmark.drawing.tables import LINK
from benchmark.experiments import EXPERIMENT_DIRECTORY
from benchmark.folder import Folder
from benchmark.publish import document, prose
from benchmark.publish.document import Document
from envs import InputError
from tests.support import ROOT, reseal

FILES = ("claims.csv", "manifest.json")
NAMES = [path.name.partition(".")[0] for path in sorted(EXPERIMENT_DIRECTORY.glob("*.md.jinja"))]


@pytest.mark.parametrize("name", NAMES)
def test_published_tables_show_what_texts_claim_and_have_their_numbers(name: str) -> None:
    folder = Folder(ROOT / "results" / name)
    text = prose.written(folder)
    assert text is not None
    links = [link for link in LINK.findall(text) if link[2].isdigit()]  # to a single row
    assert links
    for number, file, row in links:
        values = pd.read_csv(folder.path / file).iloc[int(row) - 2]
        shown = {f"{value:,.{n}f}" for value in values if isinstance(value, int | float) for n in range(3)}
        assert number in shown or number.endswith(("s", *values.astype(str))), number  # seconds, or a name


def copied(folder: Path, change: str) -> Folder:
    """Copies the published replication, with a change of text in its claims or in its manifest."""
    shutil.copytree(ROOT / "results" / "reproduce", folder)
    old, new = change.split(" -> ")
    (file,) = [file for file in map(folder.joinpath, FILES) if old in file.read_text(encoding="utf-8")]
    file.write_text(file.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    reseal(folder)
    return Folder(folder)


def test_a_claim_that_tables_do_not_show_is_not_published(tmp_path: Path) -> None:
    folder = copied(tmp_path / "false", "holds,0.361358 -> undecided,0.361358")
    with pytest.raises(prose.ClaimError, match=r"reproduce\.md\.jinja claims, that variability-S2 holds"):
        prose.written(folder)
    document = Document(folder.path)
    assert document.headline == document.study.headline(folder)


def test_a_number_that_tables_do_not_have_is_refused(tmp_path: Path) -> None:
    folder = copied(tmp_path / "missing", "S2/S1,1000 -> S2/S9,1000")
    with pytest.raises(InputError, match=r"reproduce\.md\.jinja, line \d+: claims.csv has 0 rows with"):
        prose.written(folder)


@pytest.mark.parametrize(
    "change", ['"partial": "" -> "partial": "Few."', "reproduce --rep -> reproduce --seeds 0-9 --rep"]
)
def test_other_runs_have_no_text(change: str, tmp_path: Path) -> None:
    assert prose.written(copied(tmp_path / "other", change)) is None


def test_paragraphs_are_found_by_their_title() -> None:
    folder = Folder(ROOT / "results" / "when")
    assert prose.paragraphs(folder).startswith("PPO learns faster ")
    assert prose.paragraphs(folder, "Unseen places").startswith("**Unseen places.** ")
    with pytest.raises(KeyError, match="nothing"):
        prose.paragraphs(folder, "nothing")


def test_different_values_are_counted_once() -> None:
    """Each of the paper's 11 claims has several rows: for its parts, with 100 agents and with 1,000."""
    lookups = prose.Lookups(Folder(ROOT / "results" / "reproduce"))
    assert LINK.findall(lookups.count("claims", of="claim"))[0][0] == "11"


def test_readme_looks_up_numbers_and_checks_claims(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(document, "_FRONT", tmp_path / "front.md.jinja")
    number = 'of.when.number("cells", "steps", grid="places", places=64, learner="ppo, coordinates")'
    (tmp_path / "front.md.jinja").write_text(f"{{{{ {number} | plain }}}} steps", encoding="utf-8")
    assert document.front(ROOT / "results") == "14,800 steps"
    (tmp_path / "front.md.jinja").write_text('{{ of.when.claim(1 > 2, "1 is more") }}', encoding="utf-8")
    with pytest.raises(prose.ClaimError, match="README: tables do not show that 1 is more"):
        document.front(ROOT / "results")
