"""The replication of the paper: its figure, its claims, and how far learning got."""

from benchmark.reports.replication.report import REPORT

__all__ = ["REPORT"]
