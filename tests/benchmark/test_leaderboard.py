"""The leaderboard: files say what their policies do, and files that say something else are refused."""

import os
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmark import leaderboard
from benchmark.__main__ import main
from benchmark.assessment import assess
from benchmark.commands.verify import rewritten
from benchmark.leaderboard import checked, submit, texts
from benchmark.studies import load_study
from envs import ACTIONS, InputError, load_scenario
from tests.support import ROOT

PUBLISHED = ROOT / "results" / "leaderboard"
DECLARED: dict[str, Any] = {"learner": "by | hand", "training_steps": 0, "search_trials": 1}


def walk(o: int) -> int:
    row, column = divmod(o, 12)
    return 1 if row < 4 else 3 if column < 6 else 4


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("made") / "mine.toml"
    submit(assess(walk, scenario="S1", observation="index"), path, **DECLARED)
    return path


def test_published_files_agree_with_their_policies_and_are_listed() -> None:
    assert len([*PUBLISHED.glob("*.toml")]) >= 2
    text = (PUBLISHED / "README.md").read_text("utf-8")
    assert texts(ROOT / "results", pytest.fail) == {PUBLISHED / "README.md": text}


def test_numbers_of_a_file_are_those_of_arithmetic(made: Path) -> None:
    submission = checked(made)
    # From the corner four steps down and six to the right, and a PING: as many as the optimum needs.
    assert (submission.score, submission.success, submission.steps) == pytest.approx((1, 1, 11))
    assert [submission.rows[row].index(1) for row in submission.policy] == [walk(o) for o in range(120)]


def test_probabilities_are_written_in_full(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    table = rng.dirichlet(np.ones(len(ACTIONS)), 437)
    index = iter([*range(437), *reversed(range(437))])
    agent = assess(lambda _: table[next(index)], scenario="Anywhere", observation="offset_coordinates")
    submit(agent, tmp_path / "drawn.toml", note='"\\ é 🙂', **DECLARED)
    submission = checked(tmp_path / "drawn.toml")
    assert (np.array(submission.rows)[list(submission.policy)] == agent.policy).all()
    assert submission.success == agent.success
    assert submission.note == '"\\ é 🙂'


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("score = 1.0", "score = 0.999", "score = 0.999: recomputed: 1.0"),
        ("success = 1.0", "success = 1.00001", "success = 1.00001: recomputed: 1.0"),
        (r"steps = 11\.0", "steps = -11.0", "steps = -11.0: recomputed: 11.0"),
        (r"policy = \[2", "policy = [0", "score = 1.0: recomputed: 0.43"),
        (r"policy = \[2", "policy = [3", "policy, of 120 numbers: accepted: 120 numbers from 0 to 2"),
        ("policy = .*", "policy = []", "policy, of 0 numbers: accepted: 120 numbers from 0 to 2"),
        ("policy = .*", f"policy = {[0] * 250_001}", "policy = "),
        (r"rows = \[\[0\.0, 0\.0", "rows = [[-0.5, 0.5", "rows.0 = [-0.5, 0.5, 0.0, 0.0, 1.0]: accepted: 5"),
        (r"rows = \[\[0\.0", "rows = [[nan", "rows.0.0 = NaN: "),
        (r"rows = \[\[0\.0", "rows = [[-0.0", "rows.0 = [-0.0, 0.0, 0.0, 0.0, 1.0]: accepted: 5"),
        (r"rows = \[\[0\.0", "rows = [[1.1e-9", "rows.0 = [1.1e-09, 0.0, 0.0, 0.0, 1.0]: accepted: 5"),
        ("score = ", f"{'a.' * 100_000}b = 1\nscore = ", "not valid TOML: a key has more than 50 parts"),
        (r"rows = \[\[0\.0, ", "rows = [[", "rows.0 = [0.0, 0.0, 0.0, 1.0]: accepted: 5 probabilities"),
        (r"rows = .*", "rows = []", "rows = []: "),
        ('scenario = "S1"', 'scenario = "S9"', "unknown scenario S9; accepted: "),
        ('scenario = "S1"', 'scenario = "S2"', "scenario_sha256 = "),
        ('"index"', '"coordinate"', "unknown observation coordinate (did you mean coordinates?)"),
        ("training_steps = 0", "training_steps = -1", "training_steps = -1: "),
        (r"by \| hand", r"by\\nhand", r'learner = "by\nhand": accepted: text in one line'),
    ],
)
def test_tampered_files_are_refused_in_one_sentence(
    made: Path, tmp_path: Path, old: str, new: str, expected: str
) -> None:
    text, count = re.subn(f"(?m)^(.*){old}", rf"\g<1>{new}", made.read_text(encoding="utf-8"), count=1)
    assert count == 1
    path = tmp_path / "it.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        checked(path)
    (line,) = refused.value.args
    assert line.startswith(f"{path}: ")
    assert expected in line
    assert line.endswith(".")


@pytest.mark.parametrize("name", ["a b.toml", "a\nb.toml", "[a](b).toml", "nan.toml"])
def test_files_are_named_as_everything_is(made: Path, tmp_path: Path, name: str) -> None:
    shutil.copy(made, tmp_path / name)
    with pytest.raises(InputError, match="is named after the file; accepted: a name of "):
        checked(tmp_path / name)


def test_highest_success_is_first_and_text_stays_text(made: Path, tmp_path: Path) -> None:
    folder = tmp_path / "leaderboard"
    folder.mkdir()
    assert texts(tmp_path, pytest.fail) == {}
    shutil.copy(made, folder / "z.toml")
    for name, scenario in (("a", "S1"), ("b", "Hall")):
        up = assess(lambda _: 0, scenario=scenario, observation="index")
        submit(up, folder / f"{name}.toml", **DECLARED)
    other = assess(lambda o: walk(int(o.argmax())), scenario="S1", observation="one_hot")
    other.policy[-1] = np.eye(5)[0]  # in the last corner, where no walk leads
    submit(other, folder / "zz.toml", **DECLARED)
    text = texts(tmp_path, pytest.fail)[folder / "README.md"]
    rows = re.findall(r"^## .*|^\| \[.*", text, flags=re.MULTILINE)
    assert [row[2:5] for row in rows] == [" Ha", "[b]", " S1", "[z]", "[zz", "[a]"]
    copies = [re.findall(r"same policy as \[(\w+)\]", row) for row in rows]
    assert copies == [[], [], [], ["zz"], ["z"], []]  # neither is called the original
    assert "| by &#124; hand |" in rows[1]


def test_success_comes_before_scores_and_both_are_exact(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hidden file is not read: it would not be found among these."""
    scores = {
        "a": (0.999996, 1.0),
        "b": (0.7, 0.2),
        "c": (0.5, 0.9),
        "d": (1.0, 1.0),
        "e": (0.5 + 1e-11, 0.9),
    }
    one, folder = checked(made), tmp_path / "leaderboard"
    folder.mkdir()
    for name in (*scores, ".hidden"):
        shutil.copy(made, folder / f"{name}.toml")
    found = {name: one.model_copy(update={"score": x, "success": y}) for name, (x, y) in scores.items()}
    monkeypatch.setattr(leaderboard, "checked", lambda path: found[path.stem])
    text = texts(tmp_path, pytest.fail)[folder / "README.md"]
    rows = re.findall(r"^\| \[(.).*?(\d\.\d+) +\| (\S+)", text, re.MULTILINE)
    assert [row[0] for row in rows] == ["d", "a", "e", "c", "b"]
    assert rows[3][1:] == ("0.50000000000", "0.9000")


def test_bad_files_are_left_out_by_name_without_waiting(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "leaderboard"
    shutil.copytree(ROOT / "results" / "reproduce", tmp_path / "reproduce")
    (folder / "directory.toml").mkdir(parents=True)
    os.mkfifo(folder / "pipe.toml")
    (folder / "endless.toml").symlink_to("/dev/zero")
    (folder / "nowhere.toml").symlink_to("nowhere")
    (folder / "large.toml").write_bytes(b"#" * 2_000_001)
    (folder / "empty.toml").touch()
    for name in ("good", "Twin", "twin", "\u00e9", "e\u0301"):
        shutil.copy(made, folder / f"{name}.toml")
    bad = {path.name for path in folder.glob("*.toml")} - {"good.toml"}
    refused = list[str]()
    text = texts(tmp_path, refused.append)[folder / "README.md"]
    assert re.findall(r"^\| \[(.*?)\]", text, re.MULTILINE) == ["good"]
    pattern = re.compile(rf"left out of the leaderboard: {folder}/(.*?\.toml): .*\.")
    lines = map(pattern.fullmatch, refused)
    assert sorted(line[1] for line in lines if line) == sorted(bad)
    assert main(["report", "--results", str(tmp_path)]) == 0
    assert capsys.readouterr().err.splitlines() == refused
    assert (folder / "README.md").read_text(encoding="utf-8") == text
    assert [*rewritten({"reproduce": load_study("replication")}, tmp_path)] == refused


def test_what_report_would_refuse_is_not_submitted(made: Path, tmp_path: Path) -> None:
    shutil.copy(made, tmp_path / "mine.toml")
    for name in ("Mine.toml", "mine.TOML", "other.TOML"):
        with pytest.raises(InputError, match=f"{name}: .*accepted: "):
            submit(assess(walk, scenario="S1", observation="index"), tmp_path / name, **DECLARED)
    changed = load_scenario("S1", {"rewards.target_ping": 2.0})
    for scenario in (changed, changed.model_copy(update={"name": "mine"})):
        with pytest.raises(InputError, match=r"scenario = .*: accepted: a shipped scenario, unchanged"):
            submit(assess(walk, scenario=scenario, observation="index"), tmp_path / "a.toml", **DECLARED)
    agent = assess(lambda _: -0.0 + np.eye(5)[0] * [1, -1, -1, -1, -1], scenario="S1", observation="index")
    submit(agent, tmp_path / "minus.toml", **DECLARED)
    assert checked(tmp_path / "minus.toml").score == agent.score


def test_the_command_writes_a_new_file_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "walking_agent.py").write_text("def act(o): return 1", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    arguments = ["assess", "--agent", "walking_agent:act", "--observation", "index", "--learner", "me"]
    assert main(arguments) == 2
    assert "accepted only with --submit." in capsys.readouterr().err
    arguments += ["--submit", str(tmp_path / "it.toml"), "--training-steps", "7"]
    assert main(arguments) == 2
    assert "the key search_trials is missing." in capsys.readouterr().err
    assert not (tmp_path / "it.toml").exists()
    assert main([*arguments, "--search-trials", "0"]) == 0
    assert checked(tmp_path / "it.toml").training_steps == 7
    assert main([*arguments, "--search-trials", "0"]) == 2
    assert "accepted: a new file." in capsys.readouterr().err
