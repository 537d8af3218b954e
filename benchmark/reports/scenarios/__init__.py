"""The report on scenarios: where nets do better than tables, and what each change of a scenario costs."""

from benchmark.reports.scenarios.report import REPORT

__all__ = ["REPORT"]
