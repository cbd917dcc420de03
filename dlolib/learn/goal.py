"""A layout's goal at the rod's particles, and how far a shape is from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from dlolib.errors import LayoutError
from dlolib.formats import say, signed_distance
from dlolib.learn.arm import REACH
from dlolib.types import Floats, Layout

# Fewer points than this, or a first or last one further from the rope's ends, are no goal for all of it.
FEWEST_POINTS = 4
END_SHARE = 0.02
# A goal that is drawn shorter than this share of the rope is none that it could take.
LEAST_SHARE, LOOKED_AT = 0.9, 200
# A goal of a few points does not tell its direction at the ends better than so.
TURNED_RAD, ALONG = np.radians(30.0), np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class GoalError:
    """Distances [m] between particles and goal at equal arc length: mean, largest, and at the end."""

    mean_m: float
    max_m: float
    end_m: float


def check_learnable(layout: Layout, clearance_m: float) -> None:
    """Refuse what `formats.read_layout` lets pass and no path can be learned for; say where an end is held
    across the goal.

    Args:
        layout: what is to be learned.
        clearance_m: that is asked for [m].

    Raises:
        LayoutError: an end is free, the goal covers a part of the rope or is drawn shorter than it, A and B
            leave no plane for (16), there are obstacles and the rope's thickness is not known, or one is too
            near to a held end, or the grasp or the goal's end is further away than the moved end may go.
    """
    if layout.obstacles and layout.rope.diameter_m is None:
        problem = "not known, and a rope of no thickness keeps no clearance to the obstacles"
        raise LayoutError(problem, file=layout.name, place="object.diameter_m", mend="measure it")
    if (layout.ends.start, layout.ends.end) != ("clamped", "clamped"):
        raise LayoutError("an end is free", file=layout.name, place="ends", mend="clamp both: one is moved")
    s_m, length = layout.goal_s_m, layout.rope.length_m
    if len(s_m) < FEWEST_POINTS or s_m[0] > END_SHARE * length or s_m[-1] < (1 - END_SHARE) * length:
        problem = f"the goal has {len(s_m)} points from {s_m[0]:g} to {s_m[-1]:g} m of {length:g} m"
        mend = f"give at least {FEWEST_POINTS}, from the rope's start to its end"
        raise LayoutError(problem, file=layout.name, place="goal.csv", mend=mend)
    drawn = np.diff(goal_at_particles(layout, LOOKED_AT), axis=0)
    way_m = float(np.linalg.norm(drawn, axis=1).sum())
    if way_m < LEAST_SHARE * length:
        problem = f"the way along the goal is {way_m:.4g} m, and the rope is {length:g} m long"
        mend = "draw all of the rope at its true size, or correct object.length_m"
        raise LayoutError(problem, file=layout.name, place="goal.csv", mend=mend)
    across = layout.goal_m[-1] - layout.grasp.position_m
    level = float(np.hypot(across[0], across[1]))
    if level < 1e-3:
        problem = "the goal's last point lies at the grasp, or straight above or below it"
        mend = "move one: arcs turn about an axis that stands on the way between them and on the vertical"
        raise LayoutError(problem, file=layout.name, place="grasp.position_m", mend=mend)
    _check_reach(layout)
    _check_ends(layout, clearance_m)
    say(_turned_ends(layout, drawn))


def _check_reach(layout: Layout) -> None:
    """The moved end is not led as far from the start as the rope is long: it would be taut."""
    most_m = REACH * layout.rope.length_m
    ends = {"grasp.position_m": layout.grasp.position_m, "the last point of goal.csv": layout.goal_m[-1]}
    for place, point_m in ends.items():
        away_m = float(np.linalg.norm(point_m - layout.start.position_m))
        if away_m > most_m:
            problem = f"is {away_m:.4g} m from the start, and the end is moved to {most_m:.4g} m at most"
            raise LayoutError(problem, file=layout.name, place=place, mend="bring it nearer")


def _turned_ends(layout: Layout, drawn: Floats) -> list[str]:
    """Where the goal, as steps (N, 3) along it, leaves a held end in another direction than it is held in: no
    rope that is clamped so takes that shape, and the moved end does not turn."""
    lines = []
    for end, pose, step in (("start", layout.start, drawn[0]), ("grasp", layout.grasp, drawn[-1])):
        held = Rotation.from_quat(pose.quaternion, scalar_first=True).apply(ALONG)
        angle = float(np.arccos(np.clip(held @ step / np.linalg.norm(step), -1.0, 1.0)))
        if angle > TURNED_RAD:
            problem = f"its third axis is {np.degrees(angle):.0f}° off the goal's direction there"
            mend = "give (w, x, y, z), the third axis along the rope from start to end, or correct the goal"
            lines.append(str(LayoutError(problem, file=layout.name, place=f"{end}.quaternion", mend=mend)))
    return lines


def _check_ends(layout: Layout, clearance_m: float) -> None:
    """Where the rope is held it stays at least once: no path keeps further away than that."""
    for end, pose in (("start", layout.start), ("grasp", layout.grasp)):
        for number, obstacle in enumerate(layout.obstacles):
            left_m = float(signed_distance(obstacle, pose.position_m)) - layout.rope.radius_m
            if left_m < clearance_m:
                problem = (
                    f"the rope's surface is {1e3 * left_m:.1f} mm from obstacle {number} ({obstacle.shape}), "
                    f"and {1e3 * clearance_m:g} mm are asked for"
                )
                mend = f"move the {end} or the obstacle, or ask for less (learn.clearance_m)"
                raise LayoutError(problem, file=layout.name, place=f"{end}.position_m", mend=mend)


def goal_at_particles(layout: Layout, particles: int) -> Floats:
    """The goal at equally spaced arc lengths, shape (particles, 3) [m], by a cubic spline in s.

    Before its first point and after its last, which `check_learnable` wants near the ends, it bends on.
    """
    spline = make_interp_spline(layout.goal_s_m / layout.rope.length_m, layout.goal_m, k=3)
    return np.asarray(spline(np.linspace(0.0, 1.0, particles)), dtype=np.float64)


def goal_error(positions_m: Floats, goal_m: Floats) -> GoalError:
    """Compare particles (N, 3) with the goal at the same arc lengths (N, 3)."""
    distance = np.linalg.norm(positions_m - goal_m, axis=-1)
    return GoalError(float(distance.mean()), float(distance.max()), float(distance[-1]))
