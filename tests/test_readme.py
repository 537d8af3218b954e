"""README, CONTRIBUTING and the guides: code runs, commands work, links lead somewhere."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmark.__main__ import main
from tests.support import ROOT, small_experiment, variant

GUIDES = (
    "agents/README.md",
    "benchmark/guide.md",
    "benchmark/STUDIES.md",
)  # followed step by step in another test
PAGES = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for folder in (".", "agents", "benchmark", "benchmark/experiments", "envs/scenarios")
    for path in sorted((ROOT / folder).glob("*.md"))
    if path.name != "CHANGELOG.md"
}
README, CONTRIBUTING = PAGES["README.md"], PAGES["CONTRIBUTING.md"]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
TARGETS = re.findall(r"^([\w-]+):.*##", MAKEFILE, flags=re.MULTILINE)


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page, flags=re.DOTALL)


@pytest.mark.parametrize("code", blocks(README, "python"))
def test_python_code_runs(code: str, tmp_path: Path) -> None:
    short = re.sub(r"\.learn\([\d_]+\)", ".learn(500)", code)
    command = [sys.executable, "-W", "error", "-c", short]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


# The comparison as small as can be: every command is tried, and comparisons are tested elsewhere.
SMALL = small_experiment(
    report={"kind": "comparison"},
    scenarios=["S1", "S2"],
    map_every=100,
    settings={"budget": 200, "time_limit": 50},
    algorithms={"q_learning": variant(), "dqn": variant("compiled_dqn", "one_hot")},
)


def run_in_miniature(words: list[str], directory: Path) -> bool:
    """Runs a command of the package with small experiments in place of the published ones."""
    comparison = directory / "small.toml"
    comparison.write_text(SMALL, encoding="utf-8")
    small = {name: f"{directory}/{name}" for name in ("film.webp", "dqn.zip", "table.npz")}
    small |= {"compare_deep": str(comparison), "100-199": "100-101", "0-29": "0-1"}
    arguments = [small.get(word, word) for word in words[3:]]
    arguments += ["--smoke"] * bool({"bench", "reproduce"} & {*arguments})
    if arguments[0] == "watch":
        arguments += ["--experiment", str(comparison)]
    if arguments[0] not in ("list", "assess", "export"):
        arguments += ["--results", str(directory)]
    assert main(arguments) == 0, words
    return words[1:3] == ["-m", "benchmark"]


@pytest.mark.slow
def test_every_command_works(tmp_path: Path) -> None:
    """In the order in which a reader meets them."""
    known: dict[str, Callable[[list[str]], bool]] = {
        "make": lambda words: words[1] in TARGETS and all("=" in word for word in words[2:]),
        ".venv/bin/python": lambda words: run_in_miniature(words, tmp_path),
    }
    pages = (page for name, page in PAGES.items() if name not in GUIDES)
    lines = "\n".join(block for page in pages for block in blocks(page, "sh")).splitlines()
    for words in filter(None, (line.split(" #")[0].split() for line in lines)):
        assert known[words[0]](words), words


def anchors(path: Path) -> set[str]:
    """Returns the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("name", PAGES)
def test_every_path_and_link_exists(name: str) -> None:
    page = PAGES[name]
    for link in re.findall(r"\]\((?!https?:)([^)]+)\)", page):
        file, _, anchor = link.partition("#")
        target = (ROOT / name).parent / file
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link
    folders = r"\.ci|\.github|agents|benchmark|envs|results|tests"
    quoted = re.findall(rf"`((?:{folders})/[^`\s]*)`", page)
    quoted += re.findall(r"`(\w+\.(?:md|cff|txt))`", page)
    made = "results/" if name in GUIDES else ("results/index.html", "results/bench_")
    assert [path for path in quoted if not (path.startswith(made) or (ROOT / path).exists())] == []
