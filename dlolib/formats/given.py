"""What no camera knows of a recording made elsewhere: a capture.json whose camera may be left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field

from dlolib.formats._json import checked, read_json
from dlolib.formats._plausible import check_clear, check_ends
from dlolib.formats._schema import PoseModel
from dlolib.formats.capture import FORM, OPTICS, CaptureScene, Pinhole, background
from dlolib.formats.motion import read_motion
from dlolib.formats.recording import parse_view
from dlolib.types import Ends, Floats, Motion, Obstacle, Pose, Rope

Hsv = tuple[int, int, int]


class GivenCamera(Pinhole):
    """The key `camera`: what is given replaces what the source says."""

    width: int | None = Field(default=None, gt=0)
    height: int | None = Field(default=None, gt=0)
    fx: float | None = Field(default=None, gt=0)
    fy: float | None = Field(default=None, gt=0)
    cx: float | None = None
    cy: float | None = None
    depth_scale: float | None = Field(default=None, ge=1)
    world_from_camera: list[list[float]] | None = None


class GivenModel(CaptureScene):
    """capture.json, its camera in parts, the poses that a robot's log takes for granted beside it."""

    camera: GivenCamera = GivenCamera()
    start: PoseModel | None = None
    tool_from_grasp: list[list[float]] | None = None


@dataclass(frozen=True)
class Given:
    """What a person says of a recording made elsewhere.

    optics holds those of `OPTICS` that were given (pixels, units per metre); world_from_camera (4, 4) or
    None; start is the pose of the end that is held still; tool_from_grasp (4, 4) takes the rope's frame at
    the moved end to that of the pose that was logged; background_color and background_depth are images of
    the empty scene as the capture will hold them.
    """

    file: Path
    name: str | None
    source: str
    note: str
    rope: Rope
    gravity_m_s2: Floats
    ends: Ends
    obstacles: tuple[Obstacle, ...]
    optics: Mapping[str, float]
    world_from_camera: Floats | None
    start: Pose | None
    tool_from_grasp: Floats
    rope_color_hsv: tuple[Hsv, Hsv] | None
    background_color: Path | None
    background_depth: Path | None
    static_frames: tuple[int, int] | None
    heldout_frames: tuple[int, int] | None
    quasi_static: bool
    rate_hz: float | None


def read_given(path: Path) -> Given:
    """Read and check what a person says of a recording made elsewhere.

    Raises:
        FormatError: names the file, its key, and the mend.
    """
    model = checked(GivenModel, read_json(path, FORM), path)
    view, turn = model.camera.world_from_camera, model.tool_from_grasp
    return Given(
        file=path,
        name=model.name,
        source=model.source or "",
        note=model.note or "",
        rope=model.object.rope(),
        gravity_m_s2=model.gravity(),
        ends=model.parsed_ends(),
        obstacles=model.parsed_obstacles(),
        optics={name: value for name in OPTICS if (value := getattr(model.camera, name)) is not None},
        world_from_camera=None if view is None else parse_view(view, path),
        start=None if model.start is None else model.start.pose(),
        tool_from_grasp=np.eye(4) if turn is None else parse_view(turn, path, "tool_from_grasp"),
        rope_color_hsv=model.rope_color_hsv,
        background_color=background(path, model.background_color, "background_color"),
        background_depth=background(path, model.background_depth, "background_depth"),
        static_frames=model.static_frames,
        heldout_frames=model.heldout_frames,
        quasi_static=model.quasi_static,
        rate_hz=model.rate_hz,
    )


def read_given_motion(csv: Path, given: Given) -> Motion:
    """Read motion.csv and hold it against the ends, the rope and the obstacles that it is about.

    Raises:
        FormatError: names file, line and column.
    """
    motion = read_motion(csv)
    check_ends(motion, given.ends, given.rope, csv)
    check_clear(motion, given.obstacles, csv)
    return motion
