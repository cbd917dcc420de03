"""Checks of what was observed against the rest; places against the length most often find millimetres."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dlolib.errors import FormatError
from dlolib.formats._schema import MILLIMETRES
from dlolib.formats.geometry import signed_distance
from dlolib.types import Ends, Floats, Ints, Motion, Obstacle, Points, Rope

# A rope of length L fits in a sphere of radius L about any of its points. Lengths are often measured
# a few per cent short, hence the slack; a factor of a thousand is far beyond the second bound.
SLACK = 1.25
MUCH, OF_MILLIMETRES = 20.0, 150.0
CENTIMETRES = "looks like centimetres; divide by 100"


def check_ends(motion: Motion, ends: Ends, rope: Rope, path: Path) -> None:
    """Refuse held ends without a pose, free ends with one, and ends further apart than the rope's length."""
    for end, kind, place in (("start", ends.start, motion.start_m), ("end", ends.end, motion.end_m)):
        empty = bool(np.isnan(place).all())
        if kind == "clamped" and empty:
            raise FormatError(
                f"has no pose of the clamped {end}",
                file=path,
                place=f"column {end}_x_m",
                mend=f'fill the columns of {end} or call it "free"',
            )
        if kind == "free" and not empty:
            raise FormatError(
                f"gives a pose of the free {end}",
                file=path,
                place=f"column {end}_x_m",
                mend=f'empty the columns of {end} or call it "clamped"',
            )
    apart = np.linalg.norm(motion.end_m - motion.start_m, axis=1)
    if not np.isfinite(apart).all():
        return
    worst = int(np.argmax(apart))
    if apart[worst] > SLACK * rope.length_m:
        raise _too_far(
            f"the ends are {apart[worst]:.4g} m apart", apart[worst], rope, path, when(motion, worst)
        )


def check_clear(motion: Motion, obstacles: Sequence[Obstacle], path: Path) -> None:
    """Refuse an obstacle that a held end, the middle of the rope there, is inside of."""
    for number, obstacle in enumerate(obstacles):
        for end, place in (("start", motion.start_m), ("end", motion.end_m)):
            clear = signed_distance(obstacle, place)
            if np.isnan(clear).all():
                continue
            worst = int(np.nanargmin(clear))
            if clear[worst] < 0:
                raise FormatError(
                    f"the clamped {end} is {-1e3 * clear[worst]:.1f} mm inside obstacle {number} "
                    f"({obstacle.shape})",
                    file=path,
                    place=when(motion, worst),
                    mend="move the obstacle or the clamp, whose middle must be 0 mm or more outside",
                )


def when(motion: Motion, row: int) -> str:
    """The place of a row in motion.csv by its time; its line is not known, tables may have gaps."""
    return f"t_s = {motion.t_s[row]:.12g}"


def check_ranges(
    static: tuple[int, int] | None, heldout: tuple[int, int] | None, frame: Ints, table: str, path: Path
) -> None:
    """Refuse ranges of frames that are turned round or name no frame of the table."""
    for key, span in (("static_frames", static), ("heldout_frames", heldout)):
        if span is None:
            continue
        if span[1] < span[0]:
            raise FormatError(
                f"{list(span)} ends before it begins", file=path, place=key, mend="give [first, last]"
            )
        if not ((frame >= span[0]) & (frame <= span[1])).any():
            problem = f"{list(span)} names no frame of {table}"
            raise FormatError(problem, file=path, place=key, mend="give [first, last] or null")


def check_places(frame: Ints, s_m: Floats, xyz_m: Floats, rope: Rope, path: Path, lines: Ints) -> None:
    """Refuse arc lengths outside the rope and frames that are wider than the rope is long."""
    bad = np.flatnonzero((s_m < -1e-9) | (s_m > rope.length_m * 1.001))
    if bad.size:
        row = int(bad[0])
        problem = f"s_m = {s_m[row]:g} is outside the rope of {rope.length_m:g} m"
        far = s_m[row] > MUCH * rope.length_m
        mend = MILLIMETRES if far else "give the arc length from the start in metres"
        raise FormatError(problem, file=path, place=f"line {lines[row]}, column s_m", mend=mend)
    first = np.searchsorted(frame, np.unique(frame))
    sizes = np.diff(np.append(first, len(frame)))
    middles = [
        np.median(xyz_m[begin : begin + size], axis=0) for begin, size in zip(first, sizes, strict=True)
    ]
    away = np.linalg.norm(xyz_m - np.repeat(np.array(middles), sizes, axis=0), axis=1)
    worst = int(np.argmax(away))
    if away[worst] > SLACK * rope.length_m:
        problem = f"the point lies {away[worst]:.4g} m from the middle of its frame"
        raise _too_far(problem, away[worst], rope, path, f"line {lines[worst]}")


def check_extent(points: Points, motion: Motion, rope: Rope, path: Path) -> None:
    """Refuse a rope that is many times as long as all that was seen of it, held ends included, is wide."""
    places = np.concatenate([points.xyz_m, motion.start_m, motion.end_m])
    wide_m = float(np.linalg.norm(np.nanmax(places, axis=0) - np.nanmin(places, axis=0)))
    seen_m = max(wide_m, float(points.s_m.max()))
    if rope.length_m > MUCH * seen_m:
        problem = f"{rope.length_m:g} m, and all that was seen of it is within {seen_m:.3g} m"
        mend = "correct it; give metres"
        raise FormatError(problem, file=path, place="object.length_m", mend=mend)


def check_meeting(held_m: Floats, s_m: Floats, xyz_m: Floats, rope: Rope, path: Path) -> None:
    """Refuse a motion whose held end (P, 3) is not near the points (P, 3) observed at the same time."""
    away = np.linalg.norm(held_m - xyz_m, axis=1)
    if not len(away) or not np.isfinite(away).all():
        return
    worst = int(np.argmax(away))
    if away[worst] > 2 * SLACK * rope.length_m:
        problem = f"a held end is {away[worst]:.4g} m from the point seen at s_m = {s_m[worst]:g}"
        raise _too_far(problem, away[worst], rope, path, None)


def _too_far(problem: str, distance: float, rope: Rope, path: Path, place: str | None) -> FormatError:
    many = distance / rope.length_m
    mend = "correct the positions or length_m"
    if many > MUCH:
        mend = MILLIMETRES if many > OF_MILLIMETRES else CENTIMETRES
    return FormatError(f"{problem}, on a rope of {rope.length_m:g} m", file=path, place=place, mend=mend)
