"""The log of a run: the columns of ur_rtde's own recorder, and how far the robot kept to its path."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import minimize_scalar
from scipy.spatial import KDTree

from dlolib.errors import FormatError
from dlolib.execute.path import sampled
from dlolib.execute.recorded import columns
from dlolib.files import write_csv, write_json
from dlolib.formats import interpolate_motion
from dlolib.progress import track
from dlolib.types import Floats, Ints, Motion

LOG_DIGITS, ALL_DIGITS, LATE_S = 12, 17, 1e6
# No controller counts further [s].
LATEST_S = 1e12
# No arm reaches so far [m].
FARTHEST_M = 100.0
# A log that ends so long before its path [s] is not of all of it.
BROKEN_OFF_S = 0.1
SEARCH_S = 0.05
# After the end of its path a robot has so long to come to it [s]; what it does then is another motion.
ARRIVES_S = 2.0
# Samples of a run follow each other within so long [s], most of them.
USUAL_GAP_S, LONGEST_GAP_S = 0.5, 60.0
LARGEST_LAG_S = 0.5
CURVE_STEP_M = 2e-5
ROUNDING_M = 1e-9
FAR_M = 1e3
NEEDED = columns({"timestamp": 1, "actual_TCP_pose": 6})
# A controller's demand is smoothed, and still nearer than this to the trajectory that it was given.
ANOTHER_M = 5e-3


@dataclass(frozen=True)
class ExecutionResult:
    """What came of a run; `result.json` holds the same.

    completed: whether the end of the trajectory was reached. reason: why it ended, for a person.
    samples: rows of the log. tracking_error_m: root mean square distance [m] between the recorded tool
    and the path at equal time, None where nothing was streamed. path_error_m: largest distance [m] of the
    recorded tool from the path, whatever the time. lag_s: the delay [s] that explains most of the
    tracking error. streamed_from_s: the controller's time [s] when the path began. demanded_error_m: largest
    distance [m] of the demanded tool from the path, None where the log does not tell. of_another: whether
    that says that another trajectory was run.
    """

    completed: bool
    reason: str
    samples: int
    tracking_error_m: float | None
    path_error_m: float | None = None
    lag_s: float | None = None
    streamed_from_s: float | None = None
    demanded_error_m: float | None = None
    of_another: bool = False

    @property
    def exit_status(self) -> int:
        """0 where the trajectory was completed, 1 where the motion was stopped."""
        return 0 if self.completed else 1


@dataclass(frozen=True)
class RobotLog:
    """Controller times [s] (N,), recorded and demanded tool poses (N, 6), and what result.json says."""

    t_s: Floats
    actual: Floats
    target: Floats
    result: dict[str, Any]

    @property
    def lasts_s(self) -> float:
        """From the first sample to the last [s]."""
        return float(np.ptp(self.t_s)) if len(self.t_s) else 0.0


def without_repeats(raw: Path) -> pd.DataFrame:
    """The recorder's file with one row a controller time: it free-runs, so samples repeat.

    A torn last line (the recorder was cut off) is left out; a torn header leaves nothing.
    """
    try:
        table = pd.read_csv(raw, on_bad_lines="skip", dtype=str, na_filter=False)
    except pd.errors.EmptyDataError:
        table = pd.DataFrame()
    if not set(NEEDED) <= set(table):
        table = pd.DataFrame(columns=columns())
    numbers = pd.DataFrame({name: pd.to_numeric(table[name], errors="coerce") for name in table}).dropna()
    once = numbers[numbers["timestamp"] > 0].drop_duplicates("timestamp", keep="first")
    return once.sort_values("timestamp", kind="stable").reset_index(drop=True)


def write_log(table: pd.DataFrame, out: Path) -> None:
    """Write log.csv into the folder `out`; times that count from 1970 in full."""
    late = len(table) and table["timestamp"].abs().max() >= LATE_S
    write_csv(out / "log.csv", table, digits=ALL_DIGITS if late else LOG_DIGITS)


def write_result(result: ExecutionResult, out: Path, **more: Any) -> None:
    """Write result.json into the folder `out`; `more` are further keys."""
    write_json(out / "result.json", {**asdict(result), **more})


def read_log(folder: Path) -> RobotLog:
    """Read log.csv, and result.json where there is one, from a folder that a run with --host wrote.

    Raises:
        FormatError: names file, place and mend.
    """
    file = Path(folder) / "log.csv"
    if not file.is_file():
        raise FormatError(
            "no log.csv here", file=folder, mend="give a folder that `dlo execute --host` wrote"
        )
    try:
        table = pd.read_csv(file, skip_blank_lines=False)
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise FormatError(f"is no table: {error}", file=file, mend="record it again") from error
    table["line"] = np.arange(len(table)) + 2
    table = table.dropna(how="all", subset=table.columns.difference(["line"]))
    lacking = [name for name in NEEDED if name not in table]
    if lacking:
        raise FormatError(f"no column {lacking[0]}", file=file, mend="record timestamp and actual_TCP_pose")
    t_s = _numbers(table, ["timestamp"], file)[:, 0]
    if (bad := np.flatnonzero(np.diff(t_s) <= 0)).size:
        place = f"line {table['line'].iloc[bad[0] + 1]}, column timestamp"
        raise FormatError("does not rise", file=file, place=place, mend="remove repeated samples")
    _check_gaps(t_s, table["line"].to_numpy(), file)
    actual = _numbers(table, columns({"actual_TCP_pose": 6}), file)
    if (far := np.flatnonzero(np.abs(actual[:, :3]).max(axis=1) > FARTHEST_M)).size:
        place = f"line {table['line'].iloc[far[0]]}, column actual_TCP_pose"
        mend = "give metres, or remove the row"
        raise FormatError(f"is beyond {FARTHEST_M:g} m", file=file, place=place, mend=mend)
    targets = columns({"target_TCP_pose": 6})
    target = _numbers(table, targets, file) if set(targets) <= set(table) else np.full_like(actual, np.nan)
    said = Path(folder) / "result.json"
    result = read_result(said)
    if type(result.get("completed", True)) is not bool:
        problem = f"is {result['completed']!r}"[:80]
        raise FormatError(problem, file=said, place="completed", mend="give true or false")
    start = result.get("streamed_from_s")
    if start is not None and not (type(start) in (int, float) and abs(start) <= LATEST_S):
        problem, mend = f"is {str(start)[:40]}, and no time [s]", "give the controller's time, or null"
        raise FormatError(problem, file=said, place="streamed_from_s", mend=mend)
    return RobotLog(t_s, actual, target, result)


def evaluate(log: RobotLog, path: Motion) -> ExecutionResult:
    """Compare a log with the path in the base frame that it should have followed.

    Without a result.json a log that lasts as long as the path is taken to be of a completed run. Of a run of
    which nobody says when the path began that start is taken which fits best; of one that was broken off many
    do, and nothing is compared.
    """
    said = log.result
    start = said.get("streamed_from_s")
    completed, reason = said.get("completed", True), str(said.get("reason", "recorded elsewhere"))
    if "completed" not in said and log.lasts_s < path.t_s[-1] - path.t_s[0] - BROKEN_OFF_S:
        completed, reason = False, "recorded elsewhere, and the log is shorter than the path"
    # formats.md has no such key: another's result.json says nothing of it, and null that nothing was streamed
    streamed = start is not None or (completed and "streamed_from_s" not in said)
    if not streamed or len(log.t_s) < 2:
        return ExecutionResult(completed, reason, len(log.t_s), None)
    began = best_start(log, path) if start is None else float(start)
    error = tracking_error(log, path, began)
    if error is None:
        return ExecutionResult(completed, reason, len(log.t_s), None)
    lag: float | None = _least(log, path, (began, began + LARGEST_LAG_S)) - began
    if lag is not None and lag > LARGEST_LAG_S - SEARCH_S:
        # no delay explains it
        lag = None
    away_m = path_error(log.t_s, log.actual, path, began)
    demanded_m = path_error(log.t_s, log.target, path, began) if np.isfinite(log.target).all() else None
    another = demanded_m is not None and demanded_m > ANOTHER_M
    return ExecutionResult(completed, reason, len(log.t_s), error, away_m, lag, began, demanded_m, another)


def tracking_error(log: RobotLog, path: Motion, start_s: float) -> float | None:
    """Root mean square distance [m] of the recorded tool from the path at equal time.

    The path runs from the controller's time start_s [s]; samples before it and after its end are left
    out. None where none is left.
    """
    t_s = log.t_s - start_s + path.t_s[0]
    during = (t_s >= path.t_s[0]) & (t_s <= path.t_s[-1])
    if not during.any():
        return None
    away = log.actual[during, :3] - interpolate_motion(path, t_s[during]).end_m
    return float(np.sqrt(np.mean(np.sum(away**2, axis=1))))


def path_error(t_s: Floats, poses: Floats, path: Motion, start_s: float) -> float:
    """Largest distance [m] of poses (N, 6) at times (N,) from the path as a curve, from start_s [s] on, until
    it has arrived at its end."""
    longest_m = float(np.linalg.norm(np.diff(sampled(path, SEARCH_S)[:, :3], axis=0), axis=1).max())
    curve = sampled(path, SEARCH_S * min(1.0, CURVE_STEP_M / max(longest_m, ROUNDING_M)))
    during = (t_s >= start_s) & (t_s <= start_s + np.ptp(path.t_s) + ARRIVES_S)
    away, _ = KDTree(curve[:, :3]).query(poses[during, :3])
    return float(np.max(away))


def best_start(log: RobotLog, path: Motion) -> float:
    """The start [s] of the whole path, in the controller's time, that fits the log best."""
    latest = max(log.t_s[-1] - (path.t_s[-1] - path.t_s[0]), log.t_s[0]) + SEARCH_S
    tries = np.arange(log.t_s[0] - SEARCH_S, latest, SEARCH_S)
    # a few samples a try tell which is near
    every = max(int(SEARCH_S / np.median(np.diff(log.t_s))), 1)
    thin = replace(log, t_s=log.t_s[::every], actual=log.actual[::every])
    errors = [tracking_error(thin, path, float(start)) for start in track(tries, "path in the log")]
    coarse = float(tries[int(np.argmin([FAR_M if error is None else error for error in errors]))])
    return _least(log, path, (coarse - SEARCH_S, coarse + SEARCH_S))


def _least(log: RobotLog, path: Motion, between: tuple[float, float]) -> float:
    """The start [s] between two of least tracking error."""

    def error(start: float) -> float:
        value = tracking_error(log, path, float(start))
        return FAR_M if value is None else value

    return float(minimize_scalar(error, bounds=between, method="bounded", options={"xatol": 1e-4}).x)


def _check_gaps(t_s: Floats, line: Ints, file: Path) -> None:
    """Refuse times in another unit than seconds, and logs of more than one run."""
    gaps = np.diff(t_s)
    if not len(gaps):
        return
    if np.median(gaps) > USUAL_GAP_S:
        problem = f"samples are {np.median(gaps):g} s apart, which no run's are"
        raise FormatError(problem, file=file, place="column timestamp", mend="give seconds")
    if gaps.max() > LONGEST_GAP_S:
        at = int(np.argmax(gaps)) + 1
        problem = f"nothing was recorded for {gaps[at - 1]:g} s before it"
        place = f"line {line[at]}, column timestamp"
        raise FormatError(problem, file=file, place=place, mend="give the log of one run")


def _numbers(table: pd.DataFrame, names: list[str], file: Path) -> Floats:
    cells = [pd.to_numeric(table[name], errors="coerce") for name in names]
    values = np.stack([np.asarray(column, dtype=np.float64) for column in cells], axis=1)
    if not np.isfinite(values).all():
        row, column = (int(index) for index in np.argwhere(~np.isfinite(values))[0])
        place = f"line {table['line'].iloc[row]}, column {names[column]}"
        raise FormatError("is no finite number", file=file, place=place, mend="remove the row")
    return values


def read_result(file: Path) -> dict[str, Any]:
    """The content of a result.json, empty where there is none.

    Raises:
        FormatError: it is not JSON.
    """
    if not file.is_file():
        return {}
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise FormatError(f"is not JSON: {error}", file=file, mend="remove it or run again") from error
    return content if isinstance(content, dict) else {}
