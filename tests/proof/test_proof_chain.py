"""The chain's slopes are those of its places, and its balance is the exact elastica's."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dlolib.errors import SimulationError
from dlolib.lab.elastica import planar_elastica
from dlolib.proof import equilibrium
from dlolib.proof.chain import Chain
from dlolib.proof.equilibrium import Equilibrium
from dlolib.proof.motions import ALONG_X
from dlolib.proof.world import NOTHING, Effects, Experiment, build
from dlolib.types import Floats, Motion, Obstacle

EI, LENGTH = 3e-4, 0.445


def differences(of, chain: Chain, q: Floats) -> Floats:
    """Central differences of an array by every degree of freedom, on the last axis."""
    step, found = 1e-6, []
    for side in np.eye(chain.freedoms):
        chain.move(q + step * side)
        after = np.array(of())
        chain.move(q - step * side)
        found.append((after - np.array(of())) / (2 * step))
    chain.move(q)
    return np.stack(found, axis=-1)


@pytest.mark.parametrize(
    "more", [{}, {"stretches": True}, {"yields": True}], ids=["plain", "stretches", "yields"]
)
def test_slopes_are_differences(more: dict[str, bool]) -> None:
    rng = np.random.default_rng(1)
    chain = Chain(5, np.zeros(3), ALONG_X, **more)
    chain.lengthen(0.4)
    q = rng.normal(size=chain.freedoms) * 0.2
    chain.move(q)
    jacobians = differences(lambda: chain.vertices, chain, q)
    forces, moment, masses = rng.normal(size=(6, 3)), rng.normal(size=3), rng.random(6)
    np.testing.assert_allclose(np.stack([chain.jacobian(k) for k in range(6)]), jacobians, atol=1e-8)
    np.testing.assert_allclose(chain.forces(forces), np.einsum("kid,ki->d", jacobians, forces), atol=1e-8)
    np.testing.assert_allclose(
        chain.masses(masses), np.einsum("k,kid,kie->de", masses, jacobians, jacobians), atol=1e-8
    )
    bent = differences(lambda: chain.forces(forces), chain, q)
    np.testing.assert_allclose(chain.force_slopes(forces), bent, atol=1e-7)
    turned = differences(lambda: chain.turns @ moment, chain, q)
    np.testing.assert_allclose(chain.moment_slopes(moment), turned, atol=1e-7)


def balanced(
    bodies: int,
    end_m: tuple[float, float, float],
    twist_ratio: float = 1.0,
    obstacles: tuple[Obstacle, ...] = (),
    effects: Effects = NOTHING,
) -> Equilibrium:
    rest = np.tile(ALONG_X, (2, 1))
    place = np.tile(end_m, (2, 1))
    motion = Motion(np.array([0.0, 1.0]), np.zeros((2, 3)), rest, place, rest)
    rope = build(Experiment(motion, np.zeros(1), EI, twist_ratio * EI, obstacles=obstacles), effects, bodies)
    rope.reach(place[0], Rotation.from_quat(ALONG_X, scalar_first=True).as_matrix(), 0.0)
    rope.chain.move(rope.q)
    return rope


def test_the_exact_elastica_is_approached_by_the_square_of_the_bodies() -> None:
    end = (0.25, 0.0, 0.06)
    s, x, z, _ = planar_elastica(LENGTH, EI, 0.04 * 9.81, (0, 0), 0.0, (end[0], end[2]), 0.0)
    errors = []
    for bodies in (29, 58):
        vertices = balanced(bodies, end).chain.vertices
        at = np.linspace(0, LENGTH, bodies + 1)
        exact = np.stack([np.interp(at, s, x), np.zeros(bodies + 1), np.interp(at, s, z)], axis=1)
        errors.append(np.abs(vertices - exact).max())
    assert errors[1] < 2.5e-4
    assert errors[0] / errors[1] > 3


def test_mujoco_weighs_the_balance_alike() -> None:
    """MuJoCo's own inverse dynamics of the chain, given the true masses, finds nothing missing."""
    rope = balanced(29, (0.3, 0.05, 0.05), twist_ratio=0.6)
    chain, masses = rope.chain, -rope.loads[:, 2] / 9.81
    chain.model.body_mass[1:] = masses
    mujoco.mj_setConst(chain.model, chain.data)
    chain.data.qpos[:], chain.data.qvel[:] = rope.q, 0.0
    mujoco.mj_forward(chain.model, chain.data)
    jac_m, jac_turn = np.zeros((3, chain.freedoms)), np.zeros((3, chain.freedoms))
    mujoco.mj_jac(chain.model, chain.data, jac_m, jac_turn, chain.data.xpos[-1], chain.bodies + 1)
    bend = rope.curvature(rope.q)
    springs = np.zeros(chain.freedoms)
    springs[chain.place] = bend * np.array([EI, EI, 0.6 * EI])
    held = jac_m.T @ rope.reaction[:3] + jac_turn.T @ rope.reaction[3:]
    np.testing.assert_allclose(springs + chain.data.qfrc_bias, held, atol=1e-7)


BAR = Obstacle(
    "cylinder",
    {"center_m": (0.15, 0.0, -0.12), "axis": (0.0, 1.0, 0.0), "radius_m": (0.02,), "height_m": (1.0,)},
)


def test_a_step_is_looked_for_where_the_last_one_leads() -> None:
    """Drawn over a bar: the same balance as from where the last step ended, in a third of the weighings."""
    turn = Rotation.from_quat(ALONG_X, scalar_first=True).as_matrix()
    places = np.linspace((0.3, 0.0, 0.0), (0.34, 0.0, -0.02), 11)
    ropes, weighed = [], []
    for foreseen in (True, False):
        rope = balanced(29, tuple(places[0]), obstacles=(BAR,))
        had = rope.patience
        for place in places[1:]:
            if not foreseen:
                rope.trail = rope.trail[-1:]
            rope.reach(place, turn, 0.0)
        ropes.append(rope)
        weighed.append(had - rope.patience)
    assert len(rope.contacts[0].touch(rope.chain.vertices).body)
    np.testing.assert_allclose(ropes[0].q, ropes[1].q, atol=1e-6)
    assert weighed[0] < weighed[1] / 3


def test_a_strip_does_not_stay_bent_over_its_edge(monkeypatch: pytest.MonkeyPatch) -> None:
    """Newton's method alone keeps it upright, where no strip would stay."""
    strip, end = {"anisotropic_bending": {"stiffness_ratio": 0.2}}, (0.25, 0.0, 0.06)
    with pytest.raises(SimulationError, match="stands on edge"):
        balanced(29, end, 0.3, effects=strip)
    flat = balanced(29, end, 0.3, effects={"anisotropic_bending": {"stiffness_ratio": 5.0}})
    assert equilibrium.stands(slopes(flat))
    monkeypatch.setattr(equilibrium, "stands", lambda slopes: True)
    upright = balanced(29, end, 0.3, effects=strip)
    monkeypatch.undo()
    assert not equilibrium.stands(slopes(upright))


def slopes(rope: Equilibrium) -> Floats:
    """Of a rope in its balance."""
    return rope._imbalance(rope.chain.vertices[-1], rope.chain.gripper, 0.0, None)[2]


def test_a_rope_pulled_longer_than_it_is_is_refused() -> None:
    with pytest.raises(SimulationError, match="no balance|leaps"):
        balanced(29, (0.46, 0.0, 0.0))
