"""Parameters that depend on a law's form: our law fitted to the laboratory's own moments.

The laboratory yields smoothly where formats.md yields at a point, so neither's yield curvature is the
other's. What a diagnosis should find is the law of formats.md that comes nearest, by least squares over the
rope and its way, to the laboratory's moments at the curvatures that the laboratory's rope went through.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.optimize import least_squares

from dlolib.lab.plastic import return_mapping
from dlolib.proof.laws import Elastic, Law, creeping, rubbing, yielding
from dlolib.types import Floats

Values = Mapping[str, float]
# Where fits begin, as multiples of the two parameters: on a way that ends before our law yields nothing tells
# which way to go, although the laboratory's yields there already, and little at first.
BEGIN = ((1.0, 0.85, 0.7), (1.0, 5.0))
TINY = 1e-12


@dataclass(frozen=True)
class Way:
    """What joints went through, from straight on.

    Args:
        curvature: shape (T, J, 2) [1/m].
        step_s: the time from the index before to each (T,); 0 for the first.
        length_m: rope that each joint stands for, (J,).
    """

    curvature: Floats
    step_s: Floats
    length_m: Floats

    def less(self, rest_1_m: Floats) -> Way:
        """The same over a curvature at rest (2,) [1/m]."""
        return Way(self.curvature - rest_1_m, self.step_s, self.length_m)


def nearest_parameters(name: str, values: Values, way: Way) -> dict[str, float]:
    """Parameters of our law of this name that come nearest to the laboratory's with its `values`.

    Args:
        name: of an effect with a law of another form, a key of `FORMS`.
        values: its parameters in the laboratory.
        way: where the rope's joints went, over the curvature that the law sees as none.
    """
    law, ours = FORMS[name]
    moments = driven(law(values, way.curvature.shape[1]), way)
    weights = np.sqrt(way.length_m / way.length_m.sum())[:, None]
    start = np.array([values[key] for key in values])

    def miss(logs: Floats) -> Floats:
        return np.asarray((weights * (ours(way, *(start * np.exp(logs))) - moments)).ravel())

    begin = itertools.product(*BEGIN[: len(start)])
    fits = [least_squares(miss, np.log(shares), x_scale=0.1) for shares in begin]
    found = min(fits, key=lambda fit: float(fit.cost))
    return {key: float(value) for key, value in zip(values, start * np.exp(found.x), strict=True)}


def driven(law: Law, way: Way) -> Floats:
    """The laboratory's moments over EI along a way (T, J, 2)."""
    found = []
    for curvature, step_s in zip(way.curvature, way.step_s, strict=True):
        found.append(law.moments(curvature, step_s)[0])
        law.keep(curvature, step_s)
    return np.array(found)


def _bilinear(way: Way, yield_1_m: float, hardening: float) -> Floats:
    plastic, found = np.zeros(way.curvature.shape[1:]), []
    for curvature in way.curvature:
        plastic = return_mapping(curvature, plastic, yield_1_m, hardening)
        found.append(curvature - plastic)
    return np.array(found)


def _dahl(way: Way, saturation_1_m: float, transition_1_m: float) -> Floats:
    z, found = np.zeros(way.curvature.shape[1:]), []
    before = z
    for curvature in way.curvature:
        change = curvature - before
        size = np.linalg.norm(change, axis=1, keepdims=True)
        fade = np.exp(-size / transition_1_m)
        z = fade * z + saturation_1_m * (1 - fade) * change / np.maximum(size, TINY)
        found.append(z)
        before = curvature
    return np.array(found)


def _maxwell(way: Way, ratio: float, time_s: float) -> Floats:
    q, found = np.zeros(way.curvature.shape[1:]), []
    before = q
    for curvature, step_s in zip(way.curvature, way.step_s, strict=True):
        share = step_s / time_s
        fresh = -np.expm1(-share) / share if share else 1.0
        q = q * np.exp(-share) + ratio * fresh * (curvature - before)
        found.append(q)
        before = curvature
    return np.array(found)


def _cubic(way: Way, cubic: float) -> Floats:
    square = np.sum(way.curvature**2, axis=2, keepdims=True)
    if cubic > 0:
        return np.asarray(way.curvature * (1 + cubic * square))
    return np.asarray(way.curvature / np.sqrt(1 + 2 * abs(cubic) * square))


FORMS: Mapping[str, tuple[Callable[[Values, int], Law], Callable[..., Floats]]] = MappingProxyType(
    {
        "plastic_bending": (
            lambda v, joints: yielding(np.ones((joints, 2)), 1.0, v["yield_curvature"], v["hardening_ratio"]),
            _bilinear,
        ),
        "internal_friction": (
            lambda v, joints: rubbing(1.0, v["saturation_curvature"], v["transition_curvature"], joints),
            _dahl,
        ),
        "viscoelastic_bending": (
            lambda v, joints: creeping(np.ones((joints, 2)), v["modulus_ratio"], v["relaxation_time"]),
            _maxwell,
        ),
        "nonlinear_bending": (
            lambda v, joints: Elastic(np.ones((joints, 2)), np.zeros(2), v["cubic"]),
            _cubic,
        ),
    }
)
# Laws that see the curvature over that at rest (formats.md); the others see all of it.
OVER_REST = frozenset({"plastic_bending", "nonlinear_bending"})
