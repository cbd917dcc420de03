"""How the layouts under data/layouts were made, once, by an exact rod; no stage of the pipeline.

Run from the repository's root: `python -m stages.make_goals`. A layout is drawn in the rope's own plane:
where it is clamped and under which angle, where its end arrives, and where the gap is.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.formats import write_layout
from dlolib.lab.elastica import planar_elastica
from dlolib.types import Ends, Floats, Layout, Obstacle, Pose, Rope
from stages import DATA, run

ROPE = Rope("laboratory rope", length_m=0.445, diameter_m=0.008, linear_density_kg_m=0.04)
BENDING_STIFFNESS_N_M2 = 3e-4
GRAVITY_M_S2 = 9.81
CYLINDER = {"axis": (0.0, 1.0, 0.0), "radius_m": (0.03,), "height_m": (0.06,)}
BETWEEN_CENTRES_M = 0.1
POINTS = 90
DIGITS = 6


@dataclass(frozen=True)
class Drawing:
    """A layout in the plane: lengths in m, angles in rad from +x towards +z.

    Attributes:
        start_angle, end_angle: tangents at the clamp (at the origin) and at the gripper.
        a, b: where the gripper begins and where it must arrive (x, z).
        gap_angle: direction of the gap's middle plane.
        gap_back, gap_aside: the gap's middle, from B: so far back along the plane, so far to the right.
        mirrored_at_x: x of a plane in which all of it is mirrored, or None.
    """

    start_angle: float
    end_angle: float
    a: tuple[float, float]
    b: tuple[float, float]
    gap_angle: float
    gap_back: float
    gap_aside: float = 0.0
    mirrored_at_x: float | None = None


DRAWINGS = {
    "layout_1": Drawing(-0.85, 1.0, (0.381, 0.079), (0.32, 0.16), 1.0, 0.03, -0.002),
    "layout_2": Drawing(-np.pi / 2, np.pi / 2, (0.33, -0.02), (0.20, 0.0), np.pi / 2, 0.03),
    "layout_3": Drawing(-0.8, 1.35, (0.40, 0.10), (0.30, 0.13), 1.35, 0.02),
    "layout_4": Drawing(-0.7, 1.2, (0.405, 0.08), (0.31, 0.15), 1.2, 0.025, 0.0, mirrored_at_x=0.2),
}


def main() -> None:
    for name, drawing in DRAWINGS.items():
        write_layout(layout(name, drawing), DATA / "layouts" / name)


def layout(name: str, drawing: Drawing) -> Layout:
    """The layout of a drawing; its goal is the exact rod's rest shape, clear of the cylinders."""
    s_m, x, z, _ = planar_elastica(
        ROPE.length_m,
        BENDING_STIFFNESS_N_M2,
        (ROPE.linear_density_kg_m or 0.0) * GRAVITY_M_S2,
        (0.0, 0.0),
        drawing.start_angle,
        drawing.b,
        drawing.end_angle,
        points=POINTS,
    )
    along = np.array([np.cos(drawing.gap_angle), np.sin(drawing.gap_angle)])
    aside = np.array([along[1], -along[0]])
    middle = np.array(drawing.b) - drawing.gap_back * along + drawing.gap_aside * aside
    centres = [middle - aside * BETWEEN_CENTRES_M / 2, middle + aside * BETWEEN_CENTRES_M / 2]
    return Layout(
        name=name,
        rope=ROPE,
        gravity_m_s2=np.array([0.0, 0.0, -GRAVITY_M_S2]),
        ends=Ends(),
        obstacles=tuple(
            Obstacle("cylinder", {"center_m": tuple(_placed(c, drawing).tolist()), **CYLINDER})
            for c in centres
        ),
        start=Pose(_placed(np.zeros(2), drawing), _held(drawing.start_angle, drawing)),
        grasp=Pose(_placed(np.array(drawing.a), drawing), _held(drawing.end_angle, drawing)),
        goal_s_m=s_m,
        goal_m=_placed(np.stack([x, z], axis=1), drawing),
    )


def _placed(points: Floats, drawing: Drawing) -> Floats:
    """Points (..., 2) of the drawing in the world, (..., 3)."""
    x, z = points[..., 0], points[..., 1]
    if drawing.mirrored_at_x is not None:
        x = 2 * drawing.mirrored_at_x - x
    return np.asarray(np.round(np.stack([x, np.zeros_like(x), z], axis=-1), DIGITS) + 0.0, dtype=float)


def _held(angle: float, drawing: Drawing) -> Floats:
    """Quaternion of an end with this tangent: first axis along y, third along the rope."""
    if drawing.mirrored_at_x is not None:
        angle = np.pi - angle
    tangent, first = np.array([np.cos(angle), 0.0, np.sin(angle)]), np.array([0.0, 1.0, 0.0])
    axes = np.stack([first, np.cross(tangent, first), tangent], axis=1)
    return np.asarray(Rotation.from_matrix(axes).as_quat(scalar_first=True, canonical=True))


if __name__ == "__main__":
    run(main, *sys.argv[1:])
