"""docs/your-own-rope.md: what it gives to copy does what it says."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from dlolib.formats.motion import read_motion

PAGE = Path("docs/your-own-rope.md").read_text(encoding="utf-8")


def test_a_log_becomes_a_motion(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (script,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    angle = np.linspace(0.0, 7.0, 60)  # more than a turn: a rotation vector leaps, a rotation does not
    turned = Rotation.from_rotvec(np.outer(angle, [0.0, 1.0, 0.0])) * Rotation.from_rotvec([0.3, 0.0, 0.0])
    place = np.stack([0.3 + 0.01 * angle, np.sin(angle), np.full_like(angle, 0.2)], axis=1)
    pose = np.hstack([place, turned.as_rotvec()])
    log = pd.DataFrame(pose, columns=[f"actual_TCP_pose_{k}" for k in range(6)])
    log.insert(0, "timestamp", 5.0 + 0.01 * np.arange(60))
    pd.concat([log.iloc[:1], log]).to_csv(tmp_path / "robot_log.csv", index=False)  # a sample that repeats

    monkeypatch.chdir(tmp_path)
    exec(script, {})
    motion = read_motion(tmp_path / "motion.csv")

    assert motion.t_s == pytest.approx(log["timestamp"].to_numpy())
    assert motion.end_m == pytest.approx(place)
    found = Rotation.from_quat(motion.end_q, scalar_first=True)
    assert (found * turned.inv()).magnitude() == pytest.approx(0.0, abs=1e-7)
    assert (np.sum(motion.end_q[1:] * motion.end_q[:-1], axis=1) > 0.9).all()
    assert motion.start_m == pytest.approx(0.0)
