"""The motion that a verdict asks for goes on from where the first recording ended."""

import numpy as np
import pytest

from dlolib.proof.draw import draw_case
from dlolib.types import Motion
from stages.proof_next import played_on


def test_the_rope_is_moved_on_from_its_last_pose() -> None:
    case = draw_case(3, 0, ("end_angle",))
    before = case.experiment.motion
    t_s = np.linspace(0.0, 2.0, 41)
    away = before.end_m[-1] + 0.02 * (t_s / 2.0)[:, None] * np.array([0.0, 0.0, 1.0])
    held = [np.tile(getattr(before, part)[-1], (41, 1)) for part in ("start_m", "start_q", "end_q")]
    motion = Motion(t_s, held[0], held[1], away, held[2])
    made = played_on(case, motion, "next", np.random.default_rng(0))
    assert made.motion is motion and made.static_frames is None and made.heldout_frames is None
    points = made.points
    assert points.t_s.min() == 0.0 and points.t_s.max() == pytest.approx(2.0)
    # the camera looks as often as it did
    every_s = np.median(np.diff(case.experiment.frame_t_s))
    apart_s = np.diff(np.unique(points.t_s))
    assert len(apart_s) >= 2 and (apart_s > 0.99 * every_s).all() and (apart_s < 1.5 * every_s).all()
    tip = np.isclose(points.s_m, made.rope.length_m)
    off = points.xyz_m[tip] - np.stack([np.interp(points.t_s[tip], t_s, axis) for axis in away.T], axis=1)
    assert np.abs(off).max() < 6 * case.noise.sigma_m
