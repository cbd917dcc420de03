"""Which of several equilibria: the one that was seen.

A rope that buckles goes to either side, and which it is chance decides, in the real world as in a simulation.
A roll-out follows one branch of equilibria; where the rope was seen on another, it is sought there, and
followed from there on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.errors import SimulationError
from dlolib.sim.scene import Scene
from dlolib.sim.simulate import Clock, Path, Rollout, State, follow, roll_out
from dlolib.sim.upright import about_axis
from dlolib.types import Floats

QUASI_STATIC = Clock(None)


def roll_out_as_seen(scene: Scene, state: State, path: Path, seen: Mapping[int, State]) -> Rollout:
    """The quasi-static `roll_out` of one rope, at some steps sought near where it was seen.

    Where no equilibrium is found there, it is followed on.

    Args:
        scene, state, path: as there.
        seen: by the step's index in the path.

    Raises:
        SimulationError: as there.
    """
    parts, begin = [], 0
    for step in sorted(seen):
        if step > begin:
            parts.append(roll_out(scene, state, path.between(begin, step), QUASI_STATIC))
            state = parts[-1].final.at_rest()
        parts.append(_sought(scene, state, path.between(step, step + 1), seen[step]))
        state, begin = parts[-1].final.at_rest(), step + 1
    if begin < path.x.shape[1]:
        parts.append(roll_out(scene, state, path.between(begin, path.x.shape[1]), QUASI_STATIC))
    return _joined(parts, path)


def _sought(scene: Scene, state: State, path: Path, near: State) -> Rollout:
    """One step: to the equilibrium near a shape, by a rope with the history that it has."""
    if scene.clamped.all():
        near = replace(near, q=_wound_as(state.q[0], near.q[0])[None])
    try:
        return follow(scene, state, path, QUASI_STATIC, near)
    except SimulationError:
        return roll_out(scene, state, path, QUASI_STATIC)


def _wound_as(before: Floats, q: Floats) -> Floats:
    """Frames (n + 1, 4) with as many more whole turns from end to end as those before have."""
    turns = round((_twist(before) - _twist(q)) / (2 * np.pi))
    if turns == 0:
        return q
    inside = about_axis(q[:-1], np.linspace(0.0, 2 * np.pi * turns, len(q) - 1))
    return np.concatenate([inside, q[-1:]])


def _twist(q: Floats) -> float:
    """From end to end [rad]."""
    frames = Rotation.from_quat(q, scalar_first=True)
    return float((frames[:-1].inv() * frames[1:]).as_rotvec()[:, 2].sum())


def _joined(parts: list[Rollout], path: Path) -> Rollout:
    """Roll-outs one after the other as one."""
    first = parts[0]

    def whole(part: str) -> Any:
        rest = [getattr(one, part)[:, 1:] for one in parts[1:]]
        return np.concatenate([getattr(first, part), *rest], axis=1)

    iterations = np.concatenate([one.iterations for one in parts], axis=1)
    return Rollout(
        first.scene, first.clock, path, first.before, whole("x"), whole("q"), whole("past"), whole("slip"),
        whole("sliding"), iterations,
    )  # fmt: skip
