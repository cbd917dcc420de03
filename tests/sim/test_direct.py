"""The direct solver: against the exact elastica, its derivatives against differences and each other."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sim.ropes import EI, GJ, GRAVITY, LEVEL, ROPE, cylinder, moved, pose, settled, swing, way_of

from dlolib.errors import SimulationError
from dlolib.lab.elastica import planar_elastica
from dlolib.sim import simulate
from dlolib.sim.clearance import clearance
from dlolib.sim.differentiate import Case, Variation, gradient
from dlolib.sim.rod import Rod, scene
from dlolib.sim.simulate import AT_REST, Clock, Path, State, roll_out
from dlolib.sim.start import first_shape, settle
from dlolib.types import Ends, Floats, Obstacle

CLOCKS = {
    "dynamic": Clock(0.01),
    "quasi_static": Clock(None),
    "at_rest": Clock(0.01, AT_REST),
}


def variation(rod: Rod, name: str, way: Floats, obstacles: tuple = ()) -> Variation:
    """A parameter a little more and a little less."""
    step = 1e-5 * max(abs(rod.value(name)), 1e-2)
    ahead, behind = (
        Case(scene([rod.with_values({name: rod.value(name) + d})], GRAVITY, Ends(), obstacles), way_of(way))
        for d in (step, -step)
    )
    return Variation(ahead, behind, 2 * step)


def test_second_order_towards_the_exact_elastica() -> None:
    errors = []
    exact = planar_elastica(ROPE.length_m, EI, 0.04 * 9.81, (0, 0), 0.0, (0.3, -0.05), 0.0, points=2001)
    for particles in (15, 30, 60):
        x = settled(end=pose(0.3, 0, -0.05), particles=particles).x[0]
        s = np.linspace(0, ROPE.length_m, particles)
        off = np.hypot(x[:, 0] - np.interp(s, exact[0], exact[1]), x[:, 2] - np.interp(s, exact[0], exact[2]))
        errors.append(off.max() / ROPE.length_m)
    assert errors[1] < 0.0025
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.25)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2, abs=0.25)


@pytest.mark.parametrize("stiffer", [1.0, 650.0, 670.0, 1e5])
def test_the_rope_does_not_stretch(stiffer: float) -> None:
    """Nor does one that is pushed by its own bend far more than by its weight."""
    x = settled(Rod(ROPE, stiffer * EI, stiffer * GJ)).x[0]
    lengths = np.linalg.norm(np.diff(x, axis=0), axis=1)
    assert np.abs(lengths / (ROPE.length_m / 29) - 1).max() < 5e-5


def test_three_steps_of_newton_do() -> None:
    """In long steps, and where segments resist stretch a hundred times as much; plainly 9, and 58."""
    rod = Rod(ROPE, EI, GJ)
    start = settled(rod)
    found = moved(rod, start, swing(8), Clock(None))
    assert found.iterations.mean() < 4
    made = scene([rod], GRAVITY, Ends())
    stiff = made.segments * [1.0, 100.0, 100.0, 100.0]
    stiffer = roll_out(replace(made, segments=stiff), start, way_of(swing(8)), Clock(None))
    assert stiffer.iterations.mean() < found.iterations.mean() + 1
    assert np.abs(stiffer.x - found.x).max() < 1e-5


@pytest.mark.parametrize("clock", CLOCKS.values(), ids=CLOCKS)
@pytest.mark.parametrize("obstacles", [(), (cylinder(0.17, -0.15),)], ids=["free", "contact"])
def test_adjoint_is_the_derivative(clock: Clock, obstacles: tuple, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulate, "TOLERANCE", 1e-11)
    rod = Rod(ROPE, EI, GJ, {"rest_curvature.kappa_2": 0.3})
    start = settled(rod, obstacles=obstacles)
    way = swing()
    weights = np.random.default_rng(0).normal(size=(1, len(way) + 1, 30, 3))

    def loss(rod: Rod, way: Floats, state: State = start) -> float:
        return float(np.sum(moved(rod, state, way, clock, obstacles).x * weights))

    names = ("bending_stiffness", "torsional_stiffness", "rest_curvature.kappa_2")
    variations = [variation(rod, name, way, obstacles) for name in names]
    found = gradient(moved(rod, start, way, clock, obstacles), weights, variations=variations)
    for k, name in enumerate(names):
        h = 1e-4 * rod.value(name)
        sides = (loss(rod.with_values({name: rod.value(name) + d}), way) for d in (h, -h))
        by = (next(sides) - next(sides)) / (2 * h)
        assert found.parameter[0, k] == pytest.approx(by, rel=2e-5)
    for step in (5, 30, 59):
        ahead = np.zeros_like(way)
        ahead[step] = 1e-6 * np.array([0.3, 0.5, 0.8])
        by_way = (loss(rod, way + ahead) - loss(rod, way - ahead)) / 2e-6
        assert found.end_x[0, step, 1] @ [0.3, 0.5, 0.8] == pytest.approx(by_way, rel=1e-5, abs=1e-6)
    shift = np.zeros_like(start.x)
    shift[0, 7] = 1e-6 * np.array([0.0, 0.6, 0.8])
    by_state = (
        loss(rod, way, replace(start, x=start.x + shift)) - loss(rod, way, replace(start, x=start.x - shift))
    ) / 2e-6
    assert found.initial.x[0, 7] @ [0.0, 0.6, 0.8] == pytest.approx(by_state, rel=1e-5, abs=1e-6)


def test_a_rope_does_not_know_its_batch() -> None:
    rods = [Rod(ROPE, ei, GJ) for ei in (1e-4, 3e-4, 9e-4)]
    start, way = settled(), swing()
    many = State(*(np.repeat(part, 3, axis=0) for part in (start.x, start.before, start.q)))
    path = way_of(way)
    path = replace(path, x=np.repeat(path.x, 3, axis=0), q=np.repeat(path.q, 3, axis=0))
    together = roll_out(scene(rods, GRAVITY, Ends()), many, path, Clock(0.01))
    for k, rod in enumerate(rods):
        assert np.array_equal(together.x[k], moved(rod, start, way, Clock(0.01)).x[0])


def test_quasi_static_shape_does_not_depend_on_the_way_or_the_mass_matrix() -> None:
    start = settled()
    slow = moved(Rod(ROPE, EI, GJ), start, swing(60), Clock(None)).x[0, -1]
    quick = moved(Rod(ROPE, EI, GJ), start, swing(7), Clock(None)).x[0, -1]
    assert np.abs(slow - quick).max() < 1e-9


def test_a_rope_pushed_onto_a_cylinder_stays_outside() -> None:
    obstacles = (cylinder(0.17, -0.16),)
    way = np.linspace([0.33, 0, 0.02], [0.3, 0, -0.03], 100)
    rollout = moved(Rod(ROPE, EI, GJ), settled(obstacles=obstacles), way, Clock(0.01), obstacles)
    gap = clearance(rollout.x[0], ROPE.radius_m, obstacles)
    assert gap[0] > 2e-3
    assert -1e-4 < gap[-1] < 0
    assert gap.min() > -1e-4


@pytest.mark.parametrize("radius_m", [0.005, 0.01])
@pytest.mark.parametrize("step_s", [None, 0.05])
def test_no_rope_passes_through_a_thin_cylinder_in_steps_of_50_mm(
    radius_m: float, step_s: float | None
) -> None:
    under = cylinder(0.17, -0.17 - radius_m)
    thin = replace(under, values=under.values | {"radius_m": (radius_m,), "height_m": (0.4,)})
    way = np.linspace([0.33, 0.0, 0.02], [0.33, 0.0, -0.18], 5)[1:]
    rollout = moved(Rod(ROPE, EI, GJ), settled(obstacles=(thin,)), way, Clock(step_s), (thin,))
    over = [np.interp(0.17, shape[:, 0], shape[:, 2]) for shape in rollout.x[0]]
    assert min(over) > -0.17
    assert clearance(rollout.x[0], ROPE.radius_m, (thin,)).min() > -3e-4


def wire(x: float, top: float) -> Obstacle:
    """A cylinder of 10 mm, its axis along y, its highest line at z = top."""
    thick = cylinder(x, top - 0.005)
    return replace(thick, values=thick.values | {"radius_m": (0.005,), "height_m": (0.4,)})


def test_no_rope_is_swung_through_a_wire_by_its_clamp() -> None:
    """5 degrees a step take the far end 39 mm; what is foretold from the steps before takes it as far."""
    obstacles, ends = (wire(0.25, -0.06),), Ends("clamped", "free")
    made = scene([Rod(ROPE, 0.02, 0.02)], GRAVITY, ends, obstacles)
    start = first_shape(ROPE.length_m, 30, pose(0, 0, 0), None, GRAVITY)
    turns = [Rotation.from_rotvec([0, angle, 0]) for angle in np.radians(np.arange(0, 41, 5))]
    level = Rotation.from_quat(LEVEL, scalar_first=True)
    held = np.array([(turn * level).as_quat(scalar_first=True) for turn in turns])
    path = Path(np.zeros((1, 9, 2, 3)), np.repeat(held[None, :, None], 2, axis=2))
    rest = settle(made, start, path).final.at_rest()
    for shape in roll_out(made, rest, path, Clock(None)).x[0]:
        assert np.interp(0.25, shape[:, 0], shape[:, 2]) > -0.06


def test_a_rope_thrown_at_a_wire_is_stopped_in_its_first_step() -> None:
    x = np.linspace(0, ROPE.length_m, 30)[:, None] * [1.0, 0.0, 0.0]
    made = scene([Rod(ROPE, EI, GJ)], np.zeros(3), Ends("free", "free"), (wire(0.2225, -0.012),))
    thrown = State(x[None], (x + np.array([0.0, 0.0, 0.2]))[None], np.tile(LEVEL, (1, 31, 1)))
    nowhere = Path(np.zeros((1, 1, 2, 3)), np.tile(LEVEL, (1, 1, 2, 1)))
    after = roll_out(made, thrown, nowhere, Clock(0.01)).x[0, 1]
    assert np.interp(0.2225, after[:, 0], after[:, 2]) > -0.012


def test_a_thin_obstacle_costs_nothing_where_the_rope_does_not_come() -> None:
    obstacles = (wire(5.0, 0.0),)
    start = settled(obstacles=obstacles)
    far = moved(Rod(ROPE, EI, GJ), start, swing(8), Clock(None), obstacles)
    alone = moved(Rod(ROPE, EI, GJ), start, swing(8), Clock(None))
    assert far.iterations.max() <= alone.iterations.max() + 1


def test_a_step_too_long_for_what_is_near_is_refused() -> None:
    obstacles = (wire(0.17, -0.15),)
    way = np.array([[0.1, 0.0, -0.3]])
    with pytest.raises(SimulationError, match="could pass through an obstacle"):
        moved(Rod(ROPE, EI, GJ), settled(obstacles=obstacles), way, Clock(None), obstacles)


def test_ends_further_apart_than_the_rope_is_long_are_refused() -> None:
    with pytest.raises(SimulationError, match="apart"):
        settled(end=pose(0.5, 0, 0))
