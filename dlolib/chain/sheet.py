"""A sheet for a capture: what the camera saw with the chain on it, the chain in space, what was seen when."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dlolib.captures.base import Frame, Image, Mask, Source
from dlolib.chain.extract import ChainResult
from dlolib.chain.frame import FrameChain
from dlolib.chain.segment import segment
from dlolib.files import whole_file
from dlolib.types import CaptureIndex, Floats

MARGIN_PX = 30
ENLARGED = 2
RED, AMBER = "#c1272d", "#e69f00"
DOT_RGB, LINE_RGB, START_RGB = (230, 60, 60), (60, 140, 230), (60, 200, 90)
OUTLINE_RGB = (240, 170, 40)
# Depths shown on either side of the rope's.
DEPTHS_M = 0.05


def write_sheet(result: ChainResult, source: Source, path: Path, frames: int = 3) -> None:
    """Write a PNG with `frames` frames, evenly spread over the capture, and the arc lengths of all.

    Each row: the image (or the cloud) with the outline of what was taken for the rope and the chain on it,
    the depth there, the chain from the front (x, z) and from above (x, y) in world axes, and the distance
    between neighbouring points. The picture carries no date: the same capture gives the same bytes.
    """
    rows = sorted({int(row) for row in np.linspace(0, len(result.frames) - 1, frames).round()})
    figure = Figure(figsize=(19, 2.9 * len(rows) + 2.6), layout="constrained")
    grid = figure.add_gridspec(len(rows) + 1, 5, width_ratios=(1.6, 1.6, 1.3, 1.3, 1))
    shots = _shots(source, [result.frames[row].frame for row in rows])
    for line, (row, frame) in enumerate(zip(rows, shots, strict=True)):
        chain = result.frames[row]
        views = [figure.add_subplot(grid[line, column]) for column in range(5)]
        if frame.cloud_m is not None:
            _draw_cloud(views[0], chain, frame.cloud_m, source.index, (0, 2))
            _draw_cloud(views[1], chain, frame.cloud_m, source.index, (0, 1))
        else:
            _draw_image(views[0], chain, frame, segment(frame, source.index, result.settings).mask)
            _draw_depth(views[1], chain, frame)
        views[0].set_title(*_title(chain, source.index))
        _draw_view(views[2], chain, (0, 2), "from the front")
        _draw_view(views[3], chain, (0, 1), "from above")
        _draw_spacing(views[4], chain)
    _draw_arc_lengths(figure.add_subplot(grid[-1, :]), result.frames)
    FigureCanvasAgg(figure)
    with whole_file(Path(path)) as temporary:
        figure.savefig(temporary, dpi=90, format="png", metadata={"Software": None})


def chain_on_image(color: Image, chain: FrameChain) -> Image:
    """The part of an image (H, W, 3) around the rope, twice enlarged, with the chain drawn on it."""
    low, high = _window(chain.pixel, color)
    crop = color[low[1] : high[1], low[0] : high[0]]
    picture = cv2.resize(crop, None, fx=ENLARGED, fy=ENLARGED, interpolation=cv2.INTER_NEAREST)
    place = np.round((chain.pixel - low + 0.5) * ENLARGED).astype(int)
    for number, point in enumerate(place):
        neighbour = number and chain.s_m[number] - chain.s_m[number - 1] < 1.5 * _spacing(chain)
        if neighbour:
            cv2.line(
                picture, tuple(place[number - 1].tolist()), tuple(point.tolist()), LINE_RGB, 1, cv2.LINE_AA
            )
    for number, point in enumerate(place):
        colour = START_RGB if number == 0 else DOT_RGB
        cv2.circle(picture, tuple(point.tolist()), 4, colour, -1, cv2.LINE_AA)
    return np.asarray(picture, dtype=np.uint8)


def _title(chain: FrameChain, index: CaptureIndex) -> tuple[str, dict[str, object]]:
    warning = "" if chain.fitted else f", not the known {index.rope.length_m:.3f} m: check it"
    title = f"frame {chain.frame}, {chain.t_s:.10g} s: {chain.measured_m:.3f} m measured{warning}"
    return title, {"fontsize": 9, "color": "black" if chain.fitted else RED}


def _shots(source: Source, numbers: Sequence[int]) -> list[Frame]:
    shots = []
    for frame in source.frames():
        if frame.frame in numbers:
            shots.append(frame)
        if frame.frame == numbers[-1]:
            break
    return shots


def _window(pixel: Floats, image: NDArray[Any]) -> tuple[Floats, Floats]:
    limit = np.array([image.shape[1], image.shape[0]])
    low = np.clip(np.floor(pixel.min(axis=0)).astype(int) - MARGIN_PX, 0, limit)
    return low, np.clip(np.ceil(pixel.max(axis=0)).astype(int) + MARGIN_PX, 0, limit)


def _spacing(chain: FrameChain) -> float:
    return float(np.median(np.diff(chain.s_m))) if len(chain.s_m) > 1 else 1.0


def _draw_image(axes: Axes, chain: FrameChain, frame: Frame, mask: Mask) -> None:
    """The image, or what was taken for the rope where there is none, with the chain on it."""
    color = frame.color if frame.color is not None else np.repeat(255 * mask[..., None], 3, axis=2)
    color = np.array(color, dtype=np.uint8)
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(color, outlines, -1, OUTLINE_RGB, 1)
    axes.imshow(chain_on_image(color, chain), interpolation="antialiased")
    axes.set_axis_off()


def _draw_depth(axes: Axes, chain: FrameChain, frame: Frame) -> None:
    """What the depth image has around the rope; white: no reading."""
    assert frame.depth_m is not None
    low, high = _window(chain.pixel, frame.depth_m)
    crop = frame.depth_m[low[1] : high[1], low[0] : high[0]]
    # A line may end up to a pixel outside of the image that the rope leaves.
    column, row = np.clip(np.round(chain.pixel).astype(int), 0, np.array(frame.depth_m.shape[::-1]) - 1).T
    at = frame.depth_m[row, column]
    middle = float(np.median(at[at > 0])) if (at > 0).any() else float(crop.max())
    shown = np.where(crop > 0, crop, np.nan)
    image = axes.imshow(
        shown, cmap="viridis", vmin=middle - DEPTHS_M, vmax=middle + DEPTHS_M, interpolation="nearest"
    )
    axes.plot(*(chain.pixel - low).T, "-", color="white", linewidth=0.6)
    axes.set_title("depth [m]", fontsize=9)
    axes.set_axis_off()
    bar = axes.figure.colorbar(image, ax=axes, shrink=0.8)
    bar.ax.tick_params(labelsize=7)


def _draw_cloud(
    axes: Axes, chain: FrameChain, cloud_m: Floats, index: CaptureIndex, pair: tuple[int, int]
) -> None:
    view = index.camera.world_from_camera
    cloud = cloud_m @ view[:3, :3].T + view[:3, 3]
    axes.plot(*cloud[:, pair].T, ",", color="0.75", rasterized=True)
    axes.plot(*chain.xyz_m[:, pair].T, ".-", color=RED, markersize=4, linewidth=0.8)
    axes.set_aspect("equal", adjustable="datalim")
    _labels(axes, "x [m]", f"{'xyz'[pair[1]]} [m]")


def _draw_view(axes: Axes, chain: FrameChain, pair: tuple[int, int], title: str) -> None:
    """The line (amber where hidden), the points, the start as a ring."""
    line = chain.line_m[:, pair]
    pieces = np.stack([line[:-1], line[1:]], axis=1)
    seen = chain.line_seen[:-1] & chain.line_seen[1:]
    axes.add_collection(
        LineCollection(list(pieces), colors=np.where(seen, "0.6", AMBER).tolist(), linewidths=1)
    )
    points = chain.xyz_m[:, pair]
    axes.plot(*points.T, "o", color=RED, markersize=3)
    axes.plot(*line[0], "o", markersize=8, markerfacecolor="none", color="black")
    axes.set_title(title, fontsize=9)
    axes.set_aspect("equal", adjustable="datalim")
    _labels(axes, "x [m]", f"{'xyz'[pair[1]]} [m]")


def _draw_spacing(axes: Axes, chain: FrameChain) -> None:
    chord = np.linalg.norm(np.diff(chain.xyz_m, axis=0), axis=1)
    step = np.diff(chain.s_m)
    axes.plot(1000 * chain.s_m[1:], 100 * (chord / step - 1), ".-", color=RED, linewidth=0.8)
    axes.axhline(0, color="0.7", linewidth=0.8)
    axes.set_title("chord over arc length, less one", fontsize=9)
    _labels(axes, "arc length [mm]", "[%]")


def _draw_arc_lengths(axes: Axes, chains: Sequence[FrameChain]) -> None:
    frames = np.concatenate([np.full(len(chain.s_m), chain.frame) for chain in chains])
    s = np.concatenate([chain.s_m for chain in chains])
    axes.plot(frames, 1000 * s, "s", color="0.3", markersize=2)
    doubtful = [chain.frame for chain in chains if not chain.fitted]
    if doubtful:
        label = "length differs from the known one: arc lengths as measured"
        axes.plot(doubtful, np.zeros(len(doubtful)), "^", color=AMBER, label=label)
        axes.legend(fontsize=8, loc="upper right")
    axes.set_title("arc lengths of the points in each frame: what was not seen is left blank", fontsize=9)
    axes.margins(x=0.01)
    _labels(axes, "frame", "arc length [mm]")


def _labels(axes: Axes, x: str, y: str) -> None:
    axes.set_xlabel(x, fontsize=8)
    axes.set_ylabel(y, fontsize=8)
    axes.tick_params(labelsize=7)
    axes.grid(color="0.9", linewidth=0.5)
