"""What is printed and held before the camera: a ChArUco board or a grid of ArUco markers (OpenCV's)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from pydantic import Field

from dlolib.calibrate.folder import read_object
from dlolib.calibrate.marker import markers
from dlolib.captures.base import Image
from dlolib.errors import FormatError
from dlolib.formats._json import checked
from dlolib.formats._schema import Strict
from dlolib.types import Floats

BOARD, PREFIX = "board.json", "DICT_"
SMALLEST_M, LARGEST_M = 1e-4, 2.0
# One marker's corners leave nothing over by which a wrong one would show; six of a chessboard do.
LEAST_CORNERS = {"charuco": 6, "aruco": 4}
Count = Annotated[int, Field(ge=1, le=100)]


class BoardModel(Strict):
    """board.json. `squares` counts across and down, of the chessboard or of the grid's markers.

    legacy_pattern: of an even number of rows printed with OpenCV before 4.6.
    """

    type: Literal["charuco", "aruco"]
    squares: Annotated[tuple[Count, Count], Field(strict=False)]
    square_m: float = Field(ge=SMALLEST_M, le=LARGEST_M)
    marker_m: float = Field(ge=SMALLEST_M, le=LARGEST_M)
    dictionary: str
    legacy_pattern: bool = False


@dataclass(frozen=True)
class Board:
    """A board and how it is found; `drawn` is OpenCV's, which can print it, too."""

    path: Path
    model: BoardModel
    drawn: Any

    @property
    def middle_m(self) -> Floats:
        """The middle (3,) [m] in the board's axes (x right, y down, from its first corner)."""
        across, down = self.model.squares
        gap = self.model.square_m - self.model.marker_m if self.model.type == "aruco" else 0.0
        return np.array([across * self.model.square_m - gap, down * self.model.square_m - gap, 0.0]) / 2


@dataclass(frozen=True)
class Sighting:
    """Corners of a board in one image: where they are on it [m], (K, 3), and in the image [px], (K, 2)."""

    object_m: Floats
    pixel: Floats


def read_board(path: Path) -> Board:
    """Read board.json.

    Raises:
        FormatError: names the key and the mend.
    """
    content = read_object(path, "the board")
    model = checked(BoardModel, content, path)
    # as OpenCV takes them
    if np.float32(model.marker_m) >= np.float32(model.square_m) and model.squares != (1, 1):
        problem = f"{model.marker_m:g} m is not less than square_m = {model.square_m:g}"
        raise FormatError(
            problem, file=path, place="marker_m", mend="measure both; a square holds its marker"
        )
    words = dictionary(model.dictionary, path)
    if model.type == "charuco":
        inner = (model.squares[0] - 1) * (model.squares[1] - 1)
        if inner < LEAST_CORNERS["charuco"]:
            problem = f"{inner} inner corners are too few for a pose"
            raise FormatError(problem, file=path, place="squares", mend="give at least [3, 4]")
        drawn: Any = cv2.aruco.CharucoBoard(model.squares, model.square_m, model.marker_m, words)
        drawn.setLegacyPattern(model.legacy_pattern)
        return Board(path, model, drawn)
    gap = max(model.square_m - model.marker_m, 1e-6)
    return Board(path, model, cv2.aruco.GridBoard(model.squares, model.marker_m, gap, words))


def dictionary(name: str, path: Path) -> Any:
    """One of OpenCV's dictionaries by name, such as "DICT_4X4_50" or "4X4_50".

    Raises:
        FormatError: none of that name.
    """
    full = name if name.startswith(PREFIX) else PREFIX + name
    if not hasattr(cv2.aruco, full):
        known = ", ".join(sorted(word for word in dir(cv2.aruco) if word.startswith(PREFIX)))
        raise FormatError(f"unknown {name!r}", file=path, place="dictionary", mend=f"choose from {known}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, full))


def family(name: str) -> str:
    """What dictionaries share whose first markers are the same: "4X4" of "DICT_4X4_50"; else its name."""
    words = name.removeprefix(PREFIX).upper()
    return words.partition("_")[0] if words[0].isdigit() else words


def sighting(board: Board, image: Image) -> Sighting | None:
    """The board in an image (H, W, 3); None where too little of it is seen."""
    corners: Any
    ids: Any
    if board.model.type == "charuco":
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        corners, ids, _, _ = cv2.aruco.CharucoDetector(board.drawn).detectBoard(grey)
    else:
        found = markers(image, board.drawn.getDictionary())
        corners, ids = [c[None].astype(np.float32) for c in found.values()], np.array(list(found))
    if ids is None or len(ids) == 0:
        return None
    objects, pixels = board.drawn.matchImagePoints(corners, ids)
    if objects is None or len(objects) < LEAST_CORNERS[board.model.type]:
        return None
    return Sighting(objects.reshape(-1, 3).astype(np.float64), pixels.reshape(-1, 2).astype(np.float64))
