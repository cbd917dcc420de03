"""The loss of a path, the paper's (19) and (20), with its derivatives by the rope's positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlolib.learn.settings import LearnSettings
from dlolib.sim.clearance import Nearest, nearest
from dlolib.types import Floats, Obstacle


@dataclass(frozen=True)
class LossValue:
    """Loss, its derivative by the positions (T + 1, N, 3), and the number of contacts Γ."""

    value: float
    d_positions: Floats
    contacts: int


@dataclass(frozen=True)
class ContactTerms:
    """L_c (T, N) [m], its derivative by the position (T, N, 3), and whether the obstacle is in the way."""

    value_m: Floats
    slope: Floats
    in_the_way: np.ndarray


def path_loss(
    positions_m: Floats,
    goal_m: Floats,
    obstacles: Sequence[Obstacle],
    radius_m: float,
    settings: LearnSettings,
) -> LossValue:
    """ω1 Σ L_c + ω2 MSE(x^h, x*): (19).

    How we read Σ_Γ: a mean. Summed as printed, hundreds of contacts of centimetres outweigh the goal's
    square millimetres ten-thousandfold. Contacts with an obstacle in the way are averaged over their number,
    but over a tenth of the steps at least, so that the last few of them fade out; pushing off (see
    `_contact`) is averaged over the steps. A contact's weight grows from 0 at the zone's edge to 1 at the
    margin; as the set Γ in the paper, it is not differentiated.

    Args:
        positions_m: particles at all steps, the first before the first step, shape (T + 1, N, 3).
        goal_m: goal at the particles' arc lengths, shape (N, 3).
        obstacles: in contact is what is nearer than the margin to one of these.
        radius_m: the rope's radius.
        settings: weights, margin, which loss.
    """
    d_positions = np.zeros_like(positions_m)
    miss = positions_m[-1] - goal_m
    value = settings.goal_weight * float(np.mean(miss**2))
    d_positions[-1] = settings.goal_weight * 2 * miss / miss.size
    found = nearest(positions_m[1:], obstacles)
    gap_m = found.distance_m - radius_m
    near = np.clip(
        (settings.contact_zone_m - gap_m) / (settings.contact_zone_m - settings.contact_margin_m), 0, 1
    )
    if settings.loss == "contact" and near.any():
        terms = _contact(positions_m[1:], goal_m, obstacles, found, settings.contact_zone_m - gap_m)
        slides = near * terms.in_the_way
        most = max(float(slides.sum()), 0.1 * len(near))
        share = settings.contact_weight * np.where(slides > 0, slides / most, near / len(near))
        value += float(np.sum(share * terms.value_m))
        d_positions[1:] += share[..., None] * terms.slope
    return LossValue(value, d_positions, int((gap_m < settings.clearance_m).sum()))


def _contact(
    positions_m: Floats, goal_m: Floats, obstacles: Sequence[Obstacle], found: Nearest, depth_m: Floats
) -> ContactTerms:
    """L_c of every particle (T, N), were it in contact, and its derivative (T, N, 3): (20).

    On an end section |x - x*| + |y - y*|, as printed. On a surface the paper has |x - o_c|, after naming the
    term "the difference between the particle at the position of the collision and its corresponding goal
    particle". Both draw a particle the same way as long as the obstacle's centre lies between it and its
    goal; but |x - o_c| lets the rope rest under the obstacle's middle and pulls one that touches the far
    cylinder of the gap from within back out of the gap. So here it is |x - x*| for a particle that comes
    to its goal from the obstacle's side, and only while the last shape leans on an obstacle so. Every other
    contact costs its depth in the contact zone, which pushes the particle off.

    The paper's ropes lie in x-z; x here is that of the horizontal axes along which the goal extends more.
    """
    x = int(np.argmax(np.ptp(goal_m[:, :2], axis=0)))
    y = 1 - x
    centre = np.array([_centre(obstacle, x) for obstacle in obstacles])[found.obstacle]
    off_goal = positions_m - goal_m
    behind = off_goal[..., x] * (centre - goal_m[:, x]) > 0
    behind = behind & bool(np.any(behind[-1] & (depth_m[-1] > 0)))
    slide, aside = np.zeros_like(off_goal), np.zeros_like(off_goal)
    slide[..., x] = np.sign(off_goal[..., x])
    aside[..., :2] = np.sign(off_goal[..., :2])
    wrong = np.where(behind, np.abs(off_goal[..., x]), depth_m)
    slope = np.where(behind[..., None], slide, -found.normal)
    wrong = np.where(found.section, np.abs(off_goal[..., x]) + np.abs(off_goal[..., y]), wrong)
    slope = np.where(found.section[..., None], aside, slope)
    return ContactTerms(wrong, slope, behind | found.section)


def _centre(obstacle: Obstacle, axis: int) -> float:
    """A coordinate of the cross-section's centre [m]; NaN for a plane: it has none, nothing is between."""
    return obstacle.values["center_m"][axis] if "center_m" in obstacle.values else float("nan")
