"""Checks: whether two implementations of an algorithm learn the same, as far as their runs can show."""

from benchmark.reports.equivalence.report import REPORT

__all__ = ["REPORT"]
