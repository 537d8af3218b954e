"""What a comparison found, in sentences from its published tables; each judging word follows from numbers.

A number is a Markdown link to the rows of the table that it comes from, `[0.63](summary.csv#row=13)`. Rows
are counted as by RFC 7111: the header is the first. Scores are means over runs, which show a run that fails;
interquartile means do not. Two learners differ significantly if the 95 % interval of the probability that a
run of one outscores a run of the other excludes one half.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, Final, Literal

import numpy as np
import pandas as pd

from agents import load_algorithm
from benchmark.analysis.population import GOOD_SCORE
from benchmark.drawing.tables import link
from benchmark.reports import independent
from benchmark.reports.comparison.data import SB3, Learner
from benchmark.reports.published import Published

FEWEST_RUNS: Final = 10  # per scenario, of a learner on which a verdict rests
_RANKED: Final = 3  # deep learners that are named as the best

Outcome = Literal["earns", "does not earn", "undecided"]


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
    def best_table(self) -> Learner:
        """The tabular learner with the highest mean score."""
        return max(self.tables, key=self._mean)

    @cached_property
    def best_deep(self) -> Learner:
        """The deep learner with the highest mean score."""
        return max(self.deep, key=self._mean)

    def outcome(self) -> Outcome:
        """Decides whether deep RL earns its keep over a table, by the evidence of the runs.

        It *earns* its keep if some deep learner does better than the best table: the 95 % interval of the
        probability that one of its runs outscores one of the table's lies wholly above one half. Both need at
        least `FEWEST_RUNS` runs per scenario, and the deep learner a success probability above 0 in every
        scenario. It *does not earn* its keep if every deep learner has that many runs, as does the table, and
        each one's interval lies wholly at or below one half. Everything else is *undecided*: that no learner
        is shown to do better does not show that none does. The best table is the one with the highest mean
        score; intervals are not corrected for the number of comparisons.
        """
        if self._better():
            return "earns"
        learners = [self.best_table, *self.deep]
        rows = [self._improvement(learner, self.best_table) for learner in self.deep]
        if all(map(self._has_enough_runs, learners)) and all(row["high"] <= 0.5 for row in rows):
            return "does not earn"
        return "undecided"

    def _better(self) -> list[Learner]:
        """Lists the deep learners that do better than the best table, see `outcome`."""
        return [
            learner
            for learner in self.deep
            if self._has_enough_runs(learner)
            and self._has_enough_runs(self.best_table)
            and self._rows("summary", learner)["success"].min() > 0
            and self._improvement(learner, self.best_table)["low"] > 0.5
        ]

    def _has_enough_runs(self, learner: Learner) -> bool:
        """Returns whether a verdict can rest on a learner: it has `FEWEST_RUNS` in every scenario."""
        return int(self._rows("summary", learner)["n"].min()) >= FEWEST_RUNS

    def sentences(self) -> list[str]:
        """Returns the headline and up to eleven sentences; none without both a table and a deep learner."""
        if not self.tables or not self.deep:
            return []
        written = (
            self._headline(),
            self._tables(),
            self._best_deep(),
            self._observations(),
            self._linear(),
            self._defaults(),
            self._threshold([*self.tables, self.best_deep]),
            self._cost(self.tables[0], self.best_deep),
            self._every_cell([*self.tables, self.best_deep]),
            self._region(),
            self._disagreements([*self.tables, self.best_deep]),
            self._checks(),
        )
        return [sentence for sentence in written if sentence]

    def _headline(self) -> str:
        """Says whether deep RL earns its keep."""
        table, best = self.best_table, self.best_deep
        name = f"`{table.algorithm}`"
        match self.outcome():
            case "earns":
                better = self._better()
                names = ", ".join(f"`{learner}`" for learner in better)
                verdict = (
                    f"deep RL earns its keep over a table here: {names} "
                    f"{'does' if len(better) == 1 else 'do'} better than the best table, {name}"
                )
            case "does not earn":
                verdict = (
                    "deep RL does not earn its keep over a table here: no deep learner does better than the "
                    f"best table, {name}"
                )
            case "undecided":
                few = not all(map(self._has_enough_runs, [table, *self.deep]))
                verdict = (
                    "it is undecided whether deep RL earns its keep over a table here: no deep learner "
                    f"can be said to do better than the best table, {name}, and the data do not show that "
                    "none does"
                )
                if few:
                    verdict += f" (a verdict takes at least {FEWEST_RUNS} runs per scenario and learner)"
        budgets = {self._budget(learner) for learner in [*self.tables, *self.deep]}
        budget = f"{budgets.pop()} of training" if len(budgets) == 1 else "the budgets of this experiment"
        ratio, times = self._ratio(table, best)
        batches = self._batches(best)
        return (
            f"With {budget} {verdict}. That table has a mean score of "
            f"{self._score(table)} ({self._n(table)} runs per scenario). The deep learner with the highest "
            f"mean score, `{best}`, has {self._score(best)} ({self._n(best)} runs per scenario): "
            f"{self._verdict(best, table)}. {f'Trained {batches}, it' if batches else 'It'} takes "
            f"{times} the CPU time of that table"
            + (
                ", but this compares compiled code with Python: against a table in plain Python it is about "
                f"{_plain_python(ratio)} times."
                if self._compares_languages(table, best)
                else "."
            )
        )

    def _tables(self) -> str:
        """Says how tables do, with the settings of the first arm and with others."""
        first = self.tables[0]
        budget = self._settings(first)["budget"]
        rows = self._rows("curves", first)
        late = rows[rows["step"] > budget / 2].groupby("scenario", sort=False)
        means = ", ".join(link(f"{part['success'].mean():.2f}", "curves", part) for _, part in late)
        text = (
            f"After {self._budget(first)} the table `{first.algorithm}` ({self._n(first)} runs per scenario) "
            f"succeeds with probability {self._by_scenario('summary', first, 'success', _two_decimals)} "
            f"(averaged over the second half of training: {means}), and has a mean score of "
            f"{self._score(first)} over all scenarios"
        )
        for other in self.tables[1:]:
            text += (
                f"; `{other}` ({self._n(other)} runs per scenario) has {self._score(other)}: "
                f"{self._verdict(other, first)}"
            )
        note = independent.of_papers_table(self._settings(first)) if self._has_scenario("S2") else ""
        return f"{text}. {note}".strip()

    def _best_deep(self) -> str:
        """Says how the deep learners with the highest scores do, and how the first compares with tables."""
        best, others = self.best_deep, list(dict.fromkeys((self.tables[0], self.best_table)))
        ranked = sorted(self.deep, key=self._mean, reverse=True)[:_RANKED]
        scores = []
        for learner in ranked:
            row = self._aggregate(learner, "start", "stochastic")
            stochastic = "" if row is None else f", and {_interval(row)} with its stochastic policy"
            scores.append(f"`{learner}` {self._score(learner)}{stochastic}")
        if len(ranked) == 1:
            subject = (
                f"The deep learner ({self._n(best)} runs per scenario) has a mean score: {scores[0]}. It"
            )
        else:
            subject = (
                f"The deep learners with the highest mean scores, with {self._n(*ranked)} runs per scenario "
                f"each, are {'; '.join(scores)}. The first"
            )
        return (
            f"{subject} succeeds with probability "
            f"{self._by_scenario('summary', best, 'success', _two_decimals)}; "
            f"{', and '.join(self._verdict(best, table) for table in others)}."
        )

    def _observations(self) -> str:
        """Says what the form of the observation changes."""
        parts = []
        for arm in dict.fromkeys(learner.algorithm for learner in self.deep):
            forms = [learner for learner in self._learners if learner.algorithm == arm]
            if len(forms) == 2:
                scores = " and ".join(f"{self._mean_link(form)} with {form.observation}" for form in forms)
                row = self._improvement(*forms)
                names = [form.observation for form in forms]
                better = names[0] if row["low"] > 0.5 else names[1] if row["high"] < 0.5 else ""
                verdict = f"{better} is better" if better else "no significant difference"
                if better and not all(map(self._has_enough_runs, forms)):
                    verdict = "too few runs for a verdict"
                parts.append(
                    f"`{arm}` {scores} ({verdict}, {_probability(row)}, {self._n(*forms)} runs per scenario "
                    "each)"
                )
        return f"Mean scores by form of observation: {'; '.join(parts)}." if parts else ""

    def _linear(self) -> str:
        """Says how a linear layer compares with the best net that has hidden layers, in the same learner."""
        linear = [learner for learner in self.deep if self._net(learner) == []]
        if not linear:
            return ""
        first = linear[0]
        kin = [
            learner
            for learner in self.deep
            if learner not in linear
            and learner.observation == first.observation
            and self._algorithm(learner) == self._algorithm(first)
        ]
        text = (
            f"A single linear layer over {first.observation} (`{first.algorithm}`, {self._parameters(first)} "
            f"parameters, {self._n(first)} runs per scenario) has a mean score of {self._score(first)}"
        )
        if kin:
            best = max(kin, key=self._mean)
            text += (
                f"; `{best}` with {self._parameters(best)} parameters ({self._n(best)} runs per scenario): "
                f"{self._verdict(best, first)}"
            )
            if self._other_settings(best) != self._other_settings(first):
                text += ". The two also differ in other settings"
        return f"{text}."

    def _defaults(self) -> str:
        """Says how the arms with Stable-Baselines3's own settings do; these are known by their names."""
        parts = []
        for learner in self.deep:
            if learner.is_default:
                rows = self._rows("threshold", learner)
                share = np.average(rows["reached_share"], weights=rows["n"])
                reached = f"{link(f'{share:.1%}', 'threshold', rows)} of {rows['n'].sum()} runs"
                parts.append(f"`{learner}` {self._mean_link(learner)} and {reached}")
        if not parts:
            return ""
        return (
            "The arms named `_default` have these mean scores, and these shares of runs that ever score "
            f"{GOOD_SCORE:g}: {', '.join(parts)}. Which of their settings explain this has not been tested "
            "here."
        )

    def _threshold(self, learners: Sequence[Learner]) -> str:
        """Says how many steps a good policy takes."""
        last = self._published.frame("curves")["step"].max()

        def say(step: float) -> str:
            return "never" if np.isinf(step) else "at the last evaluation" if step == last else f"{step:,.0f}"

        parts = [
            f"`{learner}` {self._by_scenario('threshold', learner, 'stays_step_median', say)}"
            for learner in learners
        ]
        return (
            f"Median number of steps after which the score stays at or above {GOOD_SCORE:g} to the last "
            f"evaluation: {'; '.join(parts)}."
        )

    def _cost(self, table: Learner, net: Learner) -> str:
        """Says what a run costs."""

        def say(row: pd.Series, time: str) -> str:
            return (
                f"{link(time, 'cost', row)} of CPU time, has {link(f'{row.parameters:,.0f}', 'cost', row)} "
                f"parameters, and its process peaks at {link(f'{row.peak_memory_mb:.0f}', 'cost', row)} MB"
            )

        def compare(learner: Learner) -> str:
            ratio, times = self._ratio(table, learner)
            text = f"{times} the CPU time of the table"
            if self._compares_languages(table, learner):
                text += (
                    f", which is compiled, and about {_plain_python(ratio)} times that of one in plain Python"
                )
            return text

        first, other = self._row("cost", table), self._row("cost", net)
        batches = self._batches(net)
        text = (
            f"A run of `{table}` takes {say(first, f'{first.cpu_time_s * 1000:.2g} ms')}; a run of `{net}`"
            f"{f', trained {batches},' if batches else ''} takes {say(other, f'{other.cpu_time_s:.2g} s')}. "
            f"That is {compare(net)}."
        )
        for check, checked in self.checks.items():
            if checked == net:
                row = self._row("cost", check)
                time = link(f"{row.cpu_time_s:.2g} s", "cost", row)
                text += f" A run of its check `{check}` takes {time}: {compare(check)}."
        return text

    def _every_cell(self, learners: Sequence[Learner]) -> str:
        """Says what was learned away from the greedy path."""
        if not (self._published.frame("aggregate")["evaluated_from"] == "every_cell").any():
            return ""
        parts = [
            f"`{learner}` {self._score(learner, 'every_cell')} against {self._mean_link(learner)}"
            for learner in learners
        ]
        return f"Mean score from a random cell against that from the start cell: {'; '.join(parts)}."

    def _region(self) -> str:
        """Says which learners know the personal space."""
        learners = [*self.tables, *self.deep]
        rows = {learner: self._rows("region", learner) for learner in learners}
        means = {learner: part.mean(numeric_only=True, skipna=False) for learner, part in rows.items()}
        best = max(self.deep, key=lambda learner: float(means[learner]["overlap"]))
        parts = []
        for learner in (*self.tables, best):
            values = means[learner][["overlap", "precision", "recall"]]
            shown = ["none" if np.isnan(value) else f"{value:.2f}" for value in values]
            overlap, precision, recall = (link(text, "region", rows[learner]) for text in shown)
            parts.append(f"`{learner}` {overlap} (precision {precision}, recall {recall})")
        return (
            "Overlap of the cells where an agent values PING with the target region (intersection over "
            f"union, mean of the scenarios): {', '.join(parts)}. The last is the deep learner with the "
            "largest overlap."
        )

    def _disagreements(self, learners: Sequence[Learner]) -> str:
        """Says how often the issuer disagrees."""
        parts = []
        for learner in learners:
            rows = self._rows("curves", learner)
            last = rows[rows["step"] > 0.9 * rows["step"].max()]
            means = (link(f"{part['disagreements'].mean():.0f}", "curves", part) for part in (rows, last))
            parts.append(f"`{learner}` {' and '.join(means)}")
        return (
            "The issuer's disagreements per 1,000 steps, over all of training and in its last tenth: "
            f"{', '.join(parts)}."
        )

    def _checks(self) -> str:
        """Says how checks and the learners that they check compare."""
        parts = []
        for check, learner in self.checks.items():
            row = self._improvement(check, learner)
            is_significant = not row["low"] <= 0.5 <= row["high"]
            verdict = "a significant difference" if is_significant else "no significant difference"
            if is_significant and not (self._has_enough_runs(check) and self._has_enough_runs(learner)):
                verdict = "too few runs for a verdict"
            scores = f"{self._score(check)} and {self._score(learner)}"
            parts.append(f"`{check}` {scores} ({verdict}, {_probability(row)})")
        if not parts:
            return ""
        n_checks, n_checked = self._n(*self.checks), self._n(*self.checks.values())
        is_sb3 = all("stable_baselines3" in self._packages(check) for check in self.checks)
        return (
            "Checks have the settings of the learners that they check and are trained by "
            f"{SB3 if is_sb3 else 'another implementation'}. Mean scores of each check ({n_checks} runs per "
            f"scenario) and of the learner that it checks ({n_checked}): {'; '.join(parts)}. These intervals "
            "are not corrected for their number, and with few runs only large differences would show."
        )

    # Numbers in words

    def _verdict(self, learner: Learner, other: Learner) -> str:
        """Says which of two learners does better, and with what probability."""
        row = self._improvement(learner, other)
        if row["low"] <= 0.5 <= row["high"]:
            return f"no significant difference from `{other}` ({_probability(row)})"
        if not (self._has_enough_runs(learner) and self._has_enough_runs(other)):
            side = "higher" if row["low"] > 0.5 else "lower"
            shown = f"though most score {side} ({_probability(row)})"
            return f"too few runs for a verdict against `{other}`, {shown}"
        return f"{'better' if row['low'] > 0.5 else 'worse'} than `{other}` ({_probability(row)})"

    def _by_scenario(self, name: str, learner: Learner, column: str, say: Callable[[float], str]) -> str:
        """Returns a learner's numbers in every scenario."""
        return ", ".join(
            f"{link(say(row[column]), name, row)} in {row['scenario']}"
            for _, row in self._rows(name, learner).iterrows()
        )

    def _score(self, learner: Learner, start: str = "start") -> str:
        """Returns a learner's mean score with its interval, of its greedy policy."""
        row = self._aggregate(learner, start)
        assert row is not None
        return _interval(row)

    def _mean_link(self, learner: Learner) -> str:
        """Returns a learner's mean score as readers see it."""
        row = self._aggregate(learner, "start")
        assert row is not None
        return link(f"{row['value']:.2f}", "aggregate", row)

    def _parameters(self, learner: Learner) -> str:
        """Returns how many parameters a learner has."""
        row = self._row("cost", learner)
        return link(f"{int(row['parameters']):,}", "cost", row)

    def _ratio(self, table: Learner, net: Learner) -> tuple[float, str]:
        """Returns how many times a table's CPU time a net takes, and the same as readers see it."""
        cheap, dear = self._row("cost", table), self._row("cost", net)
        ratio = float(dear["cpu_time_s"] / cheap["cpu_time_s"])
        return ratio, link(f"{_two_digits(ratio)} times", "cost", dear, cheap)

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

    def _aggregate(self, learner: Learner, start: str, policy: str = "greedy") -> pd.Series | None:
        """Returns the row of a learner's mean score; None if it has no such policy."""
        rows = self._rows("aggregate", learner)
        is_wanted = (
            (rows["policy"] == policy) & (rows["evaluated_from"] == start) & (rows["metric"] == "mean")
        )
        return rows[is_wanted].iloc[0] if is_wanted.any() else None

    def _mean(self, learner: Learner) -> float:
        """Returns a learner's mean score."""
        row = self._aggregate(learner, "start")
        assert row is not None
        return float(row["value"])

    def _improvement(self, learner: Learner, other: Learner) -> pd.Series:
        """Returns the row with the probability that a run of a learner outscores a run of another."""
        frame = self._published.frame("improvement")
        return frame[(frame["x"] == str(learner)) & (frame["y"] == str(other))].iloc[0]

    def _has_scenario(self, name: str) -> bool:
        """Returns whether a scenario is among those compared."""
        return bool((self._published.frame("summary")["scenario"] == name).any())

    def _arm(self, learner: Learner) -> Mapping[str, Any]:
        """Returns what the manifest says of a learner's arm."""
        arm: Mapping[str, Any] = self._published.manifest["algorithms"][learner.algorithm]
        return arm

    def _batches(self, net: Learner) -> str:
        """Returns how a net is trained, if not alone."""
        size = self._arm(net).get("batch_size", 1)
        return f"in batches of up to {size} runs" if size > 1 else ""

    def _algorithm(self, learner: Learner) -> str:
        """Returns the algorithm of a learner's arm."""
        return str(self._arm(learner)["algorithm"])

    def _settings(self, learner: Learner) -> dict[str, Any]:
        """Returns the settings of a learner's arm."""
        return dict(self._arm(learner)["settings"])

    def _budget(self, learner: Learner) -> str:
        """Returns how long a learner trains."""
        settings = self._settings(learner)
        return f"{settings['budget']:,} {settings.get('budget_unit', 'steps')}"

    def _net(self, learner: Learner) -> object:
        """Returns the hidden layers of a learner's net; None if its settings do not say."""
        return (self._settings(learner).get("policy_kwargs") or {}).get("net_arch")

    def _other_settings(self, learner: Learner) -> dict[str, Any]:
        """Returns the settings of a learner's arm, except those of its net."""
        return {key: value for key, value in self._settings(learner).items() if key != "policy_kwargs"}

    def _compares_languages(self, table: Learner, net: Learner) -> bool:
        """Returns whether a table is compiled, and a net trained from Python."""
        return "numba" in self._packages(table) and "stable_baselines3" in self._packages(net)

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


def _probability(row: pd.Series) -> str:
    """Returns a row of `improvement` as readers see it."""
    probability = link(f"{row['probability']:.2f}", "improvement", row)
    return f"P = {probability} [{row['low']:.2f}, {row['high']:.2f}]"


def _interval(row: pd.Series) -> str:
    """Returns a value with its interval."""
    return f"{link(f'{row.value:.2f}', 'aggregate', row)} [{row['low']:.2f}, {row['high']:.2f}]"


def _plain_python(ratio: float) -> str:
    """Returns a ratio to the compiled table's CPU time as one to that of a table in plain Python."""
    low, high = (_two_digits(value) for value in independent.against_plain_python(ratio))
    return f"{low} to {high}"


def _two_decimals(value: float) -> str:
    """Returns a number with two digits after the point."""
    return f"{value:.2f}"


def _two_digits(value: float) -> str:
    """Returns a number rounded to two significant digits."""
    return f"{value:.2g}" if value < 10 else f"{round(value, 2 - len(str(int(value)))):,.0f}"
