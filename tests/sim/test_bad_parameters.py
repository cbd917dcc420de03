"""What no rod can be or follow is refused by a named error that says what is valid."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sim.ropes import EI, GJ, LEVEL, ROPE, moved, pose, settled, swing
from sim.test_recording import recording

from dlolib.errors import DloError, ParameterError, SimulationError
from dlolib.sim.mesh import Mesh
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod
from dlolib.sim.simulate import Clock
from dlolib.types import Motion

BAD: dict[str, tuple[Callable[[], Rod], str]] = {
    "negative EI": (lambda: Rod(ROPE, -EI, GJ), "bending_stiffness = -0.0003 .*; give one above 0"),
    "no EI": (lambda: Rod(ROPE, 0.0, GJ), "bending_stiffness = 0 .*; give one above 0"),
    "infinite GJ": (lambda: Rod(ROPE, EI, np.inf), "torsional_stiffness = inf .*; give one above 0"),
    "no rope": (lambda: Rod(ROPE, 1e9, GJ), "bending_stiffness = 1e.09 N m.2 is stiffer than .* 40000 or"),
    "no length": (lambda: Rod(replace(ROPE, length_m=0.0), EI, GJ), "length_m = 0 .*; give one above 0"),
    "negative length": (
        lambda: Rod(replace(ROPE, length_m=-1.0), EI, GJ),
        "length_m = -1 .*; give one above 0",
    ),
    "no mass": (
        lambda: Rod(replace(ROPE, linear_density_kg_m=0.0), EI, GJ),
        "linear_density = 0 .*; give one above 0",
    ),
    "negative diameter": (
        lambda: Rod(replace(ROPE, diameter_m=-0.008), EI, GJ),
        "diameter_m = -0.008 .*; give 0 or more",
    ),
    "negative tip mass": (
        lambda: Rod(replace(ROPE, tip_mass_kg=-0.1), EI, GJ),
        "tip_mass_kg = -0.1 .*; give 0 or more",
    ),
    "a tip of a rope that nobody weighed": (
        lambda: Rod(replace(ROPE, linear_density_kg_m=None, tip_mass_kg=0.02), EI, GJ),
        "linear_density_kg_m: the density of a rope with a mass at its tip is not known; weigh the rope",
    ),
    "two particles": (lambda: Rod(ROPE, EI, GJ, particles=2), "particles = 2; a rod needs 3 or more"),
    "out of bounds": (
        lambda: Rod(ROPE, EI, GJ, {"contact_friction.coefficient": -1.0}),
        "contact_friction.coefficient = -1 is out of range; give one from 0 to",
    ),
}


@pytest.mark.parametrize(("make", "says"), BAD.values(), ids=BAD)
def test_what_no_rod_can_be(make: Callable[[], Rod], says: str) -> None:
    with pytest.raises(ParameterError, match=says) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_a_rod_of_three_particles_is_one() -> None:
    assert np.isfinite(settled(particles=3).x).all()


def test_a_mesh_carries_a_cubic() -> None:
    with pytest.raises(ParameterError, match=r"rod\.particles: is 3; give 4 or more"):
        Mesh(particles=3)
    assert Mesh(particles=4).particles_for(0.03) == 4


def jump(way_m: float, turn_rad: float) -> Motion:
    """Still but for a leap of the end, and a turn about its tangent, within 10 ms of t = 1 s."""
    t_s = np.array([0.0, 1.0, 1.01, 6.0])
    end = np.array([[0.3, 0, 0.02]] * 2 + [[0.3 - way_m, 0, 0.02]] * 2)
    level = Rotation.from_quat(LEVEL, scalar_first=True)
    rolled = (level * Rotation.from_rotvec([0.0, 0.0, turn_rad])).as_quat(scalar_first=True)
    held = np.tile(LEVEL, (4, 1))
    end_q = np.stack([LEVEL, LEVEL, rolled, rolled])
    return Motion(t_s, np.zeros((4, 3)), held, end, end_q)


@pytest.mark.parametrize(("way_m", "turn_rad"), [(0.2, 0.0), (0.0, 1.5)])
def test_a_motion_faster_than_the_step_follows(way_m: float, turn_rad: float) -> None:
    made = replace(recording(), motion=jump(way_m, turn_rad), quasi_static=False)
    rod = Rod(ROPE, EI, GJ, particles=15)
    with pytest.raises(
        SimulationError, match="from t_s = 1 on an end moves .* at most; give rod.time_step_s of 0"
    ):
        RecordingModel(made, 15, 0.01).predict(rod)
    said = ""
    try:
        RecordingModel(made, 15, 0.01).predict(rod)
    except DloError as error:
        said = str(error)
    valid = float(said.split("time_step_s of ")[1].split()[0])
    assert np.isfinite(RecordingModel(made, 15, valid).predict(rod).xyz_m).all()
    # a quasi-static rope takes as many steps as it needs
    assert np.isfinite(RecordingModel(replace(made, quasi_static=True), 15, 0.01).predict(rod).xyz_m).all()


def test_ends_that_come_too_far_apart_on_the_way() -> None:
    far = np.linspace([0.33, 0.0, 0.02], [0.5, 0.0, 0.02], 40)
    with pytest.raises(
        SimulationError, match="step 33: held 6 % longer than it is, it would tear; bring the ends"
    ):
        moved(Rod(ROPE, EI, GJ), settled(), far, Clock(None))
    with pytest.raises(SimulationError, match="apart"):
        settled(end=pose(0.46, 0.0, 0.0))
    assert np.isfinite(moved(Rod(ROPE, EI, GJ), settled(), swing(), Clock(None)).x).all()
