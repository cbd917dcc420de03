"""Equilibrium of the chain at one pose of its gripper, by Newton's method on its hinge angles.

The limit of infinitely slow motion of MuJoCo's own chain: its bodies, hinges and anchors, the springs'
moments and the weights in balance with the force and moment at the gripper. With masses and drag it is one
implicit step in time (BDF2), which is the chain's dynamics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack
from scipy.spatial.transform import Rotation

from dlolib.errors import SimulationError
from dlolib.proof.chain import Chain, turn_between
from dlolib.proof.contact import Contact
from dlolib.proof.laws import Law
from dlolib.types import Floats

ITERATIONS, MOST_TURN_RAD = 16, 0.25
NEAR_M, BALANCE_N_M = 1e-8, 1e-9
HALVINGS, SHORTENINGS = 6, 5
# How thick the honey is for the whole rope [N/m], and how many steps the rope may fall through it.
HONEY_N_M, FALLS = 100.0, 60
# What weighs alike when a step is judged: a moment and a distance.
MERIT_N_M, MERIT_M = 1e-3, 1e-2
# How far a turn of the gripper by one radian carries the rope, about [m], and how far on a step is foreseen.
LEVER_M, FORESEEN = 0.1, 2.0


@dataclass(frozen=True)
class Springs:
    """What resists besides the laws of bending.

    torsion: GJ (N + 1,) [N m²]; axial: EA [N], infinite where the rope does not stretch; clamps: (4,) of
    the start's and the end's two hinges [N m/rad], or none.
    """

    torsion: Floats
    axial: float
    clamps: Floats


@dataclass(frozen=True)
class Drift:
    """Inertia and drag over one step: at every vertex rate * x - drift is the force that is missing.

    rate (N + 1, 1) [N/m], drift (N + 1, 3) [N].
    """

    rate: Floats
    drift: Floats


class Balance(NamedTuple):
    """One that was found: q (D,), reaction (6,), and the gripper's place (3,) [m] and turn (3, 3)."""

    q: Floats
    reaction: Floats
    place_m: Floats
    turn: Floats


class Equilibrium:
    """A chain with its laws, loads and contacts, and the state that balances them."""

    def __init__(
        self,
        chain: Chain,
        laws: Sequence[Law],
        springs: Springs,
        loads: Floats,
        contacts: Sequence[Contact],
        start: Floats,
    ) -> None:
        self.chain, self.laws, self.springs = chain, laws, springs
        self.loads, self.contacts = loads, contacts
        self.q, self.reaction = start, np.zeros(6)
        self.length_m = 0.0
        # The last one or two balances on the gripper's way.
        self.trail: list[Balance] = []
        # How often the balance may still be weighed, which bounds the time that a rope thrown about takes.
        self.patience = 1000
        # Whether a balance on the way to the last pose was one in which no rope stays.
        self.topples = False

    def lengthen(self, length_m: float) -> None:
        """Give the free rope this length [m]."""
        self.length_m = length_m
        self.chain.lengthen(length_m)
        lengths = np.full(self.chain.bodies + 1, length_m / self.chain.bodies)
        lengths[[0, -1]] /= 2
        self.lengths = lengths

    def curvature(self, q: Floats) -> Floats:
        """Curvatures and twist (N + 1, 3) [1/m]."""
        return np.asarray(q[self.chain.place] / self.lengths[:, None])

    def reach(self, position: Floats, turn: Floats, step_s: float, drift: Drift | None = None) -> None:
        """Balance with the gripper at this position (3,) [m] and turn (3, 3).

        Raises:
            SimulationError: no balance was found, in however small steps, or but one in which no rope stays:
                to which side it topples the least that differs decides.
        """
        self.chain.move(self.q)
        first_m, first = self.chain.vertices[-1].copy(), self.chain.gripper.copy()
        whole = -turn_between(first, turn)
        self.trail[-1:] = [Balance(self.q, self.reaction, first_m, first)]
        share, size, self.topples = 0.0, 1.0, False
        while share < 1.0:
            aim = min(1.0, share + size)
            pose = first_m + aim * (position - first_m), turn if aim == 1.0 else _turned(whole * aim, first)
            if self._follow(*pose, step_s, drift):
                share, size = aim, 2 * size
                continue
            size /= 2
            if size < 0.5**HALVINGS:
                if self.topples:
                    raise SimulationError(
                        "the laboratory's rope stands on edge and may topple either way", mend="move it less"
                    )
                self._fall(*pose, step_s, drift)
                share, size = aim, 0.25

    def _follow(self, position: Floats, turn: Floats, step_s: float, drift: Drift | None) -> bool:
        """Balance from where the last step leads, or else from where it ended; there it stays without one."""
        last = self.trail[-1]
        for start in (*self._foreseen(position, turn), (last.q, last.reaction)):
            self.q, self.reaction = start
            slopes = self._newton(position, turn, step_s, drift)
            if slopes is None:
                continue
            if self._stays(slopes):
                self._leave_trail(position, turn)
                return True
            self.topples = True
        self.q, self.reaction = last.q, last.reaction
        return False

    def _foreseen(self, position: Floats, turn: Floats) -> list[tuple[Floats, Floats]]:
        """The last balance changed as it last changed, by as much as the gripper goes on that way.

        A rope goes millimetres in a step, and to within a tenth of one where the last step leads. What
        touches is then the same, which Newton's method takes long to find for hard contacts.
        """
        if len(self.trail) < 2:
            return []
        last, now = self.trail
        went = np.append(now.place_m - last.place_m, LEVER_M * turn_between(now.turn, last.turn))
        goes = np.append(position - now.place_m, LEVER_M * turn_between(turn, now.turn))
        share = np.clip(went @ goes / (went @ went), -FORESEEN, FORESEEN)
        return [(now.q + share * (now.q - last.q), now.reaction + share * (now.reaction - last.reaction))]

    def _leave_trail(self, position: Floats, turn: Floats) -> None:
        """Append the present state; it replaces the last one where the gripper stood."""
        last, now = self.trail[-1], Balance(self.q, self.reaction, position, turn)
        went_rad = np.linalg.norm(turn_between(turn, last.turn))
        stood = max(np.linalg.norm(position - last.place_m), LEVER_M * went_rad) < 10 * NEAR_M
        self.trail = [*self.trail[:-1], now] if stood else [last, now]

    def _fall(self, position: Floats, turn: Floats, step_s: float, drift: Drift | None) -> None:
        """Where the balance is lost the rope falls to the next one, as through honey.

        Raises:
            SimulationError: it found none.
        """
        still = Drift(np.zeros((1, 1)), np.zeros((1, 3))) if drift is None else drift
        for _ in range(FALLS):
            self.chain.move(self.q)
            rate = np.full((self.chain.bodies + 1, 1), HONEY_N_M / self.chain.bodies)
            honey = Drift(still.rate + rate, still.drift + rate * self.chain.vertices)
            if self._newton(position, turn, step_s, honey) is None:
                break
            before = self.q, self.reaction
            slopes = self._newton(position, turn, step_s, drift)
            if slopes is not None and self._stays(slopes):
                self._leave_trail(position, turn)
                return
            self.q, self.reaction = before
        raise SimulationError("the laboratory's rope found no balance", mend="move it less")

    def _stays(self, slopes: Floats) -> bool:
        """Whether the rope stays in its balance; the test is none where it rubs, which has no potential."""
        return any(contact.friction for contact in self.contacts) or stands(slopes)

    def keep(self, step_s: float) -> None:
        """Make the present state the laws' history."""
        self.chain.move(self.q)
        bend = self.curvature(self.q)[:, :2]
        for law in self.laws:
            law.keep(bend, step_s)
        for contact in self.contacts:
            contact.keep(self.chain.vertices)

    def _newton(self, position: Floats, turn: Floats, step_s: float, drift: Drift | None) -> Floats | None:
        """Slopes (D + 6, D + 6) at the balance that it came to."""
        aim = (position, turn, step_s, drift)
        residual, gap, matrix = self._imbalance(*aim)
        for _ in range(ITERATIONS):
            if np.abs(gap).max() < NEAR_M and np.abs(residual).max() < BALANCE_N_M:
                return matrix
            *_, step, failed = lapack.dgesv(matrix, -np.concatenate([residual, gap]), overwrite_a=True)
            if failed or not np.isfinite(step).all():
                return None
            count = len(residual)
            share = min(1.0, MOST_TURN_RAD / np.abs(step[:count]).max())
            merit, q, reaction = self._merit(residual, gap), self.q, self.reaction
            # Contacts come and go within a step: without contacts the whole step is taken.
            for _ in range(SHORTENINGS):
                self.q, self.reaction = q + share * step[:count], reaction + share * step[count:]
                residual, gap, matrix = self._imbalance(*aim)
                if self._merit(residual, gap) < merit or not self.contacts:
                    break
                share /= 2
            else:
                return None
        return None

    def _imbalance(
        self, position: Floats, turn: Floats, step_s: float, drift: Drift | None
    ) -> tuple[Floats, Floats, Floats]:
        """Imbalance (D,) [N m], gap at the gripper (6,), and the slopes of both (D + 6, D + 6)."""
        self.patience -= 1
        if self.patience < 0:
            raise SimulationError("the laboratory's rope leaps from balance to balance", mend="move it less")
        self.chain.move(self.q)
        gap = np.concatenate([self.chain.vertices[-1] - position, turn_between(self.chain.gripper, turn)])
        residual, slopes, held = self._system(step_s, drift)
        size = len(residual)
        matrix = np.zeros((size + 6, size + 6), order="F")
        matrix[:size, :size] = slopes
        matrix[:size, size:] = -held.T
        matrix[size:, :size] = held
        return residual, gap, matrix

    @staticmethod
    def _merit(residual: Floats, gap: Floats) -> float:
        return float(np.linalg.norm(residual) / MERIT_N_M + np.linalg.norm(gap) / MERIT_M)

    def _system(self, step_s: float, drift: Drift | None) -> tuple[Floats, Floats, Floats]:
        """Imbalance (D,) [N m], its slopes (D, D), and the gripper's Jacobian (6, D)."""
        chain = self.chain
        residual, slopes = self._springs(step_s)
        forces = self.loads.copy()
        forces[-1] += self.reaction[:3]
        for contact in self.contacts:
            touch = contact.touch(chain.vertices)
            if not len(touch.body):
                continue
            np.add.at(forces, touch.body, (1 - touch.share)[:, None] * touch.force)
            np.add.at(forces, touch.body + 1, touch.share[:, None] * touch.force)
            moved = chain.jacobians(touch.body, touch.points_m)
            pushed = moved @ touch.slope.swapaxes(1, 2)
            slopes -= np.tensordot(moved, pushed, axes=((0, 2), (0, 2)))
        if drift is not None:
            forces += drift.drift - drift.rate * chain.vertices
            slopes += chain.masses(drift.rate[:, 0])
        residual -= chain.forces(forces) + chain.turns @ self.reaction[3:]
        slopes -= chain.force_slopes(forces) + chain.moment_slopes(self.reaction[3:])
        return residual, slopes, np.concatenate([chain.jacobian(chain.bodies), chain.turns.T])

    def _springs(self, step_s: float) -> tuple[Floats, Floats]:
        """Moments of laws, torsion, stretch and clamps (D,), and their slopes (D, D)."""
        chain, springs = self.chain, self.springs
        bend = self.curvature(self.q)
        moment, slope = np.zeros((chain.bodies + 1, 2)), np.zeros((chain.bodies + 1, 2, 2))
        for law in self.laws:
            more, steeper = law.moments(bend[:, :2], step_s)
            moment, slope = moment + more, slope + steeper
        residual, slopes = np.zeros(chain.freedoms), np.zeros((chain.freedoms, chain.freedoms))
        place = chain.place
        residual[place[:, :2]] = moment
        slopes[place[:, :2, None], place[:, None, :2]] = slope / self.lengths[:, None, None]
        residual[place[:, 2]] = springs.torsion * bend[:, 2]
        slopes[place[:, 2], place[:, 2]] = springs.torsion / self.lengths
        if len(chain.slides):
            stiff = springs.axial * chain.bodies / self.length_m
            residual[chain.slides] = stiff * self.q[chain.slides]
            slopes[chain.slides, chain.slides] = stiff
        if len(chain.clamps):
            residual[chain.clamps] = springs.clamps * self.q[chain.clamps]
            slopes[chain.clamps, chain.clamps] = springs.clamps
        return residual, slopes


def stands(slopes: Floats) -> bool:
    """Whether a rope stays in a balance: something holds it back in every way that its gripper leaves it.

    Newton's method does not mind: it follows a rope that should topple or snap, standing on its edge.

    Args:
        slopes: of imbalance and gap (D + 6, D + 6). Positive definite must be the part of the first, made
            symmetric, that keeps the gap (Gould, Mathematical Programming 32, 1985).
    """
    count = len(slopes) - 6
    *reflectors, _, _ = lapack.dgeqrf(slopes[count:, :count].T)
    turned = 0.5 * (slopes[:count, :count] + slopes[:count, :count].T)
    for side, transposed in (("R", "N"), ("L", "T")):
        turned, _, _ = lapack.dormqr(side, transposed, *reflectors, turned, 64 * count)
    return bool(lapack.dpotrf(turned[6:, 6:])[1] == 0)


def _turned(vector: Floats, turn: Floats) -> Floats:
    """A turn (3, 3) turned further by a rotation vector (3,) in world axes."""
    return np.asarray(Rotation.from_rotvec(vector).as_matrix() @ turn)
