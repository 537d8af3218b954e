"""The episode that the page tells, against hand arithmetic."""

from pathlib import Path

import pytest

from benchmark.page import episode
from envs.scenario import load_scenario


def test_steps_are_those_of_the_scenario_and_values_those_of_q_learning() -> None:
    scene, steps = episode.episode()
    settings = load_scenario(episode.SCENARIO)
    target, issuer = settings.regions, scene.cells_of("issuer")[0]
    assert issuer == 6 * 12 + 8
    assert target is not None
    for step in steps:
        row, column = divmod(step.after, 12)
        distance = max(abs(row - 6), abs(column - 8))
        assert step.zone == {1: "uncomfortable", 2: "target"}.get(distance, "outside")
    steps_told = [
        (step.action, step.event, step.reward, step.was, step.value) for step in episode.highlights(steps)
    ]
    # All values begin at 0, and no action is repeated in its cell, so each becomes 0.6 * (reward + 0.9 * 0).
    assert [step[:4] for step in steps_told] == [
        ("DOWN", "move", -0.1, 0.0),
        ("PING", "wrong_ping", -0.4, 0.0),
        ("RIGHT", "move", -0.1, 0.0),
        ("DOWN", "uncomfortable", -0.8, 0.0),
        ("PING", "wrong_ping", -0.4, 0.0),
        ("PING", "target_ping", 1.0, 0.0),
    ]
    assert [step[4] for step in steps_told] == pytest.approx([-0.06, -0.24, -0.06, -0.48, -0.24, 0.6])
    assert len({(step.before, step.action) for step in steps}) == len(steps)


def test_pictures_show_the_agent_where_it_is(results: Path) -> None:
    _, steps = episode.episode()
    page = (results / "index.html").read_text(encoding="utf-8")
    pictures = page.split('<svg class="episode"')[1:]
    shown = episode.highlights(steps)
    assert len(pictures) == 1 + len(shown)
    for picture, step in zip(pictures[1:], shown, strict=True):
        row, column = divmod(step.after, 12)
        assert f'translate({20 * column + 10},{20 * row + 10})"><circle class="agent"' in picture
    assert pictures[0].count("@keyframes sign") == sum(step.action == "PING" for step in steps)
    assert "asks 2 times at a wrong distance" in pictures[0]
