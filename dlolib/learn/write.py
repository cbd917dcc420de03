"""What learning leaves behind: trajectory, controller, curve, shapes and result."""

from __future__ import annotations

import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from dlolib.files import whole_file, whole_folder, write_csv, write_json
from dlolib.formats import LEARNED_FOR, write_layout, write_motion
from dlolib.learn.learn import Learned
from dlolib.learn.policy import Policy
from dlolib.types import Floats, Motion

SHAPES_EVERY = 30
# Zip files carry a time; this one is the earliest that they can.
EPOCH = (1980, 1, 1, 0, 0, 0)


def write_learned(learned: Learned, folder: Path, ablation: pd.DataFrame | None = None) -> dict[str, Any]:
    """Write trajectory.csv, policy.npz, curve.csv, shapes.csv and result.json, whole or not at all.

    Beside them stands the layout that it was learned for, which a robot is kept out of. With an ablation also
    ablation.csv.

    Returns:
        The content of result.json.
    """
    content = result(learned)
    with whole_folder(Path(folder)) as temporary:
        write_motion(trajectory(learned), temporary / "trajectory.csv")
        write_layout(learned.layout, temporary / LEARNED_FOR)
        _write_policy(learned.policy, temporary / "policy.npz")
        write_csv(temporary / "curve.csv", learned.curve)
        write_csv(temporary / "shapes.csv", _shapes(learned))
        if ablation is not None:
            write_csv(temporary / "ablation.csv", ablation)
        write_json(temporary / "result.json", content)
    return content


def trajectory(learned: Learned) -> Motion:
    """The learned path as a motion: h + 1 rows, the first at the grasp; the gripper only translates."""
    layout, end_m = learned.layout, learned.kept.end_m
    rows = len(end_m) + 1
    return Motion(
        t_s=np.asarray(np.arange(rows) * learned.settings.step_s, dtype=np.float64),
        start_m=np.tile(layout.start.position_m, (rows, 1)),
        start_q=np.tile(layout.start.quaternion, (rows, 1)),
        end_m=np.concatenate((layout.grasp.position_m[None], end_m)),
        end_q=np.tile(layout.grasp.quaternion, (rows, 1)),
    )


def result(learned: Learned) -> dict[str, Any]:
    """result.json: the figures of the kept iterate; lengths in m."""
    kept, settings = learned.kept, learned.settings
    return {
        "layout": learned.layout.name,
        "goal_error_m": {"mean": kept.goal.mean_m, "max": kept.goal.max_m, "end": kept.goal.end_m},
        # none without an obstacle, which JSON has no number for
        "min_clearance_m": kept.min_clearance_m if np.isfinite(kept.min_clearance_m) else None,
        "contacts": kept.contacts,
        "iterations": len(learned.curve),
        "kept_iteration": learned.kept_iteration,
        "starts": learned.starts,
        "iterations_total": learned.iterations_total,
        "loss": kept.loss,
        "loss_kind": settings.loss,
        "seed": settings.seed,
        "first_arc": settings.first_arc,
        "free_of_contact": learned.free,
    }


def read_policy(path: Path) -> dict[str, Floats]:
    """The arrays of policy.npz by name."""
    with np.load(path, allow_pickle=False) as archive:
        return {name: np.asarray(archive[name]) for name in archive.files}


def _write_policy(policy: Policy, path: Path) -> None:
    """Weights and biases of the layers, Λ, the goal at the particles and the unit of length.

    `numpy.savez` would store the time of writing; two runs must agree to the byte.
    """
    arrays: dict[str, Floats] = {}
    for number, (weight, bias) in enumerate(policy.weights, start=1):
        arrays |= {f"weight_{number}": weight, f"bias_{number}": bias}
    arrays |= {"bounds": policy.bounds, "goal_m": policy.goal_m, "length_m": np.array(policy.length_m)}
    with whole_file(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, values in arrays.items():
            buffer = BytesIO()
            np.lib.format.write_array(buffer, np.asarray(values), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", EPOCH), buffer.getvalue())


def _shapes(learned: Learned) -> pd.DataFrame:
    """Every 30th shape of the kept path and the last: step, t_s, node, x_m, y_m, z_m."""
    positions = learned.kept.positions_m
    last = len(positions) - 1
    steps = np.unique([*range(0, last, SHAPES_EVERY), last])
    nodes = positions.shape[1]
    x, y, z = positions[steps].reshape(-1, 3).T
    step = np.repeat(steps, nodes)
    node = np.tile(np.arange(nodes), len(steps))
    t_s = step * learned.settings.step_s
    return pd.DataFrame({"step": step, "t_s": t_s, "node": node, "x_m": x, "y_m": y, "z_m": z})
