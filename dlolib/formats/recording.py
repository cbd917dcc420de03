"""Recordings: recording.json, motion.csv and points.csv (format "dlo-recording/1")."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from pydantic import Field

from dlolib.errors import FormatError
from dlolib.files import whole_folder, write_csv, write_json
from dlolib.formats._json import checked, read_json
from dlolib.formats._plausible import (
    check_clear,
    check_ends,
    check_extent,
    check_meeting,
    check_places,
    check_ranges,
)
from dlolib.formats._schema import MILLIMETRES, FrameRange, Scene, Strict, scene_json
from dlolib.formats._table import Table, check_whole, read_table
from dlolib.formats.doubts import moves
from dlolib.formats.motion import interpolate_motion, read_motion, write_motion
from dlolib.types import Floats, Ints, Motion, Noise, Points, Recording, Rope

FORM = "dlo-recording/1"
# A tenth of a micrometre, squared: no camera knows a point better.
LEAST_VARIANCE_M2 = 1e-14
# Points that are off by this share of the rope's length tell nothing of it.
NOISIEST = 0.05
COVARIANCES = ("cxx_m2", "cxy_m2", "cxz_m2", "cyy_m2", "cyz_m2", "czz_m2")
# What goes together over more points or frames than this is an offset, and no noise.
LONGEST = 1000.0
UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


class NoiseModel(Strict):
    """The key `noise`."""

    sigma_m: float = Field(gt=0)
    correlation_points: float = Field(ge=0, le=LONGEST)
    correlation_frames: float = Field(ge=0, le=LONGEST)


class ViewModel(Strict):
    """The key `camera`."""

    world_from_camera: list[list[float]]


class RecordingModel(Scene):
    """recording.json."""

    position_noise_m: float | None = Field(default=None, ge=0)
    noise: NoiseModel | None = None
    camera: ViewModel | None = None
    static_frames: FrameRange | None = None
    heldout_frames: FrameRange | None = None
    quasi_static: bool = True
    rate_hz: float | None = Field(default=None, gt=0)
    planar: Literal["xz"] | None = None


def read_recording(folder: Path) -> Recording:
    """Read and check a recording.

    Points are ordered by frame, then arc length. In a planar recording, which shows no y, theirs is that of
    the line between the held ends; of a rope that nobody holds an empty or absent y is 0.

    Raises:
        FormatError: names the file, its line and column or its key, and the mend.
    """
    folder = Path(folder)
    path = folder / "recording.json"
    model = checked(RecordingModel, read_json(path, FORM), path)
    rope, ends = model.object.rope(), model.parsed_ends()
    motion = read_motion(folder / "motion.csv")
    check_ends(motion, ends, rope, folder / "motion.csv")
    check_clear(motion, model.parsed_obstacles(), folder / "motion.csv")
    points = _read_points(folder / "points.csv", rope, model.planar)
    if model.planar:
        points = _between_ends(points, motion, rope)
    _check_against_motion(points, motion, rope, folder / "motion.csv")
    check_extent(points, motion, rope, path)
    _check_noise(model, points, rope, path)
    check_ranges(model.static_frames, model.heldout_frames, points.frame, "points.csv", path)
    return Recording(
        name=model.name or folder.resolve().name,
        rope=rope,
        gravity_m_s2=model.gravity(),
        ends=ends,
        motion=motion,
        points=points,
        obstacles=model.parsed_obstacles(),
        source=model.source or "",
        note=model.note or "",
        quasi_static=model.quasi_static,
        position_noise_m=model.position_noise_m,
        noise=None if model.noise is None else Noise(**model.noise.model_dump()),
        world_from_camera=None if model.camera is None else parse_view(model.camera.world_from_camera, path),
        static_frames=model.static_frames,
        heldout_frames=model.heldout_frames,
        rate_hz=model.rate_hz,
        planar=model.planar,
    )


def write_recording(recording: Recording, folder: Path) -> None:
    """Write a recording's three files, whole or not at all; numbers in CSV with nine digits."""
    view = recording.world_from_camera
    content: dict[str, Any] = {
        "format": FORM,
        "name": recording.name,
        "source": recording.source,
        "note": recording.note,
        **scene_json(recording.rope, recording.gravity_m_s2, recording.ends, recording.obstacles),
        "position_noise_m": recording.position_noise_m,
        "noise": None if recording.noise is None else vars(recording.noise),
        "camera": None if view is None else {"world_from_camera": view.tolist()},
        "static_frames": recording.static_frames,
        "heldout_frames": recording.heldout_frames,
        "quasi_static": recording.quasi_static,
        "rate_hz": recording.rate_hz,
        "planar": recording.planar,
    }
    with whole_folder(Path(folder)) as temporary:
        write_json(temporary / "recording.json", content)
        write_motion(recording.motion, temporary / "motion.csv")
        write_csv(temporary / "points.csv", points_table(recording.points))


def points_table(points: Points) -> pd.DataFrame:
    """The rows of points.csv."""
    columns: dict[str, Floats | Ints] = {"frame": points.frame, "t_s": points.t_s, "s_m": points.s_m}
    columns |= dict(zip(("x_m", "y_m", "z_m"), points.xyz_m.T, strict=True))
    if points.covariance_m2 is not None:
        covariance = points.covariance_m2
        columns |= {name: covariance[:, i, j] for name, (i, j) in zip(COVARIANCES, UPPER, strict=True)}
    return pd.DataFrame(columns)


def parse_view(rows: list[list[float]], path: Path, place: str = "camera.world_from_camera") -> Floats:
    """A rigid transform (4, 4), by default a camera's world_from_camera, checked."""
    try:
        view = np.array(rows, dtype=np.float64)
    except ValueError:
        view = np.empty(0)
    if view.shape != (4, 4) or not np.allclose(view[-1], (0, 0, 0, 1)):
        raise FormatError(
            "is no 4 x 4 transform", file=path, place=place, mend="give four rows of four, the last 0 0 0 1"
        )
    turn = view[:3, :3]
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3) or np.linalg.det(turn) < 0:
        raise FormatError(
            "its 3 x 3 part is no rotation", file=path, place=place, mend="give right-handed unit axes"
        )
    if np.abs(view[:3, 3]).max() > 50:
        raise FormatError(
            f"is {np.linalg.norm(view[:3, 3]):.4g} m away",
            file=path,
            place=place,
            mend="looks like millimetres; divide by 1000",
        )
    return view


def _read_points(path: Path, rope: Rope, planar: str | None) -> Points:
    names = ["frame", "t_s", "s_m", "x_m", "y_m", "z_m", *COVARIANCES]
    unseen = ("y_m",) if planar else ()
    table = read_table(path, names, optional=(*COVARIANCES, *unseen), empties=unseen)
    frame = check_whole(table, "frame")
    _check_frames(table, frame)
    order = np.lexsort((table.numbers["s_m"], frame))
    zero = np.zeros(len(frame))
    y_m = table.numbers.get("y_m", zero)
    xyz = np.stack([table.numbers["x_m"], np.where(np.isnan(y_m), zero, y_m), table.numbers["z_m"]], axis=-1)
    frame, s_m, xyz, lines = frame[order], table.numbers["s_m"][order], xyz[order], table.lines[order]
    twice = np.flatnonzero((np.diff(frame) == 0) & (np.diff(s_m) == 0))
    if twice.size:
        row = int(order[twice[0] + 1])
        problem = (
            f"two rows of frame {table.numbers['frame'][row]:g} with s_m = {table.numbers['s_m'][row]:g}"
        )
        raise table.refusal(row, "s_m", problem, "remove one of them")
    check_places(frame, s_m, xyz, rope, path, lines)
    return Points(frame, table.numbers["t_s"][order], s_m, xyz, _covariance(table, order, planar))


def _between_ends(points: Points, motion: Motion, rope: Rope) -> Points:
    """The points with y on the line between the held ends, or that of the one that is held.

    No fit counts it. But a rope among obstacles is sought from where it was seen, and far aside of its ends
    that would be past the obstacles.
    """
    held = interpolate_motion(motion, points.t_s)
    first, last = held.start_m[:, 1], held.end_m[:, 1]
    start, end = np.where(np.isnan(first), last, first), np.where(np.isnan(last), first, last)
    y_m = start + points.s_m / rope.length_m * (end - start)
    xyz_m = points.xyz_m.copy()
    xyz_m[:, 1] = np.where(np.isnan(y_m), xyz_m[:, 1], y_m)
    return replace(points, xyz_m=xyz_m)


def _check_frames(table: Table, frame: Ints) -> None:
    """Refuse rows out of the order of frames, a frame with two times, a time with two frames."""
    times = table.numbers["t_s"]
    step, same = np.diff(frame), np.diff(times) == 0
    for row in np.flatnonzero((step < 0) | (np.diff(times) < 0) | ((step == 0) != same)) + 1:
        here, before = f"{times[row]:.12g}", f"{times[row - 1]:.12g}"
        if step[row - 1] < 0:
            raise table.refusal(int(row), "frame", f"frame falls to {frame[row]}", "sort the rows by frame")
        if step[row - 1] == 0:
            problem = f"frame {frame[row]} has the times {before} and {here}"
            raise table.refusal(int(row), "t_s", problem, "give a frame one time")
        if times[row] == times[row - 1]:
            problem = f"frames {frame[row - 1]} and {frame[row]} have one time, t_s = {here}"
            raise table.refusal(int(row), "t_s", problem, "give every frame its own time")
        raise table.refusal(int(row), "t_s", f"t_s falls from {before} to {here}", "sort the frames by time")


def _covariance(table: Table, order: Ints, planar: str | None) -> Floats | None:
    """Covariances (P, 3, 3) [m^2] in the given order, or None without the six columns."""
    given = [name for name in COVARIANCES if name in table.numbers]
    if not given:
        return None
    if len(given) < len(COVARIANCES):
        lacking = next(name for name in COVARIANCES if name not in given)
        raise FormatError(
            f"no column {lacking}", file=table.path, place="line 1", mend="give all six or none"
        )
    covariance = np.empty((len(order), 3, 3))
    for name, (i, j) in zip(COVARIANCES, UPPER, strict=True):
        covariance[:, i, j] = covariance[:, j, i] = table.numbers[name]
    # a picture's plane says nothing of y
    seen = [0, 2] if planar else [0, 1, 2]
    least = np.linalg.eigvalsh(covariance[:, seen][:, :, seen])[:, 0]
    bad = np.flatnonzero(least < LEAST_VARIANCE_M2)
    if bad.size:
        problem = f"is no covariance: {least[bad[0]]:.3g} m^2 in a direction"
        raise table.refusal(int(bad[0]), "cxx_m2", problem, "no point is known exactly: give above 0")
    return covariance[order]


def _check_noise(model: RecordingModel, points: Points, rope: Rope, path: Path) -> None:
    """Refuse points that are said to lie anywhere along the rope."""
    given = {"position_noise_m": model.position_noise_m or 0.0}
    if model.noise is not None:
        given["noise.sigma_m"] = model.noise.sigma_m
    if points.covariance_m2 is not None:
        variance = float(np.median(np.trace(points.covariance_m2, axis1=1, axis2=2)))
        given["covariances of points.csv"] = float(np.sqrt(variance))
    for key, sigma_m in given.items():
        if sigma_m > NOISIEST * rope.length_m:
            problem = f"a deviation of {sigma_m:.3g} m, of points on a rope of {rope.length_m:g} m"
            raise FormatError(problem, file=path, place=key, mend=MILLIMETRES)


def _check_against_motion(points: Points, motion: Motion, rope: Rope, path: Path) -> None:
    first, last = motion.t_s[0], motion.t_s[-1]
    # ends that never move fit every clock
    if moves(motion) and (points.t_s[0] > last or points.t_s[-1] < first):
        frames = f"the frames {points.t_s[0]:.12g} to {points.t_s[-1]:.12g}"
        problem = f"covers t_s {first:.12g} to {last:.12g}, {frames}"
        raise FormatError(problem, file=path, mend="bring both to one clock, in seconds")
    poses = interpolate_motion(motion, points.t_s)
    check_meeting(poses.start_m, points.s_m, points.xyz_m, rope, path)
    check_meeting(poses.end_m, points.s_m, points.xyz_m, rope, path)
