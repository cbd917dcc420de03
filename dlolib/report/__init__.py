"""The report: one content, rendered as a self-contained HTML page and as a PDF."""

from dlolib.report.build import build_report, collect
from dlolib.report.diagnosis import draw_diagnosis
from dlolib.report.headline import headline
from dlolib.report.results import Results

__all__ = ["Results", "build_report", "collect", "draw_diagnosis", "headline"]
