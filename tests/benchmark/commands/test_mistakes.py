"""Mistakes on the command line are refused before any work."""

import shlex
from pathlib import Path

import pytest

from benchmark.__main__ import main

AGENT = """
def act(observation):
    return 4

def wrong(observation):
    return 7
"""
FILES = {
    "mistaken_agent.py": AGENT,
    "file": "",  # which nobody can make a folder, not even root
    "reproduce.toml": "",
}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("run reproduct", "reproduct (did you mean reproduce?)"),
        ("run FOLDER/reproduce", "or the path of a .toml file."),
        ("run FOLDER/reproduce.toml", "reproduce"),  # its results would be those of the shipped one
        ("run reproduce --jobs 0", "--jobs 0: "),
        ("run reproduce --seeds 9-2", "--seeds 9-2: "),
        ("run reproduce --results FOLDER/file/results", "/file/results"),
        ("speed --smoke --results FOLDER/file/results", "/file/results"),
        ("report", "FOLDER"),  # no results
        ("report reproduce", "runs.db"),
        ("verify reproduce --runs -1", "--runs -1: "),
        ("watch --save a.gif --scenario s1", "s1 (did you mean S1?)"),
        ("watch --save a.gif --learner dqn --observation index", "unknown learner dqn, index"),
        ("watch --save film.mp4", "film.mp4"),
        ("assess --observation index --agent mistaken_agent:wrong", "observation 0"),
        ("assess --observation index --agent mistaken_agent:act --save map.gif", "map.gif"),
        ("assess --observation index --agent a:b --model c.zip", "--agent"),
    ],
)
def test_mistakes_get_one_line_before_any_work(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: str,
    expected: str,
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    command, *rest = shlex.split(arguments.replace("FOLDER", str(tmp_path)))
    results = [] if command == "assess" else ["--results", str(tmp_path)]
    assert main([command, *results, *rest]) == 2
    line = capsys.readouterr().err
    assert expected.replace("FOLDER", str(tmp_path)) in line
    assert line.startswith("error: ")
    assert line.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} - {"__pycache__"} == FILES.keys()
