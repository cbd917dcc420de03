"""How finely a rope is discretised."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dlolib.errors import ParameterError

# The mesh of the discretisation correction, so many times as fine; no rope needs more particles than this,
# and what is seen of it is on a cubic through them, which takes four.
FINER, MOST_PARTICLES, LEAST_PARTICLES = 4, 2000, 4


@dataclass(frozen=True)
class Mesh:
    """How finely, in space and in time.

    Args:
        particles: n, at least, 4 or more; more where segments would be longer than `longest_segment_m`.
        longest_segment_m: see above [m].
        time_step_s: longest step of the dynamic clock; quasi-static recordings need none.
    """

    particles: int = 30
    longest_segment_m: float = 0.016
    time_step_s: float = 0.01

    def __post_init__(self) -> None:
        if self.particles < LEAST_PARTICLES:
            problem, mend = f"is {self.particles}", f"give {LEAST_PARTICLES} or more"
            raise ParameterError(problem, place="rod.particles", mend=mend)

    def particles_for(self, length_m: float) -> int:
        """n for a rope of this length: no segment is longer than `longest_segment_m`.

        Raises:
            ParameterError: they are more than any rope needs.
        """
        count = int(np.ceil(length_m / self.longest_segment_m)) + 1
        if count > MOST_PARTICLES:
            segments = f"segments of {self.longest_segment_m:g} m"
            problem = f"a rope of {length_m:g} m in {segments} has {count} particles"
            mend = f"give metres, at least {length_m / MOST_PARTICLES:.2g}; check the rope's length"
            raise ParameterError(problem, place="rod.longest_segment_m", mend=mend)
        return max(self.particles, count)
