"""The comparison of tables with deep learners: scores, what they cost, and what they know."""

from benchmark.reports.comparison.report import REPORT

__all__ = ["REPORT"]
