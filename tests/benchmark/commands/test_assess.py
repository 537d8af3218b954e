"""The command that assesses an agent."""

from importlib import import_module
from pathlib import Path

import pytest

from benchmark.__main__ import main
from benchmark.assessment import assess

AGENT = """
def act(observation):
    row, column = observation * (9, 11)
    return 1 if row < 3.5 else 3 if column < 5.5 else 4
"""


def test_a_function_is_assessed_as_in_python_in_any_folder_and_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "my_agent.py").write_text(AGENT, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    arguments = ["--agent", "my_agent:act", "--observation", "coordinates", "--save", "map.svg"]
    assert main(["assess", *arguments]) == 0
    text = capsys.readouterr().out
    assessment = assess(import_module("my_agent").act, scenario="S1", observation="coordinates")
    assert text == f"{assessment}\n\nmap: map.svg\n"
    numbers = dict(line.split(maxsplit=1) for line in text.splitlines() if line.startswith("  s"))
    assert numbers["score"].startswith("1 ")
    assert numbers["steps"] == "11"
    assert Path("map.svg").read_text(encoding="utf-8").startswith("<svg")
