"""Which modes of a cosine transform of what a model leaves are slow, and how many of these its fit took."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.fft import dctn

from dlolib.diagnose.whitening import MODES
from dlolib.types import Floats

# So many modes over frames and along the rope count as slow, where any of them may show what is missing.
SLOWER = (2, 4, MODES)


def slow_of(frames: int, places: int, modes: int) -> tuple[int, int]:
    """How many modes over frames and along the rope are slow: of a small recording half, or
    none were quick."""
    if max(frames, places) > modes:
        return modes, modes
    return (frames + 1) // 2, (places + 1) // 2


def taken(jacobian: Floats, covariance: Floats, shapes: Sequence[tuple[int, int, int]]) -> dict[int, float]:
    """Degrees of freedom that a fit takes from the slow modes of all recordings, for each of `SLOWER`: the
    trace there of J (J^T J)^-1 J^T. What a prior holds takes less than a whole one.

    Args:
        jacobian: of the whitened residuals (R, N), first those of each recording on its grid.
        covariance: of the parameters (N, N), infinite where one moves nothing.
        shapes: of the recordings' grids, (F, columns, A).
    """
    told = np.isfinite(np.diag(covariance))
    known = covariance[np.ix_(told, told)]
    found, first = dict.fromkeys(SLOWER, 0.0), 0
    for shape in shapes:
        last = first + int(np.prod(shape))
        moved = dctn(jacobian[first:last, told].reshape(*shape, -1), axes=(0, 1), norm="ortho")
        first = last
        for modes in SLOWER:
            m, n = slow_of(shape[0], shape[1], modes)
            low = moved[:m, :n].reshape(-1, len(known))
            found[modes] += float(np.sum((low @ known) * low))
    return found


__all__ = ["SLOWER", "slow_of", "taken"]
