"""What the laboratory plays: an experiment, the effects in it, and the chain that has them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from dlolib.proof.chain import CLAMP, Chain, Sizes
from dlolib.proof.contact import HARDNESS_N_M2, Contact
from dlolib.proof.equilibrium import Equilibrium, Springs
from dlolib.proof.laws import Elastic, Law, creeping, rubbing, yielding
from dlolib.types import Floats, Motion, Obstacle

Effects = Mapping[str, Mapping[str, float]]
NOTHING: Effects = MappingProxyType({})
GRAVITY_M_S2 = (0.0, 0.0, -9.81)
POINTS = 30
# Three bodies between neighbouring points, enough for most; `dlolib.proof.play.settled` sees to the others.
BODIES = 3 * (POINTS - 1)
# What remembers: the way along the motion's rows counts.
REMEMBERS = frozenset(
    {
        "plastic_bending",
        "internal_friction",
        "viscoelastic_bending",
        "contact_friction",
        "hidden_obstacle",
        "inertia_drag",
    }
)
# The soft spot's edges fall over this share of its width, by the sixth power of the distance.
EDGE_POWER = 6
NARROWEST_M = 1e-9
ENDS = ("start", "end")
# A clamp's hinge that does not give way [N m/rad].
RIGID_N_M = 1e3


@dataclass(frozen=True)
class Experiment:
    """An elastic rope, its motion, and what else is recorded of the scene.

    Args:
        motion: poses of both ends; the start must not move.
        frame_t_s: when the camera looks [s], shape (F,).
        bending_stiffness, torsional_stiffness: EI and GJ [N m²].
        sizes: what recording.json says of the rope.
        obstacles: spheres and cylinders that are recorded.
        hardness: of all that the rope touches, force by depth for each metre of rope [N/m²].
    """

    motion: Motion
    frame_t_s: Floats
    bending_stiffness: float
    torsional_stiffness: float
    sizes: Sizes = field(default_factory=Sizes)
    obstacles: tuple[Obstacle, ...] = ()
    hardness: float = HARDNESS_N_M2


def build(experiment: Experiment, effects: Effects, bodies: int) -> Equilibrium:
    """The chain near its first pose, without history, unbalanced still."""
    motion = experiment.motion
    compliance = effects.get("end_compliance")
    start = turned_end(motion.start_q[:1], effects, "start")[0]
    chain = Chain(
        bodies,
        motion.start_m[0],
        start.as_quat(scalar_first=True),
        stretches="axial_stretch" in effects,
        yields=compliance is not None,
    )
    length_m = free_length(experiment, effects, float(motion.t_s[0]))
    profile = _profile(experiment, effects, bodies)
    springs = Springs(
        torsion=experiment.torsional_stiffness * profile,
        axial=effects.get("axial_stretch", {}).get("axial_stiffness", np.inf),
        clamps=np.zeros(0)
        if compliance is None
        else np.repeat([compliance.get(f"{end}_stiffness", RIGID_N_M) for end in ENDS], len(CLAMP)),
    )
    balance = Equilibrium(
        chain,
        _laws(experiment, effects, profile),
        springs,
        _loads(experiment, effects, bodies),
        _contacts(experiment, effects, bodies),
        np.zeros(chain.freedoms),
    )
    balance.lengthen(length_m)
    balance.q = _hanging(chain, start, float(np.linalg.norm(motion.end_m[0] - motion.start_m[0]) / length_m))
    return balance


def free_length(experiment: Experiment, effects: Effects, t_s: float) -> float:
    """Length of the free rope at a time [m]: an error of the tape, and a grasp that slips along a ramp."""
    length = experiment.sizes.length_m * (1 + effects.get("length_error", {}).get("relative", 0.0))
    slip = effects.get("grasp_slip")
    if slip is None:
        return length
    # The ramp's slope at its middle is that of tanh((t - time) / duration) / 2.
    share = np.clip(0.5 + 0.5 * (t_s - slip["time"]) / max(slip["duration"], 1e-9), 0.0, 1.0)
    return float(length - slip["length"] * share)


def turned_end(recorded: Floats, effects: Effects, end: str) -> Rotation:
    """Where the clamps of these recorded quaternions (F, 4) really point: end_angle, end_twist."""
    turn = Rotation.from_quat(recorded, scalar_first=True)
    angle = effects.get("end_angle", {})
    tilt = [angle.get(f"{end}_1", 0.0), angle.get(f"{end}_2", 0.0), 0.0]
    roll = [0.0, 0.0, effects.get("end_twist", {}).get(end, 0.0)]
    return turn * Rotation.from_rotvec(tilt) * Rotation.from_rotvec(roll)


def _profile(experiment: Experiment, effects: Effects, bodies: int) -> Floats:
    """EI of every joint over the rope's (N + 1,): compliance averaged over the length it stands for."""
    spot = effects.get("stiffness_profile")
    if spot is None:
        return np.ones(bodies + 1)
    length = experiment.sizes.length_m
    fine = np.clip((np.arange(bodies + 1)[:, None] + np.linspace(-0.5, 0.5, 21)) / bodies, 0, 1) * length
    # Falls to a half at the edges of the width; a trial of the laboratory's own fits may have none.
    width = max(abs(spot["width"]), NARROWEST_M)
    weight = np.exp2(-(np.abs(2 * (fine - spot["s"]) / width) ** EDGE_POWER))
    return np.asarray(1 / np.mean(1 / (1 - (1 - spot["factor"]) * weight), axis=1))


def _laws(experiment: Experiment, effects: Effects, profile: Floats) -> list[Law]:
    ei = experiment.bending_stiffness
    ratio = effects.get("anisotropic_bending", {}).get("stiffness_ratio", 1.0)
    stiffness = ei * profile[:, None] * np.array([1.0, ratio])
    memory = effects.get("rest_curvature", {})
    rest = np.array([memory.get("kappa_1", 0.0), memory.get("kappa_2", 0.0)])
    laws: list[Law] = []
    plastic = effects.get("plastic_bending")
    cubic = effects.get("nonlinear_bending", {}).get("cubic", 0.0)
    laws.append(Elastic(stiffness, rest, cubic, linear=0.0 if plastic else 1.0))
    if plastic is not None:
        laws.append(yielding(stiffness, ei, plastic["yield_curvature"], plastic["hardening_ratio"], rest))
    if "internal_friction" in effects:
        friction = effects["internal_friction"]
        laws.append(
            rubbing(ei, friction["saturation_curvature"], friction["transition_curvature"], len(profile))
        )
    if "viscoelastic_bending" in effects:
        branch = effects["viscoelastic_bending"]
        laws.append(creeping(stiffness, branch["modulus_ratio"], branch["relaxation_time"]))
    return laws


def vertex_masses(experiment: Experiment, effects: Effects, bodies: int) -> Floats:
    """Mass of the rope at every vertex [kg], (N + 1,): each body's halves, a lump by the lever."""
    length, place = experiment.sizes.length_m, np.linspace(0, 1, bodies + 1)
    profile = effects.get("mass_profile", {})
    middle = (place[1:] + place[:-1]) / 2
    whole = experiment.sizes.linear_density_kg_m * length / bodies
    body = whole * (1 + profile.get("gradient", 0.0) * (2 * middle - 1))
    masses = np.zeros(bodies + 1)
    masses[:-1] += body / 2
    masses[1:] += body / 2
    at = profile.get("s", 0.0) / length * bodies
    first = min(int(at), bodies - 1)
    masses[first : first + 2] += profile.get("mass", 0.0) * np.array([first + 1 - at, at - first])
    return masses


def _loads(experiment: Experiment, effects: Effects, bodies: int) -> Floats:
    """Weights and the side load at the vertices [N], (N + 1, 3)."""
    side = effects.get("lateral_load", {})
    share = np.full(bodies + 1, experiment.sizes.length_m / bodies)
    share[[0, -1]] /= 2
    wind = np.array([side.get(axis, 0.0) for axis in "xyz"])
    masses = vertex_masses(experiment, effects, bodies)
    return np.asarray(masses[:, None] * np.array(GRAVITY_M_S2) + share[:, None] * wind)


def _contacts(experiment: Experiment, effects: Effects, bodies: int) -> list[Contact]:
    radius = experiment.sizes.diameter_m / 2
    friction = effects.get("contact_friction", {}).get("coefficient", 0.0)
    hardness = experiment.hardness
    found = [Contact(one, radius, friction, bodies, hardness) for one in experiment.obstacles]
    hidden = effects.get("hidden_obstacle")
    if hidden is not None:
        center = (hidden["x"], hidden["y"], hidden["z"])
        sphere = Obstacle("sphere", {"center_m": center, "radius_m": (hidden["radius"],)})
        found.append(Contact(sphere, radius, 0.0, bodies, hardness))
    return found


def _hanging(chain: Chain, start: Rotation, reach: float) -> Floats:
    """Angles (D,) of a chain that sags below its start's tangent, its ends `reach` of its length apart."""
    middle = (np.arange(chain.bodies) + 0.5) / chain.bodies
    reach = min(reach, 0.9995)

    def short(sag: float) -> float:
        return float(np.cos(sag * np.sin(2 * np.pi * middle)).mean() - reach)

    sag = brentq(short, 0.0, 2.4)
    bend = np.diff(np.concatenate([[0.0], -sag * np.sin(2 * np.pi * middle), [0.0]]))
    axes = start.as_matrix()
    level = np.cross(axes[:, 2], (0.0, 0.0, 1.0))
    about = axes[:, :2].T @ (level / np.linalg.norm(level))
    q = np.zeros(chain.freedoms)
    q[chain.place[:, :2]] = bend[:, None] * about
    return q
