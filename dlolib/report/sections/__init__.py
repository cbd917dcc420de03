"""The sections of a report in reading order: a new one is a file here and a line below."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from dlolib.report.model import Section
from dlolib.report.results import Results
from dlolib.report.sections import (
    ablation,
    agreement,
    bench,
    cables,
    capture,
    chain,
    comparison,
    diagnosis,
    execution,
    headline,
    identification,
    layouts,
    making,
    proof,
    solvers,
)

SECTIONS: tuple[Callable[[Results, Path], Section], ...] = (
    headline.section,
    capture.section,
    chain.section,
    identification.section,
    diagnosis.section,
    proof.section,
    layouts.section,
    ablation.section,
    execution.section,
    cables.section,
    solvers.section,
    agreement.section,
    bench.section,
    comparison.section,
    making.section,
)
