"""Strands that go on across a fork of the mask, joined: at a crossing, both pass on as one line each."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.distance import cdist

from dlolib.captures.base import Mask
from dlolib.chain.anchor import Anchor
from dlolib.chain.centre import OWN_WIDTHS, on_mask
from dlolib.chain.lift import Strand
from dlolib.chain.view import View
from dlolib.types import Floats

LARGEST_WIDTHS = 10.0
LEAST_ON_MASK = 0.9
BACK_WIDTHS = 2.0
# A tip that is so near to a held end has reached it.
REACHED_WIDTHS = 1.0
# A held end to which no line comes so near has a straight line of its own, up to so long, from so much on.
AWAY_WIDTHS, STUB_WIDTHS, LEAST_WIDTHS, LEAST_PX = 1.5, 2.0, 0.75, 4
# In which direction it is seen, a step so long along the rope tells.
BEYOND_M = 0.005


def from_held_ends(
    lines: list[Floats], width: float, view: View, start: Anchor | None, end: Anchor | None
) -> list[Floats]:
    """Straight lines [px] (K, 2) from held ends that none of the lines (K, 2) comes near, as far as there is
    rope: between a clamp and what hides or crosses the rope beside it, a skeleton is too short to count.
    """
    found: list[Floats] = []
    places = np.concatenate(lines) if lines else np.zeros((0, 2))
    for anchor in (start, end.turned() if end else None):
        seen = None if anchor is None else _in_image(anchor, view)
        if seen is None or not lines:
            continue
        place, heading = seen
        if np.linalg.norm(places - place, axis=1).min() <= AWAY_WIDTHS * width:
            continue
        far = place + np.arange(int(STUB_WIDTHS * width) + 1)[:, None] * heading
        alone = cdist(far, places).min(axis=1) > OWN_WIDTHS * width
        rope = _on_or_beside(view.mask, far) & alone
        reach = len(far) if rope.all() else int(np.argmin(rope))
        if reach >= max(LEAST_WIDTHS * width, LEAST_PX):
            found.append(far[:reach])
    return found


def may_be_joined(
    lines: list[Floats], width: float, view: View, start: Anchor | None, end: Anchor | None
) -> bool:
    """Whether `joined` would change any of these lines [px] (K, 2), in whatever order and direction.

    Where not, the look that puts them in order for it is spared.
    """
    ways = [way for line in lines for way in (line, line[::-1])]
    tips = np.array([way[-1] for way in ways])
    near = np.linalg.norm(tips[:, None] - tips, axis=-1) <= LARGEST_WIDTHS * width
    pairs = [(one, other) for one, other in np.argwhere(near) if one // 2 != other // 2]
    held = [anchor for anchor, _ in _arrivals(start, end)]
    return any(_way(ways[one], ways[other][::-1], width, view) is not None for one, other in pairs) or any(
        _stub(way, anchor, width, view) is not None for way in ways for anchor in held
    )


def joined(
    strands: list[Strand], width: float, view: View, start: Anchor | None, end: Anchor | None
) -> list[Floats] | None:
    """Lines [px] (K, 2) of ordered strands, one for each that is unbroken in the image; None as they were.

    A skeleton is cut where it forks, and its short stubs are left out. What follows on what is known once
    the strands are in order: where the way from one to the next, or to a held end, is rope in the image,
    it was only cut, and is no gap. Which of two strands is on top there, the depth readings then tell.

    Args:
        strands: in order, each from start to end.
        width: the rope's typical width [px].
        view: the mask and the optics.
        start, end: the held ends in camera axes; None where free.
    """
    lines = [strand.pixel for strand in strands]
    whole = [lines[0]]
    changed = False
    for line in lines[1:]:
        way = _way(whole[-1], line, width, view)
        if way is None:
            whole.append(line)
        else:
            whole[-1] = np.concatenate([whole[-1], way, line])
            changed = True
    for anchor, last in _arrivals(start, end):
        line = whole[-1] if last else whole[0][::-1]
        stub = _stub(line, anchor, width, view)
        if stub is not None:
            line = np.concatenate([line, stub])
            whole[-1 if last else 0] = line if last else line[::-1]
            changed = True
    return whole if changed else None


def _arrivals(start: Anchor | None, end: Anchor | None) -> Iterator[tuple[Anchor, bool]]:
    """The held ends as one comes to them along the rope, and whether it is its end."""
    if start is not None:
        yield start.turned(), False
    if end is not None:
        yield end, True


def _way(line: Floats, onward: Floats, width: float, view: View) -> Floats | None:
    """Pixels (K, 2) between the end of a line and the beginning of another, if they are rope."""
    return _curve(line[-1], _heading(line, width), onward[0], -_heading(onward[::-1], width), width, view)


def _stub(line: Floats, anchor: Anchor, width: float, view: View) -> Floats | None:
    """Pixels (K, 2) from the end of a line to a held end, if they are rope."""
    seen = _in_image(anchor, view)
    if seen is None:
        return None
    place, arriving = seen
    if np.linalg.norm(place - line[-1]) <= REACHED_WIDTHS * width or not arriving.any():
        return None
    return _curve(line[-1], _heading(line, width), place, arriving, width, view)


def _in_image(anchor: Anchor, view: View) -> tuple[Floats, Floats] | None:
    """Where a held end is seen (2,) [px] and in which direction (2,), 0 where that is the line of sight.

    None where it is not before the camera: what lies behind it would come out mirrored, into the image.
    """
    points_m = np.stack([anchor.place_m, anchor.place_m + BEYOND_M * anchor.tangent])
    if points_m[:, 2].min() <= BEYOND_M:
        return None
    place, beyond = view.pixel(points_m)
    step = beyond - place
    return place, step / max(float(np.linalg.norm(step)), 1e-12)


def _curve(
    here: Floats, heading: Floats, there: Floats, arriving: Floats, width: float, view: View
) -> Floats | None:
    gap = float(np.linalg.norm(there - here))
    # Against the heading: both cut ends went on into the fork and overlap there.
    if gap > LARGEST_WIDTHS * width or float(heading @ arriving) < -0.5:
        return None
    curve = CubicHermiteSpline([0.0, 1.0], [here, there], [gap * heading, gap * arriving])
    way = np.asarray(curve(np.linspace(0, 1, max(round(gap), 1) + 1)[1:-1]), dtype=np.float64).reshape(-1, 2)
    if len(way) and _on_or_beside(view.mask, way).mean() < LEAST_ON_MASK:
        return None
    return way


def _on_or_beside(mask: Mask, way: Floats) -> NDArray[np.bool_]:
    """Whether places (N, 2) [px] are on the mask or a pixel beside it, (N,): noise cuts a thin rope, and what
    hides it is wider than that."""
    shifts = itertools.product((-1, 0, 1), repeat=2)
    return np.asarray(np.any([on_mask(mask, way + np.array(shift)) for shift in shifts], axis=0))


def _heading(line: Floats, width: float) -> Floats:
    back = min(max(int(BACK_WIDTHS * width), 2), len(line) - 1)
    step = line[-1] - line[-1 - back]
    unit: Floats = step / max(float(np.linalg.norm(step)), 1e-12)
    return unit
