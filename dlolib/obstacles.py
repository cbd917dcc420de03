"""The obstacles that files may name: for each shape its values and how many numbers each takes.

A new shape is a line here, a file in `dlolib/sim/shapes`, and a line in the table of every other layer that
knows shapes: `DISTANCES` (`dlolib/formats/geometry.py`), `GEOMS` (`dlolib/lab/rope.py`), `MESHES`
(`dlolib/lab/scene.py`) and `OUTLINES` (`dlolib/report/drawing.py`); tests hold them against this one. A plane
has no end: it has neither mesh nor outline. The height of a capsule is between its half spheres' centres.
"""

from __future__ import annotations

SHAPES: dict[str, dict[str, int]] = {
    "cylinder": {"center_m": 3, "axis": 3, "radius_m": 1, "height_m": 1},
    "sphere": {"center_m": 3, "radius_m": 1},
    "plane": {"point_m": 3, "normal": 3},
    "box": {"center_m": 3, "quaternion": 4, "size_m": 3},
    "capsule": {"center_m": 3, "axis": 3, "radius_m": 1, "height_m": 1},
}
