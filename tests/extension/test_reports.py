"""Reports extended from outside: contrasts in TOML, an item in one short file, and a study in this one."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from benchmark.analysis.frames import by_population
from benchmark.experiments import Experiment, load_experiment
from benchmark.publish import document
from benchmark.studies import Data, Declared, Study, report_of
from benchmark.studies.item import Estimate, item
from envs import InputError
from tests.benchmark.studies.conftest import experiment_of, results_of
from tests.support import ROOT, small_experiment, variant

EXPERIMENT = small_experiment(
    scenarios=["S1", "S3"],
    horizon=200,
    evaluation_every=200,
    settings={"budget": 400},
    algorithms={"one": variant(seeds=3), "two": variant("sarsa", seeds=3)},
)
KIND = f"{__name__}:STUDY"


def _check(experiment: Experiment, _: Declared) -> None:
    if len(experiment.scenarios) > 2:
        raise InputError(f"{experiment.argument}: scenarios: accepted: at most two.")


@item("successes", "success probability", "scenario success")
def successes(analysis: Data[Declared]) -> Iterator[dict[str, Any]]:
    """A row for each population."""
    for keys, rows in by_population(analysis.runs):
        success = rows["success"]
        yield keys | {"success": Estimate(success.mean(), success.min(), success.max())}


STUDY = Study(
    declared=Declared,
    analyse=lambda data: data,
    name="successes",
    question="How often does it succeed?",
    check=_check,
    items=(successes,),
    document=Path(__file__).with_name("successes.md.jinja"),
    headline=lambda folder: f"Success in S1 is {folder.frame('successes')['success'][0]:g}.",
)


def test_contrasts_are_differences_of_means(tmp_path: Path) -> None:
    report = 'report = { kind = "comparison", contrasts = [["two, index", "one, index"]] }'
    folder = results_of(tmp_path, f"{EXPERIMENT}{report}\n")
    mean = pd.read_csv(folder / "scores.csv.gz").groupby(["variant", "scenario"])["success"].mean()
    (found,) = pd.read_csv(folder / "contrasts.csv")["success_difference"]
    assert found == pytest.approx(mean["two"].mean() - mean["one"].mean(), abs=1e-5)


def test_an_item_is_one_short_file_with_table_and_figure(tmp_path: Path) -> None:
    report = '{ kind = "comparison", items = ["tests.extension.lost:lost"] }'
    folder = results_of(tmp_path, f"{EXPERIMENT}report = {report}\n")
    shares = pd.read_csv(folder / "lost.csv")
    assert shares["scenario"].tolist() == ["S1", "S1", "S3", "S3"]
    assert ((shares["share_low"] <= shares["share"]) & (shares["share"] <= shares["share_high"])).all()
    readme = (folder / "README.md").read_text(encoding="utf-8")
    assert "| lost.csv, lost.svg" in readme  # in the list of files
    assert "![Share of runs without any success.](lost.svg)" in readme
    (tmp_path / "runs.db").unlink()  # texts can be made again from the files alone
    (folder / "README.md").unlink()
    document.write(folder, report_of(load_experiment(tmp_path / "mine.toml")).study)
    assert (folder / "README.md").read_text(encoding="utf-8") == readme
    with pytest.raises(InputError, match=r"manifest\.json: report: .*: code of"):
        document.write(folder)  # a manifest may come from anybody


def test_report_of_another_kind(tmp_path: Path) -> None:
    folder = results_of(tmp_path, f"{EXPERIMENT}report = {json.dumps(KIND)}\n")
    success = pd.read_csv(folder / "successes.csv")["success"]
    readme = (folder / "README.md").read_text(encoding="utf-8")
    assert f"\nSuccess in S1 is {success[0]:g}.\n" in readme
    assert "## Successes" in readme


@pytest.mark.parametrize(
    ("report", "names"),
    [
        ('"comparing"', ["comparing", "comparison"]),
        ('"nowhere.to:be_found"', ["nowhere.to:be_found"]),
        ('"envs:ACTIONS"', ["envs:ACTIONS"]),
        (f'{{ kind = "{KIND}", items = ["{__name__}:KIND"] }}', [f"{__name__}:KIND"]),
        (f'{{ kind = "{KIND}", items = ["{__name__}:successes"] }}', ["successes"]),
        (f'{{ kind = "{KIND}", digits = 2 }}', ["report: unknown key digits"]),
    ],
)
def test_mistakes_get_one_sentence(tmp_path: Path, report: str, names: list[str]) -> None:
    experiment = experiment_of(tmp_path / "mine.toml", f"{EXPERIMENT}report = {report}\n")
    with pytest.raises(InputError) as caught:
        report_of(experiment).check()
    assert [name for name in [str(tmp_path / "mine.toml"), *names] if name not in str(caught.value)] == []
    assert "\n" not in str(caught.value)


def test_study_of_the_guide(tmp_path: Path) -> None:
    guide = (ROOT / "benchmark" / "studies" / "README.md").read_text(encoding="utf-8")
    lost, spread = re.findall(r"```python\n(.*?)```", guide, re.DOTALL)
    (tmp_path / "lost_too.py").write_text(lost, encoding="utf-8")
    (tmp_path / "spread.py").write_text(spread, encoding="utf-8")
    (tmp_path / "spread_document.md.jinja").write_text('{{ show("spread") }}\n', encoding="utf-8")
    report = 'report = { kind = "spread:STUDY", digits = 2, items = ["lost_too:lost"] }'
    folder = results_of(tmp_path, f"{EXPERIMENT}{report}\n")
    deviations = pd.read_csv(folder / "spread.csv")["deviation"]
    assert deviations.tolist() == deviations.round(2).tolist()
    assert (folder / "lost.svg").is_file()
