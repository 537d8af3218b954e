"""Tests of `agents`."""

from typing import Any, Final

Changes = dict[str, Any]  # of a scenario's or a learner's keys

# An issuer whose mood changes at random, and with it the regions: S1 with `phases` of these.
MOODS: Final[list[Changes]] = [
    {"name": "calm", "next": {"tense": 0.3}},
    {
        "name": "tense",
        "next": {"calm": 0.5},
        "regions": {"uncomfortable_radius": 2, "target_radius": 3},
    },
]
