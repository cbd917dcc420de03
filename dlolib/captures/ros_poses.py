"""Poses in ROS messages: PoseStamped, TransformStamped, and a frame of tf."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dlolib.captures.bag import Bag, stamp_s
from dlolib.captures.clock import falls
from dlolib.captures.poses import transforms
from dlolib.errors import FormatError
from dlolib.formats import interpolate_motion
from dlolib.types import Floats, Motion

POSE, TRANSFORM, TF = (
    f"{package}_msgs/msg/{name}"
    for package, name in (
        ("geometry", "PoseStamped"),
        ("geometry", "TransformStamped"),
        ("tf2", "TFMessage"),
    )
)
KINDS = (POSE, TRANSFORM, TF, "tf/msg/tfMessage")
# A row: time [s], position [m], quaternion (w, x, y, z).
Row = tuple[float, ...]
# A link of tf: the parents that were logged, one unless something is wrong, and the poses over time.
Link = tuple[list[str], Floats]


@dataclass(frozen=True)
class Logged:
    """Poses (T, 4, 4) at t_s (T,) [s] of a body in the axes of a frame; a name may be empty."""

    t_s: Floats
    poses: Floats
    frame: str
    body: str


def choices(bag: Bag) -> list[str]:
    """What `poses` takes, for a question: the topics of poses, those of tf with their frames."""
    listed = []
    trees = [topic for topic, kind in bag.types.items() if kind in KINDS[2:]]
    moving = [topic for topic in trees if not topic.endswith("static")]
    for topic, kind in sorted(bag.types.items()):
        if kind in (POSE, TRANSFORM):
            listed.append(topic)
        elif topic in (moving or trees):
            listed += [f"{topic}:{frame}" for frame in sorted(_links(bag))]
    return listed


def poses(bag: Bag, name: str, role: str) -> Logged:
    """The poses of a topic, or as `/tf:frame` of a frame in the root of its tree.

    Raises:
        FormatError: no such topic or frame, poses in several frames or of several bodies, or a pose that is
            none.
    """
    topic, _, frame = name.partition(":")
    frame = frame.lstrip("/")
    kind = bag.types.get(topic)
    listed = ", ".join(choices(bag))
    place = f"--topic {role}={name}"
    mend = f"choose from {listed}" if listed else "leave it out: the bag holds no poses"
    if kind not in KINDS:
        problem = "no such topic" if kind is None else f"is of type {kind}, no pose"
        raise FormatError(problem, file=bag.path, place=place, mend=mend)
    if kind in (POSE, TRANSFORM):
        rows, frames, bodies = [], set(), set()
        for _, _, logged, message in bag.messages([topic]):
            rows.append(_row(message, logged))
            frames.add(message.header.frame_id.lstrip("/"))
            bodies.add(getattr(message, "child_frame_id", "").lstrip("/"))
        if len(frames) > 1:
            problem = f"its poses are in several frames: {', '.join(map(repr, sorted(frames)))}"
            raise FormatError(problem, file=bag.path, place=topic, mend="give them in one")
        if len(bodies) > 1:
            problem = f"its poses are of several bodies: {', '.join(map(repr, sorted(bodies)))}"
            mend = "record each on a topic of its own, or in tf"
            raise FormatError(problem, file=bag.path, place=topic, mend=mend)
        checked = _checked(bag, np.array(rows).reshape(-1, 8), topic)
        return Logged(*checked, "".join(frames), "".join(bodies))
    links = _links(bag)
    if frame not in links:
        raise FormatError(f"no frame {frame!r}", file=bag.path, place=place, mend=mend)
    return _composed(bag, links, frame)


def other_frame(bag: Bag, name: str, images: str) -> str | None:
    """What `poses` takes for the images' own frame, where another frame of tf was named; else None."""
    topic, _, frame = name.partition(":")
    apart = bool(frame) and frame.lstrip("/") != images
    return f"{topic}:{images}" if apart and bag.types.get(topic) in KINDS and images in _links(bag) else None


def _row(message: Any, logged_ns: int) -> Row:
    if hasattr(message, "transform"):
        place, turn = message.transform.translation, message.transform.rotation
    else:
        place, turn = message.pose.position, message.pose.orientation
    return (stamp_s(message, logged_ns), place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z)


def _checked(bag: Bag, rows: Floats, place: str) -> tuple[Floats, Floats]:
    if not len(rows):
        raise FormatError("has no message", file=bag.path, place=place, mend="name another topic")
    # republished poses repeat their stamp; the first is kept
    fresh = np.concatenate([[True], np.diff(rows[:, 0]) != 0])
    rows = rows[fresh]
    back = np.flatnonzero(np.diff(rows[:, 0]) < 0)
    if back.size:
        problem = falls(float(rows[back[0], 0]), float(rows[back[0] + 1, 0])) or ""
        raise FormatError(problem, file=bag.path, place=place, mend="mend the clock or the order")
    return rows[:, 0], transforms(rows[:, 1:4], rows[:, 4:], bag.path, place)


def _links(bag: Bag) -> dict[str, Link]:
    """Every frame's parents and rows (T, 8) in them; a static one has one row."""
    topics = [topic for topic, kind in bag.types.items() if kind in KINDS[2:]]
    parents: dict[str, list[str]] = {}
    rows: dict[str, list[Row]] = {}
    for _, _, logged_ns, message in bag.messages(topics) if topics else ():
        for transform in message.transforms:
            child = transform.child_frame_id.lstrip("/")
            parent = transform.header.frame_id.lstrip("/")
            if parent not in parents.setdefault(child, []):
                parents[child].append(parent)
            rows.setdefault(child, []).append(_row(transform, logged_ns))
    return {child: (parents[child], np.array(rows[child])) for child in parents}


def _composed(bag: Bag, links: dict[str, Link], frame: str) -> Logged:
    """A frame's poses in its root, at the times of the link that was logged most often."""
    chain, root = _upwards(bag, links, frame)
    times, _ = max(chain, key=lambda link: len(link[0]))
    product = np.tile(np.eye(4), (len(times), 1, 1))
    for own, logged in chain:
        product = _at(own, logged, times) @ product
    return Logged(times, product, root, frame)


def _upwards(bag: Bag, links: dict[str, Link], frame: str) -> tuple[list[tuple[Floats, Floats]], str]:
    """Times and poses of each link from a frame to its root, and that root's name."""
    seen, chain = set(), []
    while frame in links:
        place = f"tf, frame {frame}"
        if frame in seen:
            raise FormatError("its frames form a ring", file=bag.path, place=place, mend="record tf anew")
        seen.add(frame)
        parents, rows = links[frame]
        if len(parents) > 1:
            problem = f"hangs on several frames: {', '.join(map(repr, parents))}"
            mend = "record it below one, or name a topic of poses"
            raise FormatError(problem, file=bag.path, place=place, mend=mend)
        chain.append(_checked(bag, rows, place))
        frame = parents[0]
    return chain, frame


def _at(own_s: Floats, logged: Floats, times: Floats) -> Floats:
    """The poses of a link at other times [s], positions linearly and turns by slerp, ends held."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(logged[:, :3, :3]).as_quat(scalar_first=True)
    signs = np.where(np.sum(turn[1:] * turn[:-1], axis=1) < 0, -1.0, 1.0)
    turn[1:] *= np.cumprod(signs)[:, None]
    place = logged[:, :3, 3]
    between = interpolate_motion(Motion(own_s, place, turn, place, turn), times)
    found = np.tile(np.eye(4), (len(times), 1, 1))
    found[:, :3, :3] = Rotation.from_quat(between.start_q, scalar_first=True).as_matrix()
    found[:, :3, 3] = between.start_m
    return found
