"""The chain of one frame: Algorithm 1 of the paper (Section V.A)."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dlolib.captures.base import Frame
from dlolib.chain.anchor import Anchor, anchors
from dlolib.chain.axis import Axis, assemble
from dlolib.chain.cleaning import without_specks
from dlolib.chain.cloud import view_of_cloud
from dlolib.chain.greedy import greedy_chain
from dlolib.chain.held import POSES, astray, turned
from dlolib.chain.join import from_held_ends, joined, may_be_joined
from dlolib.chain.lift import Strand, centred, lift
from dlolib.chain.order import in_order, unordered_m
from dlolib.chain.segment import coverage, segment
from dlolib.chain.settings import ChainSettings
from dlolib.chain.skeleton import centre_lines
from dlolib.chain.tip import without_caps
from dlolib.chain.uncertainty import covariances
from dlolib.chain.view import View
from dlolib.errors import ChainError
from dlolib.types import CaptureIndex, Floats, Rope

# Where so much of the rope's length was more than can be put in order, another order may be the right one.
MOST_UNORDERED = 0.1


@dataclass(frozen=True)
class FrameChain:
    """The chain of one frame and how far it can be trusted. World axes.

    s_m (K,), xyz_m (K, 3) and pixel (K, 2), the points that were seen; line_s_m (M,), line_m (M, 3) and
    line_seen (M,), the dense line they were sampled from. measured_m: length from end to end as
    measured, hidden stretches bridged; fitted: whether it agreed with the rope's length, so that s_m was
    brought to it; seen_share of the rope's length; depth_scatter_m, of single readings about the axis.
    covariance_m2 (K, 3, 3) of the points, but of a cloud's. counts: False where both ends are held and the
    length between them is not the rope's, where it is longer, or shorter with both ends free, or in more
    pieces than can be put in order (unordered_m, the length of those left): something else was taken for it,
    or a part of it left out. astray_m: how far from the rope the start and the end were logged, 0 where it
    agrees or cannot be told. turned_rad: by how much the rope leaves them in another direction than is
    logged, NaN where that is not seen. width_m: how wide the rope looks, and how many pixels that is. skin_m:
    about how far before the axis the points lie, 0 where the rope's radius is known. tips_m (2, 3): where
    what is seen of the rope begins and ends, wherever the held ends were logged.
    """

    frame: int
    t_s: float
    s_m: Floats
    xyz_m: Floats
    pixel: Floats
    line_s_m: Floats
    line_m: Floats
    line_seen: NDArray[np.bool_]
    measured_m: float
    fitted: bool
    seen_share: float
    depth_scatter_m: float
    covariance_m2: Floats | None = None
    counts: bool = True
    unordered_m: float = 0.0
    astray_m: tuple[float, float] = (0.0, 0.0)
    skin_m: float = 0.0
    turned_rad: tuple[float, float] = (np.nan, np.nan)
    width_m: float = np.nan
    width_px: float = 0.0
    tips_m: Floats = field(default_factory=lambda: np.full((2, 3), np.nan))


def chain_frame(
    frame: Frame, index: CaptureIndex, settings: ChainSettings, previous: FrameChain | None = None
) -> FrameChain:
    """Perceive the rope in one frame, as `extract_chain` does: frame in, chain out.

    Args:
        frame: what the camera saw.
        index: the camera, the rope and the motion of its held ends.
        settings: as for `extract_chain`.
        previous: the chain before, which tells the start of a rope with two free ends and, where strands
            cross, what goes on where.

    Raises:
        ChainError: the frame shows no rope.
    """
    view = _view(frame, index, settings)
    with ThreadPoolExecutor(1) as aside:
        aside.submit(getattr, view, "read")  # as long as the lines take
        lines, width = centre_lines(view.mask)
        start, end = anchors(frame, index)
        lines += from_held_ends(lines, width, view, start, end)
        grids = centred(lines, width, view, index.rope.radius_m, settings)
    before = None if previous is None else _camera(previous.line_m, index)
    strands, more_m = _strands(grids, width, view, (start, end), before, index.rope, settings)
    if not strands:
        raise _no_rope(frame, "nothing in it is long and narrow and has depth")
    tips = _world(np.array([strands[0].points_m[0], strands[-1].points_m[-1]]), index)
    if start is None and end is None and _starts_at_the_other(tips, previous):
        strands, tips = [strand.turned() for strand in strands[::-1]], tips[::-1]
    strands = without_caps(strands, start, end, view, index.rope.radius_m)
    axis = assemble(strands, start, end, index.rope.length_m, settings.bridge_m, settings.smooth_m)
    held = (start is not None) + (end is not None)
    whole = index.rope.length_m if axis.fitted or held else float(axis.s_m[-1])
    share = _seen_share(axis, index.rope.length_m)
    if share < settings.min_seen:
        raise _no_rope(
            frame, f"only {share:.1%} of the rope is seen, chain.min_seen is {settings.min_seen:.1%}"
        )
    s_m, points, pixel = greedy_chain(axis, whole / (settings.points - 1), settings.points)
    if not len(s_m):
        raise _no_point(frame, strands, (start, end), index.rope.length_m)
    scatter = float(np.median([strand.sigma_m for strand in strands]))
    skin_m = 0.0 if index.rope.radius_m else 0.5 * width * view.pitch
    return FrameChain(
        frame.frame,
        frame.t_s,
        s_m,
        _world(points, index),
        pixel,
        axis.s_m,
        _world(axis.points_m, index),
        axis.seen,
        axis.measured_m,
        axis.fitted,
        share,
        scatter,
        None if axis.sigma_m is None else _turned(covariances(axis, s_m, points, index.rope, skin_m), index),
        axis.counts(held, index.rope.length_m) and more_m <= MOST_UNORDERED * index.rope.length_m,
        more_m,
        astray(strands, start, end, view, skin_m),
        skin_m,
        turned(strands, start, end, skin_m),
        width * view.pitch,
        width,
        tips,
    )


def _strands(
    grids: list[Floats],
    width: float,
    view: View,
    ends: tuple[Anchor | None, Anchor | None],
    before_m: Floats | None,
    rope: Rope,
    settings: ChainSettings,
) -> tuple[list[Strand], float]:
    """What was seen of the rope, in order, and the length [m] of what was more than can be put in order. How
    a cut skeleton goes on, a first and rough look tells."""
    if len(grids) > 1 and may_be_joined(grids, width, view, *ends):
        some = lift(grids, width, view, rope.radius_m, settings, fine=False)
        rough = in_order(some, width, *ends, rope.length_m, before_m)
        on = joined(rough, width, view, *ends) if rough else None
        if on is not None:
            grids = centred(on, width, view, rope.radius_m, settings)
            return lift(grids, width, view, rope.radius_m, settings), unordered_m(some)
    some = lift(grids, width, view, rope.radius_m, settings)
    return in_order(some, width, *ends, rope.length_m, before_m), unordered_m(some)


def _view(frame: Frame, index: CaptureIndex, settings: ChainSettings) -> View:
    if frame.cloud_m is not None:
        try:
            view = view_of_cloud(frame.cloud_m)
        except ChainError as error:
            raise ChainError(error.problem, file=frame.file, mend=error.mend) from error
        return replace(view, mask=without_specks(view.mask))
    camera = index.camera
    assert frame.depth_m is not None and camera.fx is not None and camera.fy is not None
    assert camera.cx is not None and camera.cy is not None
    found = segment(frame, index, settings)
    covered = coverage(found)
    return View(found.mask, covered, frame.depth_m, camera.fx, camera.fy, camera.cx, camera.cy, found.levels)


def _world(points_m: Floats, index: CaptureIndex) -> Floats:
    view = index.camera.world_from_camera
    world: Floats = points_m @ view[:3, :3].T + view[:3, 3]
    return world


def _camera(points_m: Floats, index: CaptureIndex) -> Floats:
    view = index.camera.world_from_camera
    return np.asarray((points_m - view[:3, 3]) @ view[:3, :3])


def _turned(covariance_m2: Floats, index: CaptureIndex) -> Floats:
    turn = index.camera.world_from_camera[:3, :3]
    return np.asarray(turn @ covariance_m2 @ turn.T)


def _starts_at_the_other(tips: Floats, previous: FrameChain | None) -> bool:
    """Whether the second tip (2, 3) is the start: the one nearer to the previous start, or of smaller x."""
    if previous is None:
        return bool(tips[1, 0] < tips[0, 0])
    near = np.linalg.norm(tips - previous.line_m[0], axis=1)
    return bool(near[1] < near[0])


def _seen_share(axis: Axis, whole_m: float) -> float:
    seen = axis.seen[1:] & axis.seen[:-1]
    return float(min(np.diff(axis.s_m)[seen].sum() / whole_m, 1.0))


def _no_point(
    frame: Frame, strands: list[Strand], ends: tuple[Anchor | None, Anchor | None], length_m: float
) -> ChainError:
    """Why a line has no points: a held end is out of the rope's reach, or all that is seen is too short."""
    tips_m = strands[0].points_m[0], strands[-1].points_m[-1]
    held = [(tip, end) for tip, end in zip(tips_m, ends, strict=True) if end is not None]
    off_m = max((float(np.linalg.norm(tip - end.place_m)) for tip, end in held), default=0.0)
    if off_m <= length_m:
        return _no_rope(frame, "what is long and narrow in it is too short for a chain's spacing")
    problem = f"the rope is seen {off_m:.3g} m from where a held end is logged, and is {length_m:.3g} m long"
    return ChainError(problem, file=frame.file, place=f"frame {frame.frame}", mend=POSES)


def _no_rope(frame: Frame, why: str) -> ChainError:
    return ChainError(
        f"no rope found: {why}",
        file=frame.file,
        place=f"frame {frame.frame}",
        mend="remove the frame, or say what the rope is: give rope_color_hsv, a background or a mask",
    )
