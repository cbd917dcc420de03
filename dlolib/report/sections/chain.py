"""The chain on the image, and how far it lies from the rope's true axis."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dlolib.report.measures import ChainError, by_arc_length
from dlolib.report.model import Block, Column, Figure, Missing, Paragraph, Section, Table
from dlolib.report.pictures import project, rgb, rope_window, shown, toward_camera
from dlolib.report.results import Results
from dlolib.report.sections import chain_bench
from dlolib.report.style import PLASTIC, ROD, canvas, legend_above, save, thousandths
from dlolib.report.text import fixed, millimetres
from dlolib.types import CaptureIndex, Recording

TITLE = "The chain on the image"
SHOWN = 6
COLUMNS = 360
"""Pixels across one small image: 170 to the inch on the page."""


def section(results: Results, figures: Path) -> Section:
    """Six frames with the chain on them; its error by arc length where there is a truth."""
    recording = results.captured
    if recording is None:
        return Section("chain", TITLE, (Missing("No chain is there: `dvc repro chain` makes it."),))
    blocks: list[Block] = [Paragraph(_words(recording, results.capture))]
    capture = results.capture
    if capture is not None and not np.isin(recording.points.frame, capture.frame).all():
        blocks.append(
            Missing("The chain is of another capture than the one here: `dvc repro chain` makes it.")
        )
    elif capture is not None and capture.color and capture.camera.fx:
        blocks.append(_overlay(capture, recording, figures))
    else:
        blocks.append(Missing("There are no images under this recording to lay the chain on."))
    error = results.chain_error
    if error is None:
        blocks.append(
            Missing(
                "There is no truth to compare the chain with: the capture does not come from the laboratory. "
                "The residual of the identified rod, in the next section, bounds its error from outside."
            )
        )
    else:
        blocks += [_error_figure(error, recording, figures), _error_table(error, results, recording)]
    return Section("chain", TITLE, (*blocks, *chain_bench.blocks(results)))


def _words(recording: Recording, capture: CaptureIndex | None) -> str:
    points = recording.points
    frames, counts = np.unique(points.frame, return_counts=True)
    each = f"{counts.min()} to {counts.max()}" if counts.min() < counts.max() else str(counts.min())
    line = (
        "finds the rope's centre line in each segmented cloud, seen as the depth image that it came from,"
        if capture is not None and not capture.color
        else "finds the rope's centre line in the colour image, carries it into space through the depth image"
    )
    return (
        f"Algorithm 1 of the paper {line} and walks along it at an even spacing. {len(frames)} frames gave "
        f"{len(points.frame)} points, {each} in a frame."
    )


def _overlay(capture: CaptureIndex, recording: Recording, figures: Path) -> Figure:
    assert capture.color is not None
    known = np.unique(recording.points.frame)
    chosen = known[np.linspace(0, len(known) - 1, min(SHOWN, len(known))).round().astype(int)]
    window = rope_window(capture, recording)
    columns = min(3, len(chosen))
    rows = -(-len(chosen) // columns)
    shape = (window[1] - window[0]) / max(1, window[3] - window[2])
    figure = canvas(rows * (53 * shape + 6))
    extent = (window[2] - 0.5, window[3] - 0.5, window[1] - 0.5, window[0] - 0.5)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels:
        axes.set_axis_off()
    for axes, frame in zip(panels, chosen, strict=False):
        here = recording.points.frame == frame
        pixels = project(recording.points.xyz_m[here], capture.camera)
        image = rgb(capture.color[int(np.flatnonzero(capture.frame == frame)[0])])
        axes.imshow(shown(image, window, COLUMNS), extent=extent, interpolation="none")
        axes.plot(*pixels.T, "o-", color=PLASTIC, markersize=2.4, linewidth=0.6, markeredgewidth=0)
        axes.set_title(f"frame {frame}, t = {recording.points.t_s[here][0]:.2f} s", fontweight="normal")
        axes.set(xlim=extent[:2], ylim=extent[2:])
    return Figure(
        save(figure, figures, "chain"),
        "The chain (orange) laid back onto the colour image, in frames spread evenly over the recording. "
        "See whether it follows the middle of the rope from the clamp to the gripper, also where the "
        "rope bends most.",
        "Chain points drawn over colour images of the rope",
    )


def _error_figure(error: ChainError, recording: Recording, figures: Path) -> Figure:
    figure = canvas(52)
    arc, frames = figure.subplots(1, 2, width_ratios=[1.7, 1])
    arc.plot(
        error.s_m, error.distance_m, ".", color="#8D99A6", markersize=2.6, markeredgewidth=0, label="a point"
    )
    centres, _, rms = by_arc_length(error.s_m, error.distance_m)
    arc.plot(centres, rms, color=ROD, label="root mean square")
    radius = recording.rope.radius_m
    if radius:
        arc.axhline(radius, color=PLASTIC, linewidth=0.8, linestyle=(0, (4, 3)), label="the rope's skin")
    arc.set(xlabel="arc length from the clamp [mm]", ylabel="distance to the true axis [mm]", ylim=(0, None))
    thousandths(arc)
    legend_above(arc)
    ids = np.unique(error.frame)
    per_frame = [np.sqrt(np.mean(error.distance_m[error.frame == frame] ** 2)) for frame in ids]
    frames.plot(ids, per_frame, "o-", color=ROD, markersize=2.4, linewidth=0.8)
    frames.set(xlabel="frame", ylabel="RMS of the frame [mm]", ylim=(0, None))
    thousandths(frames, "y")
    return Figure(
        save(figure, figures, "chain_error"),
        "Distance of the chain's points to the true axis: left by arc length, right frame by frame. A "
        "chain on the rope's skin instead of its axis would lie near the dashed line; see whether the "
        "error grows toward the ends, where clamp and gripper hide the rope.",
        "Distance of the chain to the true axis along the rope and over the frames",
    )


def _error_table(error: ChainError, results: Results, recording: Recording) -> Table:
    distance = error.distance_m
    along = error.s_m - error.true_s_m
    rows = [
        ("Root mean square distance to the axis", millimetres(error.rms_m, 2)),
        ("95 % of the points are nearer than", millimetres(float(np.percentile(distance, 95)), 2)),
        ("Largest distance", millimetres(float(distance.max()), 2)),
        (
            "Mean offset toward the camera (the skin would be " + _radius(recording) + ")",
            _offset(error, results),
        ),
        ("Arc length, chain minus truth: mean", millimetres(float(along.mean()), 2)),
        ("Arc length, chain minus truth: standard deviation", millimetres(float(along.std()), 2)),
    ]
    caption = (
        f"The chain against the true axis, {len(distance)} points in {len(np.unique(error.frame))} frames."
    )
    return Table(caption, (Column("Measure", align="wide"), Column("Value", "mm")), tuple(rows))


def _radius(recording: Recording) -> str:
    return f"{fixed(1e3 * recording.rope.radius_m)} mm"


def _offset(error: ChainError, results: Results) -> str:
    if results.capture is None:
        return millimetres(None)
    offset = toward_camera(error.offset_m, error.point_m, results.capture.camera)
    return millimetres(float(np.mean(offset)), 2)
