"""From a capture to a recording: Algorithm 1 of the paper (Section V.A), frame by frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dlolib.captures.base import Source
from dlolib.chain.clock import clocks_apart
from dlolib.chain.frame import MOST_UNORDERED, FrameChain
from dlolib.chain.held import POSES, off_together
from dlolib.chain.many import chains_of
from dlolib.chain.settings import ChainSettings
from dlolib.chain.uncertainty import noise_of
from dlolib.errors import ChainError
from dlolib.formats.doubts import say
from dlolib.progress import track
from dlolib.types import CaptureIndex, Floats, Motion, Points, Recording

# Looked up anew at the clocks' offset, the held ends tell what is left of it, as often as this.
PASSES = 3
# A warning names no more frames than this.
MOST_NAMED = 8
# A rope of which so much is seen between two held ends has another length than was said where all frames
# agree in it to so much and it is so far off: shares of its length.
WHOLE, SAME, OTHER = 0.95, 0.003, 0.01
UNTANGLE = "record it with fewer crossings, or with less else in view"
# A rope that leaves its clamp as logged does so within this, bent as it may be; one that is as wide as was
# said looks so within these factors, where it is, or should be, so many pixels wide.
ANOTHER_WAY_RAD = 1.0
LEAST_WIDE, MOST_WIDE, WIDE_ENOUGH_PX = 0.6, 1.5, 4.0


@dataclass(frozen=True)
class ChainResult:
    """The recording, the chain of each frame that shows a rope, how they were found, and how many frames show
    none. The recording has no points of frames whose chain does not count.

    clocks_apart_s: by how much later than logged the held ends were taken to be where they were logged; the
    recording's own clocks stay.
    """

    recording: Recording
    frames: tuple[FrameChain, ...]
    settings: ChainSettings
    clocks_apart_s: float
    without_rope: int = 0

    def metrics(self) -> Mapping[str, float | int]:
        """Figures of the whole: lengths in m, shares of 1."""
        lengths = np.array([frame.measured_m for frame in self.frames])
        spacing = np.concatenate([_spacing_errors(frame) for frame in self.frames])
        return {
            "frames": len(self.frames) + self.without_rope,
            "points": len(self.recording.points.s_m),
            "seen_share_mean": float(np.mean([frame.seen_share for frame in self.frames])),
            "seen_share_min": float(min(frame.seen_share for frame in self.frames)),
            "measured_length_mean_m": float(lengths.mean()),
            "measured_length_sd_m": float(lengths.std()),
            "frames_at_known_length": sum(frame.fitted for frame in self.frames),
            "frames_left_out": self.without_rope + sum(not frame.counts for frame in self.frames),
            "spacing_error_max": float(np.abs(spacing).max(initial=0.0)),
            "clocks_apart_s": self.clocks_apart_s,
            "depth_scatter_m": float(np.median([frame.depth_scatter_m for frame in self.frames])),
        }


def extract_chain(source: Source, settings: ChainSettings | None = None) -> ChainResult:
    """Perceive the rope in every frame of a capture as a chain of points on its axis.

    Args:
        source: an opened capture.
        settings: n and the choices of segmentation and smoothing; None takes the defaults.

    Returns:
        The recording, whose points are ordered by frame and arc length, and the frames' own chains.

    Raises:
        ChainError: no frame shows a rope, or none has one of the known length; names capture, frame and mend.
        FormatError: a frame cannot be read.
    """
    settings = settings or ChainSettings()
    late_s = more_s = 0.0
    for _ in range(PASSES):
        late_s += more_s
        index = _later(source.index, late_s)
        frames = track(source.frames(), f"chain of {index.name}", len(index.frame))
        found = chains_of(frames, index, settings)
        chains = found.chains
        if not chains:
            raise found.refused[0]
        more_s = clocks_apart(chains, index)
        if more_s == 0.0:
            break
    doubts = [*_without_rope(found.refused, index.name), *_doubts(chains, source.index)]
    say([*doubts, *_late(late_s, source.index)])
    recording = _recording(source.index, [chain for chain in chains if chain.counts], settings)
    return ChainResult(recording, tuple(chains), settings, late_s, len(found.refused))


def _without_rope(refused: Sequence[ChainError], name: str) -> Iterator[str]:
    """The frames that show no rope, and what is wrong with the first."""
    if refused:
        more = len(refused) - 1
        others = f", and {more} more frame{'s' * (more > 1)} like it" if more else ""
        yield f"{name}: left out: {refused[0]}{others}"


def _late(late_s: float, index: CaptureIndex) -> Iterator[str]:
    """By how much the held ends were logged at another time than they were seen [s]."""
    if late_s:
        where = f"the held ends are seen at t where the robot logged them at t - ({late_s:.3f} s)"
        yield f"{index.name}: {where}: arc lengths count by that, times stay; correct t_s in motion.csv"


def _doubts(chains: Sequence[FrameChain], index: CaptureIndex) -> Iterator[str]:
    """What is to be said of a rope without diameter, of held ends away from it, of a length that no frame
    bears out, and of frames in which it has not its length.

    Raises:
        ChainError: no frame counts.
    """
    known, file = index.rope.length_m, index.folder / "capture.json"
    lost = [chain for chain in chains if not chain.counts]
    astray = list(_astray(chains))
    if len(lost) == len(chains):
        astray = [*_far_astray(chains, index), *astray]
    if astray and len(lost) == len(chains):
        raise ChainError(astray[0], file=file, place="camera.world_from_camera", mend=POSES)
    tangled = [chain for chain in lost if chain.unordered_m > MOST_UNORDERED * known]
    if len(tangled) == len(chains):
        raise ChainError(_tangled(tangled), file=index.folder, place="chain", mend=UNTANGLE)
    if len(lost) == len(chains):
        raise ChainError(
            f"the rope is {known:.3f} m long, and in every frame {_lengths(lost)}",
            file=file,
            place="object.length_m",
            mend="correct it, object.diameter_m, or what is taken for the rope (chain.segmentation)",
        )
    skin_m = float(np.median([chain.skin_m for chain in chains]))
    if skin_m > 0:
        lie = f"the points lie on the skin, about {1e3 * skin_m:.1f} mm before the axis"
        yield f"{index.name}: object.diameter_m is not given: {lie}"
    for where in astray:
        yield f"{index.name}: {where}; {POSES}"
    yield from _turned(chains, index)
    yield from _has_another_width(chains, index)
    if not astray and _has_another_length(chains, index):
        measured_m = float(np.median([chain.measured_m for chain in chains]))
        says = f"every frame measures {measured_m:.3f} m, object.length_m says {known:.3f} m"
        yield f"{index.name}: {says}; correct it, or the camera's optics"
    if tangled:
        yield f"{index.name}: {_tangled(tangled)}; left out, {UNTANGLE}"
        lost = [chain for chain in lost if chain.unordered_m <= MOST_UNORDERED * known]
    if lost:
        free = "free" in (index.ends.start, index.ends.end)
        elsewhere = ", so its held ends were elsewhere then, or a part of it was not seen"
        unseen = all(chain.measured_m < known for chain in lost)
        why = f", so {'a tip was not seen' if unseen else 'something else is taken for a part of it'}"
        why = why if free else elsewhere
        says = f"the rope is {known:.3f} m long, and {_named(lost)}{why}"
        yield f"{index.name}: {says}; left out, look at sheet.png"
    off = [chain for chain in chains if chain.counts and not chain.fitted]
    short = [chain for chain in off if chain.measured_m < known]
    if short:
        yield f"{index.name}: of a rope of {known:.3f} m only {_named(short)}; counted from what was seen"
    longer = [chain for chain in off if chain.measured_m >= known]
    if longer:
        yield f"{index.name}: of a rope of {known:.3f} m {_named(longer)}; check object.length_m"


def _has_another_length(chains: Sequence[FrameChain], index: CaptureIndex) -> bool:
    """Whether all frames see the whole rope between its held ends, and agree in another length than known."""
    known, lengths = index.rope.length_m, np.array([chain.measured_m for chain in chains])
    both = index.ends.start == index.ends.end == "clamped"
    whole = all(chain.seen_share >= WHOLE for chain in chains)
    same = float(np.abs(lengths - np.median(lengths)).max()) <= SAME * known
    return both and whole and same and abs(float(np.median(lengths)) - known) > OTHER * known


def _astray(chains: Sequence[FrameChain]) -> Iterator[str]:
    """The held ends that in most frames are away from the rope."""
    off_m = np.median([chain.astray_m for chain in chains], axis=0)
    most = np.mean([np.array(chain.astray_m) > 0 for chain in chains], axis=0) > 0.5
    for number, end in enumerate(("start", "end")):
        if most[number]:
            yield f"the held {end} is logged {1e3 * off_m[number]:.0f} mm from where the rope is seen"


def _far_astray(chains: Sequence[FrameChain], index: CaptureIndex) -> Iterator[str]:
    """That both held ends are away from the rope by the same in most frames, however far."""
    if index.ends.start == index.ends.end == "clamped":
        tips_m, t_s = np.array([chain.tips_m for chain in chains]), np.array([chain.t_s for chain in chains])
        off_m = off_together(tips_m, t_s, index)
        if np.isfinite(off_m).mean() > 0.5:
            yield f"both held ends are logged {1e3 * np.nanmedian(off_m):.0f} mm from where the rope is seen"


def _turned(chains: Sequence[FrameChain], index: CaptureIndex) -> Iterator[str]:
    """The held ends that the rope leaves in another direction than is logged, in most frames that show it."""
    for number, end in enumerate(("start", "end")):
        seen = np.array([chain.turned_rad[number] for chain in chains])
        seen = seen[np.isfinite(seen)]
        if len(seen) and float(np.median(seen)) > ANOTHER_WAY_RAD:
            off = f"by {np.rad2deg(np.median(seen)):.0f} degrees in another direction than {end}_q says"
            mend = "correct motion.csv: a pose's third axis is the rope's tangent, from start to end"
            yield f"{index.name}: at its held {end} the rope is seen to run {off}; {mend}"


def _has_another_width(chains: Sequence[FrameChain], index: CaptureIndex) -> Iterator[str]:
    """A diameter that the pictures do not bear out: the axis is put half of it behind the skin."""
    known = index.rope.diameter_m
    if known is None:
        return
    wide = [
        chain.width_m
        for chain in chains
        if chain.width_px * max(1.0, known / chain.width_m) >= WIDE_ENOUGH_PX
    ]
    if len(wide) <= len(chains) / 2:
        return
    looks = float(np.median(wide))
    if not LEAST_WIDE * known < looks < MOST_WIDE * known:
        says = f"the rope looks {1e3 * looks:.1f} mm wide, object.diameter_m says {1e3 * known:.1f}"
        yield f"{index.name}: {says}; correct it, or what is taken for the rope (chain.segmentation)"


def _lengths(chains: Sequence[FrameChain]) -> str:
    told = [f"{pick(chain.measured_m for chain in chains):.3g}" for pick in (min, max)]
    return f"{' to '.join(dict.fromkeys(told))} m were measured"


def _tangled(chains: Sequence[FrameChain]) -> str:
    frames = _frames(chains)
    return f"more stretches of rope are seen than can be put in order in frame{frames}"


def _named(chains: Sequence[FrameChain]) -> str:
    return f"{_lengths(chains)} in frame{_frames(chains)}"


def _frames(chains: Sequence[FrameChain]) -> str:
    """The first of these frames, to be read after "frame"."""
    frames = ", ".join(str(chain.frame) for chain in chains[:MOST_NAMED])
    more = len(chains) - MOST_NAMED
    return f"{'s' * (len(chains) > 1)} {frames}" + (f" and {more} more" if more > 0 else "")


def _later(index: CaptureIndex, late_s: float) -> CaptureIndex:
    """The ends where they were logged so much earlier [s]."""
    if index.motion is None or late_s == 0.0:
        return index
    return replace(index, motion=replace(index.motion, t_s=index.motion.t_s + late_s))


def _spacing_errors(frame: FrameChain) -> Floats:
    """Way along the line from point to point, as a share of their difference in arc length, less one.

    Only neighbours count: no hidden stretch lies between them.
    """
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(frame.line_m, axis=0), axis=1))])
    step = np.diff(frame.s_m)
    near = step < 1.5 * np.median(step) if len(step) else np.zeros(0, dtype=np.bool_)
    error: Floats = (np.diff(np.interp(frame.s_m, frame.line_s_m, way)) / step - 1)[near]
    return error


def _recording(index: CaptureIndex, chains: list[FrameChain], settings: ChainSettings) -> Recording:
    counts = [len(chain.s_m) for chain in chains]
    given = [chain.covariance_m2 for chain in chains if chain.covariance_m2 is not None]
    covariance = np.concatenate(given) if len(given) == len(chains) > 0 else None
    spacing = index.rope.length_m / (settings.points - 1)
    points = Points(
        np.repeat(np.array([chain.frame for chain in chains], dtype=np.int64), counts),
        np.repeat(np.array([chain.t_s for chain in chains]), counts),
        np.concatenate([chain.s_m for chain in chains]),
        np.concatenate([chain.xyz_m for chain in chains]),
        covariance,
    )
    return Recording(
        name=index.name,
        rope=index.rope,
        gravity_m_s2=index.gravity_m_s2,
        ends=index.ends,
        motion=index.motion or _free_motion(index.t_s),
        points=points,
        obstacles=index.obstacles,
        source=index.source,
        note=index.note,
        quasi_static=index.quasi_static,
        world_from_camera=index.camera.world_from_camera,
        static_frames=_left_of(index.static_frames, chains),
        heldout_frames=_left_of(index.heldout_frames, chains),
        rate_hz=index.rate_hz,
        noise=None if covariance is None else noise_of(covariance, settings.smooth_m, spacing),
    )


def _left_of(span: tuple[int, int] | None, chains: list[FrameChain]) -> tuple[int, int] | None:
    """A range of frames, if any of them counts."""
    return span if span and any(span[0] <= chain.frame <= span[1] for chain in chains) else None


def _free_motion(t_s: Floats) -> Motion:
    """The motion of two free ends: their poses are not known at any time."""
    place, turn = np.full((len(t_s), 3), np.nan), np.full((len(t_s), 4), np.nan)
    return Motion(t_s, place, turn, place, turn)
