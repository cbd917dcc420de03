"""JPEGs have no checksums: whole ones are read as OpenCV reads them, others refused. PNGs have some."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from chain.tubes import Scene, photograph, wave

from dlolib.captures.pictures import decode_color, decode_png
from dlolib.errors import FormatError

PATH = Path("000000.jpg")
SAMPLING = {"4:1:1": 0x411111, "4:2:0": 0x221111, "4:2:2": 0x211111, "4:4:0": 0x121111, "4:4:4": 0x111111}
# As large as a sector of a disk.
LOST = 512


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    return photograph(wave(0.6), Scene())[0]


def jpeg(picture: np.ndarray, *options: int) -> bytes:
    return cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), options)[1].tobytes()


def as_opencv(data: bytes) -> Any:
    return cv2.cvtColor(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


@pytest.mark.parametrize("sampling", SAMPLING.values(), ids=SAMPLING)
@pytest.mark.parametrize("is_progressive", [0, 1])
@pytest.mark.parametrize("restart", [0, 5])
@pytest.mark.parametrize("quality", [30, 95])
def test_a_whole_jpeg_is_read(
    picture: np.ndarray, sampling: int, is_progressive: int, restart: int, quality: int
) -> None:
    data = jpeg(
        picture[:241, :323],
        *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling),
        *(cv2.IMWRITE_JPEG_PROGRESSIVE, is_progressive),
        *(cv2.IMWRITE_JPEG_RST_INTERVAL, restart),
        *(cv2.IMWRITE_JPEG_QUALITY, quality),
    )
    for whole in (data, data + bytes(100)):
        np.testing.assert_array_equal(decode_color(whole, PATH), as_opencv(data))


@pytest.mark.parametrize("restart", [0, 5])
def test_a_jpeg_that_lost_its_middle_is_refused(
    picture: np.ndarray, restart: int, capfd: pytest.CaptureFixture[str]
) -> None:
    data = jpeg(picture, cv2.IMWRITE_JPEG_QUALITY, 90, cv2.IMWRITE_JPEG_RST_INTERVAL, restart)
    rng = np.random.default_rng(0)
    for at in rng.integers(len(data) // 5, len(data) - LOST - 100, 20):
        damaged = data[:at] + bytes(LOST) + data[at + LOST :]
        with pytest.raises(FormatError, match=r"000000\.jpg: is a damaged JPEG; record or copy it again"):
            decode_color(damaged, PATH)
    assert capfd.readouterr().err == ""


def test_a_jpeg_of_a_kind_that_the_check_does_not_know_is_read() -> None:
    """Colour sampled more finely than brightness, which FFmpeg has not implemented."""
    flat = np.full((48, 96, 3), (200, 60, 20), np.uint8)
    data = bytearray(jpeg(flat, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, SAMPLING["4:4:4"]))
    data[data.index(b"\xff\xc0") + 14] = 0x22
    np.testing.assert_array_equal(decode_color(bytes(data), PATH), as_opencv(bytes(data)))


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


HEADER = struct.pack(">IIBBBBB", 6, 4, 8, 0, 0, 0, 0)
ROWS = zlib.compress(4 * bytes([0, 1, 2, 3, 4, 5, 6]))


def png(*chunks: tuple[bytes, bytes]) -> bytes:
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*one) for one in chunks)


def test_a_png_whose_checksums_are_right_is_looked_into_all_the_same(
    capfd: pytest.CaptureFixture[str],
) -> None:
    whole = png((b"IHDR", HEADER), (b"IDAT", ROWS), (b"IEND", b""))
    assert decode_png(whole, PATH).tolist() == [[1, 2, 3, 4, 5, 6]] * 4
    for data, says in (
        (png((b"IHDR", HEADER), (b"IDAT", zlib.compress(bytes(9))), (b"IEND", b"")), "cannot be decoded"),
        (png((b"IDAT", ROWS), (b"IHDR", HEADER), (b"IEND", b"")), "it does not begin with a header"),
        (png((b"IHDR", bytes(4) + HEADER[4:]), (b"IEND", b"")), "header: says that it has 0 x 4 pixels"),
        (png((b"IHDR", HEADER), (b"IDAT", ROWS)), f"byte {len(whole) - 12}: is truncated"),
        (whole[:-20] + b"?" + whole[-19:], "is damaged: a checksum is wrong"),
        (whole[1:], "is no PNG"),
    ):
        with pytest.raises(FormatError, match=says):
            decode_png(data, PATH)
    capfd.readouterr()
