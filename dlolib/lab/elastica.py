"""The exact planar rod: an inextensible heavy elastica, clamped at both ends. The laboratory's yardstick."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import minimize

from dlolib.errors import SimulationError
from dlolib.types import Floats

Elastica = tuple[Floats, Floats, Floats, Floats]
COARSE = 40


def planar_elastica(
    length_m: float,
    bending_stiffness: float,
    weight_n_m: float,
    start_xz: tuple[float, float],
    start_angle: float,
    end_xz: tuple[float, float],
    end_angle: float,
    guess: Elastica | None = None,
    points: int = 201,
) -> Elastica:
    """Rest shape of an inextensible rod under its own weight, both ends clamped, in the x-z plane.

    Euler's elastica with weight (Antman, Nonlinear Problems of Elasticity, ch. 4): EI θ'' = Nx sin θ -
    (Nz + w s) cos θ with x' = cos θ, z' = sin θ. Without a guess the energy of a coarse chain of
    straight pieces is minimised first, from an arc that hangs below the chord, so that the solution is a
    stable rest shape; the boundary value problem then makes it exact.

    Args:
        length_m: length [m].
        bending_stiffness: EI [N m²].
        weight_n_m: linear density times gravity [N/m], acting along -z.
        start_xz: start of the rod [m].
        start_angle: tangent at the start [rad], from +x towards +z.
        end_xz: end of the rod [m].
        end_angle: tangent at the end [rad], continued along the rod: a full turn counts.
        guess: an earlier solution nearby, whose branch is followed.
        points: how many points to return.

    Returns:
        Arc length s [m], x [m], z [m] and tangent angle θ [rad], each of shape (points,).

    Raises:
        SimulationError: the ends are further apart than the rod is long, or nothing converged.
    """
    chord = np.subtract(end_xz, start_xz) / length_m
    if np.hypot(*chord) >= 1:
        raise SimulationError(
            f"the ends are {np.hypot(*chord) * length_m:.3f} m apart and the rod is {length_m:.3f} m long",
            mend="bring the ends closer together",
        )
    weight = weight_n_m * length_m**3 / bending_stiffness
    if guess is None:
        u = (np.arange(COARSE) + 0.5) / COARSE
        hanging = _hanging(u, chord, start_angle, end_angle)
        theta = _least_energy(hanging, weight, chord, start_angle, end_angle)
        u, theta = np.r_[0, u, 1], np.r_[start_angle, theta, end_angle]
    else:
        u, theta = np.asarray(guess[0]) / length_m, np.asarray(guess[3])
    states = _boundary_value(u, theta, weight, chord, start_angle, end_angle, points)
    s = np.linspace(0, length_m, points)
    return s, start_xz[0] + length_m * states[2], start_xz[1] + length_m * states[3], states[0]


def _hanging(u: Floats, chord: Floats, start_angle: float, end_angle: float) -> Floats:
    """Angles (N,) of an arc below the chord, about as long as the rod."""
    reach = np.hypot(*chord)
    sag = np.sqrt(max(4 * (1 - reach), 0.0))
    along = np.arctan2(chord[1], chord[0])
    ends = np.where(u < 0.5, start_angle - along, end_angle - along) * np.abs(1 - 2 * u) ** 4
    return np.asarray(along - sag * np.sin(2 * np.pi * u) + ends)


def _least_energy(
    theta: Floats, weight: float, chord: Floats, start_angle: float, end_angle: float
) -> Floats:
    """Rest angles (N,) of N straight pieces, all in units of length and EI; half springs at the clamps."""
    count = len(theta)
    stiffness = np.full(count + 1, float(count))
    stiffness[[0, -1]] *= 2
    lever = weight * (count - np.arange(count) - 0.5) / count**2

    def energy(angles: Floats) -> tuple[float, Floats]:
        bend = np.diff(np.r_[start_angle, angles, end_angle])
        moment = stiffness * bend
        value = 0.5 * moment @ bend + lever @ np.sin(angles)
        return value, moment[:-1] - moment[1:] + lever * np.cos(angles)

    closed: Any = {
        "type": "eq",
        "fun": lambda angles: np.array([np.cos(angles).mean(), np.sin(angles).mean()]) - chord,
        "jac": lambda angles: np.array([-np.sin(angles), np.cos(angles)]) / count,
    }
    found = minimize(
        energy, theta, jac=True, method="SLSQP", constraints=closed, options={"maxiter": 500, "ftol": 1e-10}
    )
    return np.asarray(found.x)


def _boundary_value(
    u: Floats, theta: Floats, weight: float, chord: Floats, start_angle: float, end_angle: float, points: int
) -> Floats:
    """Angle, curvature, x and z (4, points) in units of the length, from angles (N,) at u (N,)."""
    mesh = np.linspace(0, 1, max(points, 101))
    theta = np.interp(mesh, u, theta)
    curvature = np.gradient(theta, mesh)
    bend = np.gradient(curvature, mesh)[5:-5]
    inner, at = theta[5:-5], mesh[5:-5]
    # EI θ'' is linear in the two unknown force components: least squares gives their start.
    matrix = np.column_stack([np.sin(inner), -np.cos(inner)])
    force = np.linalg.lstsq(matrix, bend + weight * at * np.cos(inner), rcond=None)[0]

    def slope(s: Floats, y: Floats, p: Floats) -> Floats:
        sine, cosine = np.sin(y[0]), np.cos(y[0])
        return np.array([y[1], p[0] * sine - (p[1] + weight * s) * cosine, cosine, sine])

    def ends(a: Floats, b: Floats, p: Floats) -> Floats:
        return np.array([a[0] - start_angle, b[0] - end_angle, a[2], a[3], b[2] - chord[0], b[3] - chord[1]])

    step = np.diff(mesh, prepend=0)
    start = np.array([theta, curvature, np.cumsum(np.cos(theta) * step), np.cumsum(np.sin(theta) * step)])
    found = solve_bvp(slope, ends, mesh, start, p=force, tol=1e-8, max_nodes=20_000)
    if not found.success:
        raise SimulationError(
            f"the exact elastica did not converge: {found.message}",
            mend="give a nearer guess: follow the motion in smaller steps",
        )
    return np.asarray(found.sol(np.linspace(0, 1, points)))
