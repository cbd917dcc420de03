"""Runs a trajectory in the virtual laboratory; compares the shape reached with the goal and the rod's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from dlolib.errors import ParameterError
from dlolib.execute.limits import ROUNDING
from dlolib.execute.log import ExecutionResult, RobotLog, evaluate, write_log, write_result
from dlolib.execute.path import LONGEST_S, tool_vectors
from dlolib.execute.recorded import RECORDED, columns
from dlolib.execute.stream import DONE
from dlolib.files import write_csv
from dlolib.formats import interpolate_motion
from dlolib.lab.play import LabRun, play
from dlolib.lab.rope import LabRope, Law
from dlolib.types import Floats, Layout, Motion

SETTLE_S = 2.0
EVERY = 30
HELD_M, HELD_RAD = 5e-3, 0.05
RUNNING = {"speed_scaling": 1.0, "robot_mode": 7.0, "safety_mode": 1.0, "runtime_state": 2.0}
"""RTDE: running, normal, playing."""


@dataclass(frozen=True)
class LawOutcome:
    """What a trajectory did to a rope of one law.

    goal_error_m: mean, max and end of the distance [m] to the goal at equal arc length, when the rope has
    settled. rod_error_m: mean and max of the distance to the rod's last shape, None where none was given.
    min_clearance_m: from the rope's surface to the nearest obstacle over every step, negative inside, None
    without obstacles.
    """

    goal_error_m: Mapping[str, float]
    rod_error_m: Mapping[str, float] | None
    min_clearance_m: float | None


@dataclass(frozen=True)
class LabExecution:
    """The outcome by law, the gripper's log as a robot's, and shapes.csv."""

    result: ExecutionResult
    laws: Mapping[str, LawOutcome]
    log: pd.DataFrame
    shapes: pd.DataFrame

    def write(self, out: Path) -> None:
        """Write log.csv, result.json and shapes.csv into the folder `out`."""
        out.mkdir(parents=True, exist_ok=True)
        write_log(self.log, out)
        write_csv(out / "shapes.csv", self.shapes)
        write_result(self.result, out, laws={name: asdict(law) for name, law in self.laws.items()})


def rope_of(layout: Layout, rope: LabRope) -> LabRope:
    """The laboratory's rope with the layout's length, diameter and density, where the layout gives them."""
    known = layout.rope
    return replace(
        rope,
        length_m=known.length_m,
        diameter_m=known.diameter_m or rope.diameter_m,
        linear_density_kg_m=known.linear_density_kg_m or rope.linear_density_kg_m,
    )


def execute_in_lab(
    trajectory: Motion,
    layout: Layout,
    rope: LabRope,
    laws: Sequence[Law] = ("elastic", "plastic"),
    rod_shapes: pd.DataFrame | None = None,
) -> LabExecution:
    """Move the laboratory's rope along a trajectory, once for each law; Section V-C and Fig. 10 of the paper.

    Args:
        trajectory: poses of both ends in the world; it begins as the layout holds them.
        layout: goal, obstacles and gravity; its rope's measures count, not those of `rope`.
        rope: the laboratory's rope, for stiffness and plasticity.
        laws: which laws bend it; the log is the last one's.
        rod_shapes: shapes.csv of the learning (step, node, x_m, y_m, z_m), whose last step is compared.

    Raises:
        ParameterError: the trajectory does not begin as the layout holds the rope, or the laboratory cannot
            play it.
        SimulationError: the rope became unstable.
    """
    _check_times(trajectory)
    _check_held(trajectory, layout)
    rod = None if rod_shapes is None else last_shape(rod_shapes)
    outcomes: dict[str, LawOutcome] = {}
    shapes: list[pd.DataFrame] = []
    last: LabRun | None = None
    steps, times_s = sampled_steps(trajectory)
    for law in laws:
        last = play(
            replace(rope_of(layout, rope), law=law),
            trajectory,
            layout.obstacles,
            layout.gravity_m_s2,
            times_s,
            SETTLE_S,
        )
        outcomes[law] = compare(last, layout, rod)
        shapes.append(_shape_rows(law, steps, last))
    if last is None:
        raise ParameterError("no law to run", place="laws", mend="give elastic, plastic, or both")
    log = gripper_log(last, trajectory)
    return LabExecution(_result(log, trajectory), outcomes, log, pd.concat(shapes, ignore_index=True))


def _check_held(trajectory: Motion, layout: Layout) -> None:
    """Refuse a trajectory that holds the rope's ends otherwise than the layout does in the beginning."""
    if (layout.ends.start, layout.ends.end) != ("clamped", "clamped"):
        mend = "clamp both, or give the trajectory's own layout"
        raise ParameterError(
            "an end is free and the trajectory holds it", place=f"{layout.name}, ends", mend=mend
        )
    row, mend = "the trajectory, row 1", "give its own layout"
    for end, pose, place_m, quaternion in (
        ("start", layout.start, trajectory.start_m[0], trajectory.start_q[0]),
        ("grasp", layout.grasp, trajectory.end_m[0], trajectory.end_q[0]),
    ):
        if np.isnan(place_m).any():
            continue  # a free end: the laboratory says that it cannot play that
        away_m = float(np.linalg.norm(place_m - pose.position_m))
        if not away_m < HELD_M:
            problem = f"the trajectory begins {away_m:.3f} m away from the {end} of {layout.name}"
            raise ParameterError(problem, place=row, mend=mend)
        turned_rad = 2 * float(np.arccos(min(1.0, abs(float(quaternion @ pose.quaternion)))))
        if not turned_rad < HELD_RAD:
            problem = (
                f"the trajectory begins turned by {turned_rad:.2f} rad against the {end} of {layout.name}"
            )
            raise ParameterError(problem, place=row, mend=mend)


def _check_times(trajectory: Motion) -> None:
    rows, lasts_s = len(trajectory.t_s), float(np.ptp(trajectory.t_s))
    if rows < 2:
        raise ParameterError("the trajectory has fewer than two rows", mend="give the whole motion")
    if lasts_s > LONGEST_S:
        problem = f"the trajectory lasts {lasts_s:g} s"
        raise ParameterError(problem, place="column t_s", mend="look for a jump of the clock")


def sampled_steps(trajectory: Motion) -> tuple[list[int], Floats]:
    """Which rows are drawn, and when [s] the rope is looked at: the last row after it has settled."""
    last = len(trajectory.t_s) - 1
    steps = [*range(0, last, EVERY), last]
    times_s = trajectory.t_s[steps].copy()
    times_s[-1] += SETTLE_S
    return steps, times_s


def last_shape(shapes: pd.DataFrame) -> Floats:
    """The nodes (N, 3) [m] of the last step in a table of shapes."""
    last = shapes[shapes["step"] == shapes["step"].max()].sort_values("node")
    return np.asarray(last[["x_m", "y_m", "z_m"]], dtype=np.float64)


def compare(run: LabRun, layout: Layout, rod_m: Floats | None) -> LawOutcome:
    """The last shape of a run beside the goal, where that says something of the rope, and the rod's nodes
    (N, 3) [m], at equal arc length."""
    share = run.s_m / run.s_m[-1]
    axis = make_interp_spline(share, run.xyz_m[-1], k=3)
    goal_share = layout.goal_s_m / layout.rope.length_m
    goal = make_interp_spline(goal_share, layout.goal_m, k=min(3, len(goal_share) - 1))
    given = (share >= goal_share[0] - ROUNDING) & (share <= goal_share[-1] + ROUNDING)
    # of a goal between two nodes its own points are compared
    compared = share[given] if given.any() else goal_share
    to_goal = _distance(axis(compared), goal(compared))
    rod_error: dict[str, float] | None = None
    if rod_m is not None:
        to_rod = _distance(rod_m, axis(np.linspace(0.0, 1.0, len(rod_m))))
        rod_error = {"mean": float(to_rod.mean()), "max": float(to_rod.max())}
    return LawOutcome(
        {"mean": float(to_goal.mean()), "max": float(to_goal.max()), "end": float(to_goal[-1])},
        rod_error,
        float(run.min_clearance_m) if np.isfinite(run.min_clearance_m) else None,
    )


def gripper_log(run: LabRun, trajectory: Motion) -> pd.DataFrame:
    """The gripper's poses as a controller would have recorded them, the world as its base.

    The columns are those of a robot's log, the target is the trajectory; joints and forces, which the
    laboratory does not have, stay empty.
    """
    held = Motion(run.log_t_s, run.log_m, run.log_q, run.log_m, run.log_q)
    vectors = {
        "actual_TCP_pose": tool_vectors(held),
        "actual_TCP_speed": _speeds(held),
        "target_TCP_pose": tool_vectors(interpolate_motion(trajectory, run.log_t_s)),
        "target_TCP_speed": _speeds(interpolate_motion(trajectory, run.log_t_s)),
    }
    count = len(run.log_t_s)
    vectors["timestamp"] = run.log_t_s[:, None]
    vectors |= {name: np.full((count, 1), value) for name, value in RUNNING.items()}
    empty = {name: np.full((count, size), np.nan) for name, size in RECORDED.items()}
    return pd.DataFrame(np.hstack(list((empty | vectors).values())), columns=columns())


def _speeds(held: Motion) -> Floats:
    """Linear [m/s] and angular [rad/s] velocity in the world's axes, shape (T, 6)."""
    linear = np.gradient(held.end_m, held.t_s, axis=0)
    turn = Rotation.from_quat(held.end_q, scalar_first=True)
    angular = np.zeros_like(linear)
    angular[1:] = (turn[1:] * turn[:-1].inv()).as_rotvec() / np.diff(held.t_s)[:, None]
    return np.hstack([linear, angular])


def _result(log: pd.DataFrame, trajectory: Motion) -> ExecutionResult:
    """The gripper's tracking, as a robot's: it follows the trajectory from the first row on."""
    poses = [
        log[columns({name: 6})].to_numpy(dtype=np.float64) for name in ("actual_TCP_pose", "target_TCP_pose")
    ]
    t_s = log["timestamp"].to_numpy(dtype=np.float64)
    said = {"completed": True, "reason": DONE, "streamed_from_s": float(trajectory.t_s[0])}
    return evaluate(RobotLog(t_s, poses[0], poses[1], said), trajectory)


def _shape_rows(law: str, steps: list[int], run: LabRun) -> pd.DataFrame:
    nodes = len(run.s_m)
    return pd.DataFrame(
        {
            "law": law,
            "step": np.repeat(steps, nodes),
            "t_s": np.repeat(run.t_s, nodes),
            "node": np.tile(np.arange(nodes), len(steps)),
            **dict(zip(("x_m", "y_m", "z_m"), run.xyz_m.reshape(-1, 3).T, strict=True)),
        }
    )


def _distance(first: Floats, second: Floats) -> Floats:
    return np.asarray(np.linalg.norm(first - second, axis=-1), dtype=np.float64)
