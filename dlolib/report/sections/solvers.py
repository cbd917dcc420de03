"""The paper's iterative solver beside the direct one, on a rope that is known exactly (solvers.json)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib import colormaps
from matplotlib.axes import Axes

from dlolib.report.model import Column, Figure, Missing, Paragraph, Section, Table
from dlolib.report.results import Results
from dlolib.report.style import OBSERVED, PAPER, ROD, WHITE, canvas, save, thousandths
from dlolib.report.text import ABSENT, fixed, listed, millimetres, scientific, span

TITLE = "The paper's solver beside ours"
DIRECT, STILL, PAPER_ENDS = "direct", "direct, quasi-static", "direct, the paper's ends"
NAMES = {
    DIRECT: "Direct, the same steps",
    STILL: "Direct, quasi-static",
    PAPER_ENDS: "Direct, the paper's ends",
    "iterative": "The paper's",
}
ITERATIVE = "#8C6D1F"
DASHED, DOTTED = (0, (4, 3)), (0, (1, 2))
STEPS = (0.1, 0.2, 0.3, 0.5, 1, 2, 3, 5, 10, 20, 30, 50, 100)
WIDEST = 10.0
"""EI over the true one up to which the residual is drawn."""


def section(results: Results, figures: Path) -> Section:
    """Shape error, identified EI and residual by iterations, as figure and as table."""
    found = results.json("solvers.json")
    if found is None:
        missing = Missing("The two solvers were not compared: `make solvers` does it, in some minutes.")
        return Section("solvers", TITLE, (missing,))
    return Section("solvers", TITLE, (Paragraph(_words(found)), _figure(found, figures), _table(found)))


def _iterative(found: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [one for one in found["solvers"] if one["solver"] == "iterative"]


def _direct(found: Mapping[str, Any], name: str) -> dict[str, Any]:
    return next(one for one in found["solvers"] if one["solver"] == name)


def _words(found: Mapping[str, Any]) -> str:
    without = [str(one["iterations"]) for one in _iterative(found) if one["bending_stiffness"] is None]
    text = (
        "The paper solves its constraints one after another, a number of times a time step; this library "
        "solves them all at once. Here both simulate one rope whose shapes are known without a simulator: "
        f"the exact elastica with EI = {scientific(found['true_ei_n_m2'], 2)} N m² between the ends that "
        f"the paper's arc of {found['steps']} waypoints gives, with the paper's {found['particles']} "
        f"particles and one step of {1e3 * found['step_s']:g} ms a waypoint. Then each is asked which EI "
        f"fits {found['frames']} of these shapes best."
    )
    if without:
        text += (
            f" With {listed(without)} iterations there is none: what the iterations leave undone bends "
            "the rope like a much softer one, at any EI, so that the residual falls however stiff the "
            "rope is made, and a descent stops only when it is stopped."
        )
    return text


def _figure(found: Mapping[str, Any], figures: Path) -> Figure:
    figure = canvas(66)
    shape, stiffness, residual = figure.subplots(1, 3)
    _draw_shape(shape, found)
    _draw_stiffness(stiffness, found)
    _draw_residual(residual, found)
    figure.legend(*stiffness.get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return Figure(
        save(figure, figures, "solvers"),
        "Left: the largest distance of a particle to the exact rope on the whole way, in % of its length; "
        "middle: the EI that fits the exact shapes best, arrows where the residual falls without end; "
        "right: that residual over EI by iterations (brown) and of the direct solver (blue), dots where it "
        "is smallest. See that more iterations come closer, yet not to the truth but to a rope half a "
        "segment longer at each clamp (dashed), as the paper's end constraints join the frames; EI has to "
        f"make up for that length. The paper states {found['particles']} particles and "
        f"{1e3 * found['step_s']:g} ms a step, but no number of iterations: the dotted grey line is this "
        f"repository's `rod.sweeps`, {found['marked_iterations']}.",
        "Shape error, identified stiffness and residual of the paper's solver by its iterations",
    )


def _over_iterations(axes: Axes, found: Mapping[str, Any], place: float) -> None:
    """A logarithmic x axis, the paper's setting marked at a height in parts of the panel's."""
    counts, marked = [one["iterations"] for one in _iterative(found)], found["marked_iterations"]
    axes.set(xscale="log", xlabel="iterations a step", xlim=(0.8 * counts[0], 1.3 * counts[-1]))
    axes.set_xticks(counts, [str(count) for count in counts])
    axes.axvline(marked, color=PAPER, linewidth=0.9, linestyle=DOTTED)
    axes.annotate(
        f"the paper's setting,\ntaken as {marked} iterations", (marked, place), (3, 0), color=PAPER,
        xycoords=("data", "axes fraction"), textcoords="offset points", fontsize=6.5, va="center", bbox=WHITE,
    )  # fmt: skip


def _plain_log(axes: Axes, low: float, high: float, unit: float = 1.0) -> None:
    """A logarithmic y axis from low to high with plain numbers, in multiples of `unit`."""
    axes.set(yscale="log", ylim=(low, high))
    ticks = [tick for tick in STEPS if low <= tick * unit <= high]
    axes.set_yticks([tick * unit for tick in ticks], [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()


def _draw_shape(axes: Axes, found: Mapping[str, Any]) -> None:
    ladder = _iterative(found)
    errors = [100 * one["shape_error"] for one in ladder]
    axes.plot([one["iterations"] for one in ladder], errors, "o-", color=ITERATIVE, markersize=3.5)
    for name, color, style in ((DIRECT, ROD, "-"), (PAPER_ENDS, ROD, DASHED)):
        axes.axhline(100 * _direct(found, name)["shape_error"], color=color, linestyle=style)
    axes.set_ylabel("largest shape error [% of the length]")
    _plain_log(axes, 0.3, 1.5 * max(errors))
    _over_iterations(axes, found, 0.3)


def _draw_stiffness(axes: Axes, found: Mapping[str, Any]) -> None:
    ladder, true = _iterative(found), found["true_ei_n_m2"]
    some = [one for one in ladder if one["bending_stiffness"] is not None]
    none = [one["iterations"] for one in ladder if one["bending_stiffness"] is None]
    values = [one["bending_stiffness"]["value"] for one in some]
    axes.plot(
        [one["iterations"] for one in some], values, "o-", color=ITERATIVE, markersize=3.5,
        label="the paper's solver",
    )  # fmt: skip
    limit = _direct(found, PAPER_ENDS)["bending_stiffness"]["value"]
    axes.axhline(true, color=OBSERVED, linewidth=0.9, linestyle=DOTTED, label="truth", zorder=3)
    axes.axhline(_direct(found, DIRECT)["bending_stiffness"]["value"], color=ROD, label="the direct solver")
    axes.axhline(limit, color=ROD, linestyle=DASHED, label="the same, with the paper's ends")
    top = 3 * max(limit, *values) if values else 10 * true
    axes.plot(none, [0.75 * top] * len(none), "^", color=ITERATIVE, markersize=5)
    if none:
        axes.annotate(
            "no EI fits best", (none[0], 0.75 * top), (-2, -5), textcoords="offset points", va="top",
            fontsize=6.5, color=ITERATIVE, bbox=WHITE,
        )  # fmt: skip
    axes.set_ylabel("EI identified [10⁻⁴ N m²]")
    _plain_log(axes, 0.6 * true, top, 1e-4)
    _over_iterations(axes, found, 0.69)


def _draw_residual(axes: Axes, found: Mapping[str, Any]) -> None:
    ladder, scan, true = _iterative(found), found["scan_ei_n_m2"], found["true_ei_n_m2"]
    shown = sum(value <= WIDEST * true * 1.001 for value in scan)
    ends = _apart([one["scan_rmse_m"][shown - 1] for one in ladder])
    for index, (one, end) in enumerate(zip(ladder, ends, strict=True)):
        color = colormaps["YlOrBr"](0.45 + 0.55 * index / max(len(ladder) - 1, 1))
        axes.plot(scan[:shown], one["scan_rmse_m"][:shown], color=color, linewidth=1.0)
        axes.annotate(
            str(one["iterations"]), (scan[shown - 1], end), (3, 0), textcoords="offset points",
            fontsize=6, va="center", color=color, annotation_clip=False,
        )  # fmt: skip
        if one["bending_stiffness"] is not None:
            axes.plot(one["bending_stiffness"]["value"], one["rmse_m"], "o", color=color, markersize=3)
    direct = _direct(found, DIRECT)
    axes.plot(scan[:shown], direct["scan_rmse_m"][:shown], color=ROD)
    axes.plot(direct["bending_stiffness"]["value"], direct["rmse_m"], "o", color=ROD, markersize=3)
    axes.axvline(true, color=OBSERVED, linewidth=0.9, linestyle=DOTTED)
    axes.set(xscale="log", xlabel="EI [N m²]", ylabel="residual a point, RMS [mm]", ylim=(0, None))
    thousandths(axes, "y")


def _apart(heights_m: list[float]) -> list[float]:
    """The heights, those that would be written on each other moved up in turn."""
    gap = max(heights_m) / 20
    out, last = list(heights_m), -gap
    for index in sorted(range(len(out)), key=lambda index: out[index]):
        last = out[index] = max(out[index], last + gap)
    return out


def _table(found: Mapping[str, Any]) -> Table:
    true = found["true_ei_n_m2"]
    rows = []
    for one in found["solvers"]:
        ei = one["bending_stiffness"]
        rows.append(
            (
                NAMES[one["solver"]],
                ABSENT if one["iterations"] is None else str(one["iterations"]),
                fixed(100 * one["shape_error"], 2),
                millimetres(one["rmse_at_truth_m"], 2),
                "none" if ei is None else scientific(ei["value"]),
                ABSENT if ei is None else span(ei["low"], ei["high"]),
                ABSENT if ei is None else fixed(100 * (ei["value"] / true - 1), 1),
                millimetres(one["rmse_m"], 2),
            )
        )
    columns = (
        Column("Solver", align="left"),
        Column("Iterations", "count"),
        Column("Shape error", "%"),
        Column("RMS at true EI", "mm"),
        Column("EI that fits", "N m²"),
        Column("95 % interval", "N m²"),
        Column("Off the truth", "%"),
        Column("RMS at it", "mm"),
    )
    caption = (
        "Both solvers on the exact rope: largest distance to it on the way over its length, and the EI "
        "identified from its shapes. Where none fits best, the last residual is that of a rope "
        f"{found['scan_ei_n_m2'][-1] / true:.0f} times too stiff. The direct solver's "
        f"{fixed(100 * _direct(found, DIRECT)['shape_error'], 2)} % is the rope's inertia in the paper's "
        f"{found['steps'] * found['step_s']:g} s, which the elastica does not have; quasi-static "
        f"{fixed(100 * _direct(found, STILL)['shape_error'], 2)} % are left, the floor of "
        f"{found['particles']} particles."
    )
    return Table(caption, columns, tuple(rows))
