"""The calibration that an Azure Kinect attaches to its recordings, for the two images as recorded.

The factory's numbers are parts of the whole sensor; a mode bins and crops it. Conventions are those of
Microsoft's sensor SDK (MIT): its `calibration.c` and `mode_specific_calibration.c`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dlolib.captures.base import Image
from dlolib.captures.foreign import Units
from dlolib.captures.lens import PINHOLE, Lens
from dlolib.errors import FormatError
from dlolib.types import Floats

Size = tuple[int, int]
# Image size: the sensor's size after binning, and where the image begins in it.
DEPTH_MODES: dict[Size, tuple[Size, Size]] = {
    (320, 288): ((512, 512), (96, 90)),
    (640, 576): ((1024, 1024), (192, 180)),
    (512, 512): ((512, 512), (0, 0)),
    (1024, 1024): ((1024, 1024), (0, 0)),
}
COLOR_MODES: dict[Size, tuple[Size, Size]] = {
    (1280, 720): ((1280, 960), (0, 120)),
    (1920, 1080): ((1920, 1440), (0, 180)),
    (2560, 1440): ((2560, 1920), (0, 240)),
    (2048, 1536): ((2048, 1536), (0, 0)),
    (3840, 2160): ((3840, 2880), (0, 360)),
    (4096, 3072): ((4096, 3072), (0, 0)),
}
MODEL = "CALIBRATION_LensDistortionModelBrownConrady"
MILLIMETRES = 1000.0
# What lies so much further away than what is seen beside it is hidden by that: a rope is thinner.
BEHIND_M = 0.02
# Cells around a point that it hides, too: between readings there are gaps, and outlines lack readings.
AROUND = np.ones((5, 5), np.uint8)


@dataclass(frozen=True)
class Calibration:
    """The depth and the colour camera's lens; color_from_depth (4, 4) [m]."""

    depth: Lens
    color: Lens
    color_from_depth: Floats

    def registered(self, color: Image, depth: Units) -> tuple[Image, Units]:
        """Both as a pinhole in the depth camera's place sees them; black where depth has no reading.

        What something hides from the colour camera, which stands beside, gets the colour of the point next
        to it that is not hidden, not that of what hides it.

        Args:
            color: (H', W', 3), as recorded.
            depth: (H, W) [mm], as recorded.

        Returns:
            colour (H, W, 3) and depth (H, W).
        """
        flat = self.depth.depth(depth)
        rows, columns = np.nonzero(flat)
        z = flat[rows, columns] / MILLIMETRES
        matrix = self.depth.matrix
        rays = np.stack(
            [(columns - matrix[0, 2]) / matrix[0, 0], (rows - matrix[1, 2]) / matrix[1, 1]], axis=-1
        )
        points = np.concatenate([rays * z[:, None], z[:, None]], axis=1)
        seen = np.full((*flat.shape, 2), -1.0, dtype=np.float32)
        if len(points):
            turn, _ = cv2.Rodrigues(self.color_from_depth[:3, :3])
            place = self.color_from_depth[:3, 3]
            found, _ = cv2.projectPoints(points, turn, place, self.color.matrix, self.color.distortion)
            away = points @ self.color_from_depth[2, :3] + place[2]
            pixels = np.asarray(found[:, 0], dtype=np.float64)
            hidden = self._hidden(pixels, away, color.shape)
            if hidden.any():
                _, beside = cKDTree(points[~hidden]).query(points[hidden])
                pixels[hidden] = pixels[~hidden][beside]
            seen[rows, columns] = pixels
        mixed = cv2.remap(color, seen[..., 0], seen[..., 1], cv2.INTER_LINEAR)
        mixed[flat == 0] = 0
        return np.asarray(mixed, dtype=np.uint8), flat

    def _hidden(self, pixels: Floats, away_m: Floats, shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """Which points, seen at pixels (N, 2) of colour, lie behind others (N,); cells are depth's pixels."""
        pitch = self.color.matrix[0, 0] / self.depth.matrix[0, 0]
        cells = np.rint(pixels / pitch).astype(np.int64)[:, ::-1]
        size = np.array(shape[:2]) // pitch + 1
        hidden: NDArray[np.bool_] = ((cells >= 0) & (cells < size)).all(axis=1)
        row, column = cells[hidden].T
        nearest = np.full(size.astype(int), np.inf, dtype=np.float32)
        np.minimum.at(nearest, (row, column), away_m[hidden].astype(np.float32))
        hidden[hidden] = away_m[hidden] > cv2.erode(nearest, AROUND)[row, column] + BEHIND_M
        return hidden


def read_calibration(
    data: bytes, path: Path, depth_size: Size, color_size: Size, given: Mapping[str, float]
) -> Calibration:
    """The calibration for images of these sizes (width, height).

    What a person has given of fx, fy, cx, cy [px] stands in the depth camera's matrix.

    Raises:
        FormatError: damaged, an unknown mode, or an unknown lens.
    """
    place = "calibration.json"
    for size, modes, what in ((depth_size, DEPTH_MODES, "depth"), (color_size, COLOR_MODES, "color")):
        if size not in modes:
            known = ", ".join(f"{w} x {h}" for w, h in modes)
            problem = f"the Azure Kinect has no mode of {what} with {size[0]} x {size[1]} pixels"
            raise FormatError(problem, file=path, place=what.upper(), mend=f"record one of {known}")
    try:
        # the recorder ends the text with a zero
        cameras = json.loads(data.rstrip(b"\0"))["CalibrationInformation"]["Cameras"]
        by_place = {camera["Location"]: camera for camera in cameras}
        depth, color = by_place["CALIBRATION_CameraLocationD0"], by_place["CALIBRATION_CameraLocationPV0"]
        models = {camera["Intrinsics"]["ModelType"] for camera in (depth, color)}
        pose = _pose(color) @ np.linalg.inv(_pose(depth))
        lenses = (_lens(depth, *DEPTH_MODES[depth_size]), _lens(color, *COLOR_MODES[color_size]))
    except (
        ValueError,
        LookupError,
        TypeError,
        OverflowError,
        RecursionError,
        np.linalg.LinAlgError,
    ) as error:
        problem, mend = "the attached calibration is damaged", "record it again with k4arecorder"
        raise FormatError(problem, file=path, place=place, mend=mend) from error
    if models != {MODEL}:
        mend = "give a recording with Brown and Conrady's lens, as the device stores it"
        raise FormatError(f"unknown lens {sorted(map(str, models))}", file=path, place=place, mend=mend)
    for name, where in PINHOLE.items():
        lenses[0].matrix[where] = given.get(name, lenses[0].matrix[where])
    return Calibration(*lenses, pose)


def _pose(camera: dict[str, Any]) -> Floats:
    """The camera's own axes from those that all of the device's share (4, 4) [m]."""
    pose = np.eye(4)
    pose[:3, :3] = np.array(camera["Rt"]["Rotation"], dtype=np.float64).reshape(3, 3)
    pose[:3, 3] = np.array(camera["Rt"]["Translation"], dtype=np.float64)
    return pose


def _lens(camera: dict[str, Any], binned: Size, begin: Size) -> Lens:
    """cx, cy, fx, fy as parts of the sensor, corner first; k1 to k6; the distortion's centre; p2, p1."""
    numbers = np.array(camera["Intrinsics"]["ModelParameters"], dtype=np.float64)
    legacy = camera["SensorWidth"] * 9 == camera["SensorHeight"] * 16
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, off_x, off_y, p2, p1 = numbers[:14]
    if not np.isfinite(numbers).all() or fx <= 0 or fy <= 0 or off_x or off_y:
        raise ValueError("implausible")
    if legacy:
        # calibrated on a 16:9 part of the 4:3 sensor
        cy, fy = (cy * 2304 + 384) / 3072, fy * 2304 / 3072
    matrix = np.array(
        [
            [fx * binned[0], 0, cx * binned[0] - begin[0] - 0.5],
            [0, fy * binned[1], cy * binned[1] - begin[1] - 0.5],
            [0, 0, 1],
        ]
    )
    return Lens(matrix, np.array([k1, k2, p1, p2, k3, k4, k5, k6]))
