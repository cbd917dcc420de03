"""Pictures of a calibration: what was found where in the images, and how well all of it agrees."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from dlolib.calibrate.folder import Shots
from dlolib.calibrate.hand_eye import HandEye
from dlolib.calibrate.plane_pose import projected
from dlolib.calibrate.standing import FoundObstacle
from dlolib.files import whole_file
from dlolib.formats import signed_distance
from dlolib.types import Floats, Obstacle

RED, BLUE, AMBER, GREEN = "#c1272d", "#1f6fb2", "#e69f00", "#2a9d3a"
SHOWN = 6
# Margins about a board, and about the markers, beside which their obstacles stand.
NARROW, WIDE = 0.35, 0.8
# A silhouette is found on a coarse grid of rays, by steps as long as the distance allows.
COARSE_PX, STEPS, FURTHEST_M, HIT_M = 2, 64, 10.0, 5e-4


def draw_hand_eye(found: HandEye, path: Path) -> None:
    """Write a PNG: corners as seen and as fitted, in frames spread over all, and each frame's residual.

    The picture carries no date: the same frames give the same bytes.
    """
    rows = sorted({int(row) for row in np.linspace(0, len(found.frame) - 1, SHOWN).round()})
    figure = Figure(figsize=(13, 11), layout="constrained")
    grid = figure.add_gridspec(4, 3, height_ratios=(2, 2, 1, 1))
    numbers = found.shots.frame.tolist()
    for place, row in enumerate(rows):
        axes = figure.add_subplot(grid[place // 3, place % 3])
        axes.imshow(found.shots.picture(numbers.index(int(found.frame[row]))))
        axes.plot(*found.sightings[row].pixel.T, "o", color=BLUE, markersize=6, markerfacecolor="none")
        axes.plot(*found.fitted_px[row].T, "+", color=RED, markersize=6)
        _around(axes, found.sightings[row].pixel, NARROW)
        text = f"frame {found.frame[row]}: {1e3 * found.residual_m[row]:.2f} mm, "
        axes.set_title(f"{text}{np.degrees(found.residual_rad[row]):.2f}°", fontsize=9)
        axes.set_axis_off()
    for line, (values, unit) in enumerate(
        ((1e3 * found.residual_m, "mm"), (np.degrees(found.residual_rad), "degrees"))
    ):
        axes = figure.add_subplot(grid[2 + line, :])
        axes.bar([str(frame) for frame in found.frame], values, color=BLUE)
        rms = float(np.sqrt(np.mean(values**2)))
        axes.axhline(rms, color=RED, linewidth=0.8, label=f"RMS {rms:.2f} {unit}")
        axes.set_ylabel(f"[{unit}]", fontsize=8)
        axes.legend(fontsize=8)
        axes.tick_params(labelsize=7)
    axes.set_xlabel("frame", fontsize=8)
    figure.suptitle(
        "the board as the camera sees it (o) and as the robot holds it (+); below, how far these are apart.\n"
        f"The camera's place is sure to {1e3 * found.sd_m:.2f} mm where the board was, its turn to "
        f"{np.degrees(found.sd_rad):.3f}° (one standard deviation)",
        fontsize=10,
    )
    _save(figure, path)


def draw_obstacles(
    found: Sequence[FoundObstacle], shots: Shots, world_from_camera: Floats, path: Path
) -> None:
    """Write a PNG: the first frame with the markers' axes and the obstacles' outlines, and the residuals."""
    figure = Figure(figsize=(10, 9.2), layout="constrained")
    axes = figure.add_subplot()
    image = shots.picture(0)
    axes.imshow(image)
    camera_from_world = np.linalg.inv(world_from_camera)
    lines = []
    for one in found:
        axes.plot(*np.vstack([one.pixel, one.pixel[:1]]).T, "-", color=BLUE, linewidth=1.2)
        _draw_axes(axes, camera_from_world @ one.world_from_marker, one, shots.matrix)
        seen = _seen(one.obstacle, world_from_camera, shots.matrix, image.shape)
        if seen.any() and not seen.all():
            across = np.arange(seen.shape[1]) * COARSE_PX, np.arange(seen.shape[0]) * COARSE_PX
            axes.contour(*across, seen.astype(float), levels=[0.5], colors=[AMBER], linewidths=1.5)
        lines.append(_said(one))
    _around(axes, np.vstack([one.pixel for one in found]), WIDE)
    axes.set_axis_off()
    axes.set_title(
        "markers (blue; x red, y green, z blue) and what stands there (amber)\n" + "\n".join(lines),
        fontsize=9,
    )
    _save(figure, path)


def _said(one: FoundObstacle) -> str:
    parts = [f"corners {one.corner_px:.2f} px"]
    if one.scatter_m is not None and one.scatter_rad is not None:
        parts.append(
            f"over {one.frames} frames {1e3 * one.scatter_m:.2f} mm, {np.degrees(one.scatter_rad):.2f}°"
        )
    if one.depth_m is not None:
        parts.append(f"depth about its plane {1e3 * one.depth_m:.2f} mm")
    return f"marker {one.marker}, {one.obstacle.shape}: {'; '.join(parts)}"


def _draw_axes(axes: Axes, camera_from_marker: Floats, one: FoundObstacle, matrix: Floats) -> None:
    reach = 0.25 * float(np.ptp(one.pixel, axis=0).max()) / matrix[0, 0] * camera_from_marker[2, 3]
    tips = projected(camera_from_marker, reach * np.vstack([np.zeros(3), 2 * np.eye(3)]), matrix)
    for tip, color in zip(tips[1:], (RED, GREEN, BLUE), strict=True):
        axes.plot(*np.vstack([tips[0], tip]).T, "-", color=color, linewidth=2)
    axes.annotate(str(one.marker), tips[0], color="white", fontsize=9, weight="bold")


def _seen(obstacle: Obstacle, view: Floats, matrix: Floats, shape: tuple[int, ...]) -> Floats:
    """Where (H / coarse, W / coarse) an obstacle is seen, whatever its shape: rays march by its distance."""
    columns, rows = np.meshgrid(np.arange(0, shape[1], COARSE_PX), np.arange(0, shape[0], COARSE_PX))
    rays = np.stack(
        [(columns - matrix[0, 2]) / matrix[0, 0], (rows - matrix[1, 2]) / matrix[1, 1], np.ones(rows.shape)],
        axis=-1,
    )
    ways = rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ view[:3, :3].T
    gone = np.zeros(rows.shape)
    for _ in range(STEPS):
        near = signed_distance(obstacle, view[:3, 3] + gone[..., None] * ways)
        gone = np.minimum(gone + np.maximum(near, 0), FURTHEST_M)
    return np.asarray((near < HIT_M) & (gone < FURTHEST_M))


def _around(axes: Axes, pixel: Floats, share: float) -> None:
    """Show what has these corners (K, 2) and a margin, a share of its size."""
    low, high = pixel.min(axis=0), pixel.max(axis=0)
    margin = share * float((high - low).max())
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(high[1] + margin, low[1] - margin)


def _save(figure: Figure, path: Path) -> None:
    FigureCanvasAgg(figure)
    with whole_file(Path(path)) as temporary:
        figure.savefig(temporary, dpi=80, format="png", metadata={"Software": None})
