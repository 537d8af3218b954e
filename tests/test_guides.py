"""The guides for newcomers: every file, command and line of Python, in the order of the page."""

import re
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmark.__main__ import main
from tests.support import ROOT

SCENE, LEARNER = "benchmark/guide.md", "agents/README.md"
# What makes the runs few and short. All else is as the page says.
MINIATURE = {
    SCENE: {
        "seeds = 15": "seeds = 2",
        "budget = 5000": "budget = 1000",
        '"settings.budget" = 20000': '"settings.budget" = 1000',
        '"report.looks" = [15]': '"report.looks" = [2]',
    },
    LEARNER: {
        "seeds = 20": "seeds = 2",
        "budget = 10000": "budget = 1000",
        "map_every = 5000": "map_every = 500",
    },
}


def steps_of(page: str) -> Iterator[tuple[str, str]]:
    """Yields a guide's files by name, and its commands as "sh"."""
    for language, text in re.findall(r"```(\w+)\n(.*?)```", page, flags=re.DOTALL):
        named = re.match(r"# (\w+\.\w+)\n", text)
        for part in text.splitlines() if language == "sh" else [text]:
            yield (named[1] if named else language), part


def follow(page: str, monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Does in a folder what a guide says, without the commands that lead there."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", [str(folder), *sys.path])  # as `python -m` does
    for kind, text in steps_of(page):
        if kind == "sh":
            words = text.split()
            if words[:3] == ["python", "-m", "benchmark"]:
                assert main(words[3:]) == 0, text
            elif words[0] == "python":
                runpy.run_path(words[1], run_name="__main__")
            else:
                assert words[0] in ("make", ".", "mkdir"), text
        else:
            Path(kind).write_text(text, encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("name", [SCENE, LEARNER])
def test_guide_can_be_followed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = small = (ROOT / name).read_text(encoding="utf-8")
    for text, smaller in MINIATURE[name].items():
        assert text in small
        small = small.replace(text, smaller)
    follow(small, monkeypatch, tmp_path)
    for path in re.findall(r"`(results/[^`]+|\w+\.(?:webp|png))`", page):
        assert (tmp_path / path).exists(), path
    printed = capsys.readouterr().out
    for success in re.findall(r"Its success is ([\d.]+)", page):
        assert f"success              {success}" in printed
    for scenario, x, y in re.findall(r"`(\w+)`, with (\d\.\d+) against (\d\.\d+)", page):
        rows = re.findall(r"^(\w+) +([\d.]+) +160 +([\d.]+) +160$", printed, flags=re.MULTILINE)
        assert [row for row in rows if float(row[1]) > float(row[2])] == [(scenario, x, y)]
        assert f"in one of {len(rows)}" in page
