"""Ropes that nobody holds, or one end alone: they fall, they swing, and they stay whole."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from sim.ropes import EI, GJ, GRAVITY, LEVEL, ROPE, pose, way_of

from dlolib.errors import SimulationError
from dlolib.sim import simulate
from dlolib.sim.effects import LAWS, named
from dlolib.sim.effects.base import Camera
from dlolib.sim.observe import seen, viewing_axis
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod, scene
from dlolib.sim.simulate import Clock, Path, Rollout, State, roll_out
from dlolib.sim.start import first_shape, released, settle
from dlolib.types import Ends, Floats, Motion, Points, Recording

FREE = Ends("free", "free")
SIZES = (5, 12, 30, 200)


def curl(s_m: Floats) -> Floats:
    """An arc that leaves its plane."""
    return np.stack([np.sin(4 * s_m) / 4, 0.05 * s_m**2, (1 - np.cos(4 * s_m)) / 4], axis=1)


def nowhere(steps: int) -> Path:
    return Path(np.zeros((1, steps, 2, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (1, steps, 2, 1)))


def longest_change(rollout: Rollout) -> float:
    lengths = np.linalg.norm(np.diff(rollout.x[0], axis=1), axis=2)
    return float(np.abs(lengths / (ROPE.length_m / lengths.shape[1]) - 1).max())


def let_go(particles: int, step_s: float, time_s: float = 0.4) -> tuple[Rollout, Floats]:
    """A bent rope let go, and the way of its centre of mass (T + 1, 3)."""
    made = scene([Rod(ROPE, EI, GJ, particles=particles)], GRAVITY, FREE)
    s = np.linspace(0, ROPE.length_m, particles)
    state = released(s, curl(s), made.segments[0, :, 0])
    rollout = roll_out(made, state, nowhere(round(time_s / step_s)), Clock(step_s))
    centre = np.einsum("n,tnk->tk", made.mass[0] / made.mass[0].sum(), rollout.x[0])
    return rollout, centre - centre[0]


@pytest.mark.parametrize("particles", SIZES)
def test_a_free_rope_falls_as_its_centre_of_mass_does(particles: int) -> None:
    """By g t^2 / 2, at any step."""
    rollout, centre = let_go(particles, 0.005)
    t = 0.005 * np.arange(len(centre))
    assert np.abs(centre - 0.5 * GRAVITY * (t**2)[:, None]).max() < 1e-6
    assert longest_change(rollout) < 1e-5
    # what is bent and let go straightens and swings
    shape = rollout.x[0] - rollout.x[0].mean(axis=1, keepdims=True)
    assert np.linalg.norm(shape[-1] - shape[0], axis=1).max() > 0.02


@pytest.mark.parametrize("particles", SIZES)
@pytest.mark.parametrize("held", ["start", "end"])
def test_a_rope_held_at_one_end_hangs_after_it_swung(particles: int, held: str) -> None:
    ends = Ends("clamped", "free") if held == "start" else Ends("free", "clamped")
    rod = Rod(ROPE, EI, GJ, {"inertia_drag.inertia": 1.0, "inertia_drag.drag": 0.5}, particles)
    made = scene([rod], GRAVITY, ends)
    here = pose(0.0, 0.0, 0.0)
    poses = (here, None) if held == "start" else (None, here)
    state = first_shape(ROPE.length_m, particles, *poses, GRAVITY)
    still = Path(np.zeros((1, 400, 2, 3)), np.tile(LEVEL, (1, 400, 2, 1)))
    rollout = roll_out(made, state, still, Clock(0.01))
    rest = roll_out(made, rollout.final.at_rest(), Path(still.x[:, :1], still.q[:, :1]), Clock(None))
    assert longest_change(rollout) < 5e-4
    assert np.abs(rollout.x[0, -1] - rest.x[0, -1]).max() < 1e-3
    tip = rest.x[0, -1, -1 if held == "start" else 0]
    assert tip[2] < -0.3 and np.linalg.norm(tip) < ROPE.length_m


def test_a_quasi_static_free_rope_is_refused() -> None:
    made = scene([Rod(ROPE, EI, GJ, particles=12)], GRAVITY, FREE)
    s = np.linspace(0, ROPE.length_m, 12)
    with pytest.raises(SimulationError, match="no end is held.*; hold an end"):
        roll_out(made, released(s, curl(s), made.segments[0, :, 0]), nowhere(3), Clock(None))
    with pytest.raises(SimulationError, match="no end is held"):
        RecordingModel(recording(quasi_static=True), 12, 0.01).predict(Rod(ROPE, EI, GJ, particles=12))
    with pytest.raises(SimulationError, match="no end is held"):
        first_shape(ROPE.length_m, 12, None, None, GRAVITY)


def recording(quasi_static: bool = False) -> Recording:
    """Four frames of a rope that falls: only the first says where it is."""
    t_s, empty = np.linspace(0, 0.3, 4), np.full((4, 7), np.nan)
    motion = Motion(t_s, empty[:, :3], empty[:, 3:], empty[:, :3], empty[:, 3:])
    s = np.linspace(0.01, 0.43, 9)
    seen = np.concatenate([curl(s), np.zeros((27, 3))])
    points = Points(np.repeat(np.arange(4), 9), np.repeat(t_s, 9), np.tile(s, 4), seen)
    return Recording("falls", ROPE, GRAVITY, FREE, motion, points, quasi_static=quasi_static)


def test_a_recording_of_a_falling_rope(monkeypatch: pytest.MonkeyPatch) -> None:
    """It begins where it was seen; derivatives are those of the points, where the free length counts too."""
    monkeypatch.setattr(simulate, "TOLERANCE", 1e-11)
    model = RecordingModel(recording(), 12, 0.01)
    rod = Rod(ROPE, EI, GJ, {"length_error.relative": 0.001, "anisotropic_bending.stiffness_ratio": 1.4}, 12)
    names = ["bending_stiffness", "torsional_stiffness", *rod.effects]
    found = model.predict(rod, names)
    assert np.abs(found.xyz_m[:9] - recording().points.xyz_m[:9]).max() < 3e-3
    fallen = np.mean(found.xyz_m[-9:] - recording().points.xyz_m[:9], axis=0)
    assert fallen[2] == pytest.approx(-0.5 * 9.81 * 0.3**2, abs=0.02)
    for k, name in enumerate(names):
        h = 1e-3 * rod.value(name)
        by = []
        for width in (h, h / 2):
            sides = (
                model.predict(rod.with_values({name: rod.value(name) + d})).xyz_m for d in (width, -width)
            )
            by.append((next(sides) - next(sides)) / (2 * width))
        true = (4 * by[1] - by[0]) / 3
        off = np.linalg.norm(found.by_parameter[:, :, k] - true) / np.linalg.norm(true)
        assert off < 1e-5, name


def curled(length_m: float, s_m: Floats) -> Recording:
    """Ten frames of a curled rope of another length than recorded, which falls."""
    rope = replace(ROPE, length_m=length_m, linear_density_kg_m=0.04 * ROPE.length_m / length_m)
    t_s, empty = np.linspace(0, 0.25, 10), np.full((10, 7), np.nan)
    motion = Motion(t_s, empty[:, :3], empty[:, 3:], empty[:, :3], empty[:, 3:])
    frame, places = np.repeat(np.arange(10), len(s_m)), s_m * length_m / ROPE.length_m
    points = Points(frame, t_s[frame], np.tile(places, 10), np.tile(curl(places), (10, 1)))
    blank = Recording("falls", rope, GRAVITY, FREE, motion, points, quasi_static=False)
    xyz_m = RecordingModel(blank, 30, 0.005).predict(Rod(rope, EI, GJ)).xyz_m
    points = replace(points, s_m=np.tile(s_m, 10), xyz_m=xyz_m)
    return replace(blank, rope=ROPE, points=points)


@pytest.mark.parametrize("relative", [0.05, -0.05, 0.0])
@pytest.mark.parametrize("camera", [Camera(), Camera(rotation=(0.0, 0.05, 0.0), depth_m=0.02)], ids=str)
def test_a_falling_rope_begins_where_it_was_whatever_its_length_and_its_camera(
    relative: float, camera: Camera
) -> None:
    made = curled((1 + relative) * ROPE.length_m, np.linspace(0, ROPE.length_m, 10))
    shown = seen(made.points.xyz_m, camera, viewing_axis(made))
    model = RecordingModel(replace(made, points=replace(made.points, xyz_m=shown)), 30, 0.005)
    effects = {
        "length_error.relative": relative,
        "camera_pose.rotation_2": camera.rotation[1],
        "camera_pose.depth": camera.depth_m,
    }
    off = np.linalg.norm(model.predict(Rod(ROPE, EI, GJ, effects)).xyz_m - shown, axis=1)
    assert off.max() < 0.005 * ROPE.length_m


@pytest.mark.parametrize("law", [{}, {"viscoelastic_bending.modulus_ratio": 0.4}], ids=str)
def test_derivatives_by_what_moves_where_a_falling_rope_begins(law: dict[str, float]) -> None:
    model = RecordingModel(curled(ROPE.length_m, np.linspace(0, ROPE.length_m, 10)), 30, 0.005)
    moving = {"length_error.relative": 0.02, "camera_pose.rotation_1": 0.02, "camera_pose.rotation_2": 0.05}
    rod = Rod(ROPE, EI, GJ, {**law, **moving})
    found = model.predict(rod, [*moving]).by_parameter
    for k, (name, value) in enumerate(moving.items()):
        sides = (model.predict(rod.with_values({name: value + by})).xyz_m for by in (1e-6, -1e-6))
        by = (next(sides) - next(sides)) / 2e-6
        assert np.abs(found[..., k] - by).max() < 1e-4 * np.abs(by).max(), name


def test_one_point_is_no_shape() -> None:
    made = recording()
    few = Points(
        *(part[8:] for part in (made.points.frame, made.points.t_s, made.points.s_m, made.points.xyz_m))
    )
    with pytest.raises(SimulationError, match="first frame has 1 point"):
        RecordingModel(replace(made, points=few), 12, 0.01).predict(Rod(ROPE, EI, GJ, particles=12))


def test_a_state_of_one_frame_is_the_first() -> None:
    rest = RecordingModel(recording(), 12, 0.01).at_rest(Rod(ROPE, EI, GJ, particles=12))
    assert isinstance(rest.final, State) and rest.x.shape[1] == 1


# Moment over EI [1/m] of a rope that was straight, by its curvature [1/m].
BENT_ONCE = {
    "nonlinear_bending": ({"cubic": 0.002}, lambda k: k + 0.002 * k**3),
    "plastic_bending": (
        {"yield_curvature": 4.0, "hardening_ratio": 0.2},
        lambda k: np.where(k < 4, k, 4 + (k - 4) * 0.2 / 1.2),
    ),
    "internal_friction": (
        {"saturation_curvature": 3.0, "transition_curvature": 2.0},
        lambda k: k + 3 * (1 - np.exp(-k / 2)),
    ),
    "viscoelastic_bending": ({"modulus_ratio": 0.5, "relaxation_time": 3.0}, lambda k: 1.5 * k),
}


def cantilever(
    moment: Callable[[Floats], Floats], ei: float, load: float, length: float, s: Floats
) -> Floats:
    """x and z (len(s), 2) of a rope held level that sags under its weight [N/m]: M' = -w (L - s) cos θ."""
    bends = np.linspace(0, 200, 40_001)
    moments = ei * moment(bends)

    def slope(at: float, y: Floats) -> tuple[float, float, float, float]:
        bend = float(np.interp(y[1], moments, bends))
        return -bend, -load * (length - at) * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])

    def shot(at_clamp: float) -> Floats:
        # shooting takes a kink of the law as it is; its steps are short, for nobody tells them where it comes
        begin = (0.0, at_clamp, 0.0, 0.0)
        found = solve_ivp(slope, (0, length), begin, t_eval=s, max_step=length / 300, rtol=1e-8)
        return np.asarray(found.y)

    at_clamp = brentq(lambda m: shot(m)[1, -1], 0.0, load * length**2 / 2)
    return shot(at_clamp)[2:].T


@pytest.mark.parametrize(
    ("ends", "held"), [(Ends("clamped", "free"), "start"), (Ends("free", "clamped"), "end")]
)
def test_a_clamp_that_gives_way_in_bending_holds_the_roll(ends: Ends, held: str) -> None:
    """Whichever end is free: a rope bent at rest would turn about itself."""
    bent = named("rest_curvature", {"kappa_1": 0.5, "kappa_2": 3.0})
    gives = named("end_compliance", {f"{held}_stiffness": 1e3})
    shapes = []
    for effects in (bent, {**bent, **gives}):
        rod = Rod(ROPE, 1.5e-3, 1.5e-3, effects)
        made = scene([rod], GRAVITY, ends)
        start, end = (pose(0, 0, 0), None) if held == "start" else (None, pose(0, 0, 0))
        guess = first_shape(ROPE.length_m, rod.particles, start, end, GRAVITY)
        shapes.append(settle(made, guess, way_of(np.zeros((1, 3)))).final.x[0])
    assert np.abs(shapes[1] - shapes[0]).max() < 1e-4 * ROPE.length_m


@pytest.mark.parametrize("law", [law.NAME for law in LAWS])
def test_no_law_puts_a_moment_on_an_end_that_nobody_holds(law: str) -> None:
    values, moment = BENT_ONCE[law]
    ei = 1.5e-3
    rod = Rod(ROPE, ei, ei, named(law, values))
    made = scene([rod], GRAVITY, Ends("clamped", "free"))
    guess = first_shape(ROPE.length_m, rod.particles, pose(0, 0, 0), None, GRAVITY)
    shape = settle(made, guess, way_of(np.zeros((1, 3)))).final.x[0]
    exact = cantilever(moment, ei, 0.04 * 9.81, ROPE.length_m, np.linspace(0, ROPE.length_m, rod.particles))
    off = np.hypot(shape[:, 0] - exact[:, 0], shape[:, 2] - exact[:, 1])
    assert exact[-1, 1] < -0.1 * ROPE.length_m
    assert off.max() < 0.003 * ROPE.length_m
