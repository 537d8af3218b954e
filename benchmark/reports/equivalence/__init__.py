"""Checks: whether two implementations of an algorithm succeed equally often, as far as runs can show."""

from benchmark.reports.equivalence.report import REPORT

__all__ = ["REPORT"]
