"""What was recorded: the camera, the rope, an image, and how the gripper moved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from dlolib.report.drawing import VIEWS, draw_clamp, mark, widest
from dlolib.report.model import Block, Column, Figure, Missing, Paragraph, Section, Table
from dlolib.report.pictures import depth_m, rgb, rope_window, shown
from dlolib.report.results import Results
from dlolib.report.style import FAINT, PATH, PLASTIC, ROD, canvas, legend_above, save, thousandths
from dlolib.report.text import fixed, millimetres
from dlolib.types import CaptureIndex, Floats, Motion, Recording

COLUMNS = 560
"""Pixels across one image: 200 to the inch on the page."""
CLOSED_M = 0.005
"""How near the end of a motion lies to its beginning where it goes out and back."""


def section(results: Results, figures: Path) -> Section:
    """A table of the set-up, one frame in colour and depth, and the gripper's motion."""
    capture, recording = results.capture, results.captured
    if capture is None:
        return Section("capture", "What was recorded", (Missing(_absent(recording)),))
    blocks: list[Block] = [Paragraph(_words(results, capture)), _table(capture)]
    if capture.color and capture.depth:
        blocks.append(_picture(capture, recording, figures))
    else:
        blocks.append(Missing("The capture holds segmented point clouds; there are no images to show."))
    if capture.motion is not None:
        blocks.append(_motion(capture, capture.motion, figures))
    return Section("capture", "What was recorded", tuple(blocks))


def _absent(recording: Recording | None) -> str:
    if recording is None:
        return "No capture is there: `dvc repro ingest` reads it."
    return "There is no capture: the recording was given as it is, and not made from images."


def _words(results: Results, capture: CaptureIndex) -> str:
    if results.truth is not None:
        return (
            "No camera and no arm took part: MuJoCo moved a rope, as a chain of bodies with a law of its "
            "own, and Open3D rendered what an Azure Kinect would have seen of it, with the noise, mixed "
            "pixels and losses of such a camera. Whatever follows knows of it only these images and the "
            "gripper's poses."
        )
    return (
        capture.source + ". " if capture.source else ""
    ) + "The capture is the user's own, from a real camera."


def _table(capture: CaptureIndex) -> Table:
    camera, rope = capture.camera, capture.rope
    duration = float(capture.t_s[-1] - capture.t_s[0])
    rows = [
        ("Rope", rope.name),
        ("Free length", f"{millimetres(rope.length_m, 0)} mm"),
        ("Diameter", f"{millimetres(rope.diameter_m)} mm" if rope.diameter_m else "not measured"),
        (
            "Linear density",
            f"{1e3 * rope.linear_density_kg_m:.3g} g/m" if rope.linear_density_kg_m else "not measured",
        ),
        ("Ends", f"start {capture.ends.start}, end {capture.ends.end}"),
        ("Frames", f"{len(capture.frame)} frames over {fixed(duration, 2)} s"),
    ]
    if capture.motion is not None:
        rows.append(("Poses of the gripper", f"{len(capture.motion.t_s)} poses"))
    if camera.width and camera.fx:
        rows.append(("Camera", f"{camera.width} × {camera.height} px, focal length {camera.fx:.0f} px"))
        rows.append(("Smallest step of depth", f"{1e3 / (camera.depth_scale or 1e3):.3g} mm"))
    return Table("The set-up.", (Column("What", align="left"), Column("Value", align="wide")), tuple(rows))


def _picture(capture: CaptureIndex, recording: Recording | None, figures: Path) -> Figure:
    assert capture.color is not None and capture.depth is not None
    index = len(capture.frame) // 2
    color = rgb(capture.color[index])
    depth = depth_m(capture.depth[index], capture.camera.depth_scale or 1e3)
    window = rope_window(capture, recording)
    figure = canvas(66)
    left, right = figure.subplots(1, 2)
    extent = (window[2] - 0.5, window[3] - 0.5, window[1] - 0.5, window[0] - 0.5)
    left.imshow(shown(color, window, COLUMNS), extent=extent, interpolation="none")
    every = -(-(window[3] - window[2]) // COLUMNS)
    seen = np.ma.masked_less_equal(depth[window[0] : window[1] : every, window[2] : window[3] : every], 0.0)
    right.set_facecolor("#2B2F33")
    limits = np.percentile(seen.compressed(), [1, 99]) if seen.count() else (0.0, 1.0)
    drawn = right.imshow(
        seen, extent=extent, cmap="viridis_r", vmin=limits[0], vmax=limits[1], interpolation="none"
    )
    bar = figure.colorbar(drawn, ax=right, shrink=0.86, pad=0.02)
    bar.set_label("depth [m]")
    bar.outline.set_visible(False)
    for axes, name in ((left, "Colour"), (right, "Depth")):
        axes.set(title=name, xlabel="column [px]", ylabel="row [px]")
        axes.grid(False)
    return Figure(
        save(figure, figures, "capture"),
        f"Frame {capture.frame[index]} (t = {capture.t_s[index]:.2f} s) in colour and in depth, cut to "
        "the rope. In the depth image see the dark pixels without a reading along the rope's edges, and "
        "the grain of the noise: a rope is only a few pixels wide.",
        "A colour image and a depth image of the rope",
    )


def _motion(capture: CaptureIndex, motion: Motion, figures: Path) -> Figure:
    figure = canvas(56)
    path, time = figure.subplots(1, 2, width_ratios=[1, 1.35])
    moved = motion.end_m if np.isfinite(motion.end_m).all() else motion.start_m
    view = widest(moved)
    across, up = view.split("-")
    path.plot(*moved[:, VIEWS[view]].T, color=PATH)
    held = motion.start_m[0]
    if np.isfinite(held).all() and moved is motion.end_m:
        draw_clamp(path, held, view)
        mark(path, held, view, "clamp", (6, 5))
    _ends(path, moved[:, VIEWS[view]])
    path.set(xlabel=f"{across} [mm]", ylabel=f"{up} [mm]", aspect="equal")
    path.margins(0.12)
    path.set_adjustable("datalim")
    thousandths(path)
    for axis, color in ((1, FAINT), (0, ROD), (2, PLASTIC)):
        time.plot(motion.t_s, moved[:, axis], color=color, label="xyz"[axis])
    legend_above(time, 3)
    time.plot(capture.t_s, np.full(len(capture.t_s), -0.04), "|", transform=time.get_xaxis_transform(),
              color="#555555", markersize=4, markeredgewidth=0.6, clip_on=False)  # fmt: skip
    time.set(xlabel="time [s]", ylabel="position [mm]")
    time.tick_params(axis="x", pad=6)
    thousandths(time, "y")
    closed = np.linalg.norm(moved[-1] - moved[0]) < CLOSED_M
    way = "out and back to the dot" if closed else "from the ring to the dot"
    return Figure(
        save(figure, figures, "motion"),
        f"How the gripper moved: left its path in the {view} plane, {way}; right its coordinates "
        "over time. The short strokes under the time axis are the moments at which a frame was taken.",
        "Path of the gripper and its coordinates over time",
    )


def _ends(axes: Axes, moved: Floats) -> None:
    axes.plot(*moved[0], "o", color=PATH, markerfacecolor="white", markersize=5)
    axes.plot(*moved[-1], "o", color=PATH, markersize=5)
