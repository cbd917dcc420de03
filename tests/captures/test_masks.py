"""Masks that others made."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from dlolib.captures.pictures import read_mask
from dlolib.errors import FormatError
from dlolib.types import Camera

CAMERA = Camera(np.eye(4), 8, 6)


def saved(path: Path, level: int) -> Path:
    image = np.zeros((6, 8), np.uint8)
    image[2:4] = level
    cv2.imwrite(str(path / "mask.png"), image)
    return path / "mask.png"


@pytest.mark.parametrize(("level", "rows"), [(255, 2), (0, 0)])
def test_white_is_rope(tmp_path: Path, level: int, rows: int) -> None:
    assert read_mask(saved(tmp_path, level), CAMERA).any(axis=1).sum() == rows


def test_ones_in_the_place_of_white_are_no_empty_mask(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="no brighter than 1 of 255 anywhere; save the rope as white"):
        read_mask(saved(tmp_path, 1), CAMERA)


@pytest.mark.parametrize(
    ("image", "kind"),
    [
        (np.full((6, 8), 60000, np.uint16), "16-bit with 1 channel"),
        (np.full((6, 8, 3), 255, np.uint8), "8-bit with 3 channels"),
    ],
)
def test_a_mask_is_grey_of_8_bits(tmp_path: Path, image: np.ndarray, kind: str) -> None:
    cv2.imwrite(str(tmp_path / "mask.png"), image)
    with pytest.raises(FormatError, match=f"mask.png: is {kind}, not 8-bit grey; save the mask as 8-bit"):
        read_mask(tmp_path / "mask.png", CAMERA)
