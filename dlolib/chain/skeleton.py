"""The rope's centre line in pixels: lines 3 and 4 of Algorithm 1, `Skeletonize` and `Corner detection`."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csgraph
from skimage.graph import pixel_graph
from skimage.morphology import skeletonize

from dlolib.captures.base import Mask
from dlolib.chain.cleaning import without_holes
from dlolib.types import Floats

HARRIS_BLOCK, HARRIS_APERTURE, HARRIS_K = 3, 3, 0.04
PRUNINGS = 3
SHORTEST_WIDTHS, SPUR_WIDTHS = 1.5, 1.5
HOLE_WIDTHS = 2.0
# A rope comes in no more parts than this: in an image of noise only the longest are looked at.
MOST_LINES = 64
# Over so many widths to either side a rope turns by less than this angle: it bends no closer than 1.4 widths.
KINK_WIDTHS, KINK_RAD = 1.5, 1.1


def centre_lines(mask: Mask) -> tuple[list[Floats], float]:
    """The centre lines of a mask (H, W), and the typical width of what they run through.

    Where the skeleton forks (the rope crosses or touches itself) it is cut, and the parts are put
    together later, in space. Short spurs of the outline are no parts of the rope.

    Returns:
        Lines of pixels (column, row), each (K, 2), neighbour after neighbour; the width [px].
    """
    top, left, crop = _cropped(mask)
    if crop.size == 0:
        return [], 0.0
    skeleton = _thinned(crop)
    distance = cv2.distanceTransform(crop.astype(np.uint8), cv2.DIST_L2, 5)
    width = float(max(2 * np.median(distance[skeleton]) - 1, 1.0))
    filled = without_holes(crop, HOLE_WIDTHS * width**2)
    if filled is not crop:
        skeleton = _thinned(filled)
    for _ in range(PRUNINGS):
        spurs = _spurs(skeleton, width)
        if not spurs.any():
            break
        skeleton = _thinned(skeleton & ~spurs)
    _, forks = _corners(skeleton)
    apart = skeleton & ~_around(forks, 0.5 * width)
    whole = [part for line in _ordered(apart) for part in _without_kinks(line, width)]
    lines = [line for line in whole if len(line) >= SHORTEST_WIDTHS * width]
    longest = sorted(sorted(range(len(lines)), key=lambda k: -len(lines[k]))[:MOST_LINES])
    return [lines[k] + np.array([left, top]) for k in longest], width


def _thinned(mask: Mask) -> Mask:
    return np.asarray(skeletonize(mask), dtype=np.bool_)  # type: ignore[no-untyped-call]


def _cropped(mask: Mask) -> tuple[int, int, Mask]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return 0, 0, mask[:0, :0]
    top, left = int(rows[0]) - 1, int(columns[0]) - 1
    crop = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return top, left, np.pad(crop, 1)


def _corners(skeleton: Mask) -> tuple[Mask, Mask]:
    """The ends and the forks of a thinned line, both (H, W).

    Harris' detector, as in the paper, answers at ends, forks and sharp bends alike; the number of
    neighbours on the skeleton tells them apart.
    """
    line = skeleton.astype(np.uint8)
    answer = cv2.cornerHarris(line, HARRIS_BLOCK, HARRIS_APERTURE, HARRIS_K)
    neighbours = cv2.filter2D(line, -1, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT) - line
    corner = skeleton & (answer > 0)
    return corner & (neighbours == 1), skeleton & (neighbours > 2)


def _around(points: Mask, radius: float) -> Mask:
    if not points.any():
        return points
    size = 2 * int(np.ceil(radius)) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return np.asarray(cv2.dilate(points.astype(np.uint8), kernel) > 0)


def _spurs(skeleton: Mask, width: float) -> Mask:
    """Twigs shorter than the rope is wide: they hang on a fork at one end and end freely at the other."""
    ends, forks = _corners(skeleton)
    if not forks.any():
        return np.zeros_like(skeleton)
    near = _around(forks, 1)
    count, labels = cv2.connectedComponents((skeleton & ~near).astype(np.uint8), connectivity=8)
    length = np.bincount(labels.ravel(), minlength=count)
    free, hanging = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    free[labels[ends]] = True
    hanging[labels[_around(near, 1) & (labels > 0)]] = True
    twig = free & hanging & (length < SPUR_WIDTHS * width)
    twig[0] = False
    return np.asarray(twig[labels], dtype=np.bool_)


def _ordered(skeleton: Mask) -> list[Floats]:
    """Each connected line of a skeleton without forks, from one of its ends to the other."""
    if np.count_nonzero(skeleton) < 2:
        return []
    graph, nodes = pixel_graph(skeleton, connectivity=2)  # type: ignore[no-untyped-call]
    rows, columns = np.unravel_index(nodes, skeleton.shape)
    place = np.stack([columns, rows], axis=-1).astype(np.float64)
    count, label = csgraph.connected_components(graph, directed=False)
    first = np.unique(label, return_index=True)[1]
    one_end = _furthest(csgraph.dijkstra(graph, directed=False, indices=first))
    away, before = csgraph.dijkstra(graph, directed=False, indices=one_end, return_predecessors=True)
    other_end = _furthest(away)
    lines = []
    for part in range(count):
        path = [int(other_end[part])]
        while path[-1] != one_end[part]:
            path.append(int(before[part, path[-1]]))
        lines.append(place[path[::-1]])
    return lines


def _without_kinks(line: Floats, width: float) -> list[Floats]:
    """The parts of a line (K, 2) between sharp turns.

    Where something hides a crossing in part, two strands may meet in a V without a fork: no rope turns so.
    """
    arm = max(round(KINK_WIDTHS * width), 3)
    if len(line) <= 2 * arm:
        return [line]
    before = line[arm:-arm] - line[: -2 * arm]
    after = line[2 * arm :] - line[arm:-arm]
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turn = np.abs(np.arctan2(cross, np.einsum("ij,ij->i", before, after)))
    kinks = []
    while turn.max() > KINK_RAD:
        place = int(np.argmax(turn))
        turn[max(place - arm, 0) : place + arm + 1] = 0
        kinks.append(place + arm)
    half = max(round(0.5 * width), 1)
    bounds = [-half, *sorted(kinks), len(line) + half]
    parts = [line[a + half : b - half] for a, b in itertools.pairwise(bounds)]
    return [part for part in parts if len(part) > 1]


def _furthest(distance: Floats) -> NDArray[np.intp]:
    """For each row of distances (P, N) the reachable node that is furthest away."""
    return np.asarray(np.argmax(np.where(np.isfinite(distance), distance, -1.0), axis=1), dtype=np.intp)
