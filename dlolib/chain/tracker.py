"""The chain as a camera delivers frames: frame in, chain out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from dlolib.captures.base import Frame
from dlolib.chain.frame import FrameChain, chain_frame
from dlolib.chain.many import following
from dlolib.chain.settings import ChainSettings
from dlolib.types import CaptureIndex, EndKind, Motion, Pose


@dataclass
class Tracker:
    """Follows a rope from frame to frame, as a closed loop needs it.

    Args:
        index: camera, rope and ends of what is looked at, as in a capture; neither its frames nor its motion
            are read.
        settings: as for `extract_chain`.
        chain: the last chain that counts, from which the next one goes on; None before the first.
    """

    index: CaptureIndex
    settings: ChainSettings = field(default_factory=ChainSettings)
    chain: FrameChain | None = None

    def see(self, frame: Frame, start: Pose | None = None, end: Pose | None = None) -> FrameChain:
        """Perceive the rope in the next frame.

        Args:
            frame: what the camera saw.
            start, end: where the grippers hold the rope at the frame's time [m] in world axes; None for an
                end that is free.

        Returns:
            The chain, which is also kept if it counts. Else, and after an error, the last good one stays.

        Raises:
            ChainError: the frame shows no rope.
        """
        held = replace(self.index.ends, start=_kind(start), end=_kind(end))
        index = replace(self.index, ends=held, motion=_motion(frame.t_s, start, end))
        chain = chain_frame(frame, index, self.settings, self.chain)
        self.chain = following(self.chain, chain)
        return chain


def _kind(pose: Pose | None) -> EndKind:
    return "free" if pose is None else "clamped"


def _motion(t_s: float, start: Pose | None, end: Pose | None) -> Motion:
    """A motion of one row, at the frame's own time."""
    nowhere = Pose(np.full(3, np.nan), np.full(4, np.nan))
    first, last = start or nowhere, end or nowhere
    return Motion(
        np.array([t_s]),
        first.position_m[None],
        first.quaternion[None],
        last.position_m[None],
        last.quaternion[None],
    )
