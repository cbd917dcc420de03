"""What bends a rope: curvature and moment of every joint at every step, for drawing one against the other."""

import numpy as np

from dlolib.sim.assembly import bent_before, frames3, joint_lengths, scalars3, scalars4, vectors3
from dlolib.sim.joints import curvature, respond
from dlolib.sim.launch import kernel
from dlolib.sim.runtime import APART, ti
from dlolib.sim.simulate import Rollout, steps_of
from dlolib.types import Floats


@kernel
def _moments(
    q: frames3,
    past: scalars4,
    steps: scalars3,
    joints: scalars3,
    fresh: ti.i32,
    bent: vectors3,
    moment: vectors3,
):
    for lane in range(q.shape[0] * APART):
        if lane % APART != 0:
            continue
        b = lane // APART
        for t in range(1, q.shape[1]):
            for i in range(joints.shape[1]):
                length, length_before = joint_lengths(joints, steps, b, t, i)
                now = curvature(q, b, t, i, length)
                before = bent_before(joints, q, b, t, i, length_before, fresh)
                _e, m, _d = respond(
                    joints, past, b, b, t - 1, i, now, before, steps[b, t, 0], 1, False, past, 0
                )
                bent[b, t - 1, i] = now
                moment[b, t - 1, i] = m


def moments(rollout: Rollout) -> tuple[Floats, Floats]:
    """Curvature [1/m] and moment [N m] about the material axes, each (B, T, n, 3), at the steps 1 ... T."""
    ropes, indices, n = rollout.x.shape[:3]
    bent, moment = (np.zeros((ropes, indices - 1, n, 3)) for _ in range(2))
    _moments(
        rollout.q, rollout.past, steps_of(rollout.path, rollout.clock), rollout.scene.joints,
        int(rollout.clock.fresh), bent, moment,
    )  # fmt: skip
    return bent, moment


__all__ = ["moments"]
