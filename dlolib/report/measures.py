"""What the report computes itself: the distance of chains to the true axis, residuals, the headline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from dlolib.types import Floats


def nearest_on_axis(points_m: Floats, axis_m: Floats, axis_s_m: Floats) -> tuple[Floats, Floats]:
    """Feet of the perpendiculars from points (P, 3) to the polyline (M, 3) [m].

    Returns:
        Offsets point minus foot (P, 3) [m], and the arc lengths of the feet (P,) [m].
    """
    start, along = axis_m[:-1], np.diff(axis_m, axis=0)
    length2 = np.maximum(np.sum(along**2, axis=1), 1e-18)
    to_point = points_m[:, None] - start
    part = np.clip(np.sum(to_point * along, axis=2) / length2, 0.0, 1.0)
    offset = to_point - part[..., None] * along
    best = np.argmin(np.sum(offset**2, axis=2), axis=1)
    rows = np.arange(len(points_m))
    arc = axis_s_m[:-1][best] + part[rows, best] * np.diff(axis_s_m)[best]
    return offset[rows, best], arc


@dataclass(frozen=True)
class ChainError:
    """A chain against the true axis, one row a point: frame, arc length, offset from the axis.

    frame (P,), s_m (P,) as the chain has it, true_s_m (P,) of the nearest point of the axis,
    offset_m (P, 3) from the axis to the point, point_m (P, 3) itself.
    """

    frame: Floats
    s_m: Floats
    true_s_m: Floats
    offset_m: Floats
    point_m: Floats

    @property
    def distance_m(self) -> Floats:
        """Distance of each point to the axis [m], (P,)."""
        return np.asarray(np.linalg.norm(self.offset_m, axis=1))

    @property
    def rms_m(self) -> float:
        """Root mean square of the distances [m]."""
        return float(np.sqrt(np.mean(self.distance_m**2)))


def chain_error(points: pd.DataFrame, t_s: Floats, xyz_m: Floats, s_m: Floats) -> ChainError | None:
    """Compare chains with the true axes.

    Args:
        points: rows of points.csv: frame, t_s, s_m, x_m, y_m, z_m.
        t_s: times of the true axes (F,). xyz_m: the axes (F, M, 3) [m]. s_m: their arc lengths (M,).

    Returns:
        The errors, or None where no frame has a true axis at its time (half a millisecond).
    """
    parts = []
    for frame, rows in points.groupby("frame"):
        nearest = int(np.argmin(np.abs(t_s - rows["t_s"].iloc[0])))
        if abs(t_s[nearest] - rows["t_s"].iloc[0]) > 5e-4:
            continue
        points_m = rows[["x_m", "y_m", "z_m"]].to_numpy()
        offset, arc = nearest_on_axis(points_m, xyz_m[nearest], s_m)
        parts.append((np.full(len(rows), frame), rows["s_m"].to_numpy(), arc, offset, points_m))
    if not parts:
        return None
    return ChainError(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def normal_residual(shape: pd.DataFrame, view: str) -> tuple[Floats, Floats]:
    """Residual of one frame of shapes.csv in the plane of a view, such as x-z, across the simulated rope.

    Returns:
        Arc length (P,) [m] and the signed distance (P,) [m], positive to the left of the way from start
        to end as seen in that view.
    """
    axes = view.split("-")
    simulated = shape[[f"sim_{axis}_m" for axis in axes]].to_numpy()
    tangent = np.gradient(simulated, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    offset = shape[[f"{axis}_m" for axis in axes]].to_numpy() - simulated
    return shape["s_m"].to_numpy(), np.sum(offset * normal, axis=1)


def by_arc_length(s_m: Floats, values: Floats, bins: int = 24) -> tuple[Floats, Floats, Floats]:
    """Mean and root mean square of values over bins of arc length: centres, means, RMS, each (B,)."""
    edges = np.linspace(0.0, float(np.max(s_m)) * (1 + 1e-9), bins + 1)
    which = np.clip(np.digitize(s_m, edges) - 1, 0, bins - 1)
    centres, means, rms = [], [], []
    for index in range(bins):
        inside = values[which == index]
        if len(inside):
            centres.append(0.5 * (edges[index] + edges[index + 1]))
            means.append(float(np.mean(inside)))
            rms.append(float(np.sqrt(np.mean(inside**2))))
    return np.array(centres), np.array(means), np.array(rms)
