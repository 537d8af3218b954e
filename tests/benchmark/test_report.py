"""Reports: what a stranger's study needs, what a folder then has, and what mistakes are told."""

import shutil
from pathlib import Path

import pandas as pd
import pytest

from benchmark import folder as folders
from benchmark import report
from benchmark.__main__ import main
from benchmark.experiment import load_experiment
from benchmark.folder import MANIFEST, README, Folder
from benchmark.tables import AGENTS, CURVES, RUNS, read
from envs import InputError
from envs.sources import FOUND
from tests.support import git, small_experiment, variant

STUDY = '''"""How much does success vary?"""

import pandas as pd

from benchmark.style import figure_of


def spread(data):
    """Success of every learner."""
    groups = data.runs.groupby("learner", sort=False)["success"]
    ends = {"success_low": groups.min(), "success_high": groups.max()}
    return pd.DataFrame({"success": groups.mean(), **ends}).reset_index()


def draw(data):
    """A dot per learner."""
    with figure_of(1, 1, (4, 2)) as (figure, axes):
        for name in data.experiment.learners:
            axes[0, 0].plot(data.tables["spread"]["success"], **data.look(name))
    return figure


def extra(data):
    """Rows."""
    return pd.DataFrame({"rows": [len(data.curves)], "remark": ["a | b"]})


TABLES = {"spread": spread, "extra": extra, "nothing": lambda data: None}
FIGURES = {"spread": draw}
SHOWN = {"spread": "learner success", "nothing": "x"}
COLUMNS = {"success": "mean success"}


def headline(data):
    return f"{len(data.tables['spread'])} learners vary."
'''
ALGORITHMS = {"table": variant(seeds=3, title="my table"), "dqn": variant("watkins_q_lambda")}


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a stranger's experiment and study, and the published runs."""
    path = tmp_path_factory.mktemp("stranger")
    (path / "spread_study.py").write_text(STUDY, encoding="utf-8")
    write_experiment(path, kind="spread_study")
    assert main(["run", str(path / "mine.toml"), "--jobs", "1", "--results", str(path)]) == 0
    return path


@pytest.fixture
def mine(trained: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    FOUND.clear()  # as in a new process
    return shutil.copytree(trained, tmp_path / "copy")


def write_experiment(path: Path, **keys: object) -> None:
    text = small_experiment(report=keys, algorithms=ALGORITHMS, note="By me.")
    (path / "mine.toml").write_text(text, encoding="utf-8")


def draw(path: Path) -> Path:
    report.write(load_experiment(path / "mine.toml"), path / "mine")
    return path / "mine"


def test_a_study_is_one_file_and_its_folder_says_what_it_has(mine: Path) -> None:
    folder = draw(mine)
    manifest = Folder(folder).manifest
    names = {"spread.csv", "spread.svg", "extra.csv", RUNS, CURVES, AGENTS}
    assert {*manifest["files"]} == names
    assert manifest["runs"] == 5
    assert {path.name for path in folder.iterdir()} == {*names, MANIFEST, README, "columns.csv"}
    runs, curves = read(folder)
    means = [runs[runs["learner"] == name]["success"] for name in ("table, index", "dqn, index")]
    text = (folder / README).read_text(encoding="utf-8")
    assert text.startswith(
        "# How much does success vary?\n\n2 learners vary.\n\n![spread](spread.svg)\n\n*A dot per"
    )
    cells = (f"{each.mean():.3g} [{each.min():.3g}, {each.max():.3g}]" for each in means)
    assert f"| my table | {next(cells)} | | dqn | {next(cells)} |" in " ".join(text.split())
    assert "By me." in text
    assert Folder(folder).tables()["extra"].to_dict("records") == [
        {"rows": len(curves), "remark": "a | b"}
    ]
    meanings = pd.read_csv(folder / "columns.csv", keep_default_na=False)
    found = {(row["file"], row["column"]): row["meaning"] for _, row in meanings.iterrows()}
    assert found["spread.csv", "success"] == "mean success"
    assert found["spread.csv", "success_low"] == "lower end of the 95 % interval of success"
    assert found["extra.csv", "rows"] == ""  # nobody said
    assert all(found[RUNS, column] for column in runs)
    assert all(found[CURVES, column] for column in curves)


def test_a_folder_follows_from_its_runs_alone(
    mine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {path.name: path.read_bytes() for path in draw(mine).iterdir()}
    (mine / "runs.db").unlink()
    (mine / "mine" / "spread.svg").unlink()
    (mine / "mine" / README).write_text("changed")
    assert main(["report", str(mine / "mine.toml"), "--results", str(mine)]) == 0
    assert {path.name: path.read_bytes() for path in (mine / "mine").iterdir()} == before | {
        "index.html": (mine / "mine" / "index.html").read_bytes()
    }
    assert f"open {mine / 'mine' / 'index.html'}, or " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("keys", "fault"),
    [
        ({"kind": "compariso"}, r"unknown report\.kind compariso .did you mean comparison"),
        ({"kind": "tests.support"}, "has no attribute 'TABLES'"),
        ({"kind": "spread_study", "level": 1}, "report: unknown key level"),
    ],
)
def test_a_report_of_another_kind_is_refused(
    mine: Path, keys: dict[str, object], fault: str
) -> None:
    write_experiment(mine, **keys)
    with pytest.raises(InputError, match=fault):
        draw(mine)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("TABLES = {'a': lambda data: 1 / 0}", r"flawed\.py, line 1: ZeroDivisionError: division"),
        ("TABLES = {}; SHOWN = {'a': 3}", r"flawed\.py: AttributeError: 'int' object"),
        ("TABLES = {}; check = lambda *_: exit(3)", r"flawed\.py, line 1: SystemExit: 3"),
        ("TABLES = {}; Declared = 3", r"flawed\.py: AttributeError: 'int' object"),
    ],
)
def test_mistakes_of_a_study_are_told_in_a_sentence(mine: Path, text: str, fault: str) -> None:
    before = {path.name: path.read_bytes() for path in (mine / "mine").iterdir()}
    (mine / "flawed.py").write_text(text)
    write_experiment(mine, kind="flawed")
    with pytest.raises(InputError, match=fault):
        draw(mine)
    assert {path.name: path.read_bytes() for path in (mine / "mine").iterdir()} == before


def test_a_changed_file_of_agents_is_refused(mine: Path) -> None:
    (mine / "mine" / AGENTS).write_bytes(b"changed")
    with pytest.raises(InputError, match=r"agents\.json\.gz: damaged"):
        draw(mine)


def test_other_runs_than_those_declared_are_refused(mine: Path) -> None:
    path = mine / "mine.toml"
    path.write_text(path.read_text().replace("budget = 200", "budget = 400"), encoding="utf-8")
    with pytest.raises(InputError, match="5 of 5 declared runs are missing"):
        draw(mine)
    single = small_experiment(report={"kind": "spread_study"}, algorithms={"a": variant(seeds=1)})
    path.write_text(single, encoding="utf-8")
    assert main(["run", str(path), "--report", "--jobs", "1", "--results", str(mine)]) == 2


def test_findings_assert_their_claims(mine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, start = mine / "mine.py", "def finding(tables):\n    n = len(tables['spread'])\n"
    path.write_text(f"{start}    assert n == 2, 'two'\n    return f'There are {{n}}.\\n\\nMore.'\n")
    text = (draw(mine) / README).read_text(encoding="utf-8")
    assert "There are 2.\n\n![spread](spread.svg)\n\n*A dot per learner.*\n\nMore." in text
    path.write_text(f"{start}    assert n == 3, 'there are three'\n    return ''\n")
    text = (draw(mine) / README).read_text(encoding="utf-8")
    assert "2 learners vary." in text
    assert "mine.py, line 3: there are three." in capsys.readouterr().err
    path.write_text(f"{start}    return tables['none']\n")
    with pytest.raises(InputError, match=r"mine\.py, line 3: KeyError: 'none'"):
        draw(mine)


def test_a_certificate_compares_with_the_last_commit(
    mine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    repository = mine / "repository"
    made = shutil.copytree(draw(mine), repository / "results" / "mine")
    git(repository, "init", "-q")
    monkeypatch.setattr(folders, "REPOSITORY", repository)
    assert report.certificate(made) == ""
    git(repository, "add", ".")
    git(repository, "commit", "-qm", "published")
    assert report.certificate(made) == "mine: identical to the published results."
    (made / "spread.csv").write_text("changed")
    (made / README).unlink()
    different = "README.md, spread.csv"
    assert report.certificate(made) == f"mine: different from the published results: {different}."
