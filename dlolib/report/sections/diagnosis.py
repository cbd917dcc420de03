"""Diagnosis: what physics an elastic rod leaves out of each recording, where, and how sure that is."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from dlolib.report.diagnosis import bends, models_figure, moments_figure, rope_figure, scan_figure
from dlolib.report.model import Block, Column, Figure, Missing, Paragraph, Section, Table
from dlolib.report.results import Results
from dlolib.report.style import save
from dlolib.report.text import fixed, millimetres, nice_unit, scientific, sentence, span, title
from dlolib.types import Quality, Verdict

TITLE = "What the elastic rod leaves out"
RATIO = "ratio"
STATUS = {
    "no_mismatch": "nothing is missing that could show",
    "explained": "explained",
    "ambiguous": "explained, but not by one model alone",
    "unexplained": "not explained by the library",
}


def section(results: Results, figures: Path) -> Section:
    """The verdict on each recording: its sentence, the rope, the scan, the models, the parameters."""
    found = [(name, results.verdict(name)) for name in results.diagnosed]
    if not found:
        missing = Missing("Nothing was diagnosed yet: `dvc repro diagnose` does it for every recording.")
        return Section("diagnosis", TITLE, (missing,))
    blocks: list[Block] = [Paragraph(_words())]
    for name, verdict in found:
        blocks += _recording(results, name, verdict, figures)
    return Section("diagnosis", TITLE, tuple(blocks))


def _words() -> str:
    return (
        "Every effect of the library is fitted to each recording, alone and, where more may be missing, in "
        "pairs, against a rod that is but elastic. An effect counts where it gains more than chance would "
        "over every model without it, and a hundredth of what an ideal law beside it explains; one that "
        "gains less beside the law makes a tie. The model of least BIC is named where the slow modes of "
        "what it leaves are noise, or little of what it explains; models within the tie margin are as good. "
        "Held-out motion was set aside before anything was fitted."
    )


def _recording(results: Results, name: str, verdict: Verdict, figures: Path) -> list[Block]:
    status = STATUS[verdict.status]
    blocks: list[Block] = [Paragraph(f"**{title(name)}: {status}.** {sentence(verdict.summary)}")]
    shapes, scan = (results.table("diagnose", name, part) for part in ("shapes.csv", "scan.csv"))
    moments = results.table("diagnose", name, "moments.csv")
    if shapes is not None:
        blocks.append(_rope(name, shapes, verdict, figures))
    if scan is not None and verdict.where:
        blocks.append(_scan(name, scan, verdict, figures))
    if verdict.status != "no_mismatch":
        blocks.append(_models(name, verdict, figures))
        if moments is not None and bends(moments):
            blocks.append(_moments(name, moments, figures))
    blocks.append(_parameters(name, verdict))
    if verdict.next_motion is not None:
        asked = verdict.next_motion
        blocks.append(
            Paragraph(
                f"To tell {_set(asked.separates[0])} from {_set(asked.separates[1])}: {asked.why} "
                f"(`{asked.file}`; expected difference in BIC {fixed(asked.expected_delta_bic, 0)})."
            )
        )
    blocks.append(_detectable(name, verdict))
    return blocks


def _set(names: tuple[str, ...]) -> str:
    return " with ".join(title(name).lower() for name in names)


def _rope(name: str, shapes: pd.DataFrame, verdict: Verdict, figures: Path) -> Figure:
    return Figure(
        save(rope_figure(shapes, verdict.recordings[0]), figures, f"diagnosis_rope_{name}"),
        f"{title(name)}: some frames of the rope, coloured by how far the observed points are off the "
        f"best elastic "
        "rod, in deviations of the noise. Dark is where it is wrong; the dashed line is the best model.",
        f"Where the elastic rod and {title(name)} disagree",
    )


def _scan(name: str, scan: pd.DataFrame, verdict: Verdict, figures: Path) -> Figure:
    return Figure(
        save(scan_figure(scan, verdict.recordings[0]), figures, f"diagnosis_scan_{name}"),
        f"{title(name)}: gain in χ² if one place of the rope were, around one frame, stiffer, curved "
        f"at rest or "
        "pushed. White: no more than noise does once in a hundred recordings. Nothing is named yet here.",
        f"Scan of local probes over {title(name)}",
    )


def _models(name: str, verdict: Verdict, figures: Path) -> Figure:
    ahead = any(one.heldout_delta_chi2 is not None for one in verdict.candidates)
    foretold = (
        "; right, what each foretells of the held-out motion against the elastic rod, to the left is better"
    )
    return Figure(
        save(models_figure(verdict), figures, f"diagnosis_models_{name}"),
        f"{title(name)}: the best models. BIC over that of the best (blue: the winner and its ties)"
        f"{foretold if ahead else ''}.",
        f"Models fitted to {title(name)}",
    )


def _moments(name: str, moments: pd.DataFrame, figures: Path) -> Figure:
    return Figure(
        save(moments_figure(moments), figures, f"diagnosis_moments_{name}"),
        f"{title(name)}: moment against curvature where the best model bends most, from the fitted "
        f"model; the dot "
        "is the first frame. A straight line is an elastic rope, a loop is one that loses energy.",
        f"Moment against curvature of the model of {title(name)}",
    )


def _parameters(name: str, verdict: Verdict) -> Table:
    rows = []
    best = "nearest model" if verdict.status == "unexplained" else "winning model"
    for words, quality in (("elastic rod", verdict.baseline), (best, verdict.augmented)):
        rows += _rows(words, quality)
        if verdict.status == "no_mismatch":
            break
    columns = (
        Column("Model", align="left"),
        Column("Parameter", align="left"),
        Column("Value"),
        Column("95 %"),
        Column("Unit", align="left"),
        Column("Distance, RMS", "mm"),
        Column("Held out", "mm"),
        Column("Slow residuals", "noise"),
    )
    caption = (
        f"{title(name)}: parameters without and with the named effect. Slow residuals: energy of their"
        f" slow modes over "
        "that of noise (1 is noise)."
    )
    return Table(caption, columns, tuple(rows))


def _rows(words: str, quality: Quality) -> list[tuple[str, ...]]:
    figures = (
        millimetres(quality.rmse_m, 2),
        millimetres(quality.heldout_rmse_m, 2),
        fixed(quality.statistic, 2),
    )
    rows: list[tuple[str, ...]] = []
    for k, (name, value) in enumerate(quality.parameters.items()):
        own = figures if k == 0 else ("", "", "")
        shown = (scientific(value.value), span(value.low, value.high), nice_unit(value.unit) or RATIO)
        rows.append((words if k == 0 else "", name.replace(".", ": ").replace("_", " "), *shown, *own))
    return rows


def _detectable(name: str, verdict: Verdict) -> Table:
    columns = (
        Column("Effect", align="left"),
        Column("Parameter", align="left"),
        Column("Seen from"),
        Column("Unit", align="left"),
    )
    rows = tuple(
        (
            title(one.name).lower(),
            one.parameter.replace("_", " "),
            "cannot be seen here" if one.value is None else scientific(one.value, 2),
            nice_unit(one.unit) or RATIO,
        )
        for one in verdict.detectable
    )
    return Table(
        f"{title(name)}: the size from which on each effect would be seen with 95 % power.", columns, rows
    )


__all__ = ["TITLE", "section"]
