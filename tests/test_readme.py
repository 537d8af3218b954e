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
from benchmark.experiments import load_experiment

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


def with_interval(row: Any, key: str, digits: int = 2) -> str:
    """Returns a number with its interval, as README has it."""
    ends = [f"{row[f'{key}{end}']:.{digits}f}" for end in ("_low", "_high")]
    return f"{row[key]:.{digits}f} [{', '.join(ends)}]"


def verdicts_on_claims(agents: int) -> Any:
    claims: Any = pd.read_csv(REPRODUCE / "claims.csv")
    return claims[claims["agents"] == agents].drop_duplicates("claim").set_index("claim")


def test_readme_tells_the_published_verdicts_on_claims() -> None:
    counts = [verdicts_on_claims(n)["verdict"].value_counts().to_dict() for n in (100, 1000)]
    assert counts[0] == {"holds": 5, "undecided": 2, "does not hold": 2}
    assert counts[1] == {"holds": 6, "undecided": 1, "does not hold": 2}
    assert says(
        "With 100 agents per scenario, as in the paper, five of its nine claims hold, two are undecided and"
    )
    assert says("and two do not hold. With 1,000 agents, six hold and one is undecided ([claims]")
    parts: Any = pd.read_csv(REPRODUCE / "claims.csv").query("agents == 1000")
    failing = parts[parts["state"] == "fails"].groupby("claim").size().to_dict()
    assert failing == {"max-near-1": 1, "identifies": 4}
    assert parts.groupby("claim").size()[["max-near-1", "identifies"]].tolist() == [2, 6]
    assert says("one of two parts of `max-near-1` fails (no PING in S3 pays more than 0.857)")
    assert says("and four of six of `identifies`")
    (note,) = parts.query("claim == 'max-near-1' and state == 'fails'")["note"]
    assert "0.857" in note


def test_readme_tells_how_often_sets_agree() -> None:
    many = verdicts_on_claims(1000)
    assert set(many["sets"]) == {10}
    varying = many[many["sets_agreeing"] < 10]
    assert list(varying.index) == ["variability-S2", "ping-S1", "random-helps"]
    assert set(varying["verdict"]) == {"holds"}
    assert says(
        "**Three verdicts depend on the agents.** In ten disjoint sets of 100, `variability-S2` holds in"
    )
    s2, s1, helps = (row for _, row in varying.iterrows())
    ends = [
        f"{row['share']:g} [{row['share_low']:.2f}, {row['share_high']:.2f}]".replace("0.00", "0")
        for row in (s2, s1, helps)
    ]
    assert says(
        f"holds in {s2['sets_agreeing']} sets (a share of {ends[0]}), `ping-S1` in {s1['sets_agreeing']}"
    )
    assert says(f"({ends[1]}) and `random-helps` in none ({ends[2]}); with 1,000, all three hold.")


def test_readme_tells_what_the_control_changes() -> None:
    sensitivity: Any = pd.read_csv(REPRODUCE / "sensitivity.csv").drop_duplicates(["claim", "reading"])
    verdicts = sensitivity.pivot(index="claim", columns="reading", values="verdict")
    changed = verdicts[(verdicts["default"] == "holds") & (verdicts["equal_pay"] != "holds")]["equal_pay"]
    assert changed.to_dict() == {
        "variability-S3": "does not hold",
        "moves-focused": "does not hold",
        "variability-S2": "undecided",
        "ping-S1": "undecided",
    }
    assert says("`variability-S3` and `moves-focused` do not hold there; `variability-S2` and `ping-S1` are")


def test_readme_tells_what_maps_show() -> None:
    parts: Any = pd.read_csv(REPRODUCE / "claims.csv").query("agents == 1000 and claim == 'identifies'")
    averaged = parts[parts["part"].str.startswith("mean map")]["value"]
    assert averaged.tolist() == pytest.approx([16 / 19, 1, 1], abs=0.001)  # three cells too many, then exact
    notes = " ".join(parts["note"].dropna())
    single = re.findall(r"precision ([\d.]+), recall ([\d.]+)", notes)
    assert [float(recall) for _, recall in single] == pytest.approx([0.5, 0.5, 0.5], abs=0.08)
    assert [float(precision) for precision, _ in single] == pytest.approx([0.5, 0.5, 1.0], abs=0.06)


def test_readme_tells_how_random_feedback_ends() -> None:
    success: Any = pd.read_csv(REPRODUCE / "success.csv").query("agents == 1000").set_index("scenario")
    assert success.loc[["S1", "S3"], "optimal_share"].tolist() == [1, 1]
    row = success.loc["S2"]
    assert says(f"In S2 success is {with_interval(row, 'success', 3)}; in S1 and S3 all 1,000 agents end")


def learners(folder: Path = COMPARISON) -> Any:
    """Returns every learner over all scenarios, by arm and observation."""
    return pd.read_csv(folder / "aggregate.csv").set_index(LEARNER)


def contrasts(folder: Path = COMPARISON) -> Any:
    return pd.read_csv(folder / "contrasts.csv").set_index(["x", "y"])


TABLE = "q_learning_tuned, index"


def test_readme_tells_the_published_answer() -> None:
    found = contrasts()
    decisive = found.xs(TABLE, level="y")
    assert decisive["success_verdict"].to_dict() == {
        "dqn, one_hot": "equivalent",
        "dqn_linear, one_hot": "equivalent",
        "ppo, one_hot": "worse",
    }
    assert says(
        "**In the paper's scenarios deep RL does not earn its keep.** With 10,000 steps and by success alone,"
    )
    assert set(found["n"]) == {100}
    assert set(found["success_margin"]) == {0.1}
    assert says(
        "each of the three deep learners that the protocol compares with a table succeeds less often than"
    )
    assert says(
        "`q_learning_tuned` (learning rate 0.2, ε 0.1) or equally often within 0.1, with 100 seeds per"
    )
    scores = pd.read_csv(COMPARISON / "scores.csv")
    assert scores[scores["algorithm"] == "q_learning_tuned"]["success"].min() == 1
    assert says("The table succeeds in every run, so none could do better.")
    p = found["success_p_different"]
    assert p["dqn, one_hot", TABLE] < 0.05 < p["dqn_linear, one_hot", TABLE]
    score = decisive["score_verdict"]
    assert (score["dqn, one_hot"], score["dqn_linear, one_hot"]) == ("worse", "undecided")
    assert says("In score, the net is worse than the table, too, and the linear layer is undecided.")
    assert found["success_verdict"]["dqn, one_hot", "ppo, one_hot"] == "equivalent"
    assert says("DQN and PPO are equivalent in success within 0.1.")
    settings = load_experiment("compare_deep").algorithms["q_learning_tuned"].settings
    assert (settings["learning_rate"], settings["epsilon"]) == (0.2, 0.1)
    assert len(found) == 8
    assert says("verdicts are adjusted for eight contrasts")
    everyone = learners()
    table, linear, net, ppo = (
        with_interval(everyone.loc[name], "success")
        for name in (
            ("q_learning_tuned", "index"), ("dqn_linear", "one_hot"), ("dqn", "one_hot"), ("ppo", "one_hot"),
        )
    )  # fmt: skip
    assert says(
        f"The table has {table}. From one-hot observations, a linear layer trained by DQN has {linear}"
    )
    assert says(f"and a net {net}: equivalent to the table, though the net's deficit is significant.")
    assert says(f"PPO, with {ppo}, is worse.")


def test_readme_tells_where_deep_rl_earns_its_keep() -> None:
    folder = ROOT / "results" / "beyond"
    found: Any = pd.read_csv(folder / "contrasts.csv")
    assert (found["scenario"].nunique(), set(found["n"]), set(found["y"])) == (17, {20}, {TABLE})
    better = found[found["success_verdict"] == "better"][["scenario", "x"]].to_numpy().tolist()
    assert better == [["MoodyHidden", "ppo, one_hot"], ["Anywhere", "dqn, coordinates"]]
    assert says("With 20,000 steps and 20 seeds, deep RL earns its keep in 2 of [17 scenarios]")
    (headline, *_) = pd.read_csv(folder / "findings.csv")["text"]
    without = re.search(
        r"it is undecided in \[13\].*there is no verdict in \[2\][^ ]* \((.*?) and (.*?)\)", headline
    )
    assert without is not None
    assert says(
        "Thirteen are undecided; two have no verdict, since the table never succeeds there and no deep"
    )
    assert says("and no deep learner is better.")
    summary: Any = pd.read_csv(folder / "summary.csv").set_index(["scenario", *LEARNER])
    for name in without.groups():
        assert summary.loc[(name, "q_learning_tuned", "index"), "success"] == 0
        assert not (found["success_verdict"] == "better")[found["scenario"] == name].any()
    shown = {
        (scenario, arm): with_interval(summary.loc[scenario, arm, observation], "success")
        for scenario, arm, observation in (
            ("Anywhere", "dqn", "coordinates"),
            ("Anywhere", "q_learning_tuned", "index"),
            ("MoodyHidden", "ppo", "one_hot"),
            ("MoodyHidden", "q_learning_tuned", "index"),
        )
    }
    assert says(f"DQN from coordinates succeeds with {shown['Anywhere', 'dqn']}, the table with")
    assert says(f"the table with {shown['Anywhere', 'q_learning_tuned']};")
    assert says(f"PPO's stochastic policy has {shown['MoodyHidden', 'ppo']} and the table")
    assert says(f"and the table {shown['MoodyHidden', 'q_learning_tuned']};")
    steps: Any = pd.read_csv(folder / "steps.csv").set_index(["scenario", *LEARNER])
    net, table = (
        steps.loc["Anywhere", "dqn", "coordinates"],
        steps.loc["Anywhere", "q_learning_long", "index"],
    )
    ends = f"{table['below_at'] / net['step']:.2g} to {table['step'] / net['below_at']:.2g}"
    assert says(
        f"stays at or above 0.9 from step {net['step']:,.0f} on, and the table needs {ends} times as many"
    )
    scenarios: Any = pd.read_csv(folder / "scenarios.csv").set_index("scenario")
    best = scenarios.loc["MoodyHidden", "memoryless_success"]
    greedy = summary.loc["MoodyHidden", "ppo", "one_hot"]["greedy_success"]
    assert says(f"PPO's greedy policy has {greedy:.2f}, the best memoryless policy found {best:.2f}.")


def test_published_protocol_is_the_declared_one() -> None:
    """The runs that it decides on have seeds that had not been seen before it was declared."""
    manifest = json.loads((COMPARISON / "manifest.json").read_text(encoding="utf-8"))
    experiment = load_experiment("compare_deep")
    protocol, declared = manifest["facts"]["protocol"], experiment.protocol
    assert declared is not None
    assert protocol["is_declared"]
    assert [tuple(pair) for pair in protocol["contrasts"]] == list(declared.contrasts)
    seeds = pd.read_csv(COMPARISON / "scores.csv").groupby("algorithm")["seed"].min()
    for x, y in declared.contrasts:
        assert min(seeds[name.partition(",")[0]] for name in (x, y)) == 100


def test_readme_tells_what_observations_change() -> None:
    found = contrasts()
    for arm in ("dqn", "ppo"):
        row = found.loc[f"{arm}, one_hot", f"{arm}, coordinates"]
        assert row["success_verdict"] == "better"
        ends = f"[{row['success_difference_low']:.2f}, {row['success_difference_high']:.2f}]"
        assert says(f"by {row['success_difference']:.2f} {ends} with {arm.upper()}")


def test_readme_tells_what_default_dqn_takes() -> None:
    scores = pd.read_csv(COMPARISON / "scores.csv").query("algorithm == 'dqn_default'")
    assert (len(scores), scores["success"].max()) == (600, 0)
    assert says("it succeeds in none of 600 runs")
    ablation = learners(ROOT / "results" / "ablation")
    assert set(ablation["runs"]) == {300}
    target, rate, both = (
        ablation["success"][name, "one_hot"] for name in ("target", "rate", "target_and_rate")
    )
    assert says(
        "with 300 runs each, synchronising its target network every 200 steps alone gives a success of"
    )
    assert says(f"a success of {target:.2f}, a learning rate of 0.003 alone {rate:.2f}, and both {both:.2f}.")
    verdicts = contrasts(ROOT / "results" / "ablation")["success_verdict"]
    assert verdicts["target, one_hot", "default, one_hot"] == "equivalent"
    assert verdicts["rate, one_hot", "default, one_hot"] == "better"
    for other in ("default", "target", "rate"):
        assert verdicts["target_and_rate, one_hot", f"{other}, one_hot"] == "better"


def test_readme_tells_how_much_was_tuned() -> None:
    tuning = {name: arm.tuning for name, arm in load_experiment("compare_deep").algorithms.items()}
    numbers = {name: (each.settings, each.seeds) for name, each in tuning.items() if each and each.settings}
    assert numbers == {"q_learning_tuned": (48, 40), "dqn": (21, 3), "dqn_linear": (7, 3), "ppo": (23, 3)}
    assert says("the best of 48 with 40 seeds each; those of DQN are the best of 21, of PPO of 23")
    assert says("and of the linear layer of 7, with two or three seeds each")


def test_readme_tells_the_published_costs() -> None:
    seconds: Any = pd.read_csv(COMPARISON / "cost.csv").set_index(LEARNER)["cpu_time_s"]
    table, plain = (seconds[arm, "index"] for arm in ("q_learning_tuned", "q_learning_plain"))
    linear, dqn, their_linear, their_dqn = (
        seconds[arm, "one_hot"] for arm in ("dqn_linear", "dqn", "dqn_linear_sb3", "dqn_sb3")
    )
    assert says(
        f"The table takes {1000 * table:.2f} ms of CPU time, and in plain Python {1000 * plain:.0f} ms."
    )
    assert says(f"the linear layer takes {linear / plain:.0f} times as long as the table in plain Python")
    assert says(
        f"and the net {dqn / plain:.0f} times; Stable-Baselines3 takes {their_linear:.1f} s and "
        f"{their_dqn:.0f} s"
    )


def test_readme_tells_the_published_equivalence() -> None:
    pairs = pd.read_csv(ROOT / "results" / "equivalence" / "equivalence.csv")
    assert (set(pairs["n"]), set(pairs["check_n"])) == ({200}, {100})
    assert set(pairs["scenario"]) == {"S1", "S2"}
    assert set(pairs["success_margin"]) == {0.15}
    assert pairs["success_verdict"].value_counts().to_dict() == {"equivalent": 7, "undecided": 1}
    assert says(
        "In S1 and S2, 200 compiled runs and 100 runs of Stable-Baselines3 are equivalent in success within"
    )
    assert says("within 0.15 in 7 of 8 pairs, and one pair is undecided ([details]")
