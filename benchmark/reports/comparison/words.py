"""Words and numbers in the sentences of a comparison."""

import pandas as pd

from benchmark.analysis.contrasts import BETTER, EQUIVALENT, MIXED, WORSE
from benchmark.drawing.tables import link
from benchmark.reports.comparison.declared import Declared, Learner
from benchmark.reports.folder import Folder
from benchmark.reports.item import Finding
from benchmark.reports.learners import Names
from envs.words import listed


def verdict(row: pd.Series, names: Names) -> Finding:
    """Says how a contrast ended, on both endpoints: of wins and losses in the same words."""
    found, where = str(row["success_verdict"]), f", in {place(row)}" if place(row) else ""
    if isinstance(row.get("algorithm"), str):
        where += f", of {names.told(name_of(row))}"
    x, y = (names.told(row[side]) for side in "xy")
    if row["policy_x"] != row["policy_y"]:
        x, y = f"{x} ({row['policy_x']} policy)", f"{y} ({row['policy_y']} policy)"
    text = (
        f"Success of {x} compared with {y}{where}: {in_words(row)}, {difference(row, 'success', 'contrasts')}"
    )
    if found == EQUIVALENT and max(row["success_x"], row["success_y"]) < row["success_margin"]:
        text += "; both succeed less often than that margin"
    if (apart := str(row.get("success_except", ""))) not in ("", "nan"):
        contradicts = "contradicting the mean:" if found == MIXED else "not shown separately in"
        text += f"; {contradicts} {listed(apart.split(', '))}"
    text += f". In score: {row['score_verdict']}, {difference(row, 'score', 'contrasts')}."
    if "wrong_pings_x" in row:
        wrong = [f"{row[f'wrong_pings_{side}']:.0f}" for side in "xy"]
        rate = link(wrong[0], "contrasts", row)
        text += f" Wrong PINGs per 1,000 steps of training: {rate} against {wrong[1]}."
    return Finding(text, found)


def in_words(row: pd.Series) -> str:
    """Returns the verdict on success; within the margin, it also says if the difference is shown not to be 0.

    >>> row = {"success_verdict": "equivalent", "success_p_different": 0.01, "success_difference": -0.05}
    >>> in_words(pd.Series(row | {"success_margin": 0.1}))
    'within 0.1, but measurably worse'
    """
    if row["success_verdict"] != EQUIVALENT or row["success_p_different"] > 0.05:
        return str(row["success_verdict"])
    than = BETTER if row["success_difference"] > 0 else WORSE
    return f"within {row['success_margin']:g}, but measurably {than}"


def place(row: pd.Series) -> str:
    """Returns the scenario and the condition of a row, as far as it names them.

    >>> place(pd.Series({"scenario": "S1", "condition": "noise", "x": "a"})), place(pd.Series({"x": "a"}))
    ('S1 under noise', '')
    """
    names = (row.get(key) for key in ("scenario", "condition"))
    return " under ".join(name for name in names if isinstance(name, str))


def scenario_labels(table: pd.DataFrame) -> pd.Series:
    """Returns the place of each row."""
    return pd.Series([place(row) for _, row in table.iterrows()], index=table.index, dtype=str)


def by_place(table: pd.DataFrame) -> pd.DataFrame:
    """Returns the same with the place of each row for its scenario."""
    return table.assign(scenario=scenario_labels(table))


def difference(row: pd.Series, name: str, table: str, decimals: int = 3) -> str:
    """Returns a difference with its 95 % interval."""
    value, low, high = (signed(row[f"{name}_difference{end}"], decimals) for end in ("", "_low", "_high"))
    return f"{link(value, table, row)} [{low}, {high}]"


def setting(folder: Folder) -> str:
    """Returns what a verdict holds for: the budgets, and the scenarios unless they are many."""
    declared = Declared.from_manifest(folder.manifest)
    budgets: dict[int, list[str]] = {}
    if "summary.csv" in folder:
        summary = folder.frame("summary")
        rows = compared(summary, folder) if declared.compared else summary
        for name, steps in dict.fromkeys((name_of(row), int(row["budget"])) for _, row in rows.iterrows()):
            budgets.setdefault(steps, []).append(folder.names.told(name))
    named, budget = [name for names in budgets.values() for name in names], "With the declared budgets"
    if len(budgets) == 1:
        budget = f"With {next(iter(budgets)):,} steps of training"
    elif budgets and len({*named}) == len(named):  # no condition changes them
        budget = "With " + listed(f"{steps:,} steps for {listed(names)}" for steps, names in budgets.items())
    scenarios = [*folder.manifest["scenarios"]]
    is_mean = declared.reporting.pool == "scenarios" and len(scenarios) > 1
    where = listed(scenarios) if len(scenarios) <= 4 else f"{len(scenarios)} scenarios"
    return f"{budget}, on average over {where}" if is_mean else f"{budget} in {where}"


def sizes(folder: Folder) -> str:
    """Returns how many runs there are of each learner compared, linked to the rows that say so."""
    name = "summary" if "summary.csv" in folder else "contrasts"
    table = folder.frame(name)
    rows = compared(table, folder) if name == "summary" else table
    fewest, most = int(rows["n"].min()), int(rows["n"].max())
    return link(f"{fewest}" if fewest == most else f"{fewest} to {most}", name, rows)


def compared(table: pd.DataFrame, folder: Folder) -> pd.DataFrame:
    """Returns the rows of the learners that contrasts compare."""
    wanted = Declared.from_manifest(folder.manifest).compared
    learners = zip(table["algorithm"], table["observation"], strict=True)
    return table[[Learner(*learner) in wanted for learner in learners]]


def name_of(row: pd.Series) -> str:
    """Returns the learner of a row, as CSV files name it."""
    return str(Learner(row["algorithm"], row["observation"]))


def signed(value: float, decimals: int = 2) -> str:
    """Returns a difference with its sign; zero has none.

    >>> signed(0.034, 3), signed(-0.034), signed(-0.0001)
    ('+0.034', '-0.03', '0.00')
    """
    text = f"{value:+.{decimals}f}"
    return text[1:] if not text.strip("+-0.") else text


def interval(row: pd.Series, key: str, table: str) -> str:
    """Returns a number with its interval."""
    return f"{link(f'{row[key]:.2f}', table, row)} [{row[f'{key}_low']:.2f}, {row[f'{key}_high']:.2f}]"


def times(ratio: float) -> str:
    """Returns a ratio with at least two digits."""
    if ratio == float("inf"):
        return "∞"
    return f"{ratio:.2g}" if ratio < 10 else f"{ratio:,.0f}"
