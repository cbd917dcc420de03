"""What leads outside or shares no clock is refused; what is odd and may be meant is said as a warning."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from captures import foreign_samples as foreign
from captures.realsense_samples import realsense
from chain.tubes import Scene, wave, write_capture

from dlolib.captures import ingest, open_capture
from dlolib.errors import FormatError
from dlolib.formats import read_motion, write_motion

LIFTED = np.array([[0, 0, 0], [0, 0, 0.01], [0, 0, 0.02]])


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    write_capture(tmp_path / "source", [wave(0.5), wave(0.6), wave(0.7)], Scene())
    return tmp_path / "source"


def said(caplog: pytest.LogCaptureFixture) -> list[str]:
    lines = [record.getMessage() for record in caplog.records if record.name.startswith("dlolib")]
    assert all(record.levelno == logging.WARNING for record in caplog.records)
    assert not [line for line in lines if "\n" in line or "; " not in line]
    return lines


def test_a_whole_capture_leaves_no_doubt(capture: Path, caplog: pytest.LogCaptureFixture) -> None:
    ingest(capture, capture.parent / "out")
    list(open_capture(capture).frames())
    assert said(caplog) == []


def test_a_table_that_lost_rows_is_said_once(capture: Path, caplog: pytest.LogCaptureFixture) -> None:
    table = capture / "frames.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:-1]))
    source = open_capture(capture)
    for _ in range(2):
        assert len(list(source.frames())) == 2
    lines = said(caplog)
    assert len(lines) == 2 and all("frames.csv: rows: 1 files in" in line for line in lines)
    assert "are in no row, the first 000002.png" in lines[0]


def test_a_motion_that_ends_early_is_said(capture: Path, caplog: pytest.LogCaptureFixture) -> None:
    motion = read_motion(capture / "motion.csv")
    moved = replace(motion, end_m=motion.end_m + LIFTED)
    write_motion(moved, capture / "motion.csv")
    text = (capture / "motion.csv").read_text()
    (capture / "motion.csv").write_text(text[: text.rindex("\n2,")])
    ingest(capture, capture.parent / "out")
    lines = said(caplog)
    assert "motion.csv: last line: does not end with a line break" in lines[0]
    assert "ends 1 s before the last frame, and its pose there is taken to hold" in lines[1]


@pytest.mark.parametrize("late", [100.0, -100.0, 1.7e9])
def test_a_motion_of_another_clock_is_refused(capture: Path, late: float) -> None:
    motion = read_motion(capture / "motion.csv")
    turned = motion.end_m + LIFTED
    write_motion(replace(motion, t_s=motion.t_s + late, end_m=turned), capture / "motion.csv")
    for command in (open_capture, lambda folder: ingest(folder, capture.parent / "out")):
        with pytest.raises(FormatError, match=r"motion\.csv: column t_s: .* they share no time; bring both"):
            command(capture)
    # ends that never move fit every clock
    still = replace(motion, t_s=motion.t_s + late, end_m=motion.end_m[[0, 0, 0]])
    write_motion(still, capture / "motion.csv")
    open_capture(capture)


def test_a_time_that_no_clock_shows_is_refused(capture: Path) -> None:
    table = capture / "frames.csv"
    table.write_text(table.read_text().replace("\n2,2,", "\n2,1e99,"))
    with pytest.raises(FormatError, match=r"frames\.csv: column t_s: a time of 1e\+99 s; give seconds"):
        open_capture(capture)


@pytest.mark.parametrize("name", ["depth/000001.png", "motion.csv", "frames.csv", "capture.json", "color"])
def test_a_link_that_leads_outside_is_refused(capture: Path, name: str) -> None:
    outside = capture.parent / "elsewhere"
    (capture / name).rename(outside)
    (capture / name).symlink_to(outside)
    for command in (open_capture, lambda folder: ingest(folder, capture.parent / "out")):
        with pytest.raises(FormatError, match=r"is a link that leads out of the folder; put the file itself"):
            command(capture)


def test_links_within_the_folder_to_it_and_of_dvc_are_followed(capture: Path) -> None:
    (capture / "depth/000001.png").rename(capture / "depth/same.png")
    (capture / "depth/000001.png").symlink_to("same.png")
    cache = capture.parent / "cache/files/md5/0a"
    cache.mkdir(parents=True)
    (capture / "color/000000.png").rename(cache / "bcdef0")
    (capture / "color/000000.png").symlink_to(cache / "bcdef0")
    (capture.parent / "link").symlink_to(capture)
    assert len(list(open_capture(capture.parent / "link").frames())) == 3


def test_a_recording_that_is_no_capture_yet(tmp_path: Path) -> None:
    for source in (
        foreign.bag(tmp_path / "rope.bag", foreign.frames(), foreign.Ros()),
        foreign.tum(tmp_path / "tum", foreign.frames()),
    ):
        with pytest.raises(FormatError, match=r"no capture folder; make one of it: dlo ingest (rope|tum)"):
            open_capture(source)
    with pytest.raises(FormatError, match=r"capture\.json: no such file"):
        open_capture(tmp_path)


def test_a_link_in_a_foreign_folder(tmp_path: Path) -> None:
    about = foreign.given(tmp_path / "object.json")
    folder = foreign.redwood(tmp_path / "source", foreign.frames())
    path = sorted(folder.glob("depth/*"))[1]
    path.rename(tmp_path / "secret.png")
    path.symlink_to(tmp_path / "secret.png")
    with pytest.raises(FormatError, match=rf"{path.name}: is a link that leads out"):
        ingest(folder, tmp_path / "out", object_json=about)


def test_a_link_that_leads_to_itself(tmp_path: Path) -> None:
    about = foreign.given(tmp_path / "object.json")
    folder = foreign.redwood(tmp_path / "source", foreign.frames())
    (folder / "depth" / "readme.png").symlink_to(folder / "depth" / "readme.png")
    with pytest.raises(FormatError, match=r"readme.png: is a link that leads to itself; "):
        ingest(folder, tmp_path / "out", object_json=about)


def test_a_frame_of_tf_that_is_not_the_images(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Its axes may be those of the camera's body: x forward."""
    about = foreign.given(tmp_path / "object.json", camera={})
    bag = foreign.bag(tmp_path / "rope.bag", foreign.frames(), foreign.Ros(eye="camera_link"))
    ingest(bag, tmp_path / "out", topics={"camera_pose": "/tf_static:camera_link"}, object_json=about)
    says = "the images are of 'camera': its axes are taken to be 'camera_link''s"
    assert any(says in line for line in said(caplog))


@pytest.mark.parametrize(("eye", "odd"), [("camera_link", True), ("camera", False)])
def test_a_transform_of_what_is_not_the_images(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, eye: str, odd: bool
) -> None:
    about = foreign.given(tmp_path / "object.json", camera={})
    bag = foreign.bag(tmp_path / "rope.bag", foreign.frames(), foreign.Ros(eye=eye, bodies=("tool",)))
    ingest(bag, tmp_path / "out", topics={"camera_pose": foreign.EYE}, object_json=about)
    says = "the images are of 'camera': its axes are taken to be 'camera_link''s"
    assert any(says in line for line in said(caplog)) == odd


def test_what_is_wrong_with_a_named_motion_is_said_of_its_own_file(
    capture: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    about = foreign.given(tmp_path / "object.json", ends={"start": "clamped", "end": "clamped"})
    shot = foreign.frames()
    folder = foreign.redwood(tmp_path / "redwood", shot)
    own = (read_motion(capture / "motion.csv"), capture, None)
    others = (foreign.motion(shot), folder, about)
    for number, (motion, source, described) in enumerate((own, others)):
        named = foreign.elsewhere(tmp_path, motion)
        named.write_bytes(named.read_bytes().rstrip(b"\n"))
        ingest(source, tmp_path / f"out{number}", named, object_json=described)
        assert f"{named}: last line: does not end with a line break" in said(caplog)[-1]
        late = replace(
            motion, t_s=motion.t_s + 100, end_m=motion.end_m - 0.01 * np.arange(len(motion.t_s))[:, None]
        )
        write_motion(late, named)
        with pytest.raises(FormatError, match=rf"{named}: column t_s: .* they share no time"):
            ingest(source, tmp_path / f"late{number}", named, object_json=described)


def test_a_table_that_is_replaced_may_lie_anywhere(capture: Path, tmp_path: Path) -> None:
    (capture / "motion.csv").rename(tmp_path / "elsewhere.csv")
    (capture / "motion.csv").symlink_to(tmp_path / "elsewhere.csv")
    ingest(capture, tmp_path / "out", tmp_path / "elsewhere.csv")


def test_images_without_a_number_are_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    about = foreign.given(tmp_path / "object.json", camera=foreign.camera_of())
    folder = foreign.redwood(tmp_path / "source", foreign.frames())
    path = sorted(folder.glob("depth/*"))[1]
    path.rename(path.with_name("frame.png"))
    ingest(folder, tmp_path / "out", object_json=about)
    assert any(
        "depth: 1 files without a number are left out, the first frame.png" in line for line in said(caplog)
    )


def test_depth_images_without_color_are_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    about = foreign.given(tmp_path / "object.json", camera=foreign.camera_of())
    folder = foreign.tum(tmp_path / "source", foreign.frames())
    lines = (folder / "rgb.txt").read_text().splitlines(keepends=True)
    (folder / "rgb.txt").write_text("".join(lines[:-1]))
    ingest(folder, tmp_path / "out", object_json=about)
    first, second = said(caplog)
    assert "depth.txt: rows: 1 of 3 depth images have no color image at their time and are left out" in first
    assert "rgb.txt: rows: 1 files in rgb are in no row, the first 1700000000.323000.png" in second


def redwood_of(tmp_path: Path) -> Path:
    folder = foreign.redwood(tmp_path / "source", foreign.frames())
    for path in sorted(folder.glob("depth/*")):
        number, time_us = path.stem.split("-")
        path.rename(path.with_name(f"{number}-{int(time_us) - foreign.EARLY_NS // 1000:012d}.png"))
    return folder


UNTIMELY: dict[str, tuple[Callable[[Path], Path], str]] = {
    "tum": (lambda place: foreign.tum(place / "source", foreign.frames()), "depth.txt: rows"),
    "redwood": (redwood_of, "source: depth"),
    "ros": (
        lambda place: foreign.bag(place / "source.bag", foreign.frames(), foreign.Ros()),
        f"source.bag: {foreign.DEPTH}",
    ),
    "realsense": (lambda place: realsense(place / "source.bag", foreign.frames()), "source.bag: "),
}


@pytest.mark.parametrize("kind", UNTIMELY)
@pytest.mark.parametrize(("early_ms", "is_said"), [(4, False), (8, True), (-12, True)])
def test_color_and_depth_of_two_times_have_color_s_and_are_said(
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
    early_ms: int,
    is_said: bool,
) -> None:
    """Color tells where the rope lies; 5 ms of a moving rope are as much as the chain's own error."""
    monkeypatch.setattr(foreign, "EARLY_NS", early_ms * 1_000_000)
    about = foreign.given(tmp_path / "object.json", camera=foreign.camera_of())
    write, where = UNTIMELY[kind]
    index = ingest(write(tmp_path), tmp_path / "out", object_json=about)
    np.testing.assert_array_equal(index.t_s, [ns / 10**9 for ns in foreign.frames().ns])
    lines = [line for line in said(caplog) if "were taken" in line]
    assert len(lines) == is_said and all(where in line for line in lines)
    apart = f"color and depth were taken {abs(early_ms)} ms (median) and up to {abs(early_ms)} ms apart"
    assert all(apart in line and "; let the camera take both at once" in line for line in lines)
