"""The command line: mistakes are refused before any work, and missing packages are named."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from benchmark.__main__ import COMMANDS, main
from benchmark.experiment import load_experiment
from tests.support import ROOT

FILES = {
    "mistaken_agent.py": "def act(o):\n    return 4\ndef wrong(o):\n    return 7\n",
    "file": "",  # which nobody can make a folder, not even root
    "reproduce.toml": "",
}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("run reproduct", "reproduct (did you mean reproduce?)"),
        ("run FOLDER/reproduce", "or the path of a .toml file."),
        ("run FOLDER/reproduce.toml", "reproduce"),  # results would be those of the shipped one
        ("run reproduce --jobs 0", "--jobs 0: "),
        ("run reproduce --seeds 9-2", "--seeds 9-2: "),
        (f"run reproduce --seeds {'9' * 5000}", "--seeds 999"),
        ("run", "EXPERIMENT; 'python -m benchmark run --help'"),
        ("run reproduce --results FOLDER/file/results", "/file/results"),
        ("speed --smoke --results FOLDER/file/results", "/file/results"),
        ("report", "FOLDER"),  # no results
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
    arguments: str,
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
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


def test_list_and_help_describe_everything(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    listed = capsys.readouterr().out
    description = load_experiment("reproduce").declared.description
    assert f"  reproduce                {description}\n" in listed
    assert re.search(r"S2 +The issuer gives random feedback", listed)
    assert re.search(r"sb3_dqn +agents\.sb3\.algorithms:DQN", listed)
    for command in COMMANDS:
        with pytest.raises(SystemExit, match="0"):
            main([command, "--help"])
    assert "(default: compare_deep)" in capsys.readouterr().out


def test_a_broken_package_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "seaborn.py").write_text("import os\nraise RuntimeError('boom')\n")
    command = [sys.executable, "-m", "benchmark", "report", "--results", str(tmp_path)]
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: {tmp_path / 'seaborn.py'}, line 2: RuntimeError: boom; ")


@pytest.mark.parametrize("package", ["agents", "envs"])
def test_a_package_that_hides_ours_is_named(package: str, tmp_path: Path) -> None:
    (file := tmp_path / package / "__init__.py").parent.mkdir()
    file.touch()
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    command = [sys.executable, "-m", "benchmark", "list"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert (
        last
        == f"ImportError: {file} is found in place of this project's package {package}; rename it."
    )
