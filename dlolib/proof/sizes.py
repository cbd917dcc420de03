"""Effects of a given size: each sampler turns a multiple of the size that is found into parameters.

`FOUND` is the size with 95 % power of missing-physics.md where that has one, otherwise the size whose
noise-free gain over the elastic rope is about 40 in the plain motion of data/practice with EI = GJ = 3e-4
N m² and white noise of 1.5 mm: places and directions, drawn at random, move the gain by a factor of a few.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from dlolib.proof.place import Place
from dlolib.proof.world import Effects

Values = dict[str, float]
Sampler = Callable[[np.random.Generator, float, Place], Values]

FOUND: Mapping[str, float] = MappingProxyType(
    {
        # missing-physics.md
        "rest_curvature": 0.8,
        "internal_friction": 0.35,
        "viscoelastic_bending": 0.29,
        "stiffness_profile": 0.06,
        "mass_profile": 0.0003,
        "end_angle": float(np.radians(0.5)),
        "lateral_load": 0.04 * 9.81 * float(np.radians(0.4)),
        # the laboratory's gain of 40
        "plastic_bending": 0.043,
        "nonlinear_bending": 0.00012,
        "anisotropic_bending": 0.35,
        "axial_stretch": 0.0115,
        "end_compliance": 1.8,
        "end_twist": 0.07,
        "grasp_slip": 0.00055,
        "length_error": 0.00063,
        "contact_friction": 0.1,
        "hidden_obstacle": 0.0012,
        "inertia_drag": 0.21,
        "clock_offset": 0.0134,
        "camera_pose": 0.00085,
    }
)
NAMES = tuple(sorted(FOUND))
# A share of the lumps is a gradient instead, of the same gain: 0.06 of the density beside 0.3 g.
GRADIENT_SHARE, GRADIENT_PER_KG = 0.3, 200.0
DEPTH_SHARE, DEPTH_PER_RAD = 0.3, 0.25
SMALLEST, LARGEST = 0.25, 8.0
FLATTEST = float(np.log(2.5))


def draw_effect(rng: np.random.Generator, name: str, place: Place, multiple: float | None = None) -> Effects:
    """One effect: its size log-uniform from 0.25 to 8 times the one that is found, or this multiple of it."""
    drawn = float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))
    size = FOUND[name] * (drawn if multiple is None else multiple)
    return {name: SAMPLERS[name](rng, size, place)}


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _disc(rng: np.random.Generator, size: float) -> tuple[float, float]:
    angle = rng.uniform(0, 2 * np.pi)
    return float(size * np.cos(angle)), float(size * np.sin(angle))


def _rest_curvature(rng: np.random.Generator, size: float, place: Place) -> Values:
    return dict(zip(("kappa_1", "kappa_2"), _disc(rng, size), strict=True))


def _plastic_bending(rng: np.random.Generator, size: float, place: Place) -> Values:
    """The size is how far the rope is bent past what lets the stack's first slider go, nearly."""
    yields = 1.25 * place.most_curvature_1_m / (1 + size)
    return {"yield_curvature": float(yields), "hardening_ratio": float(rng.uniform(0.1, 0.4))}


def _internal_friction(rng: np.random.Generator, size: float, place: Place) -> Values:
    transition = np.exp(rng.uniform(np.log(1.0), np.log(5.0)))
    return {"saturation_curvature": size, "transition_curvature": float(transition)}


def _viscoelastic_bending(rng: np.random.Generator, size: float, place: Place) -> Values:
    time = np.exp(rng.uniform(np.log(2.0), np.log(15.0)))
    return {"modulus_ratio": size, "relaxation_time": float(time)}


def _nonlinear_bending(rng: np.random.Generator, size: float, place: Place) -> Values:
    return {"cubic": _sign(rng) * size}


def _anisotropic_bending(rng: np.random.Generator, size: float, place: Place) -> Values:
    """The size is the ratio's logarithm; a cable is not flatter than one to two and a half."""
    return {"stiffness_ratio": float(np.exp(_sign(rng) * min(size, FLATTEST)))}


def _stiffness_profile(rng: np.random.Generator, size: float, place: Place) -> Values:
    """A soft spot, or a stiff one (a splice) in a quarter of the draws."""
    stiff = rng.random() < 0.25
    return {
        "s": float(rng.uniform(0.15, 0.85) * place.length_m),
        "factor": float(np.exp(size if stiff else -size)),
        "width": float(rng.uniform(0.03, 0.06)),
    }


def _mass_profile(rng: np.random.Generator, size: float, place: Place) -> Values:
    gradient = rng.random() < GRADIENT_SHARE
    lump = float(rng.uniform(0.15, 0.85) * place.length_m)
    if gradient:
        return {"s": lump, "mass": 0.0, "gradient": _sign(rng) * min(GRADIENT_PER_KG * size, 0.9)}
    return {"s": lump, "mass": size, "gradient": 0.0}


def _axial_stretch(rng: np.random.Generator, size: float, place: Place) -> Values:
    """The size is the compliance [1/N]."""
    return {"axial_stiffness": 1 / size}


def _end_angle(rng: np.random.Generator, size: float, place: Place) -> Values:
    end = str(rng.choice(["start", "end"]))
    return dict(zip((f"{end}_1", f"{end}_2"), _disc(rng, size), strict=True))


def _end_compliance(rng: np.random.Generator, size: float, place: Place) -> Values:
    """The size is the compliance [rad/(N m)]."""
    return {f"{rng.choice(['start', 'end'])}_stiffness": 1 / size}


def _end_twist(rng: np.random.Generator, size: float, place: Place) -> Values:
    return {str(rng.choice(["start", "end"])): _sign(rng) * size}


def _grasp_slip(rng: np.random.Generator, size: float, place: Place) -> Values:
    time = rng.uniform(*place.main_s)
    return {"length": size, "time": float(time), "duration": float(rng.uniform(0.2, 2.0))}


def _length_error(rng: np.random.Generator, size: float, place: Place) -> Values:
    return {"relative": _sign(rng) * size}


def _lateral_load(rng: np.random.Generator, size: float, place: Place) -> Values:
    return {**dict(zip("xy", _disc(rng, size), strict=True)), "z": 0.0}


def _contact_friction(rng: np.random.Generator, size: float, place: Place) -> Values:
    return {"coefficient": size}


def _hidden_obstacle(rng: np.random.Generator, size: float, place: Place) -> Values:
    """The size is how deep the free rope's path would enter it [m]."""
    radius = float(rng.uniform(0.015, 0.04))
    center = place.obstacle_center(rng, radius, size)
    return {**dict(zip("xyz", (float(x) for x in center), strict=True)), "radius": radius}


def _inertia_drag(rng: np.random.Generator, size: float, place: Place) -> Values:
    return {"inertia": 1.0, "drag": size}


def _clock_offset(rng: np.random.Generator, size: float, place: Place) -> Values:
    """The size is a time at a row every 0.05 s [s]: the same way of the gripper at any speed."""
    return {"time": _sign(rng) * size * place.row_s / 0.05}


def _camera_pose(rng: np.random.Generator, size: float, place: Place) -> Values:
    values = {"rotation_1": 0.0, "rotation_2": 0.0, "rotation_3": 0.0, "depth": 0.0}
    if rng.random() < DEPTH_SHARE:
        return values | {"depth": _sign(rng) * DEPTH_PER_RAD * size}
    axis = rng.normal(size=3)
    axis *= size / np.linalg.norm(axis)
    return values | {f"rotation_{index}": float(part) for index, part in enumerate(axis, 1)}


SAMPLERS: Mapping[str, Sampler] = MappingProxyType(
    {
        "rest_curvature": _rest_curvature,
        "plastic_bending": _plastic_bending,
        "internal_friction": _internal_friction,
        "viscoelastic_bending": _viscoelastic_bending,
        "nonlinear_bending": _nonlinear_bending,
        "anisotropic_bending": _anisotropic_bending,
        "stiffness_profile": _stiffness_profile,
        "mass_profile": _mass_profile,
        "axial_stretch": _axial_stretch,
        "end_angle": _end_angle,
        "end_compliance": _end_compliance,
        "end_twist": _end_twist,
        "grasp_slip": _grasp_slip,
        "length_error": _length_error,
        "lateral_load": _lateral_load,
        "contact_friction": _contact_friction,
        "hidden_obstacle": _hidden_obstacle,
        "inertia_drag": _inertia_drag,
        "clock_offset": _clock_offset,
        "camera_pose": _camera_pose,
    }
)
