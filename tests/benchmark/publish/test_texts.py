"""Texts of somebody else's experiment and scenario, in every form of file that reports write of them."""

import html
import json
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from markdown_it.token import Token

from benchmark.execution.store import Store
from benchmark.publish import draw
from benchmark.studies import report_of
from envs.scenario import SCENARIO_DIRECTORY
from tests.benchmark.studies.conftest import experiment_of, trained
from tests.support import markdown_parser, small_experiment, variant

# A formula, HTML, an entity, a script's link, ill-formed mathematics, and blocks of Markdown.
TEXT = r"""=cmd|"/C calc"!A0 <script>alert(1)</script> | a & b &lt; ![x](javascript:alert(1))
$\frac$ \input{x} % # ^ ~
# heading

- item
[x]: javascript:alert(1)

| a | b |
|---|---|
| 1 | 2 |
"""
PHASE, TITLE = r"<b>|$\frac$ [red]_", r"_=$\x^$ <i>&amp;|"


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of results of an experiment with these texts."""
    folder = tmp_path_factory.mktemp("texts")
    moody = (SCENARIO_DIRECTORY / "Moody.toml").read_text(encoding="utf-8")
    moody = moody.replace('"calm"', json.dumps(PHASE)).replace("{ calm =", f"{{ {json.dumps(PHASE)} =")
    moody = re.sub("description = .*", lambda _: f"description = {json.dumps(TEXT)}", moody)
    (folder / "mood-1.toml").write_text(moody, encoding="utf-8")
    text = small_experiment(
        description=TEXT,
        note=TEXT,
        scenarios=["S1", f"{folder}/mood-1.toml"],
        report={
            "kind": "comparison",
            "omit": ["agents"],
            "pool": "none",
            "contrasts": [["one-1, index", "2_two, index"]],
        },
        algorithms={"one-1": variant(title=TITLE), "2_two": variant("sarsa")},
    )
    experiment = experiment_of(folder / "mine-1.toml", text)
    report = report_of(experiment).check()
    with Store(folder / "runs.db") as store:
        trained(experiment, store)
        draw.draw(report, store, folder / "mine-1")
    return folder / "mine-1"


def walk(tokens: list[Token] | None) -> Iterator[Token]:
    for token in tokens or ():
        yield token
        yield from walk(token.children)


def test_readme_has_no_structure_but_its_own_and_shows_texts_as_they_are(hostile: Path) -> None:
    parser, text = markdown_parser(), (hostile / "README.md").read_text(encoding="utf-8")
    tokens = list(walk(parser.parse(text)))
    kinds = Counter(token.type for token in tokens)
    assert not kinds["html_block"] + kinds["html_inline"]
    targets = [str(token.attrGet("src") or token.attrGet("href") or "") for token in tokens]
    assert not [target for target in targets if ":" in target]
    headings = [tokens[i + 1].content for i, token in enumerate(tokens) if token.type == "heading_open"]
    assert (headings[0], headings[-1]) == ("mine-1", "Files")
    assert "heading" not in headings
    cells = kinds["th_open"] + kinds["td_open"]
    rows = [line.count(" | ") + 1 for line in text.splitlines() if line.startswith("| ")]
    assert cells == sum(rows)
    words = " ".join(html.unescape(re.sub("<[^>]+>", " ", parser.render(text))).split())
    assert words.count(" ".join(TEXT.split())) == 2  # of the experiment and its note


def test_figures_have_the_texts_as_characters(hostile: Path) -> None:
    """Ill-formed mathematics could not have been drawn."""
    texts = {
        path.stem: html.unescape("\n".join(re.findall("<text[^>]*>([^<]*)</text>", path.read_text())))
        for path in hostile.glob("*.svg")
    }
    assert PHASE in texts["scenarios"].replace("\n", " ")
    for name in ("contrasts", "curves", "summary"):
        assert TITLE in " ".join(texts[name].split("\n")), name
