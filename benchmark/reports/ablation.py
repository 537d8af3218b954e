"""Ablations: which changes make a learner better, by declared contrasts: a comparison with fewer items."""

from dataclasses import replace
from typing import Final

from benchmark.reports.comparison import findings
from benchmark.reports.comparison.data import load
from benchmark.reports.comparison.report import ITEMS, VERDICTS_TEXT, check, protocol_terms, words
from benchmark.reports.item import Report, Section

_SHOWN: Final = ("aggregate", "contrasts", "summary", "curves", "scores", "findings")

REPORT: Final = Report(
    name="ablation",
    question="Which changes make the difference?",
    check=check,
    load=load,
    items=tuple(replace(item, is_measured=False, section="") for item in ITEMS if item.name in _SHOWN),
    sections=(
        Section(
            key="ablation",
            heading="Ablation",
            text=VERDICTS_TEXT,
            terms=protocol_terms,
            terms_title="The protocol",
        ),
    ),
    headline=findings.headline,
    sentences=findings.sentences,
    words=words,
    lead="summary",
    packages=("rliable",),
)
