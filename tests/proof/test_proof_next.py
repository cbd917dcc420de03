"""The motion that a verdict asks for goes on from where the first recording ended."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dlolib.errors import SimulationError
from dlolib.proof.draw import draw_case
from dlolib.types import Floats, Motion
from stages import proof_next
from stages.proof_next import played_on


def test_the_rope_is_moved_on_from_its_last_pose() -> None:
    case = draw_case(3, 0, ("end_angle",))
    before = case.experiment.motion
    t_s = np.linspace(0.0, 2.0, 41)
    away = before.end_m[-1] + 0.02 * (t_s / 2.0)[:, None] * np.array([0.0, 0.0, 1.0])
    held = [np.tile(getattr(before, part)[-1], (41, 1)) for part in ("start_m", "start_q", "end_q")]
    motion = Motion(t_s, held[0], held[1], away, held[2])
    made = played_on(case, motion, "next", np.random.default_rng(0))
    assert made.motion is motion and made.static_frames is None and made.heldout_frames is None
    points = made.points
    assert points.t_s.min() == 0.0 and points.t_s.max() == pytest.approx(2.0)
    # the camera looks as often as it did
    every_s = np.median(np.diff(case.experiment.frame_t_s))
    apart_s = np.diff(np.unique(points.t_s))
    assert len(apart_s) >= 2 and (apart_s > 0.99 * every_s).all() and (apart_s < 1.5 * every_s).all()
    tip = np.isclose(points.s_m, made.rope.length_m)
    off = points.xyz_m[tip] - np.stack([np.interp(points.t_s[tip], t_s, axis) for axis in away.T], axis=1)
    assert np.abs(off).max() < 6 * case.noise.sigma_m


def test_each_tie_has_noise_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two of one shard had the same, point by point, and shared it with the draw of another recording."""
    seed, noise = 3, []

    def heard(case: Any, motion: Any, name: str, rng: np.random.Generator) -> None:
        noise.append(rng.normal(size=4))
        raise SimulationError("not played")

    verdict = {"equivalent": [], "next_motion": {"why": "it tells them apart"}}
    monkeypatch.setattr(proof_next, "SEALED", tmp_path)
    monkeypatch.setattr(proof_next, "own_folder", lambda name: tmp_path)
    for name, stub in (
        ("diagnose", None),
        ("draw_case", None),
        ("read_motion", None),
        ("verdict_in", verdict),
    ):
        monkeypatch.setattr(proof_next, name, lambda *_, stub=stub, **__: stub)
    monkeypatch.setattr(proof_next, "played_on", heard)
    (tmp_path / "shard").mkdir()
    for name in ("002", "003"):
        (tmp_path / "shard" / f"{name}.json").write_text(json.dumps({"effects": [], "attempt": 0}))
        assert proof_next.told_apart(seed, "shard", name, "")["not_played"] == "not played"
    drawn: list[Floats] = [np.random.default_rng([seed, 1 + index, 0]).normal(size=4) for index in range(4)]
    every = np.array([*noise, *drawn])
    assert len(np.unique(every[:, 0])) == len(every)
