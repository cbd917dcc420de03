"""How far each point of a chain may be off, and how these errors go together: what depth noise leaves.

The figures stand for what a camera of this kind does to a rope: they were set on renderings of the virtual
laboratory (`make chain-bench` holds them against its truth). A smooth bias of the camera, the same in every
frame, is none of it: that is the measurement effect `camera_pose`, or a warped room.
"""

from __future__ import annotations

import numpy as np

from dlolib.chain.axis import Axis
from dlolib.types import Floats, Noise, Rope

# Across the line of sight: of the outline's own standard error. What lasts counts as it is.
ACROSS_NOISE = 1.3
# At its tips, and where it goes out of sight, a line has sections on one side only, and what holds or hides
# it lies in them: more of what lasts, a share of the diameter, over so many diameters.
TIP_FACTOR, TIP_SHARE, TIP_REACH = 4.0, 0.01, 1.0
# Along the rope, beside the doubt of its arc length: of what noise does to the depth; and of what lasts
# across, for each radian that the rope turns.
ALONG_NOISE, ALONG_LASTING = 0.25, 1.3
# Smoothed over half waves of `smooth_m`, errors of neighbours go together over this share of it; of what
# lasts this share is the same in the frame after.
CORRELATED_SHARE, LASTS = 0.9, 0.6


def covariances(
    axis: Axis, s_m: Floats, points_m: Floats, rope: Rope, skin_m: float = 0.0
) -> tuple[Floats, Floats]:
    """Covariance [m²] (K, 3, 3) of chain points (K, 3) at arc lengths (K,), in camera axes; and which share
    of it, made independent of direction, lasts from frame to frame, (K,).

    Three parts that do not depend on each other: along the rope, along the line of sight, and across both.

    Args:
        axis: the dense line that the points were sampled from, with its deviations.
        s_m, points_m: the points.
        rope: its length, and its diameter where known.
        skin_m: the radius that the rope seems to have where the diameter is not known: by so much the points
            lie before the axis. It is the same in every frame.
    """
    assert axis.sigma_m is not None
    along = np.stack([np.interp(s_m, axis.s_m, np.gradient(axis.points_m[:, k])) for k in range(3)], axis=-1)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    sight = points_m / np.linalg.norm(points_m, axis=1, keepdims=True)
    sight = sight - np.einsum("ij,ij->i", sight, along)[:, None] * along
    sight /= np.maximum(np.linalg.norm(sight, axis=1, keepdims=True), 1e-12)
    ways = np.stack([along, sight, np.cross(along, sight)], axis=1)
    known = np.isfinite(axis.sigma_m[:, 0])
    depth, far, outline, aside = (np.interp(s_m, axis.s_m[known], axis.sigma_m[known, k]) for k in range(4))
    diameter = rope.diameter_m or 2 * skin_m
    near = np.exp(-_to_tip(axis, s_m) / (TIP_REACH * diameter))
    tip = near * np.hypot(TIP_FACTOR * aside, TIP_SHARE * diameter)
    off = np.interp(s_m, axis.s_m, axis.doubt_m)
    # A line that runs beside the axis is longer or shorter than it by as much for each radian it turns: one
    # on the skin, where the rope turns towards the camera or away.
    turning = np.hypot(1.0, _turning(axis, s_m, points_m, along))
    beside = np.hypot(ALONG_LASTING * turning * aside, skin_m * along[:, 2])
    noise = np.stack([ALONG_NOISE * depth, depth, ACROSS_NOISE * outline], axis=1) ** 2
    behind = far**2 + (0.5 * tip) ** 2 + skin_m**2
    lasting = np.stack([off**2 + beside**2, behind, aside**2 + tip**2], axis=1)
    size = noise + lasting
    return np.einsum("kw,kwi,kwj->kij", size, ways, ways), np.asarray(np.mean(lasting / size, axis=1))


def noise_of(covariance_m2: Floats, lasting: Floats, smooth_m: float, spacing_m: float) -> Noise:
    """The noise of a recording: the mean deviation of a coordinate, and how far errors go together.

    Args:
        covariance_m2, lasting: of all points, (P, 3, 3) and (P,), as `covariances` gives them.
        smooth_m: half of the shortest wave that is left along the rope [m].
        spacing_m: of the points [m].
    """
    sigma = float(np.sqrt(np.trace(covariance_m2, axis1=1, axis2=2).mean() / 3))
    alike = LASTS * float(lasting.mean())
    return Noise(sigma, CORRELATED_SHARE * smooth_m / spacing_m, -1 / float(np.log(alike)))


def _turning(axis: Axis, s_m: Floats, points_m: Floats, along: Floats) -> Floats:
    """By how much [rad] (K,) the rope's image has turned at points on the way from where its arc length is
    surest; of a rope whose length is known, less what all of it turns evenly."""
    image = along[:, :2] * points_m[:, 2:] - points_m[:, :2] * along[:, 2:]
    heading = np.unwrap(np.arctan2(image[:, 1], image[:, 0]))
    if axis.fitted:
        return np.asarray(heading - np.interp(s_m, s_m[[0, -1]], heading[[0, -1]]))
    surest = np.argmin(np.interp(s_m, axis.s_m, axis.doubt_m))
    return np.asarray(heading - heading[surest])


def _to_tip(axis: Axis, s_m: Floats) -> Floats:
    """Way [m] (K,) from arc lengths to the nearest end of what was seen."""
    seen = np.concatenate([[False], axis.seen, [False]])
    edges = np.flatnonzero(np.diff(seen.astype(np.int8)))
    places = axis.s_m[np.clip(edges - (edges >= len(axis.s_m)), 0, len(axis.s_m) - 1)]
    return np.asarray(np.abs(s_m[:, None] - places).min(axis=1))
