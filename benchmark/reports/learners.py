"""What readers call learners: a variant's title and what it observes. CSV files keep the short names."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Self

from agents import load_algorithm
from benchmark.experiments import Experiment

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
        """Returns the names in an experiment."""
        declared = experiment.algorithms
        families = {
            name: each.family or load_algorithm(each.algorithm).family for name, each in declared.items()
        }
        return cls({name: each.title for name, each in declared.items()}, families)

    @classmethod
    def from_manifest(cls, manifest: Mapping[str, Any]) -> Self:
        """Returns the names in published results."""
        declared = manifest["algorithms"]
        return cls(
            {name: each.get("title", "") for name, each in declared.items()},
            {name: each["family"] for name, each in declared.items()},
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

    def of_arm(self, arm: str) -> str:
        """Returns what readers call a learner that is given as `variant, observation`."""
        return self(*arm.split(", "))

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
