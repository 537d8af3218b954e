"""README, CONTRIBUTING and the guides: code runs, commands work, links lead somewhere, numbers are right."""

import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from benchmark.__main__ import main
from benchmark.publish import front
from tests.support import ROOT, small_experiment, variant

GUIDES = ("agents/README.md", "benchmark/guide.md")  # followed step by step in another test
FILES = (
    "README.md",
    "CONTRIBUTING.md",
    *GUIDES,
    "benchmark/commands/README.md",
    "benchmark/experiments/README.md",
    "benchmark/studies/README.md",
    "envs/scenarios/README.md",
)
PAGES = {name: (ROOT / name).read_text(encoding="utf-8") for name in FILES}
README, CONTRIBUTING = PAGES["README.md"], PAGES["CONTRIBUTING.md"]
TARGETS = re.findall(r"^([\w-]+):.*##", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page, flags=re.DOTALL)


def test_first_page_is_short() -> None:
    assert len(README.split()) <= 700


@pytest.mark.parametrize("code", blocks(README, "python"))
def test_python_code_runs(code: str, tmp_path: Path) -> None:
    short = re.sub(r"\.learn\([\d_]+\)", ".learn(500)", code)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", short], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def shell_lines() -> Iterator[str]:
    for block in (block for name in FILES if name not in GUIDES for block in blocks(PAGES[name], "sh")):
        yield from filter(None, (line.split(" #")[0].strip() for line in block.splitlines()))


# The comparison as small as can be: every command is tried, and whole comparisons are tested elsewhere.
SMALL = small_experiment(
    report="comparison",
    scenarios=["S1", "S2"],
    map_every=100,
    settings={"budget": 200, "time_limit": 50},
    algorithms={"q_learning": variant(), "dqn": variant("compiled_dqn", "one_hot")},
)


def run_in_miniature(words: list[str], directory: Path) -> bool:
    """Runs a command of the package with small experiments in place of the published ones."""
    comparison = directory / "small.toml"
    comparison.write_text(SMALL, encoding="utf-8")
    small = {
        "compare_deep": str(comparison),
        "100-199": "100-101",
        "0-29": "0-1",
        **{name: f"{directory}/{name}" for name in ("film.webp", "dqn.zip", "table.npz")},
    }
    arguments = [small.get(word, word) for word in words[3:]]
    arguments += ["--smoke"] * ("reproduce" in arguments)
    if arguments[0] == "watch":
        arguments += ["--experiment", str(comparison)]
    if arguments[0] not in ("list", "assess"):
        arguments += ["--results", str(directory)]
    assert main(arguments) == 0, words
    return words[1:3] == ["-m", "benchmark"]


@pytest.mark.slow
def test_every_command_works(tmp_path: Path) -> None:
    """In the order in which a reader meets them: a report needs the runs of the commands before it."""
    known: dict[str, Callable[[list[str]], bool]] = {
        "make": lambda words: words[1] in TARGETS and words[2:] in ([], ["SEEDS=5"]),
        ".venv/bin/python": lambda words: run_in_miniature(words, tmp_path),
    }
    for line in shell_lines():
        words = line.split()
        assert known[words[0]](words), line


def test_ci_does_what_contributing_says() -> None:
    lines = (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    assert lines[-3:] == ["make check", "make test", "make test-slow"]
    assert ".ci/run" in (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")


def anchors(page: str) -> set[str]:
    """Returns the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("name", FILES)
def test_every_path_and_link_exists(name: str) -> None:
    page = PAGES[name]
    for link in re.findall(r"\]\((?!https?:)([^)]+)\)", page):
        file, _, anchor = link.partition("#")
        target = (ROOT / name).parent / file
        assert target.exists(), link
        assert not anchor or anchor in anchors(target.read_text(encoding="utf-8")), link
    quoted = re.findall(r"`((?:\.ci|\.github|agents|benchmark|envs|results|tests)/[^`\s]*)`", page)
    quoted += re.findall(r"`(\w+\.(?:md|cff|txt))`", page)
    made = "results/" if name in GUIDES else "results/index.html"  # by who follows it
    assert [path for path in quoted if not (path.startswith(made) or (ROOT / path).exists())] == []


def test_every_extension_has_a_test() -> None:
    table = CONTRIBUTING.partition("| to add |")[2].partition("\n\n")[0]
    rows = [row.strip("|").split("|") for row in table.splitlines()[2:]]
    assert len(rows) >= 10
    for added, _, tests in rows:
        assert re.search(r"`tests/(\w+/)+test_\w+\.py`", tests), added


def test_readme_is_made_of_the_published_tables() -> None:
    """So no number and no verdict in it can be another one; `make report` writes it."""
    assert front.front(ROOT / "results") == README
