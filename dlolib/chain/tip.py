"""A free tip: the rope's outline goes on beyond the end of its axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dlolib.chain.anchor import Anchor
from dlolib.chain.lift import Strand
from dlolib.chain.view import View

# How a tip points so much of the rope tells; one that points at the camera does no better than this.
TIP_M, LEAST_SINE = 0.02, 0.5
# A line ends so far before its outline, on average; a tip so close to the image's edge goes on beyond it.
SHORT_PX, EDGE_PX = 0.5, 2.0


def without_caps(
    strands: list[Strand], start: Anchor | None, end: Anchor | None, view: View, radius_m: float
) -> list[Strand]:
    """Leave out what the outline of a free tip shows beyond the end of the axis.

    Args:
        strands: the visible stretches in order, each from start to end, at least one.
        start, end: the held ends; None where free.
        view: what the camera saw.
        radius_m: the rope's [m]; 0 where nobody knows it, and nothing is left out.
    """
    if start is None:
        strands = [_without_cap(strands[0], view, radius_m), *strands[1:]]
    if end is None:
        strands = [*strands[:-1], _without_cap(strands[-1].turned(), view, radius_m).turned()]
    return strands


def _without_cap(first: Strand, view: View, radius_m: float) -> Strand:
    """A strand that begins at the end of the axis.

    The rim of the rope's end is a circle about it. Wherever the rope does not run across the line of sight it
    is seen as an ellipse, half of which lies beyond: along the axis that is the radius over the tangent of
    the angle between rope and ray.
    """
    tip, points = first.points_m[0], first.points_m
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    chord = points[min(int(np.searchsorted(way, TIP_M)), len(way) - 1)] - tip
    size = float(np.linalg.norm(chord) * np.linalg.norm(tip))
    cosine = min(abs(float(chord @ tip)) / max(size, 1e-12), 1.0)
    beyond_m = radius_m * cosine / max(float(np.sqrt(1 - cosine**2)), LEAST_SINE)
    beyond_m -= SHORT_PX * float(way[-1]) / (len(way) - 1)
    far = np.array(view.mask.shape[::-1]) - 1 - EDGE_PX
    if beyond_m <= 0 or (first.pixel[0] < EDGE_PX).any() or (first.pixel[0] > far).any():
        return first
    cut = min(int(np.searchsorted(way, beyond_m, side="right")) - 1, len(way) - 2)
    share = min((beyond_m - float(way[cut])) / max(float(way[cut + 1] - way[cut]), 1e-12), 1.0)
    kept = first.part(slice(cut, None))
    begun = [
        np.concatenate([line[:1] + share * (line[1] - line[0]), line[1:]])
        for line in (kept.points_m, kept.pixel)
    ]
    return replace(kept, points_m=begun[0], pixel=begun[1])
