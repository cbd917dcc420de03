"""Real cables (cables.json) and the elastic laboratory (elastic.json), run beside the pipeline."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dlolib.report.model import Block, Column, Figure, Missing, Paragraph, Section, Table
from dlolib.report.results import Results, find_number
from dlolib.report.style import PLASTIC, ROD, canvas, save
from dlolib.report.text import ABSENT, fixed, millimetres, scientific, span, title

TITLE = "Real cables, and the laboratory without plasticity"


def section(results: Results, figures: Path) -> Section:
    """Apparent stiffness by recording beside the common one; the elastic laboratory against its truth."""
    blocks: list[Block] = []
    cables, elastic = results.json("cables.json"), results.json("elastic.json")
    if not cables:
        blocks.append(Missing("The real cables were not run: `make cables DATA=DIR` writes their figures."))
    else:
        blocks += _cables(cables, figures)
    if not elastic:
        blocks.append(Missing("The elastic laboratory was not run, so that its figures are missing here."))
    else:
        blocks += _elastic(elastic)
    return Section("cables", TITLE, tuple(blocks))


def _cables(cables: Mapping[str, Any], figures: Path) -> list[Block]:
    recordings = _by_name(cables.get("recordings"))
    words = (
        f"A thick cable, clamped in a robot's flange that turns it, with a free end. {len(recordings)} "
        "recordings of settled poses were identified each for itself, then together with one stiffness."
    )
    blocks: list[Block] = [Paragraph(words)]
    if recordings:
        blocks += [_stiffness_figure(recordings, cables, figures), _cable_table(recordings, cables)]
    test = _test(cables)
    if test:
        blocks.append(Paragraph(test))
    for key in ("contradiction", "says", "note", "sentence"):
        if isinstance(cables.get(key), str):
            blocks.append(Paragraph(cables[key]))
    return blocks


def _by_name(recordings: Any) -> dict[str, Mapping[str, Any]]:
    """Recordings as name to figures, whether they were listed or keyed."""
    if isinstance(recordings, Mapping):
        return dict(recordings)
    if isinstance(recordings, list):
        return {str(item.get("name", index)): item for index, item in enumerate(recordings)}
    return {}


def _interval(found: Mapping[str, Any]) -> tuple[float | None, float | None, float | None]:
    """EI with its interval, from {bending_stiffness: {value, low, high}} or {ei_n_m2: ...}."""
    for key in ("bending_stiffness", "ei_n_m2", "EI_n_m2"):
        for level in (found, found.get("parameters") or {}):
            value = level.get(key)
            if isinstance(value, Mapping):
                return value.get("value"), value.get("low"), value.get("high")
            if isinstance(value, int | float):
                return float(value), None, None
    return None, None, None


def _joint(cables: Mapping[str, Any]) -> Mapping[str, Any]:
    for key in ("joint", "together", "common"):
        if isinstance(cables.get(key), Mapping):
            return dict(cables[key])
    return {}


def _stiffness_figure(
    recordings: dict[str, Mapping[str, Any]], cables: Mapping[str, Any], figures: Path
) -> Figure:
    figure = canvas(14 + 8 * (len(recordings) + 1))
    axes = figure.subplots()
    common = _interval(_joint(cables))
    rows = [(title(name), *_interval(found), ROD) for name, found in recordings.items()]
    if common[0] is not None:
        rows.append(("All together", *common, PLASTIC))
    for place, (_, value, low, high, color) in enumerate(rows):
        if value is None:
            continue
        if low is not None and high is not None:
            axes.plot([low, high], [place, place], color=color, linewidth=2.2, solid_capstyle="butt")
        axes.plot(value, place, "o", color=color, markersize=5, markeredgecolor="white", markeredgewidth=0.6)
    axes.set_yticks(np.arange(len(rows)), [row[0] for row in rows])
    axes.set(xlabel="EI [N m²]", ylim=(len(rows) - 0.4, -0.6))
    axes.set_xlim(0, None)
    return Figure(
        save(figure, figures, "cables"),
        "Apparent stiffness of the cable from each recording with its 95 % interval, and one stiffness "
        "for all. See whether the intervals overlap: where they do not, one elastic cable with the "
        "stated mass does not explain all.",
        "Bending stiffness identified from each recording of one cable",
    )


def _cable_table(recordings: dict[str, Mapping[str, Any]], cables: Mapping[str, Any]) -> Table:
    rows = []
    for name, found in (*recordings.items(), ("all together", _joint(cables))):
        value, low, high = _interval(found)
        rms = find_number(found, "rmse_m", "rms_m", "residual_m")
        held = find_number(found, "heldout_rmse_m", "left_out_rmse_m")
        rows.append(
            (title(name), scientific(value), span(low, high), millimetres(rms, 1), millimetres(held, 1))
        )
    columns = (
        Column("Recording", align="wide"),
        Column("EI", "N m²"),
        Column("95 % interval", "N m²"),
        Column("Residual, RMS", "mm"),
        Column("On poses left out, RMS", "mm"),
    )
    return Table("The recordings of the cable.", columns, tuple(rows))


def _test(cables: Mapping[str, Any]) -> str:
    for key in ("test", "agreement"):
        found = cables.get(key)
        if isinstance(found, Mapping):
            p = find_number(found, "p_value", "p")
            statistic = find_number(found, "statistic", "F", "chi2")
            if isinstance(found.get("says"), str):
                return str(found["says"])
            if p is not None:
                verdict = "they agree" if p >= 0.05 else "they do not agree"
                name = found.get("name", "Test")
                return (
                    f"Do they agree on one stiffness? {name}: statistic {fixed(statistic, 2)}, p = "
                    f"{p:.2g}: at the 5 % level {verdict}."
                )
    return ""


def _elastic(elastic: Mapping[str, Any]) -> list[Block]:
    value, low, high = _interval(elastic)
    true = find_number(elastic, "true_ei_n_m2", "ei_true_n_m2", "truth_n_m2", "true_bending_stiffness")
    error = find_number(elastic, "ei_error", "relative_error", "ei_relative_error")
    if error is None and value and true:
        error = value / true - 1
    rms = find_number(elastic, "rmse_m", "residual_m", "rms_m")
    rows = (
        ("EI identified", scientific(value), "N m²"),
        ("its 95 % interval", span(low, high), "N m²"),
        ("EI of the laboratory's rope", scientific(true), "N m²"),
        ("Error of EI", fixed(None if error is None else 100 * error, 1), "%"),
        ("Residual a point, RMS", millimetres(rms, 2), "mm"),
    )
    shown = tuple(row for row in rows if row[1] != ABSENT)
    words = (
        "With the laboratory's law switched to elastic the rod has all the physics of the recorded rope: "
        "what is left then is camera, chain and discretisation alone."
    )
    columns = (Column("Measure", align="wide"), Column("Value"), Column("Unit", align="left"))
    return [Paragraph(words), Table("The laboratory with an elastic rope.", columns, shown)]
