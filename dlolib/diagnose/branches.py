"""The side to which a rope was seen to buckle, where a simulation, as much by chance, takes another.

A fit keeps away from what would buckle to the wrong side, and so from the right parameters. What is left then
stands out in a few frames, and any effect that bends the rope a little to the side that was seen gains much:
a curvature at rest, a clamp that is turned. Sought in those frames where it was seen, the rope tells which
effect gains as much without having to choose the side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.search import NEAR, Searched
from dlolib.diagnose.study import DiagnoseSettings, Seen, Study
from dlolib.diagnose.tasks import Task, fit_first, refit, task_from, terms_of
from dlolib.diagnose.workers import Workers
from dlolib.sim.poses import follows
from dlolib.sim.recording import FEWEST, frame_of
from dlolib.types import Ints, Points

# A frame stands out in which the elastic rod leaves so many times as much χ² as in the middle one, and by so
# much more; if more than a share of the frames do, it is not a side that the rope took.
TIMES, SHOWS, MOST = 2.0, 40.0, 1 / 3
# How many of the best models are fitted once more.
LOOKED_AT = 8


def on_the_side_seen(
    study: Study, searched: Searched, settings: DiagnoseSettings, run: Workers
) -> tuple[Study, list[Fitted]]:
    """The study with the rope sought where it was seen in frames that stand out, and the best models fitted
    to it, if one of them gains by that and then is as good as the best; else itself, and none."""
    sought = [_sought(one, _standing_out(searched.baseline, k)) for k, one in enumerate(study.seen)]
    if not any(sought):
        return study, []

    def changed(one: Seen, k: int) -> Seen:
        model = one.model
        return replace(one, model=replace(model, sought=sought[k])) if follows(model) else one

    seen = tuple(changed(one, k) for k, one in enumerate(study.seen))
    other = replace(study, seen=seen, ahead={k: changed(one, k) for k, one in study.ahead.items()})
    run.begin(other)
    fits = _gaining(study, searched, settings, run)
    if not fits:
        run.begin(study)
    return (other, fits) if fits else (study, [])


def _gaining(study: Study, searched: Searched, settings: DiagnoseSettings, run: Workers) -> list[Fitted]:
    """The best models on the side seen, if any is better there and as good as the best was."""
    models, frames = searched.models[:LOOKED_AT], study.frames
    best = min(one.bic(frames) for one in (searched.baseline, *models))
    first = run(fit_first, [_begun(study, one, settings) for one in models], "on the side seen")
    found = [(new, old) for new, old in zip(first, models, strict=True) if new is not None]
    # on another side a rope has another mesh's error, worth as much as the side may be
    again = run(refit, [task_from(new) for new, _ in found], "on the side seen, refined")
    both = [(new, old) for new, (_, old) in zip(again, found, strict=True) if new is not None]
    gain = any(new.bic(frames) < min(old.bic(frames) - NEAR, best + settings.tie) for new, old in both)
    return [new for new, _ in both] if gain else []


def _begun(study: Study, one: Fitted, settings: DiagnoseSettings) -> Task:
    """A model once more from where it is, and from usual stiffnesses where its own ran off."""
    starts = [{**one.point, **stiffness} for stiffness in study.beginnings(one.point, one.effects[-1])]
    return Task(terms_of(one), tuple(starts), one.offsets_m, settings.starts)


def _standing_out(model: Fitted, k: int) -> Ints:
    """Which frames of recording k, in order, a model leaves far more of than of most."""
    left = np.sum(model.residuals[k] ** 2, axis=(1, 2))
    middle = float(np.median(left))
    found = np.flatnonzero(left > max(TIMES * middle, middle + SHOWS))
    return found if len(found) <= MOST * len(left) else found[:0]


def _sought(one: Seen, frames: Ints) -> tuple[Points, ...]:
    """What was seen of a rope in these frames, if it is quasi-static; one among obstacles lies where they let
    it."""
    points = one.recording.points
    if not follows(one.model) or not one.recording.quasi_static or one.recording.obstacles:
        return ()
    seen: Sequence[Points] = [frame_of(points, int(np.unique(points.frame)[k])) for k in frames]
    return tuple(frame for frame in seen if len(frame.s_m) >= FEWEST)


def told_sides(study: Study) -> list[str]:
    """In which frames of which recordings the rope was sought where it was seen, as sentences."""
    several, found = len(study.seen) > 1, []
    for one in study.seen:
        frames = np.array([points.frame[0] for points in getattr(one.model, "sought", ())], dtype=int)
        if len(frames):
            of = f" of {one.recording.name}" if several else ""
            runs = np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1)
            which = ", ".join(f"{run[0]} to {run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)
            found.append(
                f"The rope may buckle to either side: in frames {which}{of} it was sought where it was seen."
            )
    return found


__all__ = ["on_the_side_seen", "told_sides"]
