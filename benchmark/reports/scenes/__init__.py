"""The report on scenes: where nets do better than tables, and what each change of a scene costs."""

from benchmark.reports.scenes.report import REPORT

__all__ = ["REPORT"]
