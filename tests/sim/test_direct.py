"""The direct solver: against the exact elastica, its derivatives against differences and each other."""

import numpy as np
import pytest
from sim.ropes import EI, GJ, GRAVITY, LEVEL, ROPE, cylinder, pose, simulator, swing

from dlolib.errors import SimulationError
from dlolib.lab.elastica import planar_elastica
from dlolib.sim.rod import Rod, scene
from dlolib.sim.simulate import Clock, Directions, Path, Rollout, State, gradient, roll_out, sensitivities
from dlolib.types import Ends, Floats

CLOCKS = {"dynamic": Clock(0.01), "quasi_static": Clock(None), "at_rest": Clock(0.01, momentum=0.0)}


def moved(rod: Rod, start: State, way: Floats, clock: Clock, obstacles: tuple = ()) -> Rollout:
    path = np.zeros((1, len(way), 2, 3))
    path[0, :, 1] = way
    return roll_out(
        scene([rod], GRAVITY, Ends(), obstacles),
        start,
        Path(path, np.tile(LEVEL, (1, len(way), 2, 1))),
        clock,
    )


def test_second_order_towards_the_exact_elastica() -> None:
    errors = []
    exact = planar_elastica(ROPE.length_m, EI, 0.04 * 9.81, (0, 0), 0.0, (0.3, -0.05), 0.0, points=2001)
    for particles in (15, 30, 60):
        x = simulator(particles, pose(0.3, 0, -0.05)).settle().x[0]
        s = np.linspace(0, ROPE.length_m, particles)
        off = np.hypot(x[:, 0] - np.interp(s, exact[0], exact[1]), x[:, 2] - np.interp(s, exact[0], exact[2]))
        errors.append(off.max() / ROPE.length_m)
    assert errors[1] < 0.0025
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.25)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2, abs=0.25)


def test_the_rope_does_not_stretch() -> None:
    x = simulator().settle().x[0]
    lengths = np.linalg.norm(np.diff(x, axis=0), axis=1)
    assert np.abs(lengths / (ROPE.length_m / 29) - 1).max() < 5e-4


@pytest.mark.parametrize("clock", CLOCKS.values(), ids=CLOCKS)
@pytest.mark.parametrize("obstacles", [(), (cylinder(0.17, -0.15),)], ids=["free", "contact"])
def test_adjoint_is_the_derivative(clock: Clock, obstacles: tuple) -> None:
    rod = Rod(ROPE, EI, GJ)
    start = simulator(obstacles=obstacles).settle()
    way = swing()
    weights = np.random.default_rng(0).normal(size=(1, len(way) + 1, 30, 3))

    def loss(rod: Rod, way: Floats, state: State = start) -> float:
        return float(np.sum(moved(rod, state, way, clock, obstacles).x * weights))

    found = gradient(moved(rod, start, way, clock, obstacles), weights)
    h = 1e-5 * EI
    by_ei = (
        loss(rod.with_values(bending_stiffness=EI + h), way)
        - loss(rod.with_values(bending_stiffness=EI - h), way)
    ) / (2 * h)
    assert found.joint_d[0, :, :2].sum() == pytest.approx(by_ei, rel=2e-5)
    by_rest = (
        loss(rod.with_values(rest_curvature=(0, 1e-4)), way)
        - loss(rod.with_values(rest_curvature=(0, -1e-4)), way)
    ) / 2e-4
    assert found.joint_rest[0, :, 1].sum() == pytest.approx(by_rest, rel=1e-5)
    for step in (5, 30, 59):
        ahead = np.zeros_like(way)
        ahead[step] = 1e-6 * np.array([0.3, 0.5, 0.8])
        by_way = (loss(rod, way + ahead) - loss(rod, way - ahead)) / 2e-6
        assert found.end_x[0, step, 1] @ [0.3, 0.5, 0.8] == pytest.approx(by_way, rel=1e-5, abs=1e-6)
    shift = np.zeros_like(start.x)
    shift[0, 7] = 1e-6 * np.array([0.0, 0.6, 0.8])
    by_state = (
        loss(rod, way, State(start.x + shift, start.before, start.q))
        - loss(rod, way, State(start.x - shift, start.before, start.q))
    ) / 2e-6
    assert found.x[0, 7] @ [0.0, 0.6, 0.8] == pytest.approx(by_state, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("clock", CLOCKS.values(), ids=CLOCKS)
def test_sensitivities_agree_with_the_adjoint(clock: Clock) -> None:
    rollout = moved(Rod(ROPE, EI, GJ), simulator().settle(), swing(), clock)
    weights = np.random.default_rng(1).normal(size=rollout.x.shape)
    back = gradient(rollout, weights)
    zero = np.zeros((1, 4, 30, 3))
    ways = Directions(zero.copy(), zero.copy(), zero.copy(), np.zeros((1, 4, 2, 3)))
    ways.joint_d[0, 0, :, 2] = 1.0
    ways.joint_rest[0, 1, 10, 1] = 1.0
    ways.force[0, 2, 12, 2] = 1.0
    ways.frame[0, 3, 1, 0] = 1.0
    out = sensitivities(rollout, ways, np.arange(1, rollout.x.shape[1]))
    forward = np.einsum("tpnk,tnk->p", out[0], weights[0, 1:])
    backward = [
        back.joint_d[0, :, 2].sum(),
        back.joint_rest[0, 10, 1],
        back.force[0, 12, 2],
        back.end_q[0, :, 1, 0].sum(),
    ]
    assert forward == pytest.approx(np.array(backward), rel=1e-9)


def test_a_rope_does_not_know_its_batch() -> None:
    rods = [Rod(ROPE, ei, GJ) for ei in (1e-4, 3e-4, 9e-4)]
    start, way = simulator().settle(), swing()
    path = np.zeros((3, len(way), 2, 3))
    path[:, :, 1] = way
    many = State(*(np.repeat(a, 3, axis=0) for a in (start.x, start.before, start.q)))
    together = roll_out(
        scene(rods, GRAVITY, Ends()), many, Path(path, np.tile(LEVEL, (3, len(way), 2, 1))), Clock(0.01)
    )
    for k, rod in enumerate(rods):
        assert np.array_equal(together.x[k], moved(rod, start, way, Clock(0.01)).x[0])


def test_quasi_static_shape_does_not_depend_on_the_way_or_the_mass_matrix() -> None:
    start = simulator().settle()
    slow = moved(Rod(ROPE, EI, GJ), start, swing(60), Clock(None)).x[0, -1]
    quick = moved(Rod(ROPE, EI, GJ), start, swing(7), Clock(None)).x[0, -1]
    assert np.abs(slow - quick).max() < 1e-9


def test_a_rope_pushed_onto_a_cylinder_stays_outside() -> None:
    sim = simulator(obstacles=(cylinder(0.17, -0.16),))
    rollout = sim.forward(sim.settle(), np.linspace([0.33, 0, 0.02], [0.3, 0, -0.03], 100))
    clearance = sim.clearance(rollout.x[0])
    assert clearance[0] > 2e-3
    assert -5e-4 < clearance[-1] < 0
    assert clearance.min() > -5e-4


def test_ends_further_apart_than_the_rope_is_long_are_refused() -> None:
    with pytest.raises(SimulationError, match="apart"):
        simulator(end=pose(0.5, 0, 0)).settle()
