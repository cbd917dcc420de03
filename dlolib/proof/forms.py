"""Parameters that depend on a law's form: our law fitted to the laboratory's own moment against curvature.

The laboratory yields smoothly where formats.md yields at a point, so neither's yield curvature is the
other's. What a diagnosis should find is the law of formats.md that comes nearest, by least squares, to the
laboratory's moments on a loop as wide as the rope is bent.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from itertools import pairwise
from types import MappingProxyType

import numpy as np
from scipy.optimize import least_squares

from dlolib.lab.plastic import return_mapping
from dlolib.proof.laws import Elastic, Law, creeping, rubbing, yielding
from dlolib.types import Floats

# The loop: out, back to the other side by half, out again; and its pace where time counts [s].
STEPS, BACK, LOOP_S = 120, -0.5, 20.0
Values = Mapping[str, float]
# Where fits begin, as multiples of the two parameters: on a loop that ends before our law yields nothing
# tells which way to go, although the laboratory's yields there already, and little at first.
BEGIN = ((1.0, 0.85, 0.7), (1.0, 5.0))


def nearest_parameters(name: str, values: Values, most_curvature_1_m: float) -> dict[str, float]:
    """Parameters of our law of this name that come nearest to the laboratory's with its `values`.

    Args:
        name: of an effect with a law of another form, a key of `FORMS`.
        values: its parameters in the laboratory.
        most_curvature_1_m: how far the loop goes [1/m].
    """
    law, ours = FORMS[name]
    path = _loop(most_curvature_1_m)
    moments = _drive(law(values), path)
    start = np.array([values[key] for key in values])

    def miss(logs: Floats) -> Floats:
        return ours(path, *(start * np.exp(logs))) - moments

    begin = itertools.product(*BEGIN[: len(start)])
    fits = [least_squares(miss, np.log(shares), x_scale=0.1) for shares in begin]
    found = min(fits, key=lambda fit: float(fit.cost))
    return {key: float(value) for key, value in zip(values, start * np.exp(found.x), strict=True)}


def _loop(most: float) -> Floats:
    turns = [0.0, most, BACK * most, most]
    parts = [np.linspace(a, b, STEPS)[1:] for a, b in pairwise(turns)]
    return np.concatenate([[0.0], *parts])


def _drive(law: Law, path: Floats) -> Floats:
    """The laboratory's moments over EI along a path about one axis."""
    found, step_s = [], LOOP_S / len(path)
    for kappa in path:
        curvature = np.array([[kappa, 0.0]])
        found.append(law.moments(curvature, step_s)[0][0, 0])
        law.keep(curvature, step_s)
    return np.array(found)


def _bilinear(path: Floats, yield_1_m: float, hardening: float) -> Floats:
    plastic, found = np.zeros((1, 2)), []
    for kappa in path:
        plastic = return_mapping(np.array([[kappa, 0.0]]), plastic, yield_1_m, hardening)
        found.append(kappa - plastic[0, 0])
    return np.array(found)


def _dahl(path: Floats, saturation_1_m: float, transition_1_m: float) -> Floats:
    z, found = 0.0, [0.0]
    for change in np.diff(path):
        fade = np.exp(-abs(change) / transition_1_m)
        z = fade * z + saturation_1_m * np.sign(change) * (1 - fade)
        found.append(z)
    return np.array(found)


def _maxwell(path: Floats, ratio: float, time_s: float) -> Floats:
    q, found, share = 0.0, [0.0], LOOP_S / len(path) / time_s
    for change in np.diff(path):
        q = q * np.exp(-share) + ratio * change * -np.expm1(-share) / share
        found.append(q)
    return np.array(found)


def _cubic(path: Floats, cubic: float) -> Floats:
    if cubic > 0:
        return path * (1 + cubic * path**2)
    return np.asarray(path / np.sqrt(1 + 2 * abs(cubic) * path**2))


UNIT = np.ones((1, 2))
FORMS: Mapping[str, tuple[Callable[[Values], Law], Callable[..., Floats]]] = MappingProxyType(
    {
        "plastic_bending": (
            lambda v: yielding(UNIT, 1.0, v["yield_curvature"], v["hardening_ratio"]),
            _bilinear,
        ),
        "internal_friction": (
            lambda v: rubbing(1.0, v["saturation_curvature"], v["transition_curvature"], 1),
            _dahl,
        ),
        "viscoelastic_bending": (
            lambda v: creeping(UNIT, v["modulus_ratio"], v["relaxation_time"]),
            _maxwell,
        ),
        "nonlinear_bending": (lambda v: Elastic(UNIT, np.zeros(2), v["cubic"]), _cubic),
    }
)
