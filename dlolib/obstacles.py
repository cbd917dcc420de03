"""The obstacles that files may name: for each shape its values and how many numbers each takes.

A new shape is a line here and a file in `dlolib/sim/shapes`.
"""

from __future__ import annotations

SHAPES: dict[str, dict[str, int]] = {
    "cylinder": {"center_m": 3, "axis": 3, "radius_m": 1, "height_m": 1},
    "sphere": {"center_m": 3, "radius_m": 1},
    "plane": {"point_m": 3, "normal": 3},
    "box": {"center_m": 3, "quaternion": 4, "size_m": 3},
}
