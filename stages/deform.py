"""Two cables that two arms swing fast (`make deform DATA=DIR [CASE="dlo1 dlo3"]`): reports/deform.json.

DIR holds the recordings `deform_<cable>_train_*` and `deform_<cable>_eval_*`, whose data have no licence: no
pipeline carries them. Each kind of material is fitted to a cable's `train` recordings together; which kind
is right is told by the `train` recording that is left out of a fit. Then every `eval` recording is simulated
open loop over all its frames, under its own motion. What is counted is the mean absolute error per
coordinate.

A cable that swings when its recording begins starts where its first frames saw it, and as fast. Beside that
stands what comes of a start at rest.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from dlolib.errors import ParameterError, SimulationError
from dlolib.files import write_json
from dlolib.formats import read_recording
from dlolib.identify.parameters import Unknown
from dlolib.identify.problem import Problem
from dlolib.progress import track
from dlolib.sim.begun import BegunModel
from dlolib.sim.continuum import refined
from dlolib.sim.recording import FIRST, RecordingModel
from dlolib.sim.rod import Rod, unit_of
from dlolib.sim.steps import dynamic_step
from dlolib.sim.upright import ROLL, ROLLS, upright
from dlolib.types import Floats, Points, Recording
from stages import REPORTS, known, run
from stages.identify import settings
from stages.proof import made_by

CABLES = ("dlo1", "dlo3")
BOOK = REPORTS / "deform.json"
GOAL_MM = 10.0
# A fit follows more and more of the frames: over all of them at once it ends where a swing is missed.
HORIZONS = (100, 200, 350, 500)
# Every so many frames count in a fit; a point that is further off than this [m] counts less than its square.
EVERY, OUTLIER_M = 4, 0.01
ITERATIONS, TOLERANCE = 12, 1e-4
# What a point of a rod counts as that cannot be simulated [m].
UNSOLVED_M = 0.5
# EI over linear density where fits begin [m^4/s^2].
STIFFNESSES_M4_S2 = (3e-3, 3e-2, 3e-1)
# Errors over time are told in pieces of so many frames.
PIECE = 50

ELASTIC = ("bending_stiffness", "torsional_stiffness", "inertia_drag.drag")
CURVED = (
    ROLL,
    *(f"rest_curvature.kappa_{axis}" for axis in (1, 2)),
    *(f"rest_curvature.wave_{axis}_{k}" for axis in (1, 2) for k in range(1, 5)),
)
UNEVEN = ("stiffness_profile.s", "stiffness_profile.factor", "stiffness_profile.width")
RUBBING = ("internal_friction.saturation_curvature", "internal_friction.transition_curvature")
CREEP = ("viscoelastic_bending.modulus_ratio", "viscoelastic_bending.relaxation_time")


@dataclass(frozen=True)
class Kind:
    """A kind of material.

    Args:
        parameters: what is fitted.
        begin: values at which a fit begins, where they are not neutral or known from the kind it is `after`.
        after: the kind whose values a fit begins at; its rest curvature is kept where it has one.
        upright: both clamps are taken to be `upright`; as recorded otherwise.
    """

    parameters: tuple[str, ...]
    begin: Mapping[str, float] = field(default_factory=dict)
    after: str = "elastic"
    upright: bool = True


KINDS = {
    "elastic": Kind(ELASTIC, {"inertia_drag.drag": 1.0}, upright=False),
    "curved": Kind((*ELASTIC, *CURVED)),
    "curved, creeping": Kind((*ELASTIC, *CURVED, *CREEP), dict(zip(CREEP, (1.0, 0.15), strict=True))),
    "curved, creeping, uneven": Kind(
        (*ELASTIC, *CURVED, *CREEP, *UNEVEN),
        dict(zip(UNEVEN, (0.5, 1.5, 0.3), strict=True)),
        after="curved, creeping",
    ),
    "curved, creeping, rubbing": Kind(
        (*ELASTIC, *CURVED, *CREEP, *RUBBING),
        dict(zip(RUBBING, (0.5, 0.5), strict=True)),
        after="curved, creeping",
    ),
}

Values = dict[str, float]


def main(data: str, *names: str) -> None:
    """Both cables, or those named; what is known of the other stays."""
    known(names, CABLES, "cable")
    found = json.loads(BOOK.read_text())["cables"] if BOOK.exists() else {}
    for cable in names or CABLES:
        train, test = (read(Path(data), f"deform_{cable}_{part}_") for part in ("train", "eval"))
        row = measured(train, test)
        found[cable] = made_by(f"make deform DATA=DIR CASE={cable}") | row
        # after each, so that nothing is lost where the next is stopped
        write_json(BOOK, {"goal_mm": GOAL_MM, "cables": found})
        for kind, one in row["kinds"].items():
            print(_line(f"{cable}, {kind}", one, chosen=kind == row["chosen"]))


def read(folder: Path, prefix: str) -> list[Recording]:
    """The recordings whose names begin so, in order.

    Raises:
        ParameterError: there is none.
    """
    found = sorted(folder.glob(f"{prefix}*/recording.json"))
    if not found:
        raise ParameterError(f"{folder} holds no {prefix}*", mend="say where the recordings lie: DATA=DIR")
    return [read_recording(path.parent) for path in found]


def measured(train: Sequence[Recording], test: Sequence[Recording]) -> dict[str, Any]:
    """Every kind fitted to all of `train` and without each of them, and what it foretells of `test`."""
    rows: dict[str, dict[str, Any]] = {}
    whole = fits(train)
    folds = [fits([one for one in train if one is not out]) for out in track(train, "each left out")]
    for name, kind in KINDS.items():
        left = {
            out.name: scores(out, simulated(out, kind, fold[name]))
            for out, fold in zip(train, folds, strict=True)
        }
        rows[name] = {
            "parameters": {key: {"value": v, "unit": _unit(key)} for key, v in whole[name].items()},
            "train_mm": {one.name: scores(one, simulated(one, kind, whole[name])) for one in train},
            "left_out_mm": left,
            "left_out_mean_mm": mean(left),
        }
    chosen = min(rows, key=lambda name: float(rows[name]["left_out_mean_mm"]["all"]))
    # only now: nothing above may know how it comes out
    for name, kind in KINDS.items():
        foretold = {one.name: _foretold(one, kind, whole[name]) for one in test}
        rows[name] |= {"eval_mm": foretold, "eval_mean_mm": mean(foretold)}
    return {"chosen": chosen, "kinds": rows}


def fits(recordings: Sequence[Recording]) -> dict[str, Values]:
    """The best values of every kind, by its name."""
    found: dict[str, Values] = {}
    for name, kind in KINDS.items():
        starts: list[Values] = [{**found.get(kind.after, {}), **kind.begin}]
        horizons: Sequence[int] = HORIZONS
        if not found:
            starts = [{**starts[0], ELASTIC[0]: ei, ELASTIC[1]: ei} for ei in STIFFNESSES_M4_S2]
        elif kind.after == "elastic":
            starts = [{**starts[0], ROLL: roll} for roll in ROLLS]
        else:
            horizons = HORIZONS[-1:]
        found[name] = fit(recordings, kind, starts, horizons)
    return found


def fit(
    recordings: Sequence[Recording], kind: Kind, starts: Sequence[Values], horizons: Sequence[int] = HORIZONS
) -> Values:
    """One material for all recordings: the best start over the first horizon, then on to the longer ones.

    Raises:
        SimulationError: none of the starts can be simulated.
    """
    best: Values | None = None
    for frames in horizons:
        problem = _problem([until(one, frames) for one in recordings], kind)
        solved = [_solved(problem, start) for start in (starts if best is None else [best])]
        ends = [end for end in solved if end is not None]
        if ends:
            best = min(ends, key=lambda end: end[0])[1]
    if best is None:
        raise SimulationError("no start can be simulated", mend="check the recordings' units and ends")
    return best


def _problem(recordings: Sequence[Recording], kind: Kind) -> Problem:
    models = tuple(model_of(one, kind) for one in recordings)
    rods = tuple(_rod(one, {}) for one in models)
    used = tuple(np.ones(len(one.points.frame), dtype=bool) for one in recordings)
    offsets = tuple(np.zeros_like(one.points.xyz_m) for one in recordings)
    return Problem(models, rods, used, offsets, tuple(map(Unknown, kind.parameters)))


def _solved(problem: Problem, start: Values) -> tuple[float, Values] | None:
    """The cost at the best of the values near a start, and these; None where it cannot be simulated."""
    unknowns = problem.unknowns
    low, high = problem.bounds
    count = sum(int(used.sum()) * 3 for used in problem.used)

    def residuals(theta: Floats) -> Floats:
        try:
            return problem.residuals(theta)
        except SimulationError:
            return np.full(count, UNSOLVED_M)

    theta = np.array([u.inward(start.get(u.name, problem.rods[0].value(u.name))) for u in unknowns])
    try:
        end = least_squares(
            residuals, np.clip(theta, low, high), problem.jacobian, bounds=(low, high),
            x_scale=np.array([u.scale for u in unknowns]), loss="soft_l1", f_scale=OUTLIER_M,
            max_nfev=ITERATIONS, ftol=TOLERANCE, xtol=TOLERANCE,
        )  # fmt: skip
    except SimulationError:
        return None
    return float(end.cost), {u.name: u.outward(float(x)) for u, x in zip(unknowns, end.x, strict=True)}


def model_of(recording: Recording, kind: Kind, rest: bool = False) -> RecordingModel:
    """The recording ready to be simulated: both ends' rolls held, begun as seen or at rest."""
    as_recorded = replace(recording, ends=replace(recording.ends, start_roll_known=True, end_roll_known=True))
    held = upright(recording) if kind.upright else as_recorded
    mesh = settings()
    made = RecordingModel if rest else BegunModel
    return made(held, mesh.particles, dynamic_step(held.motion, mesh.time_step_s))


def _rod(model: RecordingModel, values: Values) -> Rod:
    return Rod(model.recording.rope, 1.0, 1.0, {}, model.particles).with_values(values)


def simulated(recording: Recording, kind: Kind, values: Values, rest: bool = False, finer: int = 1) -> Floats:
    """The recording's points (P, 3) [m] as a rod with these values has them."""
    model = refined(model_of(recording, kind, rest), finer) if finer > 1 else model_of(recording, kind, rest)
    assert isinstance(model, RecordingModel)
    return model.predict(_rod(model, values)).xyz_m


def until(recording: Recording, frames: int) -> Recording:
    """The first so many frames, of these every `EVERY`-th and those that the start is read from."""
    points = recording.points
    number = np.unique(points.frame, return_inverse=True)[1]
    kept = (number < frames) & ((number % EVERY == 0) | (number < FIRST))
    some = Points(points.frame[kept], points.t_s[kept], points.s_m[kept], points.xyz_m[kept])
    return replace(recording, points=some)


def scores(recording: Recording, xyz_m: Floats) -> dict[str, Any]:
    """Mean absolute error per coordinate [mm]: over all markers, over the free ones, by marker, and by pieces
    of `PIECE` frames; xyz_m: simulated points (P, 3)."""
    points = recording.points
    off = 1e3 * np.abs(xyz_m - points.xyz_m).mean(axis=1)
    return {
        "all": float(off.mean()),
        "free": float(off[free(points)].mean()),
        "by_marker": [float(off[points.s_m == s].mean()) for s in np.unique(points.s_m)],
        "over_time": [float(off[mine].mean()) for mine in _pieces(points)],
    }


def free(points: Points) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Which points (P,) are not on the held ends: neither at the least nor at the largest s_m."""
    return np.asarray((points.s_m > points.s_m.min()) & (points.s_m < points.s_m.max()))


def _pieces(points: Points) -> Iterator[np.ndarray[tuple[int, ...], np.dtype[np.bool_]]]:
    number = np.unique(points.frame, return_inverse=True)[1]
    for first in range(0, int(number.max()) + 1, PIECE):
        yield (number >= first) & (number < first + PIECE)


def mean(rows: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    """Over recordings, of what counts."""
    return {key: float(np.mean([row[key] for row in rows.values()])) for key in ("all", "free")}


def _foretold(recording: Recording, kind: Kind, values: Values) -> dict[str, Any]:
    """Begun as seen; also at rest, and as seen on a mesh twice as fine."""
    row = scores(recording, simulated(recording, kind, values))
    for what, how in (("from_rest", {"rest": True}), ("finer_mesh", {"finer": 2})):
        try:
            other = scores(recording, simulated(recording, kind, values, **how))
            row[what] = {key: other[key] for key in ("all", "free")}
        except SimulationError:
            row[what] = None
    return row


def _unit(name: str) -> str:
    """Of what comes out where the rope counts as 1 kg/m."""
    unit = unit_of(name)
    return {"N m^2": "m^4/s^2", "N s/m^2": "1/s"}.get(unit, unit)


def _line(what: str, row: Mapping[str, Any], chosen: bool) -> str:
    left, foretold = row["left_out_mean_mm"], row["eval_mean_mm"]
    return (
        f"{what}{' (chosen)' if chosen else ''}: eval {foretold['all']:.1f} mm, free markers "
        f"{foretold['free']:.1f} mm; left out of train {left['all']:.1f}, {left['free']:.1f} mm"
    )


if __name__ == "__main__":
    run(main, *sys.argv[1:])
