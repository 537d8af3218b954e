"""Tests of `agents`."""

from typing import Any, Final

# An issuer whose mood changes at random, and with it the regions: S1 with `phases` of these.
MOODS: Final[list[dict[str, Any]]] = [
    {"name": "calm", "next": {"tense": 0.3}},
    {"name": "tense", "next": {"calm": 0.5}, "regions": {"uncomfortable_radius": 2, "target_radius": 3}},
]
