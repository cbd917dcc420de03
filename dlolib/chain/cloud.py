"""A segmented cloud seen as the depth image it came from: from there on it goes the way of an image."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from dlolib.captures.base import Depth, Mask
from dlolib.chain.view import View
from dlolib.errors import ChainError
from dlolib.types import Floats

LARGEST_PX = 4096
MARGIN_PX = 8
CLOSING_PX, EDGE_PX = 3, 5
JUMP_M, FAR_M = 0.02, 1e3
# Points of a plain cloud all lie at whole steps (1; 0 for points anywhere), and fill the rope's pixels but
# for a few at its outline (0.88 of a rope of three pixels, 0.94 and more of wider ones).
LEAST_TOGETHER, LEAST_READ = 0.5, 0.85


def view_of_cloud(cloud_m: Floats) -> View:
    """Project points [m] (N, 3), N ≥ 2, in camera axes onto the grid of pixels that fits them.

    A depth camera's points lie on a lattice in (x/z, y/z), one pixel apart: the median distance to the
    nearest neighbour there is one over the focal length. Nearer points hide further ones.

    Raises:
        ChainError: the cloud is no image: too few points, too wide for their spacing, or thinned.
    """
    flat = cloud_m[:, :2] / cloud_m[:, 2:]
    near = np.asarray(cKDTree(flat).query(flat, k=2)[0])[:, 1] if len(flat) > 1 else np.zeros(1)
    pitch = float(np.median(near))
    if pitch <= 0 or np.ptp(flat, axis=0).max() / pitch > LARGEST_PX:
        raise ChainError(
            f"{len(cloud_m)} points make no image of a rope",
            mend="give the segmented cloud as the camera saw it",
        )
    focal = 1.0 / pitch
    lattice = flat * focal
    # The lattice's own offset, by the mean angle of its fractional part: no pixel then falls between two.
    mean = np.exp(2j * np.pi * lattice).mean(axis=0)
    # A camera's two focal lengths differ a little, and the spacing is the smaller one of both axes.
    if np.abs(mean).max() < LEAST_TOGETHER:
        raise _thinned(f"the {len(cloud_m)} points lie on no grid of pixels")
    turn = np.angle(mean) / (2 * np.pi)
    corner = np.floor((lattice - turn).min(axis=0)) - MARGIN_PX
    place = np.round(lattice - turn - corner).astype(int)
    width, height = place.max(axis=0) + MARGIN_PX + 1
    depth = np.full((height, width), np.inf, dtype=np.float32)
    np.minimum.at(depth, (place[:, 1], place[:, 0]), cloud_m[:, 2].astype(np.float32))
    read = np.isfinite(depth)
    kernel = np.ones((CLOSING_PX, CLOSING_PX), np.uint8)
    mask = cv2.morphologyEx(read.astype(np.uint8), cv2.MORPH_CLOSE, kernel) > 0
    share = np.count_nonzero(read) / np.count_nonzero(mask)
    if share < LEAST_READ:
        raise _thinned(f"of the rope's pixels only {share:.0%} have a point")
    cx, cy = -(turn + corner)
    depth[~read] = 0
    mask &= ~_behind_edges(depth)
    return View(np.asarray(mask), mask.astype(np.float32), depth, focal, focal, float(cx), float(cy))


def _thinned(problem: str) -> ChainError:
    return ChainError(problem, mend="give the cloud as the camera made it, unthinned")


def _behind_edges(depth_m: Depth) -> Mask:
    """Pixels (H, W) just behind the edge of something nearer: there one strand passes under another."""
    around = np.ones((EDGE_PX, EDGE_PX), np.uint8)
    near = cv2.erode(np.where(depth_m > 0, depth_m, np.float32(FAR_M)), around)
    far = cv2.dilate(depth_m, around)
    return np.asarray((far - near > JUMP_M) & ((depth_m == 0) | (depth_m - near > JUMP_M)))
