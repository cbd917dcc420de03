"""How things of the laboratory lie: MuJoCo and Open3D both build them along z."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.types import Floats


def from_z(direction: Floats) -> Rotation:
    """The turn of +z into this direction (3,), of any length."""
    axis = direction / np.linalg.norm(direction)
    return Rotation.align_vectors([axis], [[0.0, 0.0, 1.0]])[0]
