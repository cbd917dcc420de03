"""From the results of the stages to report.json, report.html and report.pdf."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib import rc_context

from dlolib.errors import DloError
from dlolib.files import whole_file, whole_folder, write_json
from dlolib.formats import say
from dlolib.progress import track
from dlolib.report.headline import headline
from dlolib.report.model import as_json, numbered
from dlolib.report.render import render_html, render_pdf
from dlolib.report.results import CAPTURED, Results, read_object
from dlolib.report.sections import SECTIONS
from dlolib.report.style import STYLE

LARGE_BYTES = 5_000_000
FORMAT = "dlo-report/1"
FILES = ("report.json", "report.pdf", "report.html")


def build_report(
    results: Path,
    out: Path,
    *,
    data: Path | None = None,
    has_truth: bool = True,
    parameters: Mapping[str, Any] | None = None,
) -> Path:
    """Write report.json, report.html, report.pdf and figures/ into `out`; the same bytes at every run.

    Args:
        results: what the stages left: identify/, learn/, execute/, *.json.
        out: the folder to write to; it may be `results` itself.
        data: captures, recordings, layouts and truth; by default data/ beside `results`.
        has_truth: False where data/truth does not belong to this capture (a capture of the user's own).
        parameters: the pipeline's parameters, block by block, for the last section.

    Returns:
        The path of report.html.

    Raises:
        DloError: `results` is no folder, one of its files cannot be read, or `out` holds what no report left.
    """
    results, out = Path(results), Path(out).resolve()  # a link may lead to another disk
    if not results.is_dir():
        problem = "is a file" if results.is_file() else "no such folder"
        raise DloError(problem, file=results, mend="name the folder with the stages' results")
    for name in ("recording.json", "capture.json", "layout.json"):
        if (results / name).is_file():
            problem = f"is a {name.removesuffix('.json')}, no results"
            raise DloError(problem, file=results, mend="name the folder with the stages' results")
    _check_place(out)
    beside = Path(os.path.normpath(results / ".." / "data"))
    source = Results(results, beside if data is None else Path(data), has_truth, parameters)
    out.parent.mkdir(parents=True, exist_ok=True)
    # what is there may be a disk of its own, onto which nothing can be renamed from beside it
    with tempfile.TemporaryDirectory(prefix=".report.", dir=out if out.is_dir() else out.parent) as name:
        work = Path(name)
        report = collect(source, work / "figures")
        page, document = render_html(report, work), render_pdf(report, work)
        if len(page.encode()) > LARGE_BYTES:
            problem = f"the page has {len(page.encode()) / 1e6:.1f} MB, more than {LARGE_BYTES / 1e6:g}"
            mend = "report fewer recordings or layouts at once if it opens slowly"
            say([str(DloError(problem, file=out / "report.html", mend=mend))])
        write_json(work / "report.json", report)
        (work / "report.pdf").write_bytes(document)
        (work / "report.html").write_text(page, encoding="utf-8")
        with whole_folder(out / "figures") as figures:
            for path in sorted((work / "figures").iterdir()):
                path.rename(figures / path.name)
        for name in FILES:
            with whole_file(out / name) as temporary:
                (work / name).rename(temporary)
    return out / "report.html"


def _check_place(out: Path) -> None:
    """Refuse to replace what no earlier report left."""
    mend = "write to a folder of its own"
    if out.exists() and not out.is_dir():
        raise DloError("is a file", file=out, mend=mend)
    there = [name for name in ("figures", *FILES) if (out / name).exists()]
    for name in there:
        if (out / name).is_dir() != (name == "figures"):
            raise DloError("is there and of no report", file=out / name, mend=mend)
    said = read_object(out / "report.json") if there else None
    if there and (said is None or said.get("format") != FORMAT):
        raise DloError("is there and of no report", file=out / there[0], mend=mend)


def collect(results: Results, figures: Path) -> dict[str, Any]:
    """Gather the content of a report and draw its figures into `figures`.

    Returns:
        What report.json holds: format, title, kicker, subtitle, headline (`dlolib.report.headline`) and
        sections, each with its blocks (`dlolib.report.model`); paths of figures are relative to the report.
    """
    figures.mkdir(parents=True, exist_ok=True)
    with rc_context(STYLE):
        sections = [section(results, figures) for section in track(SECTIONS, "report")]
    return {
        "format": FORMAT,
        "title": _title(results),
        "kicker": "dlolib report",
        "subtitle": (
            "From depth images of a rope to its stiffness, and from its stiffness to motions that shape "
            "it without contact."
        ),
        "headline": headline(results),
        "sections": as_json(numbered(tuple(sections))),
    }


def _title(results: Results) -> str:
    rope = results.captured.rope.name if results.captured is not None else ""
    named = rope or (results.recordings[0] if results.recordings else CAPTURED)
    return f"Stiffness and shaping of a rope: {named.replace('_', ' ')}"
