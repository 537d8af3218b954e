"""The guides for newcomers: every file, command and line of Python, in the order of the page."""

import doctest
import re
import runpy
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmark.__main__ import main
from benchmark.experiment import load_experiment
from benchmark.report import study_of
from envs import load_scenario, scenario_names
from tests.support import ROOT, made

SCENE, LEARNER, STUDIES = "benchmark/guide.md", "agents/README.md", "benchmark/STUDIES.md"
# What makes the runs few and short. All else is as the page says.
MINIATURE: dict[str, dict[str, str]] = {
    STUDIES: {},
    SCENE: {
        "seeds = 15": "seeds = 2",
        "budget = 5000": "budget = 1000",
        '"settings.budget" = 20000': '"settings.budget" = 1000',
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
@pytest.mark.parametrize("name", [SCENE, LEARNER, STUDIES])
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


def test_guide_to_experiments_has_a_reading_to_copy(tmp_path: Path) -> None:
    guide = (ROOT / "benchmark" / "experiments" / "README.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"```toml\n# dear\.toml\n(.*?)```", guide, flags=re.DOTALL)
    experiment = made(tmp_path / "dear.toml", text)
    study_of(experiment)
    costs = {each.condition.name: each.scenario.rewards for each in experiment.populations}
    assert (costs["default"].wrong_ping, costs["dear"].wrong_ping) == (-0.4, -1.0)
    assert len(costs) == 1 + len(load_experiment("reproduce").declared.readings)


def test_guide_to_scenarios_lists_all_and_its_examples_are_right() -> None:
    guide = (ROOT / "envs" / "scenarios" / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\w+) \| [^|]+\. \|$", guide, flags=re.MULTILINE)
    assert sorted(rows) == scenario_names()
    group, others, onlookers = re.findall(r"```toml\n(.*?)```", guide, flags=re.DOTALL)
    (session,) = re.findall(r"```pycon\n(.*?)```", guide, flags=re.DOTALL)
    examples = doctest.DocTestParser().get_doctest(session, {}, "README", None, 0)
    result = doctest.DocTestRunner().run(examples)
    assert result.attempted > 0
    assert not result.failed
    three = load_scenario("Anywhere", {"grid.metres_per_cell": 0.3, **tomllib.loads(group)})
    assert three.group == load_scenario("ThreeTalking").group
    assert len(load_scenario("Anywhere", tomllib.loads(onlookers)).layout.ways) == 222
    assert load_scenario("S1", tomllib.loads(others)).layout.others[4][0].position == (2, 6)
