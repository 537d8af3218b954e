"""Tests of `envs`."""

from typing import Any

Changes = dict[str, Any]  # of a scenario's keys
