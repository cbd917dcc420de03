"""What can be set about the way from images to a chain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from dlolib.errors import ParameterError

Segmentation = Literal["auto", "threshold", "local", "color", "background", "mask"]
SEGMENTATIONS: tuple[Segmentation, ...] = get_args(Segmentation)


@dataclass(frozen=True)
class ChainSettings:
    """Settings of `extract_chain`.

    points: n of Algorithm 1; the spacing l is length / (n - 1).
    segmentation: which pixels are rope, one of `SEGMENTATIONS`; `dlolib.chain.segment` says what each does.
    threshold: grey level from which a pixel is rope, 1 to 254; None finds it by Otsu's method.
    min_contrast: how much brighter than the rest the rope must be on average, in grey levels, before
        Otsu's threshold is believed.
    background_levels: from this difference on a pixel differs from the empty scene, in levels of 255.
    background_depth_m: from so much nearer on a pixel is nearer than the empty scene, where noise is less.
    edge_px: over how many pixels a depth reading is a mean; so far inside the outline it mixes with what
        is behind, and deeper in still with how round the rope is.
    smooth_m: half of the shortest wave that depth may show along the rope; noise below it goes.
    bridge_m: a hidden stretch up to this length is no gap. Longer ones leave a gap in the chain.
    min_seen: the least part of the rope's length that must be seen in a frame.
    """

    points: int = 30
    segmentation: Segmentation = "auto"
    threshold: int | None = None
    min_contrast: float = 40.0
    background_levels: float = 25.0
    background_depth_m: float = 0.006
    edge_px: float = 1.5
    smooth_m: float = 0.03
    bridge_m: float = 0.006
    min_seen: float = 0.2

    def __post_init__(self) -> None:
        checks = {
            "points": (self.points >= 2, "2 or more"),
            "threshold": (self.threshold is None or 1 <= self.threshold <= 254, "1 to 254, or null"),
            "segmentation": (self.segmentation in SEGMENTATIONS, ", ".join(SEGMENTATIONS)),
            "background_levels": (0 < self.background_levels <= 255, "above 0, up to 255"),
            "background_depth_m": (0 < self.background_depth_m < 1, "above 0, below 1 m"),
            "min_contrast": (0 < self.min_contrast <= 255, "above 0, up to 255"),
            "edge_px": (self.edge_px >= 0, "0 or more"),
            "smooth_m": (0 < self.smooth_m < 1, "above 0, below 1 m"),
            "bridge_m": (0 <= self.bridge_m < 1, "0 or more, below 1 m"),
            "min_seen": (0 < self.min_seen <= 1, "above 0, up to 1"),
        }
        for name, (good, valid) in checks.items():
            if not good:
                raise ParameterError(
                    f"{getattr(self, name)} is out of range; valid: {valid}", place=f"chain.{name}"
                )
