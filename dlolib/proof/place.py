"""Where an effect can be placed: what the elastic rope does in this motion with nothing in its way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlolib.errors import SimulationError
from dlolib.proof.motions import MAIN_FRAMES, STATIC_FRAMES
from dlolib.proof.play import play
from dlolib.proof.world import POINTS, Experiment
from dlolib.types import Floats

TRIES = 200
# Around an obstacle the standing rope, and both clamps at any time, stay this clear of it [m].
CLEAR_M, FROM_CLAMPS = 0.003, 4


@dataclass(frozen=True)
class Place:
    """The free elastic rope in one motion.

    length_m, radius_m of the rope; points_m (F, 30, 3); most_curvature_1_m; main_s, first and last time
    [s] of the main way; row_s, time a row.
    """

    length_m: float
    radius_m: float
    points_m: Floats
    most_curvature_1_m: float
    main_s: tuple[float, float]
    row_s: float

    def obstacle_center(
        self, rng: np.random.Generator, radius_m: float, depth_m: float, axis: Floats | None = None
    ) -> Floats:
        """A centre (3,) [m] of a ball, or of a bar along a unit axis, that the rope's path enters so deep.

        The side is random, for a bar one from beneath: there the rope comes to lie on it.

        Raises:
            SimulationError: none was found that leaves the standing rope and the clamps alone.
        """
        reach = radius_m + self.radius_m
        across = np.eye(3) - (0.0 if axis is None else np.outer(axis, axis))
        for _ in range(TRIES):
            frame = STATIC_FRAMES + int(rng.integers(MAIN_FRAMES // 8, MAIN_FRAMES))
            index = int(rng.integers(POINTS // 4, 3 * POINTS // 4))
            tangent = self.points_m[frame, index + 1] - self.points_m[frame, index - 1]
            side = np.cross(tangent, rng.normal(size=3) if axis is None else axis)
            side = side if axis is None or side[2] < 0 else -side
            center = self.points_m[frame, index] + reach * side / np.linalg.norm(side)
            distance = np.linalg.norm((self.points_m - center) @ across, axis=-1)
            main = distance[STATIC_FRAMES : STATIC_FRAMES + MAIN_FRAMES]
            # The path comes nearest somewhere: set it back until that is the depth.
            when, where = np.unravel_index(int(main.argmin()), main.shape)
            away = (center - self.points_m[STATIC_FRAMES + when, where]) @ across
            center = center + (reach - depth_m - main.min()) * away / np.linalg.norm(away)
            if self._fits(center, reach, across):
                return np.asarray(center)
        raise SimulationError("no room for an obstacle beside this motion", mend="draw another motion")

    def _fits(self, center: Floats, reach: float, across: Floats) -> bool:
        distance = np.linalg.norm((self.points_m - center) @ across, axis=-1)
        clear = distance[:STATIC_FRAMES].min() > reach + CLEAR_M
        ends = np.delete(distance, np.s_[FROM_CLAMPS : POINTS - FROM_CLAMPS], axis=1)
        return bool(clear and ends.min() > reach + CLEAR_M)


def most_curvature(points_m: Floats, length_m: float) -> float:
    """The largest curvature [1/m] of a rope whose points (F, 30, 3) [m] are even along its length [m]."""
    side = np.diff(points_m, axis=1)
    turn = np.cross(side[:, 1:], side[:, :-1])
    return float(np.linalg.norm(turn, axis=-1).max() / (length_m / (POINTS - 1)) ** 3)


def find_place(experiment: Experiment, row_s: float) -> Place:
    """Play the elastic rope without obstacles."""
    points = play(experiment)
    frames = experiment.frame_t_s[STATIC_FRAMES : STATIC_FRAMES + MAIN_FRAMES]
    return Place(
        length_m=experiment.sizes.length_m,
        radius_m=experiment.sizes.diameter_m / 2,
        points_m=points,
        most_curvature_1_m=most_curvature(points, experiment.sizes.length_m),
        main_s=(float(frames[0]), float(frames[-1])),
        row_s=row_s,
    )
