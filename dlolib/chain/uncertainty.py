"""How far each point of a chain may be off, and how these errors go together: what depth noise leaves.

How much of the readings' scatter smoothing leaves depends on whether readings beside each other are off
together, as a stereo camera's are; each line tells that itself (`smooth.noise_together`).

The figures stand for what a camera of this kind does to a rope: they were set on renderings of the virtual
laboratory (`make chain-bench` holds them against its truth). A smooth bias of the camera, the same in every
frame, is none of it: that is the measurement effect `camera_pose`, or a warped room.

In clear view they are wider than the truth asks for. Besides its noise a chain has an error across the rope,
of some hundredths of a millimetre, that stays as long as the rope lies as it does. Whoever fits a rod allows
for one as large as these covariances; narrower ones, right for single points, made 13 alarms of 20 recordings
with nothing missing (at 37dea96).
"""

from __future__ import annotations

import numpy as np

from dlolib.chain.axis import Axis
from dlolib.types import Floats, Noise, Rope

# Across the line of sight: of the outline's own standard error, and a floor as a share of the diameter.
ACROSS_FACTOR, ACROSS_SHARE = 0.95, 0.005
# At its tips, and where it goes out of sight, a line has sections on one side only, and what holds or hides
# it lies in them: more of the outline's standard error, a share of the diameter, over so many diameters.
TIP_FACTOR, TIP_SHARE, TIP_REACH = 2.0, 0.02, 1.0
# Along the line of sight: what the smoothing leaves of the readings' scatter, which is not quite white.
DEPTH_FACTOR, DEPTH_M = 1.0, 3e-5
# Along the rope: a floor beside the doubt of its arc length.
ALONG_M = 3e-5
# Smoothed over half waves of `smooth_m`, errors of neighbours go together over this share of it.
CORRELATED_SHARE, CORRELATED_FRAMES = 1.25, 1.0


def covariances(axis: Axis, s_m: Floats, points_m: Floats, rope: Rope, skin_m: float = 0.0) -> Floats:
    """Covariance [m²] (K, 3, 3) of chain points (K, 3) at arc lengths (K,), in camera axes.

    Three parts that do not depend on each other: along the rope, along the line of sight, and across both.

    Args:
        axis: the dense line that the points were sampled from, with its deviations.
        s_m, points_m: the points.
        rope: its length, and its diameter where known.
        skin_m: the radius that the rope seems to have where the diameter is not known: by so much the points
            lie before the axis. It is the same in every frame, and so more than noise.
    """
    assert axis.sigma_m is not None
    along = np.stack([np.interp(s_m, axis.s_m, np.gradient(axis.points_m[:, k])) for k in range(3)], axis=-1)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    sight = points_m / np.linalg.norm(points_m, axis=1, keepdims=True)
    sight = sight - np.einsum("ij,ij->i", sight, along)[:, None] * along
    sight /= np.maximum(np.linalg.norm(sight, axis=1, keepdims=True), 1e-12)
    across = np.cross(along, sight)
    known = np.isfinite(axis.sigma_m[:, 0])
    depth, outline = (np.interp(s_m, axis.s_m[known], axis.sigma_m[known, k]) for k in range(2))
    diameter = rope.diameter_m or 2 * skin_m
    near = np.exp(-_to_tip(axis, s_m) / (TIP_REACH * diameter))
    tip = near * np.hypot(TIP_FACTOR * outline, TIP_SHARE * diameter)
    off = np.interp(s_m, axis.s_m, axis.doubt_m)
    variances = (
        # A line that runs beside the axis is longer or shorter than it by as much, for each radian it turns:
        # one on the skin, where the rope turns towards the camera or away.
        (along, ALONG_M**2 + off**2 + (ACROSS_FACTOR * outline) ** 2 + (skin_m * along[:, 2]) ** 2),
        (sight, DEPTH_M**2 + (DEPTH_FACTOR * depth) ** 2 + (0.5 * tip) ** 2 + skin_m**2),
        (across, (ACROSS_SHARE * diameter) ** 2 + (ACROSS_FACTOR * outline) ** 2 + tip**2),
    )
    return np.asarray(sum(np.einsum("k,ki,kj->kij", size, way, way) for way, size in variances))


def noise_of(covariance_m2: Floats, smooth_m: float, spacing_m: float) -> Noise:
    """The noise of a recording: the mean deviation of a coordinate, and how far errors go together.

    Args:
        covariance_m2: of all points, (P, 3, 3).
        smooth_m: half of the shortest wave that is left along the rope [m].
        spacing_m: of the points [m].
    """
    sigma = float(np.sqrt(np.trace(covariance_m2, axis1=1, axis2=2).mean() / 3))
    return Noise(sigma, CORRELATED_SHARE * smooth_m / spacing_m, CORRELATED_FRAMES)


def _to_tip(axis: Axis, s_m: Floats) -> Floats:
    """Way [m] (K,) from arc lengths to the nearest end of what was seen."""
    seen = np.concatenate([[False], axis.seen, [False]])
    edges = np.flatnonzero(np.diff(seen.astype(np.int8)))
    places = axis.s_m[np.clip(edges - (edges >= len(axis.s_m)), 0, len(axis.s_m) - 1)]
    return np.asarray(np.abs(s_m[:, None] - places).min(axis=1))
