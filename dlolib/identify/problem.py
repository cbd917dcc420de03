"""Residuals of one or several recordings of one object, and their derivatives."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import approx_fprime

from dlolib.errors import ParameterError
from dlolib.formats import interpolate_motion
from dlolib.identify.parameters import Unknown, within
from dlolib.sim.poses import Model
from dlolib.sim.rod import Rod
from dlolib.sim.upright import unrolled
from dlolib.types import Floats, Recording

Bools = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
# Lengths of one object, measured again for each recording, differ by no more than this share.
AS_LONG = 0.05
# Points this near to an end tell where it is; an end this far from where it was held is no effect but an
# error. Both are shares of the rope's length.
NEAR_END, ELSEWHERE = 0.02, 0.1


@dataclass(frozen=True)
class Problem:
    """Simulated minus observed points of all recordings, as a function of the unknowns.

    Args:
        models: one a recording.
        rods: the rod of each recording before any unknown is set (its length and masses differ).
        used: for each recording which of its points count, shape (P,).
        offsets: for each recording what a finer mesh adds to the simulated points, (P, 3) [m], or 0.
        unknowns: in the order of the fit's coordinates.
    """

    models: tuple[Model, ...]
    rods: tuple[Rod, ...]
    used: tuple[Bools, ...]
    offsets: tuple[Floats, ...]
    unknowns: tuple[Unknown, ...]

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lowest and highest coordinates (N,) each."""
        density = self.rods[0].rope.linear_density_kg_m
        low, high = np.array([within(density) if u.stiffness else u.bounds for u in self.unknowns]).T
        return low, high

    def rod(self, k: int, theta: Floats) -> Rod:
        """The rod of recording k at the coordinates theta (N,)."""
        values = {
            u.name: u.outward(float(t))
            for u, t in zip(self.unknowns, theta, strict=True)
            if u.recording in (None, k)
        }
        return self.rods[k].with_values(values)

    def simulated(self, k: int, theta: Floats) -> Floats:
        """Simulated points of recording k at the coordinates theta: (P, 3) [m]."""
        return np.asarray(self.models[k].predict(self.rod(k, theta)).xyz_m + self.offsets[k])

    def distances(self, k: int, theta: Floats) -> Floats:
        """Simulated minus observed points of recording k, all of them: (P, A) [m]; A = 2 where planar."""
        model = self.models[k]
        return (self.simulated(k, theta) - model.recording.points.xyz_m)[:, axes(model)]

    def residuals(self, theta: Floats) -> Floats:
        """The points that count, as one vector (R,) [m]."""
        return np.concatenate(
            [self.distances(k, theta)[self.used[k]].ravel() for k in range(len(self.models))]
        )

    def jacobian(self, theta: Floats) -> Floats:
        """Derivatives of `residuals` by theta, (R, N); differences for the iterative solver."""
        if any(getattr(model, "sweeps", None) is not None for model in self.models):
            steps = 1e-4 * np.array([u.scale for u in self.unknowns])
            return np.asarray(approx_fprime(theta, self.residuals, steps)).reshape(-1, len(theta))
        blocks = []
        for k, model in enumerate(self.models):
            mine = [n for n, u in enumerate(self.unknowns) if u.recording in (None, k)]
            names = [self.unknowns[n].name for n in mine]
            by = model.predict(self.rod(k, theta), names).by_parameter[self.used[k]][:, axes(model)]
            block = np.zeros((by.shape[0] * by.shape[1], len(self.unknowns)))
            block[:, mine] = by.reshape(-1, len(mine))
            blocks.append(block)
        chain = [
            u.outward(float(t)) if u.logarithmic else 1.0 for u, t in zip(self.unknowns, theta, strict=True)
        ]
        return np.asarray(np.concatenate(blocks) * np.array(chain))


def axes(model: Model) -> list[int]:
    """The observed axes: x and z where only the plane was seen."""
    return seen_axes(model.recording)


def seen_axes(recording: Recording) -> list[int]:
    """The same of a recording."""
    return [0, 2] if recording.planar == "xz" else [0, 1, 2]


def check_one_object(recordings: Sequence[Recording]) -> None:
    """Refuse recordings of different objects, which no one stiffness fits, two of one name, whose own
    mounting could not be told apart, and such whose ends' roll is known beside others whose is not: one
    number stands for the roll that was not recorded (`dlolib.sim.upright`). The mass at the tip may differ.

    Raises:
        ParameterError: names the two recordings and what differs.
    """
    first = recordings[0]
    for one in recordings[1:]:
        for what in ("name", "linear_density_kg_m", "diameter_m", "length_m"):
            here, there = getattr(one.rope, what), getattr(first.rope, what)
            alike = here == there or (what == "length_m" and abs(here - there) <= AS_LONG * there)
            if not alike:
                raise ParameterError(
                    f"{one.name} has object.{what} = {here!r}, {first.name} has {there!r}",
                    place="recording.json",
                    mend="give recordings of one object together, with what is known of it in each",
                )
    name, times = Counter(one.name for one in recordings).most_common(1)[0]
    if times > 1:
        mend = "give each once, under a name of its own"
        raise ParameterError(f"{times} recordings are named {name}", place="recording.json", mend=mend)
    held = [one for one in recordings if one.ends.start == one.ends.end == "clamped"]
    told = {unrolled(one): one.name for one in held}
    if len(told) > 1:
        raise ParameterError(
            f"how the ends are rolled is known in {told[False]} and not in {told[True]}",
            place="recording.json",
            mend='give them apart, or set "roll_known": {"start": false} in all of them',
        )


def check_held_ends(recording: Recording) -> None:
    """Refuse a recording whose rope was seen elsewhere than where the motion has its held ends.

    Raises:
        ParameterError: names the recording and the end.
    """
    points, length = recording.points, recording.rope.length_m
    motion, seen = interpolate_motion(recording.motion, points.t_s), seen_axes(recording)
    for end, held_m, s_m in (("start", motion.start_m, 0.0), ("end", motion.end_m, length)):
        near = np.abs(points.s_m - s_m) < NEAR_END * length
        if getattr(recording.ends, end) != "clamped" or not near.any():
            continue
        off = float(np.median(np.linalg.norm((points.xyz_m - held_m)[near][:, seen], axis=1)))
        if off > ELSEWHERE * length:
            problem = f"{recording.name}: the rope's {end} was seen {1e3 * off:.0f} mm from where it was held"
            raise ParameterError(problem, place="motion.csv", mend="correct the motion, or the points")
