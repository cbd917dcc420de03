"""Azure Kinect and RealSense recordings and clouds that cannot be used: one line, nothing written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from captures import foreign_samples as foreign
from captures.refusals import Refusals

from dlolib.captures.cloud_folder import read_cloud
from dlolib.errors import FormatError


def kinect(attached: dict[str, Any] | None, **names: str) -> Callable[[Path], None]:
    shot = foreign.frames(2, foreign.KINECT_WIDTH, foreign.KINECT_HEIGHT)
    return lambda path: foreign.kinect(path, shot, attached, **names) and None


def first_camera(**changes: Any) -> dict[str, Any]:
    content = foreign.calibration()
    content["CalibrationInformation"]["Cameras"][0] |= changes
    return content


def test_kinects(tmp_path: Path, refused: Refusals) -> None:
    path = tmp_path / "source.mkv"
    foreign.given(refused.about)
    nothing = {"ModelParameters": None, "ModelType": None}
    known = foreign.calibration()["CalibrationInformation"]["Cameras"][0]["Intrinsics"]
    lens = known | {"ModelType": "CALIBRATION_LensDistortionModelRational6KT"}
    for write, says in (
        (kinect(None), "calibration.json: no calibration is attached"),
        (kinect({}), "calibration.json: the attached calibration is damaged"),
        (kinect(first_camera(Intrinsics={})), "calibration.json: the attached calibration is damaged"),
        (kinect(first_camera(Intrinsics=nothing)), "calibration.json: the attached calibration is damaged"),
        (kinect(first_camera(Intrinsics=lens)), "calibration.json: unknown lens ['CALIBRATION_LensDist"),
        (kinect(foreign.calibration(), tracks="INFRA"), "DEPTH: no track DEPTH, found COLOR, INFRA"),
    ):
        write(path)
        refused(path, f"{path}: {says}")
    shot = foreign.frames(2)
    foreign.kinect(path, replace(shot, color=foreign.frames(2, 320, 288).color), foreign.calibration())
    refused(
        path,
        f"{path}: DEPTH: the Azure Kinect has no mode of depth with 32 x 24 pixels; record one of 320 x 288",
    )


def test_truncated_kinects(tmp_path: Path, refused: Refusals) -> None:
    path = tmp_path / "source.mkv"
    kinect(foreign.calibration())(path)
    whole = path.read_bytes()
    for share in (0.0, 1e-6, 0.2, 0.5, 0.9, 0.9999):
        path.write_bytes(whole[: int(share * len(whole))])
        refused(path, "is truncated" if share > 0.1 else "is no Matroska file")
    for at in range(0, 3000, 100):
        spoilt = bytearray(whole)
        spoilt[at : at + 4] = b"\xff\x00\x81\x7f"
        path.write_bytes(bytes(spoilt))
        refused.status(path)


def clouds(folder: Path, name: str = "000000.ply") -> Path:
    folder.mkdir()
    numbers = b"".join(b"property float %c\n" % axis for axis in b"xyz")
    (folder / name).write_bytes(b"ply\nformat ascii 1.0\nelement vertex 2\n%send_header\n1 1 1\n" % numbers)
    return folder


def test_clouds(tmp_path: Path, refused: Refusals) -> None:
    source = clouds(tmp_path / "source")
    refused(source, "object.json: rate_hz: when 000000.ply was taken is not recorded")
    foreign.given(refused.about, rate_hz=1.0, camera=foreign.camera_of())
    refused(source, "000000.ply: is truncated: 1 points where its header promises 2")
    refused(clouds(tmp_path / "other", "rope.ply"), "other: holds no numbered .ply")


def test_an_image_of_the_empty_scene_beside_clouds_asks_for_its_optics(
    tmp_path: Path, refused: Refusals
) -> None:
    cv2.imwrite(str(tmp_path / "empty.png"), np.zeros((12, 16, 3), np.uint8))
    foreign.given(refused.about, rate_hz=1.0, background_color="empty.png")
    refused(clouds(tmp_path / "source"), "object.json: camera.width: the recording does not say width")


@pytest.mark.parametrize(
    ("header", "says"),
    [
        ("property float x\nproperty float y\nproperty float depth", "no number z of its vertices"),
        (
            "property float x\nproperty float y\nproperty list uchar int z",
            "'property list uchar int z' is no",
        ),
        ("property\nproperty float x\nproperty float y\nproperty float z", "'property' is no number"),
        ("property float x\nproperty float y\nproperty float z\nelement vertex 9", "is no PLY with vertices"),
    ],
)
def test_a_cloud_without_coordinates(tmp_path: Path, header: str, says: str) -> None:
    path = tmp_path / "000000.ply"
    body = "1 1 1\n" * 2
    path.write_text(f"ply\nformat ascii 1.0\nelement vertex 2\n{header}\nend_header\n{body}")
    with pytest.raises(FormatError, match=says):
        read_cloud(path)
