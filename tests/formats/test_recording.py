"""Recordings: round trips, the real ones, and every refusal."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from formats import samples

from dlolib.errors import FormatError
from dlolib.formats import read_capture_index, read_recording, write_recording
from dlolib.types import Ends, Floats, Noise, Recording

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"


def assert_equal(one: Any, other: Any) -> None:
    for field in dataclasses.fields(one):
        left, right = getattr(one, field.name), getattr(other, field.name)
        if dataclasses.is_dataclass(left):
            assert_equal(left, right)
        elif isinstance(left, np.ndarray):
            np.testing.assert_allclose(left, right, rtol=1e-8, atol=1e-12, err_msg=field.name)
        else:
            assert left == right, field.name


@pytest.fixture(name="shared", params=["real", "practice", "sealed"])
def shared_folder(request: pytest.FixtureRequest) -> Path:
    folder = SHARED / request.param
    if not folder.is_dir():
        pytest.skip(f"no ../shared/data/{request.param}: the shared recordings are not on this machine")
    return folder


def test_shared_recordings_are_read_without_complaint_and_survive_a_round_trip(
    shared: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folders = sorted(path.parent for path in shared.glob("*/recording.json"))
    assert folders
    for folder in folders:
        recording = read_recording(folder)
        assert recording.name == folder.name
        assert len(recording.points.s_m) > 40
        write_recording(recording, tmp_path / "again")
        assert_equal(recording, read_recording(tmp_path / "again"))
    assert "is not read" not in caplog.text


def test_the_shared_clouds_are_read() -> None:
    if not (SHARED / "real" / "rope_clouds").is_dir():
        pytest.skip("no ../shared/data/real/rope_clouds: the shared captures are not on this machine")
    index = read_capture_index(SHARED / "real" / "rope_clouds")
    assert index.cloud is not None and len(index.cloud) == 6 and index.color is None and index.motion is None


def full() -> Recording:
    plain = samples.recording()
    covariance = np.tile(np.diag([1e-6, 2e-6, 3e-6]) + 1e-7, (30, 1, 1))
    return dataclasses.replace(
        plain,
        points=dataclasses.replace(plain.points, covariance_m2=covariance),
        noise=Noise(0.001, 3.0, 2.0),
        position_noise_m=0.001,
        world_from_camera=np.array([[1.0, 0, 0, 0], [0, 0, 1, -0.7], [0, -1, 0, 0], [0, 0, 0, 1]]),
        static_frames=(0, 1),
        heldout_frames=(2, 2),
        rate_hz=30.0,
        quasi_static=False,
        source="a test",
        note="two lines are one",
    )


def test_round_trip_of_every_key(tmp_path: Path) -> None:
    write_recording(full(), tmp_path / "one")
    again = read_recording(tmp_path / "one")
    assert_equal(full(), again)
    write_recording(again, tmp_path / "two")
    for name in ("recording.json", "motion.csv", "points.csv"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_points_of_a_frame_are_put_in_order(tmp_path: Path) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    header, *rows = (folder / "points.csv").read_text().splitlines()
    rows[2], rows[7] = rows[7], rows[2]
    (folder / "points.csv").write_text("\n".join([header, *rows]))
    assert_equal(samples.recording(), read_recording(folder))


def test_a_planar_recording_needs_no_y(tmp_path: Path) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    samples.set_key(folder / "recording.json", "planar", "xz")
    for line in range(2, 32):
        samples.set_cell(folder / "points.csv", line, "y_m", "")
    assert (read_recording(folder).points.xyz_m[:, 1] == 0).all()


@pytest.mark.parametrize(
    ("start_y", "end_y", "expected"),
    [("1.5", "1.5", lambda share: 1.5), ("0.1", "0.2", lambda share: 0.1 + 0.1 * share)],
)
@pytest.mark.parametrize("given", ["", "0"])
def test_in_a_planar_recording_y_is_on_the_line_between_the_ends(
    tmp_path: Path, start_y: str, end_y: str, expected: Callable[[Floats], Floats], given: str
) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    samples.set_key(folder / "recording.json", "planar", "xz")
    samples.set_key(folder / "recording.json", "obstacles", [])
    for line in range(2, 32):
        samples.set_cell(folder / "points.csv", line, "y_m", given)
    for line in range(2, 7):
        samples.set_cell(folder / "motion.csv", line, "start_y_m", start_y)
        samples.set_cell(folder / "motion.csv", line, "end_y_m", end_y)
    points = read_recording(folder).points
    assert points.xyz_m[:, 1] == pytest.approx(expected(points.s_m / samples.ROPE.length_m), abs=1e-12)
    seen = pd.read_csv(folder / "points.csv")
    assert np.array_equal(points.xyz_m[:, [0, 2]], seen[["x_m", "z_m"]])


@pytest.mark.parametrize("free", ["start", "end"])
def test_in_a_planar_recording_y_is_that_of_the_held_end(tmp_path: Path, free: str) -> None:
    made = samples.recording()
    poses = {
        f"{end}_m": getattr(made.motion, f"{end}_m") + np.array([0.0, 0.3, 0.0]) for end in ("start", "end")
    }
    poses |= {f"{free}_m": np.full((5, 3), np.nan), f"{free}_q": np.full((5, 4), np.nan)}
    ends = replace(made.ends, **{free: "free"})
    write_recording(
        replace(made, ends=ends, motion=replace(made.motion, **poses), planar="xz"), tmp_path / "r"
    )
    assert (read_recording(tmp_path / "r").points.xyz_m[:, 1] == 0.3).all()


def test_in_a_planar_recording_of_a_rope_that_nobody_holds_y_is_what_it_says(tmp_path: Path) -> None:
    made = samples.recording()
    nowhere = {f"{end}_m": np.full((5, 3), np.nan) for end in ("start", "end")}
    nowhere |= {f"{end}_q": np.full((5, 4), np.nan) for end in ("start", "end")}
    motion, points = replace(made.motion, **nowhere), replace(made.points, xyz_m=made.points.xyz_m + 0.25)
    falling = replace(made, ends=Ends("free", "free"), motion=motion, points=points, planar="xz")
    write_recording(falling, tmp_path / "r")
    assert (read_recording(tmp_path / "r").points.xyz_m[:, 1] == 0.25).all()


def refused(folder: Path, name: str) -> str:
    with pytest.raises(FormatError) as caught:
        read_recording(folder)
    line = str(caught.value)
    assert line.startswith(str(folder / name)) and "; " in line and "\n" not in line
    return line


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("format", "dlo-capture/1", "format: says 'dlo-capture/1', expected 'dlo-recording/1'"),
        ("object.length_m", "0.445", "object.length_m: Input should be a valid number, got '0.445'"),
        ("object.length_m", 445, "a rope of 445 m looks like millimetres; divide by 1000"),
        ("object.length_m", None, "object.length_m: Input should be a valid number, got None"),
        ("object.length_m", 0, "object.length_m: Input should be greater than 0"),
        ("object.diameter_m", 8, "looks like millimetres; divide by 1000"),
        ("object.diameter_m", 1e-300, "of diameter_m = 1e-300 is inf kg/m³, more than any material has"),
        ("object.linear_density_kg_m", -1, "object.linear_density_kg_m: Input should be greater than 0"),
        ("object.linear_density_kg_m", 40, "8e+05 kg/m³, more than any material has: g/m are to be divided"),
        (
            "object.length_m",
            44.5,
            "object.length_m: 44.5 m, and all that was seen of it is within 0.445 m; correct it",
        ),
        (
            "position_noise_m",
            1.5,
            "position_noise_m: a deviation of 1.5 m, of points on a rope of 0.445 m; looks",
        ),
        (
            "noise",
            {"sigma_m": 1.5, "correlation_points": 1.0, "correlation_frames": 1.0},
            "noise.sigma_m: a deviation of 1.5 m",
        ),
        ("gravity_m_s2", [0, -9.81], "gravity_m_s2"),
        ("gravity_m_s2", [0, 0, -9810], "looks like millimetres"),
        ("gravity_m_s2", [0, 0, 1e200], "1e+200 m/s^2 looks like millimetres"),
        ("object.tip_mass_kg", 120, "object.tip_mass_kg: 120 looks like grams; divide by 1000"),
        ("ends.end", "glued", "ends.end: Input should be 'clamped' or 'free', got 'glued'"),
        ("quasi_static", "yes", "quasi_static: Input should be a valid boolean"),
        ("planar", "xy", "planar: Input should be 'xz'"),
        ("static_frames", [5, 1], "static_frames: [5, 1] ends before it begins"),
        ("heldout_frames", [50, 60], "heldout_frames: [50, 60] names no frame of points.csv"),
        ("heldout_frames", [1], "heldout_frames"),
        ("position_noise_m", -0.001, "position_noise_m: Input should be greater than or equal to 0"),
        ("camera", {"world_from_camera": [[1, 0], [0, 1]]}, "camera.world_from_camera: is no 4 x 4"),
        (
            "obstacles.0.shape",
            "torus",
            "unknown shape 'torus'; valid are cylinder, sphere, plane, box",
        ),
        ("obstacles.0.radius_m", -0.03, "radius_m = -0.03 is not positive"),
        ("obstacles.0.center_m", [200, 0, 150], "looks like millimetres"),
        ("obstacles.0.axis", [0, 0, 0], "axis is zero; give a direction"),
        ("obstacles.0.axis", [0, 1], "give 3 numbers"),
    ],
)
def test_a_bad_key_is_named(tmp_path: Path, key: str, value: Any, says: str) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    samples.set_key(folder / "recording.json", key, value)
    assert says in refused(folder, "recording.json")


@pytest.mark.parametrize(("given", "read"), [(0.012, 0.012), (0.0, 0.0), (None, 0.0)])
def test_a_tip_mass_is_read_and_one_that_nobody_measured_is_none(
    tmp_path: Path, given: float | None, read: float
) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    samples.set_key(folder / "recording.json", "object.tip_mass_kg", given)
    assert read_recording(folder).rope.tip_mass_kg == read


def test_ends_further_apart_than_the_rope_are_refused(tmp_path: Path) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    samples.set_cell(folder / "motion.csv", 4, "end_x_m", "0.6")
    says = "t_s = 2: the ends are 0.6 m apart, on a rope of 0.445 m; correct the positions"
    assert says in refused(folder, "motion.csv")


@pytest.mark.parametrize(
    ("line", "column", "value", "says"),
    [
        (5, "x_m", "0,1", "give every row as many cells"),
        (5, "x_m", "seen", "line 5, column x_m: 'seen' in a number's place"),
        (5, "x_m", "NaN", "line 5, column x_m: NaN is not a finite number"),
        (5, "s_m", "0.5", "s_m = 0.5 is outside the rope of 0.445 m; give the arc length"),
        (5, "s_m", "148.3", "looks like millimetres"),
        (5, "s_m", "-0.1", "s_m = -0.1 is outside the rope"),
        (5, "z_m", "-3", "on a rope of 0.445 m; correct the positions or length_m"),
        (5, "z_m", "-300", "looks like millimetres; divide by 1000"),
        (5, "z_m", "-30", "looks like centimetres; divide by 100"),
        (5, "frame", "0.5", "0.5 is no frame number; count from 0 in whole numbers"),
        (5, "frame", "1e19", "1e+19 is no frame number; count from 0 in whole numbers below 2^53"),
        (5, "t_s", "0.5", "line 5, column t_s: frame 0 has the times 0 and 0.5; give a frame one time"),
        (5, "frame", "2", "line 5, column t_s: frames 0 and 2 have one time, t_s = 0"),
        (12, "t_s", "-1", "line 12, column t_s: t_s falls from 0 to -1"),
        (25, "frame", "0", "line 25, column frame: frame falls to 0; sort the rows by frame"),
        (4, "s_m", "0", "two rows of frame 0 with s_m = 0; remove one of them"),
    ],
)
def test_a_bad_point_is_named(tmp_path: Path, line: int, column: str, value: str, says: str) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    samples.set_cell(folder / "points.csv", line, column, value)
    assert says in refused(folder, "points.csv")


def test_a_column_that_is_there_twice_is_named(tmp_path: Path) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    lines = (folder / "points.csv").read_text().splitlines()
    twice = [f"{line},{'x_m' if number == 0 else '0.5'}" for number, line in enumerate(lines)]
    (folder / "points.csv").write_text("\n".join(twice) + "\n")
    assert "line 1: two columns x_m; remove one of them" in refused(folder, "points.csv")


def test_a_point_that_is_known_exactly_is_named(tmp_path: Path) -> None:
    made = samples.recording()
    covariance = np.tile(1e-6 * np.eye(3), (len(made.points.s_m), 1, 1))
    covariance[2] = 0.0
    points = dataclasses.replace(made.points, covariance_m2=covariance)
    write_recording(dataclasses.replace(made, points=points), tmp_path / "r")
    said = refused(tmp_path / "r", "points.csv")
    assert "line 4, column cxx_m2: is no covariance" in said and "give above 0" in said


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("quasistatic", False, "quasistatic: is not read; write quasi_static, if it is meant"),
        ("object.diameter", 0.008, "object.diameter: is not read; write diameter_m, if it is meant"),
        (
            "ends.roll_known",
            {"end": False},
            "ends.roll_known: is not read here; put it beside ends, if it is meant",
        ),
        ("gravity", [0, 0, -1], None),
        ("operator", "A. N. Other", None),
    ],
)
def test_a_key_that_looks_misspelt_is_named_and_others_are_left_alone(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, key: str, value: Any, says: str | None
) -> None:
    path = samples.recording_folder(tmp_path / "small") / "recording.json"
    content = json.loads(path.read_text())
    # what is null is written, and a key that is there is not meant by another
    content["object"].pop("diameter_m")
    content.pop("quasi_static")
    inside, _, name = key.rpartition(".")
    (content[inside] if inside else content)[name] = value
    path.write_text(json.dumps(content))
    read_recording(path.parent)
    said = [record.getMessage() for record in caplog.records]
    assert said == ([] if says is None else [f"warning: {path}: {says}"])


@pytest.mark.parametrize("name", ["recording.json", "motion.csv", "points.csv"])
def test_a_missing_file_is_named(tmp_path: Path, name: str) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    (folder / name).unlink()
    assert "no such file" in refused(folder, name)


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"nowhere: no such folder; correct the path"):
        read_recording(tmp_path / "nowhere")
    (tmp_path / "given").touch()
    with pytest.raises(FormatError, match="given: is a file where a folder should be; give the folder"):
        read_recording(tmp_path / "given")


def test_broken_json_names_the_line(tmp_path: Path) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    path = folder / "recording.json"
    path.write_text(path.read_text().replace('"note": "",', '"note": ""'))
    assert "line 6, column 3: is not JSON" in refused(folder, "recording.json")
    path.write_text('{"format": NaN}')
    assert "NaN is not JSON" in refused(folder, "recording.json")


@pytest.mark.parametrize(
    ("name", "suffix", "blamed"),
    [
        ("points.csv", "s_m", "points.csv"),
        ("points.csv", "x_m", "points.csv"),
        ("motion.csv", "_m", "motion.csv"),
    ],
)
def test_millimetres_are_seen(tmp_path: Path, name: str, suffix: str, blamed: str) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    samples.scale_columns(folder / name, suffix, 1000.0)
    assert "looks like millimetres; divide by 1000" in refused(folder, blamed)


def test_a_held_end_far_from_the_points_is_seen(tmp_path: Path) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    for line in range(2, 7):
        for end in ("start", "end"):
            samples.set_cell(folder / "motion.csv", line, f"{end}_y_m", "3")
    assert "a held end is 3" in refused(folder, "motion.csv")


def test_ends_and_motion_agree(tmp_path: Path) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    samples.set_key(folder / "recording.json", "ends.end", "free")
    assert "gives a pose of the free end" in refused(folder, "motion.csv")
    for line in range(2, 7):
        for column in ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"):
            samples.set_cell(folder / "motion.csv", line, f"end_{column}", "")
    assert np.isnan(read_recording(folder).motion.end_m).all()
    samples.set_key(folder / "recording.json", "ends.end", "clamped")
    assert "has no pose of the clamped end" in refused(folder, "motion.csv")


def test_two_clocks_are_seen(tmp_path: Path) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    path = folder / "motion.csv"
    for line in range(2, 7):
        samples.set_cell(path, line, "t_s", str(1.7e9 + line))
    assert "bring both to one clock" in refused(folder, "motion.csv")


def test_ends_that_never_move_fit_every_clock(tmp_path: Path) -> None:
    made = samples.recording()
    still = dataclasses.replace(
        made.motion,
        t_s=made.motion.t_s + 1.7e9,
        **{name: getattr(made.motion, name)[[0] * 5] for name in ("start_m", "start_q", "end_m", "end_q")},
    )
    write_recording(dataclasses.replace(made, motion=still), tmp_path / "r")
    assert read_recording(tmp_path / "r").motion.t_s[0] == 1.7e9


def test_covariances_in_square_millimetres_are_seen(tmp_path: Path) -> None:
    made = samples.recording()
    points = dataclasses.replace(made.points, covariance_m2=np.tile(np.eye(3), (len(made.points.s_m), 1, 1)))
    write_recording(dataclasses.replace(made, points=points), tmp_path / "r")
    assert "covariances of points.csv: a deviation of 1.73 m" in refused(tmp_path / "r", "recording.json")


def test_some_of_the_columns_of_a_covariance_are_no_covariance(tmp_path: Path) -> None:
    write_recording(full(), tmp_path / "r")
    path = tmp_path / "r" / "points.csv"
    path.write_text(path.read_text().replace("cyz_m2", "comment"))
    assert "line 1: no column cyz_m2; give all six or none" in refused(tmp_path / "r", "points.csv")


def test_times_from_1970_are_told_apart_in_a_refusal(tmp_path: Path) -> None:
    folder = samples.recording_folder(tmp_path / "r")
    for line, t_s in zip(range(2, 7), (0.0, 0.5, 0.25, 1.0, 1.5), strict=True):
        samples.set_cell(folder / "motion.csv", line, "t_s", repr(1.7e9 + t_s))
    assert "t_s falls from 1700000000.5 to 1700000000.25" in refused(folder, "motion.csv")


def test_nothing_half_written(tmp_path: Path) -> None:
    broken = dataclasses.replace(samples.recording(), rate_hz=float("nan"))
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_recording(broken, tmp_path / "r")
    assert list(tmp_path.iterdir()) == []
