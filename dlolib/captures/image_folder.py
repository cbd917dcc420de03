"""A capture folder with color and depth images: the layout of Open3D and TUM RGB-D with one JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from dlolib.captures.base import Frame
from dlolib.captures.pictures import read_color, read_depth, read_mask
from dlolib.types import CaptureIndex


@dataclass(frozen=True)
class ImageFolder:
    """Frames with color (H, W, 3), depth [m] (H, W) and, where given, a mask (H, W)."""

    index: CaptureIndex

    def frames(self) -> Iterator[Frame]:
        """Read one frame after the other; a `FormatError` names the image that cannot be used."""
        index = self.index
        assert index.color is not None and index.depth is not None
        for row, frame in enumerate(index.frame):
            yield Frame(
                int(frame),
                float(index.t_s[row]),
                index.color[row],
                color=read_color(index.color[row], index.camera),
                depth_m=read_depth(index.depth[row], index.camera),
                mask=None if index.mask is None else read_mask(index.mask[row], index.camera),
            )
