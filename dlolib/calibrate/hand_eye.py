"""Where a fixed camera stands in the robot's world, from a board that the robot turns before it.

The format asks for one `world_from_camera`, so the camera stands still and the board rides on the tool:
world_from_tool · tool_from_board = world_from_camera · camera_from_board, for every frame. A closed form
(Park and Martin, Robot sensor calibration: solving AX = XB on the Euclidean group, 1994, as OpenCV has it)
begins, least squares on the corners as they are seen ends it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

from dlolib.calibrate.board import BOARD, Board, Sighting, read_board, sighting
from dlolib.calibrate.folder import Shots, read_shots, read_tool_poses
from dlolib.calibrate.plane_pose import PlanePose, plane_pose, posed, projected
from dlolib.errors import FormatError
from dlolib.formats import say
from dlolib.progress import track
from dlolib.types import Floats, Ints

LEAST_FRAMES = 4
# RMS of the tool's turns about the second of its axes; below it a place along the first stays unknown.
LEAST_TURN_RAD = np.radians(3.0)
# What a wrong board, wrong units or another robot's poses exceed, and any calibration of use does not.
WORST_M, WORST_RAD = 0.01, np.radians(2.0)
# So many times better must the other arrangement fit to be believed.
CLEARLY = 5.0
CORNER_PX = 1.0
# A board's size or a focal length so far off, at so small a chance, is doubted: 0.3 % of 0.7 m are 2 mm.
DOUBTED, CHANCE = 0.003, 0.001
POSES = 12


@dataclass(frozen=True)
class HandEye:
    """A camera's pose in the world, and how well the frames agree about it.

    world_from_camera, tool_from_board (4, 4). frame (F,): those in which the board was found and whose pose
    is given; for each, how far apart the board is as the camera sees it and as the robot holds it,
    residual_m [m] (of its middle) and residual_rad, and the corners' RMS residual_px. unseen: frames without
    a board. sd_m, sd_rad: standard deviations of the world's place of a point where the board was, and of the
    camera's turn, from the frames' disagreement, if square_m and the focal length are right: doubts say where
    they seem not to be. sightings and fitted_px (K, 2): each frame's corners as
    found, as fitted.
    """

    board: Board
    shots: Shots
    world_from_camera: Floats
    tool_from_board: Floats
    frame: Ints
    residual_m: Floats
    residual_rad: Floats
    residual_px: Floats
    unseen: tuple[int, ...]
    sd_m: float
    sd_rad: float
    doubts: tuple[str, ...]
    sightings: tuple[Sighting, ...]
    fitted_px: tuple[Floats, ...]


@dataclass(frozen=True)
class _Frames:
    """What is known of each frame: its number, the tool's pose, the board as seen."""

    frame: list[int]
    tool: Floats
    seen: list[Sighting]
    board: Floats


def calibrate_hand_eye(folder: Path) -> HandEye:
    """Find world_from_camera from a calibration's folder: frames, robot_poses.csv and board.json.

    Raises:
        FormatError: a file that cannot be used, too few frames with the board, turns about one axis alone, a
            camera on the tool, or frames that do not agree; names the file, the place and the mend.
    """
    shots = read_shots(folder)
    board, poses_csv = read_board(Path(folder) / BOARD), Path(folder) / "robot_poses.csv"
    frames, unseen = _found(shots, board, read_tool_poses(poses_csv), poses_csv)
    _check_turns(frames, poses_csv)
    camera, held = _closed_form(frames)
    _check_arrangement(frames, camera, poses_csv)
    camera, held, sd_m, sd_rad = _refined(frames, camera, held, board, shots.matrix)
    apart_m, apart_rad = _apart(frames, camera, held, board)
    if np.sqrt(np.mean(apart_m**2)) > WORST_M or np.sqrt(np.mean(apart_rad**2)) > WORST_RAD:
        worst = int(np.argmax(apart_m))
        problem = (
            f"robot and camera disagree by {1e3 * np.sqrt(np.mean(apart_m**2)):.1f} mm and "
            f"{np.degrees(np.sqrt(np.mean(apart_rad**2))):.2f}°, most in frame {frames.frame[worst]}"
        )
        mend = "check square_m, the poses' units and axes, and that each pose is that of its frame"
        raise FormatError(problem, file=poses_csv, place="residual", mend=mend)
    doubts = _doubts(frames, camera, held, shots, board)
    say(doubts)
    fitted = _seen_from(frames, camera, held, shots.matrix)
    pixels = [
        np.sqrt(np.mean(np.sum((f - s.pixel) ** 2, axis=1))) for f, s in zip(fitted, frames.seen, strict=True)
    ]
    return HandEye(
        board, shots, camera, held, np.array(frames.frame), apart_m, apart_rad, np.array(pixels), unseen,
        sd_m, sd_rad, doubts, tuple(frames.seen), tuple(fitted),
    )  # fmt: skip


def _found(
    shots: Shots, board: Board, tools: dict[int, Floats], poses_csv: Path
) -> tuple[_Frames, tuple[int, ...]]:
    """The frames with a pose and a board, and the numbers of those with a pose alone."""
    both = [row for row, frame in enumerate(shots.frame.tolist()) if frame in tools]
    if not both:
        problem = "names none of the frames in frames.csv"
        raise FormatError(problem, file=poses_csv, place="column frame", mend="give each frame's own number")
    kept: list[tuple[int, Sighting, PlanePose]] = []
    unseen = []
    for row in track(both, "finding the board"):
        seen = sighting(board, shots.picture(row))
        pose = None if seen is None else plane_pose(seen.object_m, seen.pixel, shots.matrix)
        if seen is None or pose is None:
            unseen.append(int(shots.frame[row]))
        else:
            kept.append((int(shots.frame[row]), seen, pose))
    if len(kept) < LEAST_FRAMES:
        seen_in = f"the board is found in {len(kept)} of {len(both)} frames that have a pose"
        problem = f"{seen_in}, {LEAST_FRAMES} are needed"
        mend = (
            "check type, squares, dictionary (legacy_pattern for old prints), or record it nearer and sharper"
        )
        raise FormatError(problem, file=board.path, place="the board", mend=mend)
    numbers = [frame for frame, _, _ in kept]
    tool = np.array([tools[frame] for frame in numbers])
    return _Frames(
        numbers, tool, [s for _, s, _ in kept], np.array([p.camera_from_target for _, _, p in kept])
    ), tuple(unseen)


def _check_turns(frames: _Frames, path: Path) -> None:
    turns = Rotation.from_matrix(frames.tool[:, :3, :3])
    away = (turns.mean().inv() * turns).as_rotvec()
    spread = np.linalg.svd(away, compute_uv=False) / np.sqrt(len(away))
    if spread[1] < LEAST_TURN_RAD:
        first, second = np.degrees(spread[:2])
        problem = f"the tool turns by {first:.1f}° about one axis and {second:.1f}° about a second"
        mend = "add frames in which the tool is turned by 20° or more about two axes"
        raise FormatError(problem, file=path, place="the turns", mend=mend)


def _closed_form(frames: _Frames) -> tuple[Floats, Floats]:
    """world_from_camera and tool_from_board, from the poses alone."""
    from_tool = np.asarray(np.linalg.inv(frames.tool), dtype=np.float64)
    camera = _hand_eye(from_tool, frames.board)
    return camera, _mean(from_tool @ camera @ frames.board)


def _hand_eye(base_from_hand: Floats, eye_from_target: Floats) -> Floats:
    """hand_from_eye (4, 4) where the target stands still in the base."""
    turn, place = cv2.calibrateHandEye(
        list(base_from_hand[:, :3, :3]),
        list(base_from_hand[:, :3, 3]),
        list(eye_from_target[:, :3, :3]),
        list(eye_from_target[:, :3, 3]),
        method=cv2.CALIB_HAND_EYE_PARK,
    )
    pose = np.eye(4)
    if np.isfinite(turn).all() and np.isfinite(place).all():
        # where the frames contradict each other the turn is none: the nearest one is
        left, _, right = np.linalg.svd(turn)
        pose[:3, :3] = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        pose[:3, 3] = place.ravel()
    return pose


def _mean(poses: Floats) -> Floats:
    """The mean (4, 4) of poses (N, 4, 4)."""
    mean = np.eye(4)
    mean[:3, :3] = Rotation.from_matrix(poses[:, :3, :3]).mean().as_matrix()
    mean[:3, 3] = poses[:, :3, 3].mean(axis=0)
    return mean


def _scatter_m(poses: Floats) -> float:
    """RMS distance [m] of the places of poses (N, 4, 4) from their mean."""
    return float(np.sqrt(np.mean(np.sum((poses[:, :3, 3] - poses[:, :3, 3].mean(axis=0)) ** 2, axis=1))))


def _check_arrangement(frames: _Frames, camera: Floats, path: Path) -> None:
    """Refuse a camera that rides on the tool before a board that stands still.

    Poses of the world in the tool's axes, of a camera that stands, are the very same equations.
    """
    on_tool = _hand_eye(frames.tool, frames.board)
    riding = _scatter_m(frames.tool @ on_tool @ frames.board)
    fixed = _scatter_m(np.linalg.inv(frames.tool) @ camera @ frames.board)
    if fixed > CLEARLY * riding and np.isfinite(riding):
        problem = (
            "the camera rides on the tool and the board stands still, or the poses are the wrong way round "
            f"(they then agree to {1e3 * riding:.1f} mm, else to {1e3 * fixed:.0f} mm)"
        )
        mend = (
            "fix the camera and put the board on the tool (a capture knows one pose of its camera), and give "
            "the tool's poses in the world's axes"
        )
        raise FormatError(problem, file=path, place="arrangement", mend=mend)


def _refined(
    frames: _Frames, camera: Floats, held: Floats, board: Board, matrix: Floats
) -> tuple[Floats, Floats, float, float]:
    """Least squares on the corners; with standard deviations of place (where the board was) and turn."""
    about = np.mean((frames.tool @ held @ np.append(board.middle_m, 1.0))[:, :3], axis=0)

    def unpacked(values: Floats) -> tuple[Floats, Floats]:
        turned = np.eye(4)
        turned[:3, :3] = Rotation.from_rotvec(values[:3]).as_matrix()
        turned[:3, 3] = about - turned[:3, :3] @ about + values[3:6]
        return turned @ camera, held @ posed(values[6:])

    values, covariance = _fitted(frames, POSES, lambda values: _seen_from(frames, *unpacked(values), matrix))
    found, grip = unpacked(values)
    sd_rad, sd_m = (float(np.sqrt(np.trace(covariance[part, part]))) for part in (slice(3), slice(3, 6)))
    return found, grip, sd_m, sd_rad


def _doubts(frames: _Frames, camera: Floats, held: Floats, shots: Shots, board: Board) -> tuple[str, ...]:
    """Where the frames agree with another size of the board or another focal length, a line each.

    Both are free beside the poses: the robot's own way tells the one, perspective the other. A wrong one
    hides in the camera's place, and the frames' disagreement tells a tenth of what is off.
    """

    def seen(values: Floats) -> list[Floats]:
        size, focal = 1 + values[POSES:]
        matrix = shots.matrix * np.array([[focal, 1, 1], [1, focal, 1], [1, 1, 1]])
        eye, grip = camera @ posed(values[:6]), held @ posed(values[6:POSES])
        return _seen_from(frames, eye, grip, matrix, size)

    values, covariance = _fitted(frames, POSES + 2, seen)
    off, sd = values[POSES:], np.sqrt(np.diag(covariance))[POSES:]
    # a frame tells six numbers: the unknowns use up more than two frames
    doubted = np.abs(off) > np.maximum(DOUBTED, student.isf(CHANCE / 2, len(frames.seen) - 3) * sd)
    square, fx = (1 + off) * [board.model.square_m, shots.matrix[0, 0]]
    found = (
        ("board.json", "square_m", f"{square:.4g} m", "measure the printed squares, and marker_m"),
        ("capture.json", "camera.fx", f"{fx:.4g} pixels", "calibrate the camera, and straighten its images"),
    )
    lines = []
    for row in np.flatnonzero(doubted):
        file, place, value, mend = found[row]
        problem = f"the frames agree with {value}, {100 * off[row]:+.2f} ± {100 * sd[row]:.2f} %"
        lines.append(str(FormatError(problem, file=file, place=place, mend=mend)))
    return tuple(lines)


def _fitted(frames: _Frames, count: int, seen: Callable[[Floats], list[Floats]]) -> tuple[Floats, Floats]:
    """The unknowns, begun with 0, with which the corners are seen where they were found; their covariance.

    What a pose of the robot is off by all corners of its frame share: the covariance is that of clusters.
    """

    def residual(values: Floats) -> Floats:
        off = [(fitted - one.pixel).ravel() for fitted, one in zip(seen(values), frames.seen, strict=True)]
        return np.concatenate(off)

    fit = least_squares(residual, np.zeros(count), x_scale="jac", loss="cauchy", f_scale=CORNER_PX)
    jacobian = np.asarray(least_squares(residual, fit.x, max_nfev=1).jac)
    off = residual(fit.x)
    weight = 1 / (1 + (off / CORNER_PX) ** 2)
    bread = np.linalg.pinv(jacobian.T @ (weight[:, None] * jacobian))
    owner = np.repeat(np.arange(len(frames.seen)), [one.pixel.size for one in frames.seen])
    pulls = []
    for frame in range(len(frames.seen)):
        # a frame pulls the fit towards itself: without it its residual would be larger (CR3, a jackknife)
        own, light = jacobian[owner == frame], weight[owner == frame]
        held_back = np.eye(len(own)) - own @ bread @ (light[:, None] * own).T
        pulls.append(own.T @ (light * np.linalg.solve(held_back, off[owner == frame])))
    return fit.x, bread @ np.transpose(pulls) @ np.array(pulls) @ bread * (1 - 1 / len(pulls))


def _seen_from(
    frames: _Frames, camera: Floats, held: Floats, matrix: Floats, size: float = 1.0
) -> list[Floats]:
    """Where each frame's corners are seen [px], on a board `size` times as large as it is said to be."""
    poses = np.linalg.inv(camera) @ frames.tool @ held
    return [
        projected(pose, size * one.object_m, matrix) for pose, one in zip(poses, frames.seen, strict=True)
    ]


def _apart(frames: _Frames, camera: Floats, held: Floats, board: Board) -> tuple[Floats, Floats]:
    """Of each frame, how far [m] and by what angle [rad] the held and the seen board are apart."""
    middle = np.append(board.middle_m, 1.0)
    robot, eye = frames.tool @ held, camera @ frames.board
    apart = np.linalg.norm(((robot - eye) @ middle)[:, :3], axis=1)
    turn = Rotation.from_matrix(robot[:, :3, :3]).inv() * Rotation.from_matrix(eye[:, :3, :3])
    return np.asarray(apart), np.asarray(turn.magnitude())
