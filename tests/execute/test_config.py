"""robot.json: read strictly, refused in one line that names file, key and mend."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dlolib.errors import FormatError
from dlolib.execute import Limits, RobotConfig, read_robot

TURNED = [[0, -1, 0, 0.5], [1, 0, 0, 0.1], [0, 0, 1, 0.2], [0, 0, 0, 1]]


def written(content: Any, folder: Path) -> Path:
    file = folder / "robot.json"
    file.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return file


def test_without_a_file_the_world_is_the_robots_base_with_the_limits_of_a_ur5e(
    caplog: pytest.LogCaptureFixture,
) -> None:
    config = read_robot(None)
    assert "the world of the recordings is taken for the robot's base frame" in caplog.text
    assert config == RobotConfig()
    assert config.limits.reach_m == 0.85
    assert config.limits.workspace_m == ((-0.85,) * 3, (0.85,) * 3)
    assert np.array_equal(config.matrices(), [np.eye(4), np.eye(4)])


def test_what_is_given_counts_and_the_rest_is_default(tmp_path: Path) -> None:
    config = read_robot(written({"base_from_world": TURNED, "limits": {"speed_m_s": 0.1}}, tmp_path))
    assert np.array_equal(config.matrices()[0], TURNED)
    assert config.limits == Limits(speed_m_s=0.1)
    assert read_robot(written(config.content(), tmp_path)) == config
    marked = written("\ufeff" + json.dumps(config.content()), tmp_path)
    assert read_robot(marked) == config


BAD = {
    "no JSON": ("{", "robot.json"),
    "twice": ('{"time_scale": 5, "time_scale": 1}', "time_scale: this key is given twice; remove one"),
    "no place of the base": ({}, "base_from_world"),
    "unknown key": ({"base_from_world": TURNED, "base": 1}, "base: unknown key; valid are robot"),
    "unknown limit": (
        {"base_from_world": TURNED, "limits": {"speed": 1}},
        "limits.speed: unknown key; valid are",
    ),
    "text": ({"base_from_world": TURNED, "limits": {"speed_m_s": "0.1"}}, "limits.speed_m_s"),
    "negative": ({"base_from_world": TURNED, "limits": {"reach_m": -1}}, "limits.reach_m"),
    "fast approach": (
        {"base_from_world": TURNED, "limits": {"approach_speed_m_s": 0.3}},
        "approach_speed_m_s",
    ),
    "mirror": ({"base_from_world": np.diag([1, 1, -1, 1]).tolist()}, "no rigid motion"),
    "scaled": ({"base_from_world": np.diag([2, 2, 2, 1]).tolist()}, "no rigid motion"),
    "transposed": ({"base_from_world": np.array(TURNED).T.tolist()}, "no rigid motion"),
    "millimetres": ({"base_from_world": [[1, 0, 0, 500], *np.eye(4)[1:].tolist()]}, "looks like millimetres"),
    "three rows": ({"base_from_world": TURNED[:3]}, "base_from_world"),
    "swapped box": (
        {"base_from_world": TURNED, "limits": {"workspace_m": [[1, 1, 1], [0, 0, 0]]}},
        "give [lowest, highest]",
    ),
    "another robot": ({"base_from_world": TURNED, "robot": "kuka"}, "valid are ur"),
    "faster": ({"base_from_world": TURNED, "time_scale": 0.5}, "time_scale"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_robot_json_is_refused_in_one_line(tmp_path: Path, case: str) -> None:
    content, message = BAD[case]
    with pytest.raises(FormatError) as refused:
        read_robot(written(content, tmp_path))
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
    assert refused.value.mend


def test_a_missing_robot_json_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="no such file"):
        read_robot(tmp_path / "robot.json")
