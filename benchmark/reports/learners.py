"""What readers call learners: a variant's title and what it observes. CSV files keep the short names."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Self

import pandas as pd

from benchmark.experiments import Experiment, family_of
from envs import InputError

_OBSERVED: Final = {
    "index": " on the cells' index",
    "one_hot": " on one-hot cells",
    "coordinates": " on coordinates",
    "offset": " on the offset's index",
    "offset_one_hot": " on one-hot offsets",
    "offset_coordinates": " on offset coordinates",
}
# A table has a row for each observation, in whatever form it is given; so has a planner.
_ROWS: Final = {"index": "", "one_hot": "", "offset": " of offsets", "offset_one_hot": " of offsets"}


@dataclass(frozen=True)
class Names:
    """The names of an experiment's learners."""

    titles: Mapping[str, str]  # of variants; those without a title are called by their own names
    families: Mapping[str, str]  # of variants

    @classmethod
    def of(cls, experiment: Experiment) -> Self:
        """Returns the names in an experiment.

        Raises:
          InputError: Two of its learners have the same name.
        """
        declared = experiment.algorithms
        families = {name: family_of(experiment, name) for name in declared}
        names = cls({name: each.title for name, each in declared.items()}, families)
        first: dict[str, str] = {}
        for variant, each in declared.items():
            for observation in each.observations:
                name, arm = names(variant, observation), f"{variant}, {observation}"
                if (other := first.setdefault(name, arm)) != arm:
                    raise InputError(
                        f'{experiment.argument}: algorithms: "{name}" is the name of {other} and of {arm}; '
                        "accepted: titles that differ."
                    )
        return names

    @classmethod
    def from_manifest(cls, manifest: Mapping[str, Any]) -> Self:
        """Returns the names in published results."""
        declared = manifest.get("algorithms", {})
        return cls(
            {name: each.get("title", "") for name, each in declared.items()},
            {name: each.get("family", "") for name, each in declared.items()},
        )

    def __call__(self, variant: str, observation: str) -> str:
        """Returns what readers call a learner.

        >>> families = {"q": "tabular", "dqn": "deep", "mine": "deep"}
        >>> names = Names({"q": "Q-learning table", "dqn": "DQN"}, families)
        >>> names("q", "index"), names("q", "offset"), names("dqn", "coordinates"), names("mine", "one_hot")
        ('Q-learning table', 'Q-learning table of offsets', 'DQN on coordinates', 'mine on one-hot cells')
        """
        phrases = _OBSERVED if self.families.get(variant) == "deep" else _OBSERVED | _ROWS
        return (self.titles.get(variant) or variant) + phrases.get(observation, f" on {observation}")

    def of_side(self, side: str) -> str:
        """Returns a side of a contrast, or any other text, with the names of the learners in it.

        >>> names = Names({"q": "Q-learning table"}, {"q": "tabular"})
        >>> names.of_side("q, offset @ S1"), names.of_side("S1"), names.of_side("q")
        ('Q-learning table of offsets @ S1', 'S1', 'q')
        """
        parts = [(part, *part.partition(", ")) for part in side.split(" @ ")]
        return " @ ".join(
            self(variant, observation) if observation and variant in self.families else part
            for part, variant, _, observation in parts
        )

    def told(self, side: str) -> str:
        """Returns the same for a sentence: a table has an article.

        >>> names = Names({"q": "Q-learning table", "dqn": "DQN"}, {"q": "tabular", "dqn": "deep"})
        >>> names.told("q, index"), names.told("dqn, coordinates")
        ('the Q-learning table', 'DQN on coordinates')
        """
        name = self.of_side(side)
        return f"the {name}" if re.search(r"\btable\b", name) else name

    def in_table(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Returns a table with a column of learners, and with their names for sides of contrasts."""
        frame = frame.copy()
        if {"algorithm", "observation"} <= {*frame} and "learner" not in frame:
            learners = [
                self.of_side(f"{row['algorithm']}, {row['observation']}") for _, row in frame.iterrows()
            ]
            frame.insert([*frame].index("algorithm"), "learner", learners)
        for column in {"learner", "x", "y"} & {*frame}:
            frame[column] = [self.of_side(each) if isinstance(each, str) else each for each in frame[column]]
        return frame
