"""How right the chain is on ropes whose axis is known: reports/chain_bench.json (`make chain-bench`).

Every figure stands with its goal and with how it was measured; one that misses its goal stays in the table.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dlolib.captures.base import Frame
from dlolib.chain import ChainSettings, FrameChain, chain_frame
from dlolib.chain.many import chains_of
from dlolib.chain.uncertainty import noise_of
from dlolib.errors import ChainError
from dlolib.files import write_json
from dlolib.params import Chain, load_block
from dlolib.types import CaptureIndex, Motion
from stages import REPORTS, known, run
from stages.chain_score import Score, score
from stages.chain_views import CASES, DRAWN, FRAMES, Case, Take, takes

# Goals of the axis RMS [mm]; those of the rest hold for all rows but the hard ones.
AXIS_MM = {"clear": 0.6, "clear_bias": 1.2}
HARD = ("pillar", "gripper", "crossing", "start_out_of_frame", "end_out_of_frame", "drawn")
OTHER_AXIS_MM, HARD_AXIS_MM = 1.0, 1.5
ARC_MM, HARD_ARC_MM = 3.0, 8.0
FRAMES_A_SECOND = 30.0
IN_ELLIPSOID, CHI2_3, LAG_TOLERANCE = (0.90, 0.98), 7.815, 0.2
TIMED, TIMED_TOGETHER = ("clear", "crossing", "gripper"), ("clear", "crossing")
REPEATS, TOGETHER = 3, 400
HOW = {
    "axis_rms_mm": "distance of the points from the true axis, root mean square",
    "arc_rms_mm": "arc length of the points less that of the axis beside them, root mean square",
    "spacing_percent": "distance of neighbours over the true one at their arc lengths, less one, largest",
    "order": "share of frames whose points follow each other along the rope, none 30 mm off",
    "completeness": "share of the visible axis within 10 mm of the chain, mean of the frames",
    "stray": "points further than 10 mm from the axis",
    "invented": "points deeper than 3 mm in a hidden stretch",
    "in_ellipsoid": "share of points whose 95 % ellipsoid holds the axis at their arc length",
    "point_lag": "correlation of whitened errors of neighbours less the one of recording.json: noise",
    "frame_lag": "the same of two frames that follow each other in the laboratory's default capture",
    "frames_a_second": f"one over the time of a frame of 640 x 576 alone, best of {REPEATS}",
    "frames_together": f"frames a second of a capture of {TOGETHER}, the start of processes included",
}


@dataclass(frozen=True)
class Row:
    """The scores of a case's frames, the time of each [s] where it was measured, alone and in a long capture,
    and what correlation from point to point and from frame to frame the chain foretells."""

    case: Case
    scores: list[Score]
    refused: list[str]
    hidden: tuple[float, float]
    frame_s: dict[str, float]
    correlation: tuple[float, float]


def main(*names: str) -> None:
    """Measure all cases, or those named, which then are printed only."""
    known(names, [case.name for case in CASES], "case")
    settings = ChainSettings(**load_block(Chain).model_dump())
    rows = []
    for case in CASES:
        if names and case.name not in names:
            continue
        print(f"measuring {case.name}", file=sys.stderr)
        rows.append(measure(case, settings))
    table = {row.case.name: figures(row) for row in rows}
    for line in lines(table):
        print(line)
    if not names:
        write_json(REPORTS / "chain_bench.json", {"command": "make chain-bench", "how": HOW, "cases": table})


def measure(case: Case, settings: ChainSettings) -> Row:
    """Render a case and hold the chain of each of its frames against the truth."""
    shots, scores, refused = list(takes(case)), [], []
    previous: FrameChain | None = None
    for shot in shots:
        try:
            before = None if case.shapes == "drawn" else previous
            previous = chain_frame(shot.frame, shot.index, settings, before)
        except ChainError as error:
            refused.append(str(error))
            continue
        scores.append(score(previous, shot.s_m, shot.axis_m, shot.visible, settings.points))
    hidden = [1 - float(shot.visible.mean()) for shot in shots]
    timed = {}
    if case.name in TIMED and not refused:
        timed["frames_a_second"] = seconds_a_frame(shots, settings)
    if case.name in TIMED_TOGETHER and not refused:
        timed["frames_together"] = seconds_a_frame_together(shots, settings)
    spacing = shots[0].index.rope.length_m / (settings.points - 1)
    noise = noise_of(np.eye(3)[None], settings.smooth_m, spacing)
    foretold = (float(np.exp(-1 / noise.correlation_points)), float(np.exp(-1 / noise.correlation_frames)))
    return Row(case, scores, refused, (min(hidden), max(hidden)), timed, foretold)


def seconds_a_frame(shots: Sequence[Take], settings: ChainSettings) -> float:
    """Least time for a frame [s], on all cores of a machine that is otherwise idle."""
    best = np.inf
    for _ in range(REPEATS):
        begin = time.perf_counter()
        for shot in shots:
            chain_frame(shot.frame, shot.index, settings)
        best = min(best, (time.perf_counter() - begin) / len(shots))
    return float(best)


def seconds_a_frame_together(shots: Sequence[Take], settings: ChainSettings) -> float:
    """Time for a frame [s] of a long capture, its processes' start included."""
    frames, index = to_and_fro(shots, TOGETHER)
    begin = time.perf_counter()
    chains_of(frames, index, settings)
    return (time.perf_counter() - begin) / len(frames)


def to_and_fro(shots: Sequence[Take], count: int) -> tuple[list[Frame], CaptureIndex]:
    """A capture of so many frames of a rope that goes through these shapes and back, again and again; nothing
    else is in view."""
    shapes = np.resize([*range(len(shots)), *reversed(range(len(shots)))], count)
    frames = [replace(shots[k].frame, frame=row, t_s=float(k)) for row, k in enumerate(shapes)]
    poses = {
        name: np.array([getattr(shot.index.motion, name)[0] for shot in shots])
        for name in ("start_m", "start_q", "end_m", "end_q")
    }
    motion = Motion(np.arange(len(shots), dtype=np.float64), **poses)
    return frames, replace(shots[0].index, frame=np.arange(count), t_s=np.arange(count) / 30, motion=motion)


def figures(row: Row) -> dict[str, Any]:
    """Value, goal and whether it is met, for each figure of a row."""
    hard = row.case.name in HARD
    found = row.scores
    off, arc, spacing = (_all(getattr(one, key) for one in found) for key in ("off_m", "arc_m", "spacing"))
    frames = len(found) + len(row.refused)
    table = {
        "axis_rms_mm": _most(
            1e3 * _rms(off), AXIS_MM.get(row.case.name, HARD_AXIS_MM if hard else OTHER_AXIS_MM)
        ),
        "arc_rms_mm": _most(1e3 * _rms(arc), HARD_ARC_MM if hard else ARC_MM),
        "spacing_percent": _most(100 * float(np.abs(spacing).max(initial=0.0)), 3.0),
        "order": _least(sum(one.ordered for one in found) / frames, 0.98 if hard else 1.0),
        "completeness": _least(float(np.sum([one.covered for one in found])) / frames, 0.98),
        "stray": _most(sum(one.stray for one in found), 0),
        "invented": _most(sum(one.invented for one in found), 0),
    }
    squares = _all(one.squares for one in found)
    held = float(np.mean(squares < CHI2_3)) if len(squares) else float("nan")
    table["in_ellipsoid"] = _between(held, *IN_ELLIPSOID)
    if found:
        white = np.array([one.white for one in found])
        lags = {"point_lag": _correlation(white[:, :-1], white[:, 1:]) - row.correlation[0]}
        # loops are drawn one by one, and what was refused leaves no pairs
        if row.case.shapes == "arc" and not row.refused:
            lags["frame_lag"] = _correlation(white[::2], white[1::2]) - row.correlation[1]
        table |= {key: _between(lag, -LAG_TOLERANCE, LAG_TOLERANCE) for key, lag in lags.items()}
    for key, frame_s in row.frame_s.items():
        table[key] = _least(1 / frame_s, FRAMES_A_SECOND) | {"how": f"{HOW[key]}, {os.cpu_count()} cores"}
    low, high = row.hidden
    how = f"{frames} frames, {low:.0%} to {high:.0%} of the axis hidden"
    return {"frames": frames, "how": how, "refused": row.refused, "figures": table}


def lines(table: dict[str, Any]) -> Iterable[str]:
    """The table for a terminal; what misses its goal is marked."""
    yield f"{'case':20s}" + "".join(f"{key:>16s}" for key in HOW)
    for name, content in table.items():
        cells = [content["figures"].get(key) for key in HOW]
        texts = [
            "" if cell is None else f"{cell['value']:.4g}{'' if cell['met'] else ' !'}" for cell in cells
        ]
        yield f"{name:20s}" + "".join(f"{text:>16s}" for text in texts)
    yield f"! misses its goal; {FRAMES} frames a case, {DRAWN} of the last"


def _correlation(one: Any, other: Any) -> float:
    """Correlation of values about zero with their neighbours, over all that both are there."""
    return float(np.nanmean(one * other) / np.sqrt(np.nanmean(one**2) * np.nanmean(other**2)))


def _between(value: float, low: float, high: float) -> dict[str, Any]:
    return {"value": _short(value), "goal": [low, high], "met": bool(low <= value <= high)}


def _most(value: float, goal: float) -> dict[str, Any]:
    return {"value": _short(value), "goal": goal, "at_least": False, "met": bool(value <= goal)}


def _least(value: float, goal: float) -> dict[str, Any]:
    return {"value": _short(value), "goal": goal, "at_least": True, "met": bool(value >= goal)}


def _short(value: float) -> float | None:
    """Null where there was nothing to measure."""
    return float(f"{value:.4g}") if np.isfinite(value) else None


def _all(parts: Iterable[Any]) -> Any:
    return np.concatenate([np.zeros(0), *parts])


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


if __name__ == "__main__":
    run(main, *sys.argv[1:])
