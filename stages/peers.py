"""The scenes of `make bench` in our rod and in its peers: one rope, one arc, n particles, a step of 10 ms.

Every scene is a function that returns a `Race`: what is timed, and the shapes that it gave. A peer is
imported where its scene is made, since all but MuJoCo are in the extra `bench`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from dlolib.lab.arc import arc_motion
from dlolib.lab.elastica import Elastica, planar_elastica
from dlolib.sim.rod import Rod, scene
from dlolib.sim.scene import Scene
from dlolib.sim.simulate import Clock, Path, Rollout, State, roll_out
from dlolib.sim.start import first_shape, settle
from dlolib.types import Ends, Floats, Obstacle, Pose, Rope

ROPE = Rope("rope", 0.445, 0.008, 0.04)
EI, GJ = 3e-4, 3e-4
GRAVITY = np.array([0.0, 0.0, -9.81])
STEP_S, STEPS = 0.01, 400
# Gentle enough that inertia, which the elastica has none of, moves no point by more than 0.1 % of the length.
MOTION = arc_motion(STEPS + 1, STEP_S, sweep_rad=0.6)
SHOWN = np.arange(20, STEPS + 1, 20)
"""The rows of the motion at which shapes are held against the elastica."""


@dataclass(frozen=True)
class Race:
    """One solver on the arc: `go` runs it whole; `shapes` gives (len(SHOWN), points, 2) [m] of the last run,
    and `arc_m` their arc lengths."""

    go: Callable[[], Any]
    shapes: Callable[[], Floats]
    arc_m: Floats


def exact_shapes(points: int = 601) -> Floats:
    """The elastica at the rows SHOWN, (len(SHOWN), points, 2) [m], at even arc lengths."""
    shapes: list[Floats] = []
    branch: Elastica | None = None
    for row in (0, *SHOWN):
        end = (float(MOTION.end_m[row, 0]), float(MOTION.end_m[row, 2]))
        weight = 0.04 * 9.81
        branch = planar_elastica(ROPE.length_m, EI, weight, (0, 0), 0.0, end, 0.0, branch, points)
        shapes.append(np.stack(branch[1:3], axis=1))
    return np.array(shapes[1:])


def error_of(race: Race, exact: Floats) -> float:
    """The largest distance of a point to the exact one of its arc length, over the length."""
    s = np.linspace(0, ROPE.length_m, exact.shape[1])
    worst = 0.0
    for shape, true in zip(race.shapes(), exact, strict=True):
        off = [shape[:, k] - np.interp(race.arc_m, s, true[:, k]) for k in range(2)]
        worst = max(worst, float(np.hypot(*off).max()))
    return worst / ROPE.length_m


def arc_path(ropes: int = 1) -> Path:
    """The arc's poses after its first row."""
    x = np.stack([MOTION.start_m, MOTION.end_m], axis=1)[1:]
    q = np.stack([MOTION.start_q, MOTION.end_q], axis=1)[1:]
    return Path(np.tile(x, (ropes, 1, 1, 1)), np.tile(q, (ropes, 1, 1, 1)))


def at_rest(
    rods: list[Rod], obstacles: tuple[Obstacle, ...] = (), gravity: Floats = GRAVITY
) -> tuple[Scene, State]:
    """Rods of one number of particles at the arc's beginning: their scene, and their equilibrium."""
    poses = (Pose(MOTION.start_m[0], MOTION.start_q[0]), Pose(MOTION.end_m[0], MOTION.end_q[0]))
    made = scene(rods, gravity, Ends(), obstacles)
    one = first_shape(rods[0].rope.length_m, rods[0].particles, *poses, gravity)
    many = State(*(np.repeat(part, len(rods), axis=0) for part in (one.x, one.before, one.q)))
    x, q = (np.array([[[getattr(p, name) for p in poses]]]) for name in ("position_m", "quaternion"))
    ends = Path(np.repeat(x, len(rods), axis=0), np.repeat(q, len(rods), axis=0))
    return made, settle(made, many, ends).final.at_rest()


def ours(particles: int = 30, clock: Clock | None = None) -> Race:
    """Our rod."""
    made, start = at_rest([Rod(ROPE, EI, GJ, particles=particles)])
    path = arc_path()
    kept: list[Rollout] = []

    def go() -> Rollout:
        kept[:] = [roll_out(made, start, path, clock or Clock(STEP_S))]
        return kept[0]

    return Race(go, lambda: kept[0].x[0][SHOWN][:, :, [0, 2]], np.linspace(0, ROPE.length_m, particles))


# The edge outside each clamp, over a segment. MuJoCo joins two edges by EI over the mean of their lengths; a
# clamp's is half a segment, so that the edge that is held must have next to no length.
STUB = 0.01
# Stiffness [1/s^2] and damping [1/s] of the constraint on an edge's length. MuJoCo does not see the mocap
# body's speed, so that the edge beside it lags behind: less the stiffer it is; softer and at the default
# impedance the rope is 1 to 12 % of its length off.
EDGE, HARD = "-1e5 -1e2", "0.9999 0.9999 0.001"
# While the rope comes to rest at the arc's beginning, its points are slowed by so much [N s/m].
CALM_N_S_M = 1e-2
COMING, RESTING = 200, 800


def mujoco_flex(particles: int = 30, ei: float = EI) -> Race:
    """MuJoCo 4's one-dimensional flex: discrete elastic rods, integrator "discrete" (implicit), no twist.

    The outer edge at each end is held, by the world and by a mocap body that goes the arc's way.
    """
    model, data = flex_scene(particles, ei)
    start = flex_at_rest(model, data)
    kept: list[Floats] = []

    def go() -> None:
        kept[:] = flex_run(model, data, start)

    return Race(go, lambda: np.array(kept)[SHOWN - 1][:, :, [0, 2]], np.linspace(0, ROPE.length_m, particles))


def flex_scene(particles: int, ei: float) -> tuple[Any, Any]:
    """Model and data of the flex, straight along x from the origin."""
    nodes = np.linspace(0, ROPE.length_m, particles)
    stub, radius = STUB * nodes[1], ROPE.radius_m
    slides = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
    # the mass of a point is its share of the length; an inertia is asked for, and not used
    inertial = f'<inertial pos="0 0 0" mass="{0.04 * nodes[1]}" diaginertia="1e-9 1e-9 1e-9"/>'
    points = "".join(
        f'<body name="p{i}" pos="{x} 0 0">{slides}{inertial}</body>' for i, x in enumerate(nodes[1:-1], 1)
    )
    bodies = ["world", "world", *(f"p{i}" for i in range(1, particles - 1)), "hand", "hand"]
    vertices = np.zeros((particles + 2, 3))
    vertices[[0, -1], 0] = -stub, stub
    numbers = " ".join(f"{value:.9g}" for value in vertices.ravel())
    elements = " ".join(f"{i} {i + 1}" for i in range(particles + 1))
    young, shear = ei / (np.pi * radius**4 / 4), GJ / (np.pi * radius**4 / 2)
    model = mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <option timestep="{STEP_S}" integrator="discrete"><flag contact="disable"/></option>
  <worldbody>
    {points}
    <body name="hand" mocap="true" pos="{nodes[-1]} 0 0"/>
  </worldbody>
  <deformable>
    <flex name="rope" dim="1" radius="{radius}" body="{" ".join(bodies)}" vertex="{numbers}"
          element="{elements}">
      <contact selfcollide="none"/>
      <elasticity young="{young}" shear="{shear}"/>
    </flex>
  </deformable>
  <equality><flex flex="rope" solref="{EDGE}" solimp="{HARD}"/></equality>
</mujoco>""")
    return model, mujoco.MjData(model)


def flex_at_rest(model: Any, data: Any) -> Floats:
    """The flex's state (positions of its joints) at rest at the arc's beginning."""
    mujoco.mj_resetData(model, data)
    model.dof_damping[:] = CALM_N_S_M
    far, near = np.array([ROPE.length_m, 0.0, 0.0]), MOTION.end_m[0]
    for step in range(COMING + RESTING):
        share = min(1.0, (step + 1) / COMING)
        data.mocap_pos[0] = (1 - share) * far + share * near
        mujoco.mj_step(model, data)
    model.dof_damping[:] = 0.0
    return np.array(data.qpos)


def flex_run(model: Any, data: Any, start: Floats) -> list[Floats]:
    """The arc from rest; the rope's points (n, 3) after every step."""
    mujoco.mj_resetData(model, data)
    data.qpos[:] = start
    data.mocap_pos[0] = MOTION.end_m[0]
    kept = []
    for end in MOTION.end_m[1:]:
        data.mocap_pos[0] = end
        mujoco.mj_step(model, data)
        kept.append(data.flexvert_xpos[1:-1].copy())
    return kept


def pyelastica(elements: int = 30, substeps: int = 100) -> Race:
    """PyElastica's Cosserat rod, explicit (position Verlet), so many substeps in a step of ours.

    Its first and last elements are held whole. They stand half outside the clamps, so that the distance from
    the clamp to the next element's middle is that between any two; bending is then clamped at the wall.
    """
    import elastica  # in the extra `bench`

    class Simulator(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing):  # type: ignore[misc]
        pass

    class Held(elastica.ConstraintBase):  # type: ignore[misc]
        """The first and the last element go the arc's way."""

        def __init__(self, **given: Any) -> None:
            super().__init__(**given)
            self.nodes = self.system.position_collection[:, [0, 1, -2, -1]].copy()
            self.frames = self.system.director_collection[..., [0, -1]].copy()

        def constrain_values(self, system: Any, time: float) -> None:
            moved = (end_at(float(time)) - far)[:, None]
            system.position_collection[:, :2] = self.nodes[:, :2]
            system.position_collection[:, -2:] = self.nodes[:, 2:] + moved
            system.director_collection[..., 0] = self.frames[..., 0]
            system.director_collection[..., -1] = self.frames[..., 1]

        def constrain_rates(self, system: Any, time: float) -> None:
            row = int(float(time) / STEP_S)
            system.velocity_collection[:, :2] = 0.0
            system.velocity_collection[:, -2:] = speeds[row] if time >= 0.0 else 0.0
            system.omega_collection[:, [0, -1]] = 0.0

    class Calm(elastica.NoForces):  # type: ignore[misc]
        """Slows every node on the way to the arc's beginning."""

        def apply_forces(self, system: Any, time: float = 0.0) -> None:
            if time < 0.0:
                system.external_forces -= CALM_N_S_M * system.velocity_collection

    coming = 3.0
    far = np.array([ROPE.length_m, 0.0, 0.0])
    # one speed a step; the last is for the rounding of the last substep's time
    speeds = np.diff(MOTION.end_m, axis=0, append=MOTION.end_m[-1:])[..., None] / STEP_S

    def end_at(t: float) -> Floats:
        if t < 0.0:
            share = min(1.0, 2 * (1 + t / coming))
            return np.asarray((1 - share) * far + share * MOTION.end_m[0])
        row = int(t / STEP_S)
        return np.asarray(MOTION.end_m[row] + (t - row * STEP_S) * speeds[row, :, 0])

    length = ROPE.length_m * elements / (elements - 1)
    half = length / elements / 2
    area = np.pi * ROPE.radius_m**2
    inertia = area * ROPE.radius_m**2 / 4
    made = Simulator()
    rod = elastica.CosseratRod.straight_rod(
        elements, np.array([-half, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), length,
        ROPE.radius_m, 0.04 / area, youngs_modulus=EI / inertia, shear_modulus=GJ / (2 * inertia),
    )  # fmt: skip
    made.append(rod)
    made.constrain(rod).using(Held)
    made.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=GRAVITY)
    made.add_forcing_to(rod).using(Calm)
    made.finalize()
    stepper, h = elastica.PositionVerlet(), STEP_S / substeps
    time, begun = -coming, {}
    for _ in range(round(coming / h)):
        time = stepper.step(made, time, h)
    names = ("position", "director", "velocity", "omega", "acceleration", "alpha")
    for name in names:
        begun[name] = getattr(rod, f"{name}_collection").copy()
    kept: list[Floats] = []

    def go() -> None:
        for name in names:
            getattr(rod, f"{name}_collection")[...] = begun[name]
        kept.clear()
        time = 0.0
        for _ in range(STEPS):
            for _ in range(substeps):
                time = stepper.step(made, time, h)
            kept.append(rod.position_collection.T.copy())

    arc = np.linspace(-half, ROPE.length_m + half, elements + 1)[1:-1]
    return Race(go, lambda: np.array(kept)[SHOWN - 1][:, 1:-1][:, :, [0, 2]], arc)
