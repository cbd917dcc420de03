"""Where a chain begins, and the arc length of its points, against the rope's known length."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from chain.test_clouds import distances
from chain.tubes import (
    FOCAL,
    WIDTH,
    Scene,
    errors,
    rms,
    seen_by,
    wave,
    write_capture,
)

from dlolib.captures import open_capture
from dlolib.captures.image_folder import ImageFolder
from dlolib.chain import ChainSettings, chain_frame, extract_chain
from dlolib.errors import ChainError
from dlolib.formats import read_recording, write_recording
from dlolib.types import CaptureIndex, Ends


def of_length(index: CaptureIndex, share: float) -> CaptureIndex:
    """The same capture of a rope that was measured to be so many times as long."""
    return replace(index, rope=replace(index.rope, length_m=share * index.rope.length_m))


HELD = {"start": Ends("clamped", "free"), "end": Ends("free", "clamped")}


@pytest.mark.parametrize("ends", [Ends("free", "free"), *HELD.values()])
def test_more_than_the_rope_does_not_count(
    ends: Ends, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """As where another cable lies beyond a free tip; but a length may be known roughly."""
    write_capture(tmp_path / "long", [wave(0.6), 1.07 * wave(0.6), 1.2 * wave(0.6)], Scene(noisy=False))
    index = replace(open_capture(tmp_path / "long").index, ends=ends)
    result = extract_chain(ImageFolder(index))
    assert [chain.counts for chain in result.frames] == [True, True, False]
    assert set(result.recording.points.frame) == {0, 1}
    assert result.recording.points.s_m.max() <= index.rope.length_m
    assert "m were measured in frame 1; check object.length_m" in caplog.text
    assert "m were measured in frame 2, so something else is taken for a part of it; left out" in caplog.text
    assert "only" not in caplog.text
    with pytest.raises(ChainError, match="in every frame 0.445 to") as told:
        extract_chain(ImageFolder(of_length(index, 0.8)))
    assert told.value.place == "object.length_m"


@pytest.mark.parametrize("held", HELD)
def test_a_free_tip_out_of_sight_stretches_no_arc_length(held: str) -> None:
    """8 mm of 445 lie outside the image: what is seen counts from the end that is held."""
    axis = wave(0.5)
    half = 0.5 * WIDTH / FOCAL * 0.75
    middle = axis[-1, 0] - 0.008 - half if held == "start" else axis[0, 0] + 0.008 + half
    frame, index = seen_by(axis, Scene(camera_m=(middle, -0.75, -0.02)))
    chain = chain_frame(frame, replace(index, ends=HELD[held]), ChainSettings())
    assert not chain.fitted and chain.counts
    assert errors(axis, chain.s_m, chain.xyz_m).max() < 1.2e-3
    # the seen part's own end is a point, too
    tip = chain.s_m[-1] if held == "start" else 0.445 - chain.s_m[0]
    assert tip == pytest.approx(0.4365, abs=1.5e-3)


@pytest.mark.parametrize("held", HELD)
@pytest.mark.parametrize("share", [0.98, 1.02])
def test_a_length_that_was_measured_wrong_stretches_no_arc_length(held: str, share: float) -> None:
    """Arc length counts from the end that is held: to the tip, or to the known length where that is less."""
    axis = wave(0.5)
    frame, index = seen_by(axis, Scene())
    known = share * 0.445
    chain = chain_frame(frame, replace(of_length(index, share), ends=HELD[held]), ChainSettings())
    assert not chain.fitted
    true_s = chain.s_m + (0.445 - known if held == "end" else 0.0)
    assert errors(axis, true_s, chain.xyz_m).max() < 1.2e-3
    assert len(chain.s_m) >= 29 and chain.s_m[0] >= 0 and chain.s_m[-1] <= known
    assert np.ptp(chain.s_m) == pytest.approx(min(known, 0.445), abs=1.5e-3)


def test_a_frame_in_which_the_rope_has_not_its_length_is_said_and_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Held at both ends it is all there: what is missing was not found, and arc lengths are off."""
    axes = [wave(0.6), 0.8 * wave(0.6), wave(0.6)]
    write_capture(tmp_path / "held", axes, Scene(noisy=False))
    source = open_capture(tmp_path / "held")
    index = replace(source.index, static_frames=(1, 1), heldout_frames=(1, 2))
    result = extract_chain(ImageFolder(index))
    says = "tube: the rope is 0.445 m long, and 0.356 m were measured in frame 1, so its held ends"
    assert says in caplog.text
    write_recording(result.recording, tmp_path / "out")
    read = read_recording(tmp_path / "out")
    assert set(read.points.frame) == {0, 2}
    assert read.static_frames is None and read.heldout_frames == (1, 2)
    assert result.metrics()["frames_left_out"] == 1 and len(result.frames) == 3


def test_a_rope_that_never_has_its_length_is_refused(tmp_path: Path) -> None:
    write_capture(tmp_path / "held", [wave(0.6)], Scene(noisy=False))
    index = of_length(open_capture(tmp_path / "held").index, 1.2)
    with pytest.raises(ChainError, match="the rope is 0.534 m .* in every frame 0.445 m were") as told:
        extract_chain(ImageFolder(index))
    assert told.value.place == "object.length_m"


def test_a_length_that_every_frame_measures_otherwise_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Within 3 % it is taken for an error of each frame; but no such error is the same in all."""
    write_capture(tmp_path / "held", [wave(0.5), wave(0.8)], Scene(noisy=False))
    index = open_capture(tmp_path / "held").index
    extract_chain(ImageFolder(of_length(index, 1.005)))
    hidden = replace(index, ends=Ends("clamped", "free"))
    extract_chain(ImageFolder(of_length(hidden, 1.02)))
    assert "every frame" not in caplog.text
    extract_chain(ImageFolder(of_length(index, 1.02)))
    assert "tube: every frame measures 0.445 m, object.length_m says 0.454 m; correct it" in caplog.text


def test_the_start_is_the_held_start_whichever_way_the_rope_lies() -> None:
    axis = wave(0.6) * np.array([-1, 1, 1]) + np.array([0.4, 0, 0])
    frame, index = seen_by(axis, Scene())
    assert index.motion is not None
    back = np.tile([0.5, 0.5, -0.5, -0.5], (1, 1))
    index = replace(index, motion=replace(index.motion, start_q=back, end_q=back))
    chain = chain_frame(frame, index, ChainSettings())
    assert (np.diff(chain.xyz_m[:, 0]) < 0).all()
    assert rms(errors(axis, chain.s_m, chain.xyz_m)) < 0.6e-3


def test_with_free_ends_the_start_stays_the_start(tmp_path: Path) -> None:
    # The rope slides past its own length from frame to frame: only nearness tells the tips apart.
    axes = [wave(0.6), wave(0.6) + np.array([0.02, 0, 0]), wave(0.6) + np.array([-0.02, 0, 0.03])]
    write_capture(tmp_path / "free", axes, Scene(), clamped=False)
    for chain, axis in zip(extract_chain(open_capture(tmp_path / "free")).frames, axes, strict=True):
        # Nothing but the mask's own edge tells where a free end is: arc length is less certain than the axis.
        assert rms(distances(chain.xyz_m, axis)) < 0.6e-3
        assert rms(errors(axis, chain.s_m, chain.xyz_m)) < 3.0e-3


def test_arc_lengths_of_a_free_rope_that_is_seen_in_part_go_from_tip_to_tip(tmp_path: Path) -> None:
    """Its length was measured a little wrongly, or a tip is out of sight: it is readable all the same."""
    write_capture(tmp_path / "free", [wave(0.4)], Scene(noisy=False), clamped=False)
    result = extract_chain(ImageFolder(of_length(open_capture(tmp_path / "free").index, 1.08)))
    write_recording(result.recording, tmp_path / "out")
    s_m = read_recording(tmp_path / "out").points.s_m
    assert not result.frames[0].fitted
    assert len(s_m) == 30 and s_m[-1] == pytest.approx(0.445, abs=3e-3)
    seen = result.recording.points.xyz_m
    assert np.linalg.norm(np.diff(seen, axis=0), axis=1).sum() == pytest.approx(0.445, abs=3e-3)


@pytest.mark.parametrize("degrees", [-40, 40])
def test_a_free_tip_that_points_at_the_camera_or_away_ends_with_its_axis(degrees: int) -> None:
    """Its outline ends at the rim of its end: half an ellipse further, 5 mm of a rope of 12 mm."""
    way = np.array([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees)), 0.0])
    axis = np.array([0.2, -0.2, -0.02]) + np.linspace(-0.15, 0.15, 400)[:, None] * way
    frame, index = seen_by(axis, Scene(diameter_m=0.012, plate_y_m=0.5), clamped=False)
    chain = chain_frame(frame, index, ChainSettings())
    assert chain.fitted and chain.measured_m == pytest.approx(0.3, abs=3e-3)
    assert rms(errors(axis, chain.s_m, chain.xyz_m)[[0, -1]]) < 3e-3


def test_of_a_free_rope_of_which_a_third_is_out_of_sight_nobody_knows_where_it_begins(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    index = write_capture(tmp_path / "free", [wave(0.4), wave(0.4)], Scene(noisy=False), clamped=False)
    picture = cv2.imread(str(tmp_path / "free/color/000001.png"))
    picture[:, 400:] = 12
    cv2.imwrite(str(tmp_path / "free/color/000001.png"), picture)
    result = extract_chain(open_capture(tmp_path / "free"))
    assert [chain.counts for chain in result.frames] == [True, False]
    assert "m were measured in frame 1, so a tip was not seen; left out" in caplog.text
    with pytest.raises(ChainError, match="and in every frame 0.331 to 0.445 m were measured"):
        extract_chain(ImageFolder(of_length(index, 1.5)))
