"""What a comparison found, in sentences from its published tables; each judging word follows from numbers.

A number is a Markdown link to the rows of the table that it comes from, `[0.63](summary.csv#row=13)`. Rows
are counted as by RFC 7111: the header is the first. Words that judge (better, worse, equivalent) are verdicts
on the protocol's contrasts, and are used for nothing else: all other sentences describe.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, Final

import numpy as np
import pandas as pd

from agents import load_algorithm
from benchmark.analysis.contrasts import BETTER, EQUIVALENT, NO_VERDICT, WORSE
from benchmark.analysis.population import GOOD_SCORE
from benchmark.drawing.tables import link
from benchmark.reports.comparison.data import SB3
from benchmark.reports.comparison.protocol import (
    Learner,
    Protocol,
    counted,
    decisive_rows,
    has_failed,
    outcome,
)
from benchmark.reports.published import Published

_TABLE: Final = "contrasts"
_IN_WORDS: Final = {
    BETTER: "better than `{}`",
    WORSE: "worse than `{}`",
    EQUIVALENT: "equivalent to `{}`",
}


def table(published: Published) -> pd.DataFrame:
    """Returns the headline and the sentences after it, one per row; none if there is nothing to compare."""
    texts = Findings(published).sentences()
    return pd.DataFrame({"finding": range(len(texts)), "text": pd.Series(texts, dtype=object)})


def headline(published: Published) -> str:
    """Returns the headline as published; empty if there is none."""
    return "".join(_texts(published)[:1])


def sentences(published: Published) -> list[str]:
    """Returns the sentences after the headline as published."""
    return _texts(published)[1:]


def _texts(published: Published) -> list[str]:
    """Returns the published findings."""
    return [str(text) for text in published.frame("findings")["text"]]


class Findings:
    """Reads the tables of a comparison and puts them into words."""

    def __init__(self, published: Published) -> None:
        """Takes a folder of results, from whose files everything is read."""
        self._published = published

    # What there is

    @cached_property
    def _everyone(self) -> list[Learner]:
        """All learners, in the order of the tables."""
        frame = self._published.frame("summary")
        pairs = dict.fromkeys(zip(frame["algorithm"], frame["observation"], strict=True))
        return [Learner(*pair) for pair in pairs]

    @cached_property
    def checks(self) -> dict[Learner, Learner]:
        """The checks, with the learner that each checks."""
        arms = {learner: self._arm(learner).get("check_of") for learner in self._everyone}
        return {check: Learner(arm, check.observation) for check, arm in arms.items() if arm}

    @cached_property
    def _learners(self) -> list[Learner]:
        """The learners that are no checks; all sentences but one are about them."""
        return [learner for learner in self._everyone if learner not in self.checks]

    @cached_property
    def tables(self) -> list[Learner]:
        """The tabular learners."""
        return [learner for learner in self._learners if self._family(learner) == "tabular"]

    @cached_property
    def deep(self) -> list[Learner]:
        """The deep learners."""
        return [learner for learner in self._learners if self._family(learner) == "deep"]

    @cached_property
    def protocol(self) -> Protocol | None:
        """What was to be decided; None if nothing was."""
        found = self._published.manifest["facts"].get("protocol")
        return None if found is None else Protocol.from_json(found)

    @cached_property
    def _contrasts(self) -> pd.DataFrame:
        """The contrasts, a row each; none if the learners of all of them are missing."""
        if f"{_TABLE}.csv" not in self._published:
            return pd.DataFrame(columns=["x", "y", "n", "success_verdict", "success_y"])
        return self._published.frame(_TABLE)

    def sentences(self) -> list[str]:
        """Returns the headline and the sentences after it; none without a protocol."""
        if self.protocol is None:
            return []
        written = [
            self._headline(),
            *(self._contrast(row) for _, row in self._contrasts.iterrows()),
            self._policies(),
        ]
        if "threshold.csv" in self._published:
            written += [
                self._threshold(),
                self._cost(),
                self._every_cell(),
                self._region(),
                self._disagreements(),
            ]
        written += [self._tuning(), self._checks()]
        return [sentence for sentence in written if sentence]

    def _headline(self) -> str:
        """Answers the question, and says what the answer rests on."""
        assert self.protocol is not None
        reference = self.protocol.reference
        budgets = {self._budget(learner) for learner in self._learners}
        budget = f"With {budgets.pop()} of training" if len(budgets) == 1 else "With these budgets"
        if self._contrasts.empty:
            return f"{budget}, there is no verdict: runs are missing."
        if reference is None:
            n = link(str(len(self._contrasts)), _TABLE, self._contrasts)
            one = len(self._contrasts) == 1
            return f"{budget}, of {n} contrast{'' if one else 's'}, {counted(self._contrasts)}."
        rows = decisive_rows(self.protocol, self._contrasts)
        start = f"{budget} and by success alone, "
        match outcome(self.protocol, self._contrasts):
            case "earns":
                better = rows[rows["success_verdict"] == BETTER]
                names = _and([f"`{name}`" for name in better["x"]])
                verb = "succeeds" if len(better) == 1 else "succeed"
                text = (
                    f"{start}deep RL earns its keep over a table here: {names} {verb} more often than "
                    f"`{reference}`."
                )
            case "does not earn":
                if len(rows) == 1:
                    subject = f"`{rows['x'].iloc[0]}`"
                else:
                    subject = f"each of the {len(rows)} deep learners that the protocol compares with a table"
                text = (
                    f"{start}deep RL does not earn its keep over a table here: {subject} succeeds less often "
                    f"than `{reference}`, or equally often within {self.protocol.success_margin:g}."
                )
            case "undecided":
                text = (
                    f"{start}it is undecided whether deep RL earns its keep over a table here: against "
                    f"`{reference}`, {counted(rows)}."
                )
            case "no verdict":
                return (
                    f"{budget}, there is no verdict on whether deep RL earns its keep over a table: "
                    f"{self._reason(rows)}."
                )
        side = self._row("aggregate", reference)
        found = [f"`{row['x']}` {self._total(Learner.of(row['x']))}" for _, row in rows.iterrows()]
        mean = "Mean success" if self._n_scenarios > 1 else "Success"
        over = f" over {self._n_scenarios} scenarios" if self._n_scenarios > 1 else ""
        return (
            f"{text}\n\n{mean}{over}: `{reference}` {_with_interval(side, 'success', 'aggregate')}; "
            f"{'; '.join(found)}.{self._ceiling(side)}"
        )

    def _reason(self, rows: pd.DataFrame) -> str:
        """Says why there is no verdict."""
        assert self.protocol is not None
        if self._published.manifest.get("partial", "").startswith("Partial: "):
            return "runs are missing"
        if (rows["success_verdict"] != NO_VERDICT).all() and has_failed(self.protocol, rows):
            return (
                f"no deep learner is better, and `{self.protocol.reference}` succeeds less often than the "
                f"margin of {self.protocol.success_margin:g}"
            )
        return f"a verdict takes {self.protocol.fewest_runs} runs per scenario and learner"

    def _ceiling(self, side: pd.Series) -> str:
        """Says how little room the reference leaves above it; empty if that is more than the margin."""
        assert self.protocol is not None
        room = 1 - side["success"]
        if room >= self.protocol.success_margin:
            return ""
        if room < 1e-6:
            return " The table succeeds in every run, so no learner could succeed more often."
        return f" No learner could succeed more often than the table by more than {room:.3f}."

    def _contrast(self, row: pd.Series) -> str:
        """Says how a contrast ended, on both endpoints."""
        verdict, x, y = str(row["success_verdict"]), f"`{row['x']}`", row["y"]
        found = {
            endpoint: f"{link(_signed(row[f'{endpoint}_difference']), _TABLE, row)} "
            f"[{_signed(row[f'{endpoint}_difference_low'])}, {_signed(row[f'{endpoint}_difference_high'])}]"
            for endpoint in ("success", "score")
        }
        if verdict in (BETTER, WORSE, EQUIVALENT):
            text = f"{x} is {_IN_WORDS[verdict].format(y)} in success: {found['success']}"
        elif verdict == NO_VERDICT:
            n = link(str(row["n"]), _TABLE, row)
            text = f"There is no verdict on {x} against `{y}` in success: {found['success']} "
            text += f"({n} runs per scenario)"
        else:
            text = f"{x} against `{y}` is undecided in success: {found['success']}{self._needed(row)}"
        if verdict == EQUIVALENT and row["success_p_different"] <= 0.05:
            text += (
                f"; the difference is significant (p = {row['success_p_different']:.2g}), but smaller than "
                f"{row['success_margin']:g}"
            )
        if verdict == EQUIVALENT and max(row["success_x"], row["success_y"]) < row["success_margin"]:
            text += "; both succeed less often than that margin"
        return f"{text}. In score: {row['score_verdict']}, {found['score']}."

    def _needed(self, row: pd.Series) -> str:
        """Says how far an undecided contrast is from a verdict, and what would decide it."""
        p, q = row["success_p_different"], row["success_p_equivalent"]
        needed = row["success_deciding_runs"]
        many = "over a million" if math.isinf(needed) else f"about {link(f'{needed:,.0f}', _TABLE, row)}"
        return (
            f" (p = {p:.2g} for no difference, {q:.2g} for one as large as {row['success_margin']:g}); a new "
            f"study would need {many} runs per scenario and learner to decide it with a power of 80 %, if "
            "the means stay as they are"
        )

    # Descriptions

    def _policies(self) -> str:
        """Says what the other policy of a stochastic learner does."""
        parts = []
        for learner in self._learners:
            rows = self._rows("summary", learner)
            if (rows["policy"] == "stochastic").all():
                stochastic, greedy = (
                    link(f"{rows[column].mean():.2f}", "summary", rows)
                    for column in ("success", "greedy_success")
                )
                parts.append(
                    f"`{learner}` {stochastic} by its stochastic policy and {greedy} by its greedy one"
                )
        if not parts:
            return ""
        text = f"Success by policy{', means over scenarios' * (self._n_scenarios > 1)}: {'; '.join(parts)}."
        return f"{text} The protocol names the one that counts."

    def _threshold(self) -> str:
        """Says how many steps a good policy takes."""
        last = self._published.frame("curves")["step"].max()

        def say(step: float) -> str:
            return "never" if np.isinf(step) else "at the last evaluation" if step == last else f"{step:,.0f}"

        parts = [
            f"`{learner}` {self._by_scenario('threshold', learner, 'stays_step_median', say)}"
            for learner in self._compared
        ]
        return (
            f"Median number of steps after which the score stays at or above {GOOD_SCORE:g} to the last "
            f"evaluation: {'; '.join(parts)}."
        )

    def _cost(self) -> str:
        """Says what a run costs: time, updates, parameters."""
        parts = []
        for learner in [*self._compared, *self._checks_of(*self._compared)]:
            row = self._row("cost", learner)
            time = _duration(row["cpu_time_s"])
            parts.append(
                f"`{learner}` {link(time, 'cost', row)} and "
                f"{link(f'{row.updates:,.0f}', 'cost', row)} updates of "
                f"{link(f'{row.parameters:,.0f}', 'cost', row)} parameters"
            )
        text = f"CPU time of a run, median: {'; '.join(parts)}."
        plain = self._plain_python()
        if plain is None:
            return text
        deep = [learner for learner in self._compared if self._family(learner) == "deep"]
        ratios = [
            f"`{learner}` {link(f'{_two_digits(ratio)} times', 'cost', self._row('cost', learner), plain)}"
            for learner in [*deep, *self._checks_of(*deep)]
            for ratio in [float(self._row("cost", learner)["cpu_time_s"] / plain["cpu_time_s"])]
        ]
        return f"{text} Relative to `{plain['algorithm']}`, a table in plain Python: {'; '.join(ratios)}."

    def _plain_python(self) -> pd.Series | None:
        """Returns the cost of a table that needs no package and so is in plain Python, or None."""
        for check, learner in self.checks.items():
            if self._family(check) == "tabular" and not self._packages(check) and learner in self.tables:
                return self._row("cost", check)
        return None

    def _every_cell(self) -> str:
        """Says what was learned away from the path from the start."""
        if "every_cell_success" not in self._published.frame("aggregate"):
            return ""
        parts = []
        for learner in self._compared:
            row = self._row("aggregate", learner)
            success = link(f"{row['success']:.2f}", "aggregate", row)
            parts.append(
                f"`{learner}` {_with_interval(row, 'every_cell_success', 'aggregate')} against {success}"
            )
        return f"Success from a random cell against that from the start cell: {'; '.join(parts)}."

    def _region(self) -> str:
        """Says how well learners know the personal space."""
        parts = []
        for learner in self._compared:
            rows = self._rows("region", learner)
            means = rows.reindex(columns=["overlap", "precision", "recall"]).mean(skipna=False)
            shown = ["none" if np.isnan(value) else f"{value:.2f}" for value in means]
            overlap, precision, recall = (link(text, "region", rows) for text in shown)
            parts.append(f"`{learner}` {overlap} (precision {precision}, recall {recall})")
        return (
            "Overlap of the cells where an agent values PING with the target region (intersection over "
            "union, mean over agents and scenarios; precision, of agents that mark a cell): "
            f"{'; '.join(parts)}."
        )

    def _disagreements(self) -> str:
        """Says how often the issuer disagrees."""
        parts = []
        for learner in self._compared:
            rows = self._rows("curves", learner)
            last = rows[rows["step"] > 0.9 * rows["step"].max()]
            means = (link(f"{part['disagreements'].mean():.0f}", "curves", part) for part in (rows, last))
            parts.append(f"`{learner}` {' and '.join(means)}")
        return (
            "The issuer's disagreements per 1,000 steps, over all of training and in its last tenth: "
            f"{'; '.join(parts)}."
        )

    def _tuning(self) -> str:
        """Says how much search the settings took."""
        searched, taken = [], []
        for arm in dict.fromkeys(learner.algorithm for learner in self._learners):
            tuning = self._published.manifest["algorithms"][arm].get("tuning")
            if tuning is not None and tuning["settings"]:
                searched.append(f"`{arm}` {tuning['settings']} with up to {tuning['seeds']} seeds each")
            elif tuning is not None:
                taken.append(f"`{arm}`")
        texts = []
        if searched:
            texts.append(f"Settings that were tried, in runs that are not used here: {'; '.join(searched)}.")
        if taken:
            texts.append(f"No settings were searched for {_and(taken)}.")
        return " ".join(texts)

    def _checks(self) -> str:
        """Says how checks and the learners that they check compare."""
        parts = []
        for check, learner in self.checks.items():
            rows = [self._row("aggregate", each) for each in (check, learner)]
            both = " and ".join(_with_interval(row, "success", "aggregate") for row in rows)
            parts.append(f"`{check}` {both}")
        if not parts:
            return ""
        n_checks, n_checked = self._n(*self.checks), self._n(*self.checks.values())
        deep = [check for check in self.checks if self._family(check) == "deep"]
        is_sb3 = deep and all("stable_baselines3" in self._packages(check) for check in deep)
        trained = f", nets by {SB3}" if is_sb3 else ""
        return (
            "Checks have the settings of the learners that they check and are trained by another "
            f"implementation{trained}. Success probability of each check ({n_checks} runs per scenario) and "
            f"of the learner that it checks ({n_checked}): {'; '.join(parts)}. No verdict rests on them."
        )

    # Numbers in words

    @cached_property
    def _compared(self) -> list[Learner]:
        """The learners of the contrasts with the reference, or of all contrasts; tables come first."""
        assert self.protocol is not None
        named = self.protocol.compared
        if self.protocol.reference is not None:
            named = {x for x, y in self.protocol.contrasts if y == self.protocol.reference} | {*self.tables}
        return [learner for learner in self._learners if learner in named]

    def _checks_of(self, *learners: Learner) -> list[Learner]:
        """Returns the checks of learners."""
        return [check for check, learner in self.checks.items() if learner in learners]

    @property
    def _n_scenarios(self) -> int:
        """How many scenarios a mean is over."""
        return int(self._published.frame("summary")["scenario"].nunique())

    def _total(self, learner: Learner) -> str:
        """Returns a learner's success over all scenarios with its interval."""
        return _with_interval(self._row("aggregate", learner), "success", "aggregate")

    def _by_scenario(self, name: str, learner: Learner, column: str, say: Callable[[float], str]) -> str:
        """Returns a learner's numbers in every scenario."""
        return ", ".join(
            f"{link(say(row[column]), name, row)} in {row['scenario']}"
            for _, row in self._rows(name, learner).iterrows()
        )

    def _n(self, *learners: Learner) -> str:
        """Returns how many runs learners have in each scenario."""
        rows = pd.concat([self._rows("summary", learner) for learner in learners])
        fewest, most = rows["n"].min(), rows["n"].max()
        return link(f"{most}" if fewest == most else f"{fewest} to {most}", "summary", rows)

    # Tables and manifest

    def _rows(self, name: str, learner: Learner) -> pd.DataFrame:
        """Returns the rows of a learner."""
        frame = self._published.frame(name)
        is_own = (frame["algorithm"] == learner.algorithm) & (frame["observation"] == learner.observation)
        return frame[is_own]

    def _row(self, name: str, learner: Learner) -> pd.Series:
        """Returns the only row of a learner."""
        rows = self._rows(name, learner)
        assert len(rows) == 1
        return rows.iloc[0]

    def _arm(self, learner: Learner) -> Mapping[str, Any]:
        """Returns what the manifest says of a learner's arm."""
        arm: Mapping[str, Any] = self._published.manifest["algorithms"][learner.algorithm]
        return arm

    def _budget(self, learner: Learner) -> str:
        """Returns how long a learner trains."""
        settings = self._arm(learner)["settings"]
        return f"{settings['budget']:,} {settings.get('budget_unit', 'steps')}"

    def _packages(self, learner: Learner) -> tuple[str, ...]:
        """Returns what a learner's algorithm is made with."""
        arm = self._arm(learner)
        # Manifests of older results do not say.
        return tuple(arm["packages"] if "packages" in arm else load_algorithm(arm["algorithm"]).packages)

    def _family(self, learner: Learner) -> str:
        """Returns whether a learner learns a table or a net."""
        arm = self._arm(learner)
        # Manifests of older results do not say.
        return str(arm["family"]) if "family" in arm else load_algorithm(arm["algorithm"]).family


def _with_interval(row: pd.Series, key: str, table: str) -> str:
    """Returns a number with its interval."""
    return f"{link(f'{row[key]:.2f}', table, row)} [{row[f'{key}_low']:.2f}, {row[f'{key}_high']:.2f}]"


def _signed(value: float) -> str:
    """Returns a difference.

    >>> _signed(0.034), _signed(-0.034), _signed(-0.0001)
    ('+0.034', '-0.034', '0.000')
    """
    shown = f"{value:+.3f}"
    return shown[1:] if shown in ("+0.000", "-0.000") else shown


def _and(parts: Sequence[str]) -> str:
    """Returns parts as a list in a sentence."""
    *others, last = parts
    return f"{', '.join(others)} and {last}" if others else last


def _duration(seconds: float) -> str:
    """Returns a time with two significant digits.

    >>> _duration(0.000319), _duration(0.0345), _duration(0.0999), _duration(175)
    ('0.32 ms', '34 ms', '100 ms', '180 s')
    """
    return f"{_two_digits(seconds * 1000)} ms" if seconds < 0.1 else f"{_two_digits(seconds)} s"


def _two_digits(value: float) -> str:
    """Returns a number rounded to two significant digits."""
    return f"{value:.2g}" if value < 10 else f"{round(value, 2 - len(str(int(value)))):,.0f}"
