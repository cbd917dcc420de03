"""Damages that a recording has from the beginning: it is written with them."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from captures import foreign_samples as foreign
from captures.foreign_samples import Frames, Ros
from captures.harm import Damage, Rng
from captures.realsense_samples import COLOR, DEPTH, UNITS, realsense


def written_bag(kind: str, name: str) -> Damage:
    def damage(place: Path, rng: Rng) -> str:
        shot = foreign.frames()
        row = int(rng.integers(len(shot.ns)))
        dark_depth = shot.depth.copy()
        dark_depth[row] = 0
        cases: list[tuple[str, Ros, Frames]] = [
            ("no CameraInfo", Ros(kind, info=False), shot),
            ("two topics of depth", Ros(kind, second_depth=True), shot),
            ("color is mono8", Ros(kind, color="mono8"), shot),
            ("times go back", Ros(kind, backwards=True), shot),
            ("time stands still", Ros(kind), replace(shot, ns=[shot.ns[0]] * 2 + shot.ns[2:])),
            (f"depth of frame {row} is zero", Ros(kind), replace(shot, depth=dark_depth)),
            ("depth is half the size", Ros(kind), replace(shot, depth=shot.depth[:, ::2, ::2])),
            ("depth has another viewpoint", Ros(kind, depth_frame="infrared"), shot),
            ("a lens that is not known", Ros(kind, distortion=(0.1,) * 3), shot),
        ]
        said, how, spoilt = cases[int(rng.integers(len(cases)))]
        source = place / name
        if source.is_dir():
            shutil.rmtree(source)
        else:
            source.unlink()
        foreign.bag(source, spoilt, how)
        return said

    return damage


def written_kinect(place: Path, rng: Rng) -> str:
    shot = foreign.frames(2, foreign.KINECT_WIDTH, foreign.KINECT_HEIGHT)
    attached: dict[str, Any] | None = foreign.calibration()
    tracks, which = "DEPTH", int(rng.integers(5))
    if which == 0:
        said, attached = "no calibration", None
    elif which == 1:
        name = ("Intrinsics", "Rt", "Location", "SensorWidth")[int(rng.integers(4))]
        del attached["CalibrationInformation"]["Cameras"][0][name]
        said = f"the calibration lacks {name}"
    elif which == 2:
        said, tracks = "no track DEPTH", "INFRARED"
    elif which == 3:
        said, shot = (
            "depth of frame 0 is zero",
            replace(shot, depth=np.stack([0 * shot.depth[0], shot.depth[1]])),
        )
    else:
        said, shot = "time stands still", replace(shot, ns=[shot.ns[0]] * 2)
    (place / "source.mkv").unlink()
    foreign.kinect(place / "source.mkv", shot, attached, tracks)
    return said


def written_realsense(place: Path, rng: Rng) -> str:
    shot = foreign.frames()
    dark_depth = shot.depth.copy()
    dark_depth[0] = 0
    apart = np.eye(4)
    apart[0, 3] = np.nan
    cases: list[tuple[str, dict[str, Any]]] = [
        (f"no {topic}", {"lacking": [topic]})
        for topic in (UNITS, f"{COLOR}/tf", f"{DEPTH}/tf", f"{COLOR}/info", f"{DEPTH}/info", COLOR, DEPTH)
    ]
    cases += [
        ("color is mono8", {"how": Ros(color="mono8")}),
        ("a lens that is not known", {"how": Ros(model="Kannala Brandt4", distortion=(0.1,) * 5)}),
        ("the color camera stands nowhere", {"color_from_depth": apart}),
        ("time stands still", {"shot": replace(shot, ns=[shot.ns[0]] * 2 + shot.ns[2:])}),
        ("depth of frame 0 is zero", {"shot": replace(shot, depth=dark_depth)}),
        ("depth is half the size", {"shot": replace(shot, depth=shot.depth[:, ::2, ::2])}),
    ]
    said, how = cases[int(rng.integers(len(cases)))]
    (place / "source.bag").unlink()
    realsense(place / "source.bag", **({"shot": shot} | how))
    return said
