"""Where something that was not recorded may have touched the rope."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnose.test_diagnose import QUICK, SEEN, SIGMA, made
from diagnose.test_search import fitted
from sim.ropes import ROPE

from dlolib.diagnose import touch
from dlolib.diagnose.alternatives import _apart
from dlolib.diagnose.diagnose import raw_study
from dlolib.diagnose.search import baseline
from dlolib.diagnose.study import Study, acting_only
from dlolib.diagnose.tasks import beginnings, fit_first
from dlolib.diagnose.touch import FINER, PLACES, _gains, _Pushed, _spheres, touches
from dlolib.errors import SimulationError
from dlolib.identify.identify import FIRST_STIFFNESS_M4_S2
from dlolib.types import Recording

EFFECT, FORM = "hidden_obstacle", ("x", "y", "z", "radius")
RADIUS_M, DEEP_M = 0.012, 0.008


@cache
def obstructed(side: float) -> tuple[Recording, np.ndarray]:
    """A sphere in the way of the rope's middle, on one side of it or the other; and where it is touched."""
    free = made({}, sigma_m=1e-9).points.xyz_m.reshape(-1, SEEN, 3)
    across = np.cross(free[24, 8] - free[24, 6], [0.0, side, 0.0])
    way = across / np.linalg.norm(across)
    center = free[24, 7] - (RADIUS_M + ROPE.radius_m - DEEP_M) * way
    values = {f"{EFFECT}.{name}": float(x) for name, x in zip(FORM, (*center, RADIUS_M), strict=True)}
    return made(values), center + RADIUS_M * way


def studied(recording: Recording) -> Study:
    return acting_only(raw_study([recording], QUICK), FIRST_STIFFNESS_M4_S2)


def off_m(center_m: np.ndarray, radius_m: float, touched_m: np.ndarray) -> float:
    """How far a sphere's surface is from where the rope was touched."""
    return abs(float(np.linalg.norm(touched_m - center_m)) - radius_m)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_sphere_in_the_ropes_way_is_found(side: float) -> None:
    recording, touched_m = obstructed(side)
    study = studied(recording)
    found = baseline(study)
    assert found.chi2 > 2 * found.coordinates
    (task,) = beginnings(study, found, {}, EFFECT, FORM, touches(study, found), 2)
    best = fit_first(study, task)
    assert best is not None
    x, y, z, radius = best.theta[-4:]
    assert off_m(np.array([x, y, z]), radius, touched_m) < 0.005
    assert best.chi2 < best.coordinates + 3 * np.sqrt(2 * best.coordinates)


def test_one_that_is_touched_in_passing_is_told_too() -> None:
    """For two frames: the mean over more of them is the noise's."""
    touching, touched_m = obstructed(1.0)
    free = made({}, seed=2)
    apart = np.linalg.norm(touching.points.xyz_m - free.points.xyz_m, axis=1)
    frames = np.unique(free.points.frame)
    most = int(np.argmax([apart[free.points.frame == frame].max() for frame in frames]))
    brief = np.isin(free.points.frame, frames[most : most + 2])
    xyz_m = np.where(brief[:, None], touching.points.xyz_m, free.points.xyz_m)
    study = studied(replace(free, points=replace(free.points, xyz_m=xyz_m)))
    told = touches(study, baseline(study))
    assert min(off_m(one.center_m, one.radius_m, touched_m) for one in told) < 0.01
    ends = [
        np.linalg.norm(one.center_m - other.center_m) for one in told for other in told if one is not other
    ]
    assert min(ends) > touch.APART_M


def test_where_only_a_plane_was_seen_a_sphere_is_found_in_it() -> None:
    touching, touched_m = obstructed(1.0)
    study = studied(replace(touching, planar="xz"))
    told = touches(study, baseline(study))
    there = [one.center_m + one.radius_m * _toward(touched_m - one.center_m) for one in told]
    assert min(np.linalg.norm((point - touched_m)[[0, 2]]) for point in there) < 0.01


def _toward(way: np.ndarray) -> np.ndarray:
    return np.asarray(way / np.linalg.norm(way))


def test_spheres_dip_into_the_rope_all_round_it_and_not_to_its_axis() -> None:
    """Of a straight rope that goes up: as deep as is tried, where a small sphere can be."""
    x_m = np.zeros((3, PLACES * FINER, 3))
    x_m[:, :, 0] = np.arange(PLACES * FINER) / 100
    x_m[:, :, 2] = np.arange(3)[:, None]
    none = np.zeros((3, PLACES, 3))
    told = _spheres(_Pushed(x_m, none, none, none, none), ROPE.radius_m, 2)
    told = told.reshape(2, PLACES, touch.SIDES, -1, 4)
    away = told[..., :3] - x_m[[0, 2], FINER // 2 :: FINER][:, :, None, None]
    reach = told[..., 3] + ROPE.radius_m
    depth = reach - np.linalg.norm(away, axis=-1)
    tried = np.sort(np.unique(np.round(depth, 9)))
    small = touch.DEEPEST * (min(touch.RADII_M) + ROPE.radius_m)
    assert tried == pytest.approx(sorted({min(d, small) for d in touch.DEPTHS_M} | set(touch.DEPTHS_M)))
    assert np.all(depth <= touch.DEEPEST * reach + 1e-12)
    assert away[..., 0] == pytest.approx(0.0)
    assert away.sum(axis=2) == pytest.approx(0.0)


def test_a_spheres_gain_is_that_of_the_springs_that_it_presses() -> None:
    """One place, as a spring: pushed out by the depth, which is all that the points are off."""
    give, depth = 0.3, 0.002
    x_m = np.zeros((2, FINER, 3))
    x_m[:, :, 0] = np.linspace(-0.005, 0.005, FINER)
    for frame, far in enumerate((0.0, 0.5)):
        x_m[frame, :, 2] = far
    left = np.zeros((2, 3))
    left[0] = [0.0, 0.0, -depth / SIGMA]
    force = give / SIGMA * np.eye(3)
    pushed = _Pushed(
        x_m,
        np.tile(give * np.eye(3), (2, 1, 1, 1)),
        (left @ force)[:, None],
        np.tile(force @ force, (2, 1, 1, 1)),
        np.zeros((2, 1, 3, 0)),
    )
    below = [0.0, 0.0, -(0.02 + ROPE.radius_m - depth), 0.02]
    above, beyond = [0.0, 0.0, -below[2], 0.02], [0.0, 0.0, below[2] - depth, 0.02]
    gains = _gains(pushed, np.array([below, above, beyond]), ROPE.radius_m)
    whole = (depth / SIGMA) ** 2
    assert gains == pytest.approx([whole, -3 * whole, 0.0])
    # what the model's own parameters take up as well is no gain
    shared = np.zeros((2, 1, 3, 1))
    shared[0, 0, 2] = give / SIGMA
    own = replace(pushed, along=np.zeros((2, 1, 3)), shared=shared)
    assert _gains(own, np.array([below]), ROPE.radius_m) == pytest.approx([0.0])


def test_where_the_rope_cannot_be_simulated_nothing_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    study = studied(made({}))
    found = baseline(study)

    def no(*_: object) -> object:
        raise SimulationError("no equilibrium")

    monkeypatch.setattr(touch, "_pushed", no)
    assert touches(study, found) == []
    assert study.starts(EFFECT, FORM, []) == []


def test_of_other_optima_each_counts_once_and_the_models_own_not_again() -> None:
    at = fitted(100.0, (EFFECT,), FORM)
    near = replace(at, theta=at.theta + 0.5, chi2=101.0)
    far = [replace(at, theta=at.theta + shift, chi2=102.0 + shift) for shift in (5.0, 5.5, -5.0)]
    assert _apart([*far, near], at) == [far[2], far[0]]
