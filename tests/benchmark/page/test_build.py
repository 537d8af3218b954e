"""The page as a file: made of published files alone, with every number in the row that it links to."""

import html
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pandas as pd
import pytest

from benchmark.drawing.tables import plain, show
from benchmark.experiments import load_experiment
from benchmark.page import build
from benchmark.reports import REPORTS, Item, Report, load_report, texts
from benchmark.reports.published import Published
from benchmark.reports.texts import load
from envs import InputError
from tests.benchmark.page.pages import RESULTS, rows_of, unpacked


class Links(HTMLParser):
    """Collects the links of a page, with their texts."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, str, str]] = []  # class, target, text
        self._open: tuple[str, str] | None = None
        self._text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "a":
            values = dict(attrs)
            self._open = values.get("class") or "", values.get("href") or ""
            self._text = ""

    def handle_data(self, data: str) -> None:
        self._text += data

    def handle_endtag(self, tag: str) -> None:
        if tag == "a" and self._open is not None:
            self.found.append((*self._open, self._text))
            self._open = None


def links(text: str) -> list[tuple[str, str, str]]:
    parser = Links()
    parser.feed(text)
    return parser.found


def without_pictures(text: str) -> str:
    """Returns the page without what libraries of other builds compress otherwise."""
    text = re.sub(r'base64,[^"]+"', 'base64,"', text)
    return re.sub(r'(id="data">)[^<]+<', r"\1<", text)


def test_published_page_is_what_the_code_makes(results: Path, text: str) -> None:
    published = (RESULTS / "index.html").read_text(encoding="utf-8")
    assert without_pictures(published) == without_pictures(text), "index.html is out of date: run make report"
    assert unpacked(published) == unpacked(text)
    index = (results / "README.md").read_text(encoding="utf-8")
    assert (RESULTS / "README.md").read_text(encoding="utf-8") == index


def test_same_files_make_the_same_page(results: Path, text: str) -> None:
    build.write(results)
    assert (results / "index.html").read_text(encoding="utf-8") == text


def test_page_is_small_and_whole(results: Path, text: str) -> None:
    assert len(text.encode()) <= 4_000_000
    words = html.unescape(re.sub("<[^>]+>", "", text)).replace("−", "-")
    headline = plain(pd.read_csv(results / "compare_deep" / "findings.csv")["text"].iloc[0])
    assert " ".join(headline.replace("`", "").split()) in " ".join(words.split())
    assert not re.findall(r'(?:src|action|data)="(?!data:)[^"]', text)
    assert not re.findall(r"@import|url\(|<link(?! rel=\"icon\")", text)


def test_answer_comes_first_and_every_report_says_its_own(results: Path, text: str) -> None:
    starts = ["<h1>", 'id="finding"', "<nav", 'id="task"', 'id="comparison"', 'id="equivalence"',
              'id="replication"', 'id="explorer"', 'id="speed"', 'id="made"']  # fmt: skip
    places = [text.index(start) for start in starts]
    assert places == sorted(places)
    assert text.count("<nav") == 1
    for name, part, follower in (
        ("compare_deep", 'id="finding"', "<nav"),
        ("equivalence", 'id="equivalence"', 'id="replication"'),
        ("reproduce", 'id="replication"', 'id="explorer"'),
    ):
        published = Published(results / name)
        report, _ = load(published)
        words = re.sub("<[^>]+>", "", text[text.index(part) : text.index(follower)])
        shown = " ".join(html.unescape(words).replace("−", "-").split())
        headline = plain(report.headline(published)).replace("`", "")
        assert " ".join(headline.split()) in shown
        for sentence in report.sentences(published):
            place = html.unescape(re.sub("<[^>]+>", "", text)).replace("−", "-")
            assert place.count(plain(sentence).replace("`", "")) == 1


@pytest.fixture
def comparison(results: Path, tmp_path: Path) -> Path:
    """A folder with the results of the comparison alone."""
    shutil.copytree(results / "compare_deep", tmp_path / "compare_deep")
    return tmp_path


@pytest.mark.parametrize(("lead", "is_there"), [("region", True), ("region", False), ("", True)])
def test_figure_of_the_lead_stands_above_the_headline_and_only_there(
    comparison: Path, monkeypatch: pytest.MonkeyPatch, lead: str, is_there: bool
) -> None:
    if not is_there:
        (comparison / "compare_deep" / "region.png").unlink()
    monkeypatch.setattr(texts, "load", lambda published: _led(published, lead))
    text = build.write(comparison).read_text(encoding="utf-8")
    finding = text[text.index('id="finding"') : text.index("<nav")]
    has_lead = bool(lead) and is_there
    assert finding.count("<img") == has_lead
    # Elsewhere the region is shown on demand, as its table and not as its figure; other figures stay.
    assert text.count('href="compare_deep/region.svg"') == has_lead
    assert text.count('href="compare_deep/aggregate.svg"') == 1
    if has_lead:
        assert finding.index("<img") < finding.index('<p class="lead">')
        assert '<a href="compare_deep/region.svg"><img' in finding


def _led(published: Published, lead: str) -> tuple[Report, tuple[Item, ...]]:
    """Returns a folder's report with another lead, and its items."""
    report, items = load(published)
    return replace(report, lead=lead), items


@pytest.mark.parametrize("name", sorted(REPORTS))
def test_lead_of_a_report_is_one_of_its_items(name: str) -> None:
    report = load_report(name)
    assert report.lead in {"", *(item.name for item in report.items)}


def test_every_link_leads_somewhere(results: Path, text: str) -> None:
    found = links(text)
    assert len(found) > 500
    for _, target, _ in found:
        file, _, fragment = target.partition("#")
        if not file:
            assert f'id="{fragment}"' in text, target
        elif not file.startswith("https://arxiv.org/"):
            assert (results / file).exists(), target


def numbers_in(row: list[str], like: str) -> set[str]:
    """Returns what the numbers of a CSV row look like when they are shown as a number of the page is."""
    cells = [float(cell) for cell in row if re.fullmatch(r"-?[\d.]+(e[+-]\d+)?|-?inf", cell)]
    decimals = len(like.partition(".")[2])
    return {show(cell) for cell in cells} | {f"{cell:.{decimals}f}" for cell in cells}


def test_every_number_is_in_the_row_that_it_links_to(results: Path, text: str) -> None:
    checked = 0
    for kind, target, shown in links(text):
        file, _, place = target.partition("#row=")
        if kind != "n" or not place.isdecimal():
            continue  # of several rows
        _, *rows = rows_of(results / file)
        row = rows[int(place) - 2]
        if file.endswith("sensitivity.csv"):
            assert shown in row or shown == "1"  # of the claims that a sentence counts
        elif match := re.fullmatch(r"([−\d.,]+|inf) \[([−\d.,]+), ([−\d.,]+)\]", shown):
            assert {end.replace("−", "-") for end in match.groups()} <= numbers_in(row, "")
        elif re.fullmatch(r"[-−\d.,]+", shown):
            number = shown.replace("−", "-").replace(",", "")
            known = numbers_in(row, number)
            known |= {text[1:] for text in known if text.startswith("-") and not text.strip("-0.")}
            assert {number, f"{float(number):,.0f}"} & known, (shown, target)
        else:
            continue  # in other units
        checked += 1
    assert checked > 500


def test_page_of_the_replication_alone(results: Path, tmp_path: Path) -> None:
    shutil.copytree(results / "reproduce", tmp_path / "reproduce")
    text = build.write(tmp_path).read_text(encoding="utf-8")
    assert "The paper's claims" in html.unescape(text)
    assert 'id="comparison"' not in text


def test_nothing_to_tell(tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match=(
            "there are no results of compare_deep or beyond or ablation or equivalence or reproduce to report"
        ),
    ):
        build.write(tmp_path)
    assert not list(tmp_path.iterdir())


def test_manifest_of_the_published_results_says_what_the_page_needs() -> None:
    names = build.published(RESULTS)
    assert set(names) >= {"compare_deep", "equivalence", "reproduce"}
    for name in names:
        manifest = json.loads((RESULTS / name / "manifest.json").read_text(encoding="utf-8"))
        assert tuple(manifest["scenarios"]) == load_experiment(name).scenarios
        assert manifest["command"].endswith(f"run {name} --report")
