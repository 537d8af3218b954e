"""The command that assesses an agent."""

from pathlib import Path

import pytest

from benchmark.__main__ import main

AGENT = """
def act(observation):
    row, column = observation * (9, 11)
    return 1 if row < 3.5 else 3 if column < 5.5 else 4

def wrong(observation):
    return 7

nothing = None
"""


@pytest.fixture(autouse=True)
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A module of the user's."""
    (tmp_path / "my_agent.py").write_text(AGENT, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)


def test_a_function_is_assessed_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "map.svg"
    arguments = ["--agent", "my_agent:act", "--observation", "coordinates", "--save", str(path)]
    assert main(["assess", *arguments]) == 0
    text = capsys.readouterr().out
    assert text.startswith("S1, observed as coordinates: ")
    # It PINGs in rows 4 to 9 and columns 6 to 11, 36 cells that hold all 16 of the region.
    numbers = dict(line.split(maxsplit=1) for line in text.splitlines() if line.startswith("  s"))
    assert numbers["score"].startswith("1 ")
    assert numbers["steps"] == "11"
    assert f"region overlap       {16 / 36:g}" in text
    assert "ranks 1 of " in text
    assert f"map: {path}" in text
    assert path.read_text(encoding="utf-8").startswith("<?xml")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--agent", "my_agent:wrong"], "observation 0"),
        (["--agent", "my_agent:nothing"], "my_agent:nothing"),
        (["--agent", "my_agent:act", "--scenario", "S7"], "S7"),
        (["--agent", "my_agent:act", "--stochastic"], "stochastic"),
        (["--agent", "my_agent:act", "--save", "map.gif"], "map.gif"),
        (["--model", "model.zip", "--algorithm", "stable_baselines3:PPO"], "model.zip"),
        (["--agent", "a:b", "--model", "c.zip"], "--agent"),
    ],
)
def test_mistakes_get_one_sentence(
    capsys: pytest.CaptureFixture[str], arguments: list[str], expected: str
) -> None:
    assert main(["assess", "--observation", "coordinates", *arguments]) == 2
    message = capsys.readouterr().err
    assert expected in message
    assert message.count("\n") == 1
