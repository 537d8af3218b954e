"""Reports extended from outside: an item in one short file, and a kind of report in this one."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from benchmark.analysis.frames import by_population
from benchmark.experiments import Experiment, load_experiment
from benchmark.folder import Folder
from benchmark.publish import document
from benchmark.publish.document import Document
from benchmark.studies import Data, Declared, Study, load_study, report_of
from benchmark.studies.item import Estimate, called, item
from envs import InputError
from tests.benchmark.studies.conftest import experiment_of, results_of
from tests.support import ROOT, small_experiment, variant

ITEM = Path(__file__).with_name("lost.py")
EXPERIMENT = small_experiment(
    scenarios=["S1", "S3"],
    horizon=200,
    evaluation_every=200,
    settings={"budget": 400},
    algorithms={"one": variant(seeds=3), "two": variant("sarsa", seeds=3)},
)
KIND = f"{__name__}:STUDY"


# A kind of report: the final success of every run


def _check(experiment: Experiment, _: Declared) -> None:
    if len(experiment.scenarios) > 2:
        raise InputError(f"{experiment.argument}: scenarios: accepted: at most two.")


@item("successes", "success probability", "scenario success")
def successes(analysis: Data[Declared]) -> Iterator[dict[str, Any]]:
    """A row for each population."""
    for keys, rows in by_population(analysis.runs):
        success = rows["success"]
        yield keys | {"success": Estimate(success.mean(), success.min(), success.max())}


def _headline(folder: Folder) -> str:
    row = folder.frame("successes").iloc[0]
    return f"Success in {row['scenario']} is {row.success:g}."


STUDY = Study(
    declared=Declared,
    analyse=lambda data: data,
    name="successes",
    question="How often does it succeed?",
    check=_check,
    items=(successes,),
    document=Path(__file__).with_name("successes.md.jinja"),
    headline=_headline,
)


def test_an_item_is_one_short_file_with_table_and_figure(tmp_path: Path) -> None:
    assert len(ITEM.read_text(encoding="utf-8").splitlines()) <= 25
    names = json.dumps([each.name for each in load_study("comparison").items if each.name != "summary"])
    report = f'{{ kind = "comparison", omit = {names}, items = ["tests.extension.lost:lost"] }}'
    folder = results_of(tmp_path, f"{EXPERIMENT}report = {report}\n")
    assert {f"lost.{end}" for end in ("csv", "svg")} <= {file.name for file in folder.iterdir()}
    shares = pd.read_csv(folder / "lost.csv")
    assert shares["scenario"].tolist() == ["S1", "S1", "S3", "S3"]
    assert ((shares["share_low"] <= shares["share"]) & (shares["share"] <= shares["share_high"])).all()
    readme = (folder / "README.md").read_text(encoding="utf-8")
    assert "| lost.csv, .svg" in readme  # in the list of files
    assert "![Share of runs without any success.](lost.svg)" in readme
    (tmp_path / "runs.db").unlink()  # texts can be made again from the files alone
    (folder / "README.md").unlink()
    document.write(folder, report_of(load_experiment(tmp_path / "mine.toml")).study)
    assert (folder / "README.md").read_text(encoding="utf-8") == readme
    with pytest.raises(InputError, match=r"manifest\.json: report: tests\.extension\.lost:lost: code of"):
        document.write(folder)  # a manifest may come from anybody


def test_report_of_another_kind(tmp_path: Path) -> None:
    folder = results_of(tmp_path, f"{EXPERIMENT}report = {json.dumps(KIND)}\n")
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["report"]["kind"] == KIND
    success = pd.read_csv(folder / "successes.csv")["success"]
    readme = (folder / "README.md").read_text(encoding="utf-8")
    assert f"\nSuccess in S1 is {success[0]:g}.\n" in readme
    assert "## Successes" in readme
    assert Document(folder, STUDY).question == "How often does it succeed?"


@pytest.mark.parametrize(
    ("report", "names"),
    [
        ('"comparing"', ["comparing", "comparison"]),
        ('"nowhere.to:be_found"', ["nowhere.to:be_found"]),
        ('"envs:ACTIONS"', ["envs:ACTIONS"]),
        (f'{{ kind = "{KIND}", items = ["{__name__}:KIND"] }}', [f"{__name__}:KIND"]),
        (f'{{ kind = "{KIND}", items = ["{__name__}:NOWHERE"] }}', ["NOWHERE"]),
        (f'{{ kind = "{KIND}", items = ["{__name__}"] }}', ["accepted: module:attribute"]),
        (f'{{ kind = "{KIND}", items = ["{__name__}:successes"] }}', ["successes"]),
    ],
)
def test_mistakes_get_one_sentence(tmp_path: Path, report: str, names: list[str]) -> None:
    experiment = experiment_of(tmp_path / "mine.toml", f"{EXPERIMENT}report = {report}\n")
    with pytest.raises(InputError) as caught:
        report_of(experiment).check()
    assert [name for name in [str(tmp_path / "mine.toml"), *names] if name not in str(caught.value)] == []
    assert "\n" not in str(caught.value)


def test_a_function_of_other_arguments_is_named() -> None:
    def counted(runs: object, curves: object) -> None: ...

    with pytest.raises(
        InputError, match=r"counted: missing a required argument: 'curves'; benchmark/studies"
    ):
        called(counted, None)


def test_a_folder_without_results_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there are no results; run the experiment with --report first"):
        Document(tmp_path)


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
