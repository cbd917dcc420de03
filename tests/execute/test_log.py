"""Reading a log, and how far it is from the path."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from dlolib.errors import FormatError
from dlolib.execute import RobotLog, evaluate, read_log
from dlolib.execute.log import without_repeats, write_log
from dlolib.execute.path import sampled
from dlolib.execute.recorded import columns

from .conftest import arc

START_S, PERIOD_S = 50.0, 0.002


def followed(lag_s: float = 0.0, aside_m: float = 0.0, until: int = 401) -> RobotLog:
    """A log of the arc, late by lag_s, beside it by aside_m in y, up to a sample."""
    poses = sampled(arc(), PERIOD_S)[:until]
    poses[:, 1] += aside_m
    t_s = START_S + lag_s + PERIOD_S * np.arange(len(poses))
    return RobotLog(t_s, poses, poses, {"completed": True, "reason": "", "streamed_from_s": START_S})


def test_a_perfect_log_has_no_error() -> None:
    result = evaluate(followed(), arc())
    assert result.tracking_error_m == pytest.approx(0, abs=1e-9)
    assert result.path_error_m == pytest.approx(0, abs=1.1e-5)
    assert result.lag_s == pytest.approx(0, abs=1e-3)


def test_a_late_log_is_on_the_path_but_not_in_time() -> None:
    result = evaluate(followed(lag_s=0.05), arc())
    speed = 0.03 * np.pi / 0.8
    assert result.tracking_error_m == pytest.approx(0.05 * speed, rel=0.05)
    assert result.path_error_m == pytest.approx(0, abs=1.1e-5)
    assert result.lag_s == pytest.approx(0.05, abs=1e-3)


def test_a_log_beside_the_path_has_that_error() -> None:
    result = evaluate(followed(aside_m=0.002), arc())
    assert result.tracking_error_m == pytest.approx(0.002, rel=1e-6)
    assert result.path_error_m == pytest.approx(0.002, rel=1e-4)


def test_a_log_that_stops_is_compared_as_far_as_it_goes() -> None:
    result = evaluate(followed(until=100), arc())
    assert result.samples == 100
    assert result.path_error_m == pytest.approx(0, abs=1.1e-5)


def test_what_never_streamed_has_no_tracking_error() -> None:
    log = followed()
    said = {"completed": False, "reason": "interrupted (Ctrl-C)", "streamed_from_s": None}
    result = evaluate(RobotLog(log.t_s, log.actual, log.target, said), arc())
    assert (result.completed, result.tracking_error_m, result.exit_status) == (False, None, 1)


def test_a_result_with_the_keys_of_the_formats_alone_is_of_a_run_that_is_compared() -> None:
    log = followed(aside_m=0.002)
    said = {"completed": True, "reason": "done", "samples": len(log.t_s), "tracking_error_m": 0.002}
    result = evaluate(replace(log, result=said), arc())
    assert result.tracking_error_m == pytest.approx(0.002, rel=1e-3)
    assert result.streamed_from_s == pytest.approx(START_S, abs=1e-3)
    # of a part of the path no start is known
    assert evaluate(replace(log, result=said | {"completed": False}), arc()).tracking_error_m is None


def test_a_log_that_breaks_off_is_of_no_completed_run() -> None:
    for until in (0, 5, 300):
        result = evaluate(replace(followed(until=until), result={}), arc())
        assert not result.completed and "shorter than the path" in result.reason
        assert result.tracking_error_m is None  # of a part of the path no start is known
    assert evaluate(replace(followed(), result={}), arc()).completed


def test_what_a_robot_does_after_its_path_is_another_motion() -> None:
    log = followed()
    home = np.repeat(log.actual[-1:], 3000, axis=0)
    home[:, 2] += np.linspace(-2.0, 1.0, 3000).clip(0.0) * 0.1
    t_s = np.concatenate([log.t_s, log.t_s[-1] + PERIOD_S * np.arange(1, 3001)])
    went = np.concatenate([log.actual, home])
    result = evaluate(RobotLog(t_s, went, went, {}), arc())
    assert result.path_error_m == pytest.approx(0, abs=1.1e-5) and not result.of_another
    # what it does at once is not
    near = np.concatenate([log.actual, home[2900:]])
    result = evaluate(RobotLog(t_s[: len(near)], near, near, {}), arc())
    assert result.path_error_m > 0.05 and result.of_another


def test_what_no_delay_explains_has_no_lag() -> None:
    log = followed()
    still = replace(log, actual=np.tile(log.actual[:1], (len(log.actual), 1)))
    assert evaluate(still, arc()).lag_s is None


def recorded(folder: Path, rows: int = 5) -> Path:
    table = pd.DataFrame(np.zeros((rows, len(columns()))), columns=columns())
    table["timestamp"] = START_S + PERIOD_S * np.arange(rows)
    table["actual_TCP_pose_0"] = np.arange(rows)
    file = folder / "log.csv"
    table.to_csv(file, index=False)
    return file


@pytest.mark.parametrize(
    ("t_s", "said"),
    [
        (
            1e3 * PERIOD_S * np.arange(5),
            "column timestamp: samples are 2 s apart, .*; give seconds",
        ),
        (
            [0.0, 1.7e9, 1.7e9 + 0.1, 1.7e9 + 0.2, 1.7e9 + 0.3],
            "line 3, column timestamp: nothing was",
        ),
    ],
)
def test_times_that_no_run_has_are_refused(tmp_path: Path, t_s: list[float], said: str) -> None:
    file = recorded(tmp_path)
    pd.read_csv(file).assign(timestamp=t_s).to_csv(file, index=False)
    with pytest.raises(FormatError, match=said):
        read_log(tmp_path)


def test_repeats_and_a_torn_last_line_of_the_recorder_are_left_out(tmp_path: Path) -> None:
    file = recorded(tmp_path)
    header, *lines = file.read_text().splitlines()
    torn = lines[-1][:20]
    file.write_text("\n".join([header, lines[0], lines[0], *lines[:4], lines[3], torn]))
    table = without_repeats(file)
    assert table["actual_TCP_pose_0"].tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("written", [0, 25])
def test_a_recorder_that_was_cut_off_before_its_first_line_ended_leaves_a_log_without_rows(
    tmp_path: Path, written: int
) -> None:
    """A crash or a full disk: the reason of the motion's end still is to be told."""
    file = recorded(tmp_path)
    file.write_text(file.read_text()[:written])
    write_log(without_repeats(file), tmp_path)
    said = {"completed": False, "reason": "connection lost", "streamed_from_s": None}
    log = read_log(tmp_path)
    result = evaluate(RobotLog(log.t_s, log.actual, log.target, said), arc())
    assert (result.samples, result.reason, result.tracking_error_m) == (0, "connection lost", None)


def test_the_columns_are_those_that_the_robots_recorder_writes() -> None:
    names = columns()
    assert len(names) == len(set(names)) == 5 + 7 * 6
    assert names[:8] == ["timestamp", *(f"target_q_{k}" for k in range(6)), "actual_q_0"]
    assert names[-4:] == ["speed_scaling", "robot_mode", "safety_mode", "runtime_state"]
    assert not [name for name in names if name.endswith("_6")]


SPOILED = {
    "text": (
        "line 3, column actual_TCP_pose_2",
        lambda table: table.assign(actual_TCP_pose_2=["0", "x", *"000"]),
    ),
    "falling": ("line 4, column timestamp", lambda table: table.iloc[[0, 2, 1, 3, 4]]),
    "no column": ("no column actual_TCP_pose_4", lambda table: table.drop(columns="actual_TCP_pose_4")),
}


@pytest.mark.parametrize("case", SPOILED)
def test_a_spoiled_log_is_refused(tmp_path: Path, case: str) -> None:
    place, spoil = SPOILED[case]
    file = recorded(tmp_path)
    spoil(pd.read_csv(file)).to_csv(file, index=False)
    with pytest.raises(FormatError, match=r"log\.csv") as refused:
        read_log(tmp_path)
    assert place in str(refused.value)


@pytest.mark.parametrize("content", [b"", b"timestamp,actual_q_0\n1,2,3\n1,2,3,4\n", b"\xff\xfe\x00\x81"])
def test_what_is_no_table_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "log.csv").write_bytes(content)
    with pytest.raises(FormatError, match=r"log\.csv: is no table: .*; record it again"):
        read_log(tmp_path)


def test_a_result_that_is_no_json_is_refused(tmp_path: Path) -> None:
    recorded(tmp_path)
    assert read_log(tmp_path).result == {}
    for content in (b"{", b"\xff"):
        (tmp_path / "result.json").write_bytes(content)
        with pytest.raises(FormatError, match=r"result\.json: is not JSON: .*; remove it or run again"):
            read_log(tmp_path)


def test_a_result_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    recorded(tmp_path)
    for content in ("[" * 100_000, '{"samples": ' + "9" * 5000 + "}"):
        (tmp_path / "result.json").write_text(content)
        with pytest.raises(FormatError, match=r"result\.json: is not JSON"):
            read_log(tmp_path)
    (tmp_path / "result.json").write_text('{"completed": "false"}')
    with pytest.raises(FormatError, match=r"completed: is 'false'; give true or false"):
        read_log(tmp_path)


def test_a_pose_beyond_any_arm_is_refused_by_its_line(tmp_path: Path) -> None:
    file = recorded(tmp_path)
    lines = file.read_text().splitlines()
    row = lines[3].split(",")
    row[lines[0].split(",").index("actual_TCP_pose_1")] = "1e308"
    file.write_text("\n".join([*lines[:2], "", "", lines[2], ",".join(row), *lines[4:]]) + "\n")
    with pytest.raises(FormatError, match=r"line 6, column actual_TCP_pose: is beyond 100 m"):
        read_log(tmp_path)


@pytest.mark.parametrize("start", ['"50"', "[50]", "true", "NaN", "9" * 400])
def test_a_start_that_is_no_time_is_refused(tmp_path: Path, start: str) -> None:
    recorded(tmp_path)
    (tmp_path / "result.json").write_text(f'{{"completed": true, "streamed_from_s": {start}}}')
    with pytest.raises(FormatError, match=r"result\.json: streamed_from_s: is .*, and no time .*; give the"):
        read_log(tmp_path)


def test_a_folder_without_a_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"no log\.csv here"):
        read_log(tmp_path)


@pytest.mark.parametrize("start_s", [0.0, 1_700_000_000.0])
def test_a_log_that_was_written_is_read_at_any_clock(tmp_path: Path, start_s: float) -> None:
    t_s = start_s + PERIOD_S * np.arange(50)
    poses = {name: np.zeros(50) for name in columns({"actual_TCP_pose": 6})}
    write_log(pd.DataFrame({"timestamp": t_s, **poses}), tmp_path)
    np.testing.assert_allclose(read_log(tmp_path).t_s, t_s, rtol=0, atol=1e-6)
