"""How learners look in the figures of all studies."""

from typing import Any

from benchmark.drawing.style import learner_style
from benchmark.experiments import Experiment

Style = dict[str, Any]  # arguments of matplotlib


def style_of(learner: str, experiment: Experiment, observation: str | None = None) -> Style:
    """Returns a learner's colour, marker and dash, perhaps as if it had another observation.

    Colour and marker show its algorithm, and tint and dash its observation, so that figures can be read in
    grey. A reference implementation looks like its learner, but hollow and on a dotted line.
    """
    declared = {other.variant: other.declared for other in experiment.learners.values()}
    colours = {name: variant.colour for name, variant in declared.items() if not variant.reference_for}
    drawn = experiment.learners[learner]
    seen = drawn.observation if observation is None else observation
    of = drawn.declared.reference_for
    style = learner_style(of or drawn.variant, seen, colours, drawn.family)
    return style | {"mfc": "white", "ls": (0, (1, 1))} if of else style
