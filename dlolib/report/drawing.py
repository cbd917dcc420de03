"""Ropes and obstacles as they look along an axis of the world, at their true thickness."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from dlolib.report.style import OBSTACLE, OBSTACLE_EDGE
from dlolib.types import Floats, Obstacle

Values = Mapping[str, Floats]

VIEWS = {"x-z": (0, 2), "x-y": (0, 1), "y-z": (1, 2), "y-x": (1, 0)}
"""Which coordinates go to the right and up; the first two views are those of the paper's Fig. 10."""
CIRCLE = np.linspace(0.0, 2 * np.pi, 73)


def widest(places_m: Floats) -> str:
    """The view in which places (..., 3) [m] extend most: a rope on a table lies in x-y, one that hangs in x-z
    or y-z. Rows without a place, NaN, do not count."""
    flat = places_m.reshape(-1, 3)
    extent = np.nanmax(flat, axis=0) - np.nanmin(flat, axis=0)
    return max(VIEWS, key=lambda view: float(extent[list(VIEWS[view])].sum()))


def ribbon(line: Floats, radius_m: float) -> Floats:
    """Outline (2 N, 2) of a rope with a centre line (N, 2) and a radius [m]."""
    tangent = np.gradient(line, axis=0)
    length = np.linalg.norm(tangent, axis=1, keepdims=True)
    tangent = tangent / np.where(length > 0, length, 1.0)
    normal = radius_m * np.column_stack([-tangent[:, 1], tangent[:, 0]])
    return np.vstack([line + normal, (line - normal)[::-1]])


def smooth(line: Floats, count: int = 200) -> Floats:
    """The points (N, D) of a chain joined by a cubic spline, (count, D)."""
    from scipy.interpolate import CubicSpline

    if len(line) < 3:
        return line
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    if np.any(np.diff(at) <= 0):
        return line
    return np.asarray(CubicSpline(at, line)(np.linspace(0.0, at[-1], count)))


def draw_rope(
    axes: Axes,
    nodes_m: Floats,
    view: str,
    color: str,
    radius_m: float,
    *,
    fill: float = 0.25,
    label: str = "",
) -> None:
    """Draw nodes (N, 3) as a rope of its true thickness: a pale body and its axis."""
    line = smooth(nodes_m)[:, VIEWS[view]]
    if radius_m > 0:
        body = Polygon(ribbon(line, radius_m), facecolor=color, edgecolor="none", alpha=fill, zorder=3)
        axes.add_patch(body)
    axes.plot(*line.T, color=color, linewidth=1.1, zorder=4, label=label or None)


def silhouette(obstacle: Obstacle, view: str) -> Floats | None:
    """Outline (K, 2) [m] of an obstacle seen along the view's axis; None for a plane, which has none."""
    if obstacle.shape not in OUTLINES:
        return None
    values = {name: np.asarray(value, dtype=float) for name, value in obstacle.values.items()}
    flat = OUTLINES[obstacle.shape](values, list(VIEWS[view]))
    return np.asarray(flat[ConvexHull(flat).vertices])


def _sphere(values: Values, across: list[int]) -> Floats:
    circle = values["radius_m"] * np.column_stack([np.cos(CIRCLE), np.sin(CIRCLE)])
    return np.asarray(values["center_m"][across] + circle)


def _capsule(values: Values, across: list[int]) -> Floats:
    half = 0.5 * values["height_m"] * values["axis"] / np.linalg.norm(values["axis"])
    ends = [_sphere({**values, "center_m": values["center_m"] + side * half}, across) for side in (-1, 1)]
    return np.vstack(ends)


def _box(values: Values, across: list[int]) -> Floats:
    corners = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T * values["size_m"]
    turn = Rotation.from_quat(values["quaternion"], scalar_first=True)
    return np.asarray(values["center_m"] + turn.apply(corners))[:, across]


def _cylinder(values: Values, across: list[int]) -> Floats:
    axis = values["axis"] / np.linalg.norm(values["axis"])
    sides = np.linalg.svd(axis[None])[2][1:]
    rim = values["radius_m"] * (np.outer(np.cos(CIRCLE), sides[0]) + np.outer(np.sin(CIRCLE), sides[1]))
    half = 0.5 * values["height_m"] * axis
    return np.vstack([values["center_m"] + rim - half, values["center_m"] + rim + half])[:, across]


OUTLINES: dict[str, Callable[[Values, list[int]], Floats]] = {
    "cylinder": _cylinder,
    "sphere": _sphere,
    "box": _box,
    "capsule": _capsule,
}
"""Points of each shape, projected onto a view's coordinates, whose convex hull is its outline."""


def draw_obstacles(axes: Axes, obstacles: Sequence[Obstacle], view: str) -> None:
    """Draw the outlines of the obstacles, and planes that are seen edge on as lines."""
    across = VIEWS[view]
    for obstacle in obstacles:
        outline = silhouette(obstacle, view)
        if outline is not None:
            axes.add_patch(
                Polygon(outline, facecolor=OBSTACLE, edgecolor=OBSTACLE_EDGE, linewidth=0.7, zorder=2)
            )
        elif obstacle.shape == "plane":
            normal = np.asarray(obstacle.values["normal"])[list(across)]
            if np.linalg.norm(normal) > 0.9:
                point = np.asarray(obstacle.values["point_m"])[list(across)]
                beyond = point + np.array([-normal[1], normal[0]])
                axes.axline(tuple(point), tuple(beyond), color=OBSTACLE_EDGE, linewidth=0.9, zorder=1)


def draw_clamp(axes: Axes, position_m: Floats, view: str, size_m: float = 0.012) -> None:
    """Mark a held end by a small square."""
    x, y = position_m[list(VIEWS[view])]
    half = size_m / 2
    square = np.array(
        [[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]]
    )
    axes.add_patch(Polygon(square, facecolor="#333333", edgecolor="white", linewidth=0.5, zorder=6))


def mark(
    axes: Axes, position_m: Floats, view: str, text: str, offset_pt: tuple[float, float] = (5, 4)
) -> None:
    """Write a letter beside a point (3,) [m], as the paper writes A and B."""
    x, y = position_m[list(VIEWS[view])]
    axes.annotate(
        text,
        (float(x), float(y)),
        offset_pt,
        textcoords="offset points",
        fontsize=7.5,
        fontweight="bold",
        zorder=8,
        path_effects=[withStroke(linewidth=2.0, foreground="white")],
    )
