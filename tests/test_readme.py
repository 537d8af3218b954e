"""README and CONTRIBUTING: code runs, commands work, paths exist, and numbers are the published ones."""

import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import pandas as pd
import pytest

from benchmark.__main__ import main
from benchmark.reports import independent

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
REPRODUCE = ROOT / "results" / "reproduce"
COMPARISON = ROOT / "results" / "compare_deep"
LEARNER = ["algorithm", "observation"]
TARGETS = re.findall(r"^([a-z-]+):.*##", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page, flags=re.DOTALL)


def says(sentence: str) -> bool:
    """Whether README has these words, wherever its lines break."""
    return sentence in " ".join(README.split())


# Code, commands, paths


def test_readme_is_short() -> None:
    assert len(README.splitlines()) <= 140


@pytest.mark.parametrize("code", blocks(README, "python"))
def test_python_code_runs(code: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def shell_lines() -> Iterator[str]:
    for block in blocks(README, "sh") + blocks(CONTRIBUTING, "sh"):
        yield from filter(None, (line.split(" #")[0].strip() for line in block.splitlines()))


# The comparison as small as can be: every command is tried, and whole comparisons are tested elsewhere.
SMALL = """
description = "A table and a net."
report = "comparison"
scenarios = ["S1", "S2"]
horizon = 50
evaluation_every = 100
map_every = 100
settings = { budget = 200, time_limit = 50 }
algorithms.q_learning = { algorithm = "q_learning", observations = ["index"], seeds = 2 }
algorithms.dqn = { algorithm = "dqn", observations = ["one_hot"], seeds = 2 }
"""


def run_in_miniature(words: list[str], directory: Path) -> bool:
    """Runs a command of the package with small experiments in place of the published ones."""
    comparison = directory / "small.toml"
    comparison.write_text(SMALL, encoding="utf-8")
    small = {
        "reproduce": "reproduce_smoke",
        "compare_deep": str(comparison),
        "100-199": "100-101",
        "0-29": "0-1",
        "film.webp": f"{directory}/film.webp",
    }
    arguments = [small.get(word, word) for word in words[1:]]
    if "watch" in arguments:
        arguments += ["--terminal", "--experiment", str(comparison)]
    if "--help" in arguments:
        with pytest.raises(SystemExit) as ended:
            main(arguments[2:])
        assert ended.value.code == 0
    else:
        assert main([*arguments[2:], "--results", str(directory)]) == 0, words
    return words[1:3] == ["-m", "benchmark"]


def test_every_command_works(tmp_path: Path) -> None:
    """In the order in which a reader meets them: a report needs the runs of the commands before it."""
    known: dict[str, Callable[[list[str]], bool]] = {
        "make": lambda words: words[1] in TARGETS and words[2:] in ([], ["SEEDS=10"]),
        ".venv/bin/python": lambda words: run_in_miniature(words, tmp_path),
    }
    for line in shell_lines():
        words = line.split()
        assert known[words[0]](words), line


def test_every_make_target_is_named() -> None:
    for target in TARGETS:
        assert f"make {target}" in README, target


def test_ci_does_what_contributing_says() -> None:
    lines = (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    commands = [line for line in lines if line and not line.startswith(("#", "set "))]
    assert commands[-2:] == ["make check", "make test"]
    assert "`make check` and `make test`" in CONTRIBUTING
    assert [line.split()[0] for line in commands[:-2]] == ["if", "apt-get", "fi"]  # Chromium
    assert "`apt-get install chromium`" in README
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    assert ".ci/run" in workflow


@pytest.mark.parametrize("page", [README, CONTRIBUTING], ids=["README", "CONTRIBUTING"])
def test_every_path_exists(page: str) -> None:
    links = [link.partition("#")[0] for link in re.findall(r"\]\((?!https?:)([^)]+)\)", page)]
    quoted = re.findall(r"`((?:\.ci|\.github|agents|benchmark|envs|results|tests)/[^`\s]*)`", page)
    files = re.findall(r"`(\w+\.(?:md|cff|toml|txt))`", page)
    paths = links + quoted + files
    assert len(paths) >= 10
    assert [path for path in paths if not (ROOT / path).exists()] == []


def test_every_dotted_name_exists() -> None:
    names = re.findall(r"`((?:agents|benchmark|envs)(?:\.\w+)+)`", CONTRIBUTING)
    assert len(names) > 4
    for name in names:
        resolve_name(name)  # raises if there is none


def test_every_extension_has_a_test() -> None:
    table = CONTRIBUTING.partition("| to add |")[2].partition("\n\n")[0]
    rows = [row.strip("|").split("|") for row in table.splitlines()[2:]]
    assert len(rows) >= 10
    for added, _, test in rows:
        assert re.fullmatch(r"tests/extension/test_\w+\.py", test.strip(" `")), added


# Numbers


def test_readme_tells_the_published_verdicts() -> None:
    claims: Any = pd.read_csv(REPRODUCE / "claims.csv").set_index("claim")
    assert claims["verdict"].value_counts().to_dict() == {"holds": 6, "holds in part": 3}
    assert set(claims["agents"]) == {100}
    assert says("With 100 agents per scenario, six of the paper's nine claims hold and three hold in part")
    failing = {claim: parts.count("fails") for claim, parts in claims["parts"].items() if "fails" in parts}
    assert failing == {"max-near-1": 1, "identifies": 4}
    assert says("one of two parts of `max-near-1`")
    assert claims["parts"]["max-near-1"].count(";") == 1
    assert "its ceiling 0.857" in claims["parts"]["max-near-1"]
    assert says("pays more than 0.857")
    assert says("four of six parts of `identifies`")
    assert claims["parts"]["identifies"].count(";") == 5
    assert says(f"with a ratio of {claims['value']['variability-S2']:.2f}")


def test_readme_tells_what_the_control_changes() -> None:
    sensitivity: Any = pd.read_csv(REPRODUCE / "sensitivity.csv")
    verdicts = sensitivity.pivot(index="claim", columns="reading", values="verdict")
    explained = verdicts[(verdicts["default"] == "holds") & (verdicts["equal_pay"] == "does not hold")]
    assert set(explained.index) == {"variability-S3", "moves-focused", "ping-S1"}
    assert says("`variability-S3`, `moves-focused` and `ping-S1` hold, but fail")


def test_readme_tells_what_maps_show() -> None:
    parts = pd.read_csv(REPRODUCE / "claims.csv").set_index("claim")["parts"]["identifies"]
    averaged = [float(value) for value in re.findall(r"mean map S\d: ([\d.]+)", parts)]
    assert averaged == pytest.approx([16 / 19, 1, 1], abs=0.001)  # three cells too many, then exact
    single = re.findall(r"precision ([\d.]+), recall ([\d.]+)", parts)
    assert [float(recall) for _, recall in single] == pytest.approx([0.5, 0.5, 0.5], abs=0.08)
    assert [float(precision) for precision, _ in single] == pytest.approx([0.5, 0.5, 1.0], abs=0.06)


def test_readme_tells_how_random_feedback_ends() -> None:
    optimal = pd.read_csv(REPRODUCE / "optimal.csv").set_index("scenario")
    assert (optimal["optimal_share"]["S1"], optimal["optimal_share"]["S3"]) == (1, 1)
    assert set(optimal["agents"]) == {100}
    learning = pd.read_csv(REPRODUCE / "learning.csv").query("scenario == 'S2'")
    replicated = round(100 * learning["success"].iloc[-1])
    compared = runs_and_successes("scenario == 'S2'").loc[("q_learning", "index")]
    assert compared["count"] == 100
    assert says(f"{replicated} of 100 succeed in the replication, and {compared['sum']:.0f} of 100 in the")


def runs_and_successes(rows: str = "index >= 0") -> Any:
    """Counts runs, and those whose greedy policy succeeds at the end, of every learner that is no check."""
    scores = pd.read_csv(COMPARISON / "scores.csv").query(rows)
    scores = scores[~scores["algorithm"].str.endswith("_sb3")]
    assert set(scores["success"].round(9)) <= {0, 1}
    return scores.groupby(LEARNER)["success"].agg(["sum", "count"])


def mean_scores(start: str, *, checks: bool = False) -> Any:
    """Returns the mean scores of greedy policies, with their intervals, of every learner or every check."""
    frame = pd.read_csv(COMPARISON / "aggregate.csv")
    rows = frame.query(f"policy == 'greedy' and metric == 'mean' and evaluated_from == '{start}'")
    rows = rows[rows["algorithm"].str.endswith("_sb3") == checks]
    return rows.set_index(LEARNER)[["value", "low", "high"]]


def test_readme_tells_the_published_scores() -> None:
    scores = mean_scores("start")
    is_table = scores.index.get_level_values(0).str.startswith("q_learning")
    assert scores["value"].idxmax() == ("q_learning_tuned", "index")
    best = scores[~is_table].nlargest(3, "value")
    assert list(best.index) == [("dqn_linear", "one_hot"), ("dqn", "one_hot"), ("ppo", "one_hot")]
    linear, dqn, ppo = (f"{value:.2f} [{low:.2f}, {high:.2f}]" for value, low, high in best.to_numpy())
    assert says(f"have {linear} (a linear layer trained by DQN), {dqn} (DQN) and {ppo} (PPO)")
    assert all(scores["high"][learner] < scores["low"]["q_learning_tuned", "index"] for learner in best.index)
    value, low, high = mean_scores("start", checks=True).loc[("dqn_sb3", "one_hot")]
    assert says(f"with ten seeds per scenario, has {value:.2f} [{low:.2f}, {high:.2f}].")
    assert says("By mean score all three are below the best table.")
    assert says(f"with a mean score of {scores['value'].max():.2f}")
    successes = runs_and_successes()
    assert set(successes.loc[best.index]["count"]) == {300}
    assert says("succeeds in {sum:.0f} of {count:.0f} runs".format(**successes.loc[scores["value"].idxmax()]))
    everywhere = mean_scores("every_cell")["value"]
    assert everywhere.idxmax() == ("q_learning", "index")
    assert says(f"the best mean score, {everywhere.max():.2f} (300 runs)")


def test_readme_claims_no_more_than_the_comparison_shows() -> None:
    """Undecided: some intervals of P(better than the best table) reach beyond 0.5, and none lies above."""
    improvement = pd.read_csv(COMPARISON / "improvement.csv").query("y == 'q_learning_tuned, index'")
    is_deep = ~improvement["x"].str.startswith("q_learning")  # checks are not compared with tables
    deep: Any = improvement[is_deep].set_index("x")
    assert len(deep) == 9
    assert (deep["low"] <= 0.5).all()
    assert set(deep[deep["high"] > 0.5].index) == {"dqn, one_hot", "dqn_linear, one_hot"}
    assert deep["high"]["ppo, one_hot"] < 0.5
    assert says("**Undecided.** With 10,000 steps and 100 seeds per learner and scenario")
    scores: Any = pd.read_csv(COMPARISON / "scores.csv")
    runs = scores.groupby([*LEARNER, "scenario"]).size()
    is_check = runs.index.get_level_values("algorithm").str.endswith("_sb3")
    assert (set(runs[~is_check]), set(runs[is_check])) == ({100}, {10})


def test_readme_tells_the_published_equivalence() -> None:
    pairs = pd.read_csv(ROOT / "results" / "equivalence" / "equivalence.csv")
    assert set(pairs["n"]) == set(pairs["check_n"]) == {100}
    assert set(pairs["scenario"]) == {"S1", "S2"}
    assert set(pairs["margin"]) == {0.15}
    verdicts = pairs["verdict"].value_counts()
    assert set(verdicts.index) == {"equivalent", "undecided"}
    assert says(f"Of {len(pairs)} pairs with 100 runs on each side, in S1 and S2, success is equivalent")
    assert says(f"within 0.15 in {verdicts['equivalent']}, undecided in {verdicts['undecided']} and")
    assert says("and different in none ([details](results/equivalence/README.md))")


def test_readme_tells_the_published_successes_of_deep_learners() -> None:
    successes = runs_and_successes()["sum"].astype(int)
    assert set(runs_and_successes()["count"]) == {300}
    dqn, ppo = successes["dqn"], successes["ppo"]
    assert says(
        f"DQN succeeds in {dqn['one_hot']} of 300 runs from one-hot observations and in {dqn['coordinates']} "
        f"of 300 from coordinates, and PPO in {ppo['one_hot']} and {ppo['coordinates']} of 300"
    )
    default_dqn, default_ppo = successes["dqn_default"].sum(), successes["ppo_default"].sum()
    assert says(f"DQN succeeds in {default_dqn} of 600 runs and PPO in {default_ppo}.")


def test_readme_tells_the_published_costs() -> None:
    seconds: Any = pd.read_csv(COMPARISON / "cost.csv").set_index(LEARNER)["cpu_time_s"]
    table, linear, dqn, their_linear, their_dqn = (
        seconds[arm, "index" if arm == "q_learning" else "one_hot"]
        for arm in ("q_learning", "dqn_linear", "dqn", "dqn_linear_sb3", "dqn_sb3")
    )
    assert says(f"takes {1000 * table:.2f} ms of CPU time.")
    assert says(f"the linear layer takes {linear:.2f} s and DQN {dqn:.1f} s")
    assert says(f"by Stable-Baselines3, {their_linear:.1f} s")
    assert says(f"in plain Python) and {their_dqn:.0f} s.")


def test_readme_tells_what_independent_checks_found() -> None:
    """The same as the results' pages tell."""
    settings = json.loads((REPRODUCE / "manifest.json").read_text(encoding="utf-8"))["algorithms"]
    paper = independent.of_papers_table(settings["q_learning"]["settings"])
    for words, number in (("an independent run of {} agents", "2,000"), ("agents gives {}.", "0.515")):
        assert number in paper
        assert says(words.format(number))
    assert "16 of 30 sets of 100" in independent.VARIABILITY_S2
    assert says("in 16 of 30 fresh sets of 100 seeds")
    cost: Any = pd.read_csv(COMPARISON / "cost.csv").set_index(LEARNER)["cpu_time_s"]
    ratio = cost["dqn_linear_sb3", "one_hot"] / cost["q_learning_tuned", "index"]
    fewest, most = independent.against_plain_python(ratio)
    assert says(f"({round(fewest, -1):.0f} to {round(most, -1):.0f} times a table in plain Python")
