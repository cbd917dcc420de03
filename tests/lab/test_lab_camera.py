"""What the laboratory's camera makes of a known geometry."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from dlolib.formats import signed_distance
from dlolib.lab.arc import ALONG_X
from dlolib.lab.camera import Sensor, default_camera, render
from dlolib.lab.rope import GEOMS
from dlolib.lab.scene import MESHES, build_scene
from dlolib.obstacles import SHAPES
from dlolib.types import Floats, Obstacle, Pose

EXACT = Sensor(noise_m=0.0, edge_loss=0.0)
STRAIGHT = np.stack([np.linspace(0, 0.4, 41), np.zeros(41), np.zeros(41)], axis=1)
CAMERA = default_camera()


def look(
    sensor: Sensor, frame: int = 0, obstacles: tuple[Obstacle, ...] = ()
) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    start, end = (Pose(point, np.array(ALONG_X)) for point in STRAIGHT[[0, -1]])
    return render(build_scene(STRAIGHT, 0.004, start, end, obstacles), CAMERA, sensor, frame)


def project(points: Floats) -> tuple[Floats, Floats, Floats]:
    """Column, row and depth [m] of world points (N, 3)."""
    turn, place = CAMERA.world_from_camera[:3, :3], CAMERA.world_from_camera[:3, 3]
    x, y, z = ((points - place) @ turn).T
    return 504.0 * x / z + 320, 504.0 * y / z + 288, z


def test_depth_of_a_straight_rope_agrees_with_geometry() -> None:
    color, depth = look(EXACT)
    column, row, axis = project(STRAIGHT[2:-2])
    at = np.rint(row).astype(int), np.rint(column).astype(int)
    assert axis.min() > 0.6 and axis.max() < 0.9
    # The ray through the axis meets the skin a radius before it, a little more where it comes aslant.
    skin = axis - depth[at] / 1000
    assert np.all((skin > 0.0025) & (skin < 0.0055))
    assert color[at].min() > 150
    assert np.ptp(color[at].astype(int)) > 10


def test_the_rope_is_as_wide_as_it_should_be_and_the_rest_is_dark() -> None:
    cylinder = {
        "center_m": (0.2, 0.0, -0.1),
        "axis": (0.0, 1.0, 0.0),
        "radius_m": (0.03,),
        "height_m": (0.06,),
    }
    color, depth = look(EXACT, obstacles=(Obstacle("cylinder", cylinder),))
    column, row, axis = project(np.array([[0.2, 0.0, 0.0], [0.2, -0.03, -0.1]]))
    strip = color[int(row[0]) - 10 : int(row[0]) + 10, int(column[0]), 0] > 60
    assert abs(strip.sum() - 504 * 0.008 / axis[0]) <= 1.5
    top = int(row[1]), int(column[1])
    assert abs(depth[top] / 1000 - axis[1]) < 1e-3
    assert color[top].max() < 80


def test_every_obstacle_is_seen_where_its_surface_is() -> None:
    assert set(MESHES) == set(SHAPES) - {"plane"} and set(GEOMS) == set(SHAPES)
    values = {
        "center_m": (0.2, 0.01, -0.1),
        "axis": (0.3, 1.0, 0.2),
        "radius_m": (0.02,),
        "height_m": (0.03,),
        "quaternion": (0.9, 0.1, 0.2, 0.3),
        "size_m": (0.04, 0.02, 0.03),
    }
    for shape, mesh_of in MESHES.items():
        obstacle = Obstacle(shape, {name: values[name] for name in SHAPES[shape]})
        mesh, turn = mesh_of({name: np.array(value) for name, value in obstacle.values.items()})
        corners = np.asarray(mesh.rotate(turn, center=(0, 0, 0)).translate(values["center_m"]).vertices)
        off = signed_distance(obstacle, corners)
        # a cylinder's end sections have a vertex in their middle, and half spheres one inside the capsule
        assert off.max() < 1e-9 and np.quantile(off, 0.9) > -1e-9 and np.ptp(corners, axis=0).min() > 0.02


def test_edges_mix_near_and_far_and_lose_readings() -> None:
    _, exact = look(EXACT)
    _, lossy = look(replace(EXACT, edge_loss=0.3))
    along = np.stack([np.linspace(0.03, 0.37, 200), np.zeros(200), np.zeros(200)], axis=1)
    column, row, axis = project(along)
    rows = row.astype(int)[:, None] + np.arange(-6, 7)
    columns = np.broadcast_to(column.astype(int)[:, None], rows.shape)
    behind = exact[rows, columns] / 1000 - axis[:, None]
    mixed = (behind > 0.003) & (behind < 0.026)  # neither the rope's skin nor the plate, 30 mm behind
    assert 1.5 < mixed.sum() / len(along) < 3
    lost = lossy[rows, columns] == 0
    assert 0.2 < lost.sum() / mixed.sum() < 0.4
    assert np.array_equal(lossy[lossy > 0], exact[lossy > 0])


def test_noise_is_as_stated_and_frames_differ() -> None:
    _, exact = look(EXACT)
    noisy = [look(Sensor(), frame)[1].astype(float) for frame in (0, 1)]
    corner = (slice(400, 500), slice(100, 300))  # the plate
    sigma = (noisy[0] - noisy[1])[corner].std() / np.sqrt(2)
    stated = 0.8 * (exact[corner].mean() / 700) ** 2
    assert abs(sigma / np.hypot(stated, 1 / np.sqrt(12)) - 1) < 0.05


def test_noise_of_a_grain_is_as_large_and_goes_together_over_so_many_pixels() -> None:
    grain_px = 2.0
    grained = Sensor(noise_m=0.008, grain_px=grain_px)
    one, other = (look(grained, frame)[1].astype(float) for frame in (0, 1))
    plate = (one - other)[400:500, 100:300]
    stated = 8.0 * (one[400:500, 100:300].mean() / 700) ** 2
    assert plate.std() / np.sqrt(2) == pytest.approx(stated, rel=0.1)
    for apart in (2, 4):
        together = np.corrcoef(plate[:, apart:].ravel(), plate[:, :-apart].ravel())[0, 1]
        assert together == pytest.approx(np.exp(-(apart**2) / (4 * grain_px**2)), abs=0.1)


def test_bias_is_smooth_bounded_and_the_same_in_every_frame() -> None:
    biased = replace(EXACT, bias_m=0.01)
    _, exact = look(EXACT)
    off = look(biased)[1].astype(int) - exact.astype(int)
    assert 8 < np.abs(off[exact > 0]).max() <= 11
    plate = off[300:500, 50:400]
    assert np.abs(np.diff(plate, axis=0)).max() <= 1 and np.abs(np.diff(plate, axis=1)).max() <= 1
    assert np.array_equal(look(biased, 1)[1], look(biased, 0)[1])


def test_the_gripper_hides_what_is_behind_it() -> None:
    color, depth = look(EXACT)
    column, row, _ = project(np.array([[0.43, 0.0, 0.0]]))
    at = int(row[0]), int(column[0])
    front = project(np.array([[0.43, -0.015, 0.0]]))[2][0]
    assert color[at].max() < 60
    assert abs(depth[at] / 1000 - front) < 2e-3


def test_a_pixel_on_an_edge_is_as_bright_as_the_share_of_it_that_is_covered() -> None:
    front = np.eye(4)
    front[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    front[:3, 3] = [0.2, -0.7, 0.0]
    camera = replace(CAMERA, world_from_camera=front)
    start, end = (Pose(point, np.array(ALONG_X)) for point in STRAIGHT[[0, -1]])
    rows = np.arange(284, 293)
    for edge_px in np.linspace(288, 289, 9):
        # the upper edge of a box that the camera looks straight at, along a row of pixels
        top = -(edge_px - 288) * 0.6 / 504
        size = np.array([0.2, 0.002, 0.04])
        values = {"center_m": (0.2, -0.099, top - 0.02), "quaternion": (1.0, 0, 0, 0), "size_m": size}
        scene = build_scene(STRAIGHT + np.array([0, 0, 0.1]), 0.004, start, end, (Obstacle("box", values),))
        level = render(scene, camera, EXACT, 0)[0][rows, 240:400, 0].mean(axis=1)
        covered = (level - level[0]) / (level[-1] - level[0])
        true = np.clip((rows + 0.75 - edge_px) / 1.5, 0, 1)
        assert np.abs(covered - true).max() < 0.03
