"""Stiffness given as arrays along the rope, and what each joint and segment of a mesh makes of them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from dlolib.errors import ParameterError
from dlolib.types import Floats


@dataclass(frozen=True)
class Profile:
    """Stiffnesses of equal pieces of the rope, from the start to the end; None: that of the whole rod.

    As many pieces as there are: with one fewer than particles they are the segments. Each field may have its
    own number. A joint bends, and a segment stretches, with the mean compliance of its piece of the rope.

    Args:
        bending: EI [N m^2].
        torsional: GJ [N m^2].
        axial: EA [N], in series with what holds an inextensible rope.
        shear: GA [N], likewise.
    """

    bending: tuple[float, ...] | None = None
    torsional: tuple[float, ...] | None = None
    axial: tuple[float, ...] | None = None
    shear: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            values = getattr(self, field.name)
            if values is not None and not (len(values) > 0 and min(values) > 0 and np.isfinite(values).all()):
                raise ParameterError(
                    f"profile.{field.name} = {values} is no row of positive numbers",
                    mend="give one or more above 0",
                )

    def scaled(self, bending: float, torsional: float) -> Profile:
        """EI and GJ times a factor each."""
        ei = None if self.bending is None else tuple(bending * value for value in self.bending)
        gj = None if self.torsional is None else tuple(torsional * value for value in self.torsional)
        return Profile(ei, gj, self.axial, self.shear)


def mean_compliance(values: tuple[float, ...], length_m: float, low_m: Floats, high_m: Floats) -> Floats:
    """Mean of 1 / values between two arc lengths, (K,) each: of springs in series."""
    edges = np.linspace(0.0, length_m, len(values) + 1)
    along = np.concatenate([[0.0], np.cumsum(np.diff(edges) / np.asarray(values))])
    return np.asarray((np.interp(high_m, edges, along) - np.interp(low_m, edges, along)) / (high_m - low_m))
