"""Results as the stages write them, from invented shapes: nothing here was simulated, recorded or learned."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from report.diagnosed import write_diagnosed

from dlolib.files import write_csv, write_json
from dlolib.formats import write_capture_index, write_fit, write_layout, write_motion, write_recording
from dlolib.proof.score import share, summarise
from dlolib.report.pictures import project
from dlolib.types import (
    Camera,
    CaptureIndex,
    Ends,
    Estimate,
    Fit,
    Floats,
    Layout,
    Motion,
    Obstacle,
    Points,
    Pose,
    Recording,
    Rope,
)

LENGTH_M = 0.445
ROPE = Rope("invented rope", LENGTH_M, 0.008, 0.04)
ALONG_X = np.array([0.5, 0.5, 0.5, 0.5])
GRAVITY = np.array([0.0, 0.0, -9.81])
CAMERA = Camera(
    np.array([[1.0, 0, 0, 0.15], [0, 0, 1.0, -0.75], [0, -1.0, 0, -0.05], [0, 0, 0, 1.0]]),
    320, 288, 252.0, 252.0, 159.5, 143.5, 1000.0,
)  # fmt: skip
FRAMES = 12
LAYOUTS = ("layout_1", "layout_2", "layout_3", "layout_4")


def curve(bend: float, lift: float = 0.0, count: int = 30, length_m: float = LENGTH_M) -> Floats:
    """A curve (count, 3) from the origin, along +x at both ends, in the x-z plane."""
    fine = np.linspace(0.0, 1.0, 2001)
    angle = -bend * np.sin(2 * np.pi * fine) + lift * np.sin(np.pi * fine) ** 2
    step = length_m / 2000
    x, z = (
        np.concatenate([[0.0], np.cumsum(step * f(angle[:-1] + np.diff(angle) / 2))])
        for f in (np.cos, np.sin)
    )
    at = np.linspace(0.0, 1.0, count)
    return np.column_stack([np.interp(at, fine, x), np.zeros(count), np.interp(at, fine, z)])


def write_results(root: Path, *, truth: bool = True, execution: bool = True, extras: bool = True) -> Path:
    """Write data/ and reports/ under `root`; return the results' folder."""
    rng = np.random.default_rng(7)
    _write_capture(root / "data", rng, truth)
    _write_identified(root / "reports" / "identify", rng)
    write_diagnosed(root / "reports" / "diagnose" / "captured", [curve(b, 0.3) for b in _bends()], LENGTH_M)
    for index, name in enumerate(LAYOUTS):
        _write_layout(root, name, 0.35 + 0.12 * index, rng)
        if execution:
            _write_execution(root / "reports" / "execute" / name, 0.35 + 0.12 * index)
    _write_ablation(root / "reports" / "learn" / LAYOUTS[0] / "ablation.csv", rng)
    if extras:
        _write_extras(root / "reports")
    return root / "reports"


def _bends() -> Floats:
    return 1.1 + 0.35 * np.sin(np.linspace(0.0, np.pi, FRAMES))


def _motion() -> Motion:
    times = np.linspace(0.0, 2.2, 111)
    bends = np.interp(times, np.linspace(0.0, 2.2, FRAMES), _bends())
    ends = np.array([curve(bend, 0.3)[-1] for bend in bends])
    turn = np.tile(ALONG_X, (len(times), 1))
    return Motion(times, np.zeros_like(ends), turn, ends, turn)


def _write_capture(data: Path, rng: np.random.Generator, truth: bool) -> None:
    times, folder = np.linspace(0.0, 2.2, FRAMES), data / "capture"
    fine = np.array([curve(bend, 0.3, 200) for bend in _bends()])
    for kind in ("color", "depth"):
        (folder / kind).mkdir(parents=True)
    for index, axis in enumerate(fine):
        pixels = np.rint(project(axis, CAMERA)).astype(np.int32)[None]
        color, depth = np.full((288, 320, 3), 12, np.uint8), np.full((288, 320), 780, np.uint16)
        cv2.polylines(color, pixels, False, (225, 225, 225), 3)
        cv2.polylines(depth, pixels, False, 746, 3)
        depth[rng.random(depth.shape) < 0.02] = 0
        cv2.imwrite(str(folder / f"color/{index:06d}.png"), color)
        cv2.imwrite(str(folder / f"depth/{index:06d}.png"), depth)
    names = {
        kind: tuple(folder / f"{kind}/{i:06d}.png" for i in range(FRAMES)) for kind in ("color", ("depth"))
    }
    frame = np.arange(FRAMES)
    index_of = CaptureIndex(
        ("invented"), folder, ROPE, GRAVITY, Ends(), CAMERA, frame, times, motion=_motion(), **names
    )
    write_capture_index(index_of, folder)
    nodes = np.array([curve(bend, 0.3) for bend in _bends()]) + rng.normal(0, 6e-4, (FRAMES, 30, 3))
    s_m = np.linspace(0, LENGTH_M, 30)
    points = Points(np.repeat(frame, 30), np.repeat(times, 30), np.tile(s_m, FRAMES), nodes.reshape(-1, 3))
    write_recording(
        Recording("captured", ROPE, GRAVITY, Ends(), _motion(), points), data / "recordings" / "captured"
    )
    if truth:
        write_json(data / "truth" / "truth.json", {"law": "plastic", "bending_stiffness_n_m2": 3e-4})
        np.savez(data / "truth" / "shapes.npz", t_s=times, xyz_m=fine, s_m=np.linspace(0, LENGTH_M, 200))


def _write_identified(folder: Path, rng: np.random.Generator) -> None:
    _write_one(
        folder / "captured",
        ("captured"),
        [curve(b, 0.3) for b in _bends()],
        LENGTH_M,
        3.04e-4,
        rng,
        paper=True,
    )
    for name, ei, wave in (("wire_white", 9.4e-5, 0.003), ("wire_black", 9.9e-4, 0.009)):
        shape = curve(1.3, 0.8, 51, 1.5)
        _write_one(folder / name, name, [shape] * 5, 1.5, ei, rng, wave=wave)


def _write_one(
    folder: Path,
    name: str,
    shapes: list[Floats],
    length_m: float,
    ei: float,
    rng: np.random.Generator,
    *,
    wave: float = 0.001,
    paper: bool = False,
) -> None:
    s_m = np.linspace(0, length_m, len(shapes[0]))
    parts = []
    for frame, shape in enumerate(shapes):
        seen = (
            shape + rng.normal(0, 5e-4, shape.shape) + np.outer(wave * np.sin(12 * s_m / length_m), [0, 0, 1])
        )
        columns = {"frame": frame, "t_s": 0.2 * frame, "s_m": s_m}
        columns |= dict(zip(("x_m", "y_m", "z_m"), seen.T, strict=True))
        columns |= dict(zip(("sim_x_m", "sim_y_m", "sim_z_m"), shape.T, strict=True))
        parts.append(pd.DataFrame(columns))
    write_csv(folder / "shapes.csv", pd.concat(parts))
    estimate = Estimate(ei, 0.97 * ei, 1.04 * ei, "N m^2")
    nuisance = {name: {"end_angle.start_1": Estimate(0.011, 0.004, 0.018, "rad")}}
    points = sum(len(shape) for shape in shapes)
    write_fit(
        Fit({"bending_stiffness": estimate}, 1.4e-3, len(shapes), points, nuisance), folder / ("fit.json")
    )
    loss = [("least_squares", i, 0.9 * 0.35**i + 0.05, ei * (1 - 0.8 * 0.4**i)) for i in range(9)]
    if paper:
        loss += [
            ("gradient_descent", i, 1.1 * np.exp(-i / 60) + 0.06, 2.3e-5 + 2.6e-4 * (1 - np.exp(-i / 70)))
            for i in range(301)
        ]
    columns = ["method", "iteration", "loss_m", "bending_stiffness"]
    write_csv(folder / "loss.csv", pd.DataFrame(loss, columns=columns))
    published = {"alpha_b": 0.0081, "iterations": 300, "loss_m": 0.071} if paper else None
    write_json(folder / "summary.json", {
        "name": name, "rmse_m": 1.4e-3, "mean_distance_m": 1.2e-3, "loss_paper_m": 0.05, (
            "frames"
        ): len(shapes),
        "heldout_rmse_m": 1.6e-3 if paper else None, "heldout_frames": [10, 11] if paper else None,
        "points": points, "paper_method": published,
    })  # fmt: skip


def _steps(lift: float) -> list[Floats]:
    return [
        curve(bend, lift * share)
        for share, bend in zip(np.linspace(0, 1, 11), np.linspace(1.0, 1.25, 11), strict=True)
    ]


def _nodes(steps: list[Floats]) -> pd.DataFrame:
    parts = [
        pd.DataFrame(
            {
                "step": 30 * i,
                "t_s": 0.3 * i,
                "node": np.arange(30),
                "x_m": n[:, 0],
                "y_m": n[:, 1],
                ("z_m"): n[:, 2],
            }
        )
        for i, n in enumerate(steps)
    ]
    return pd.concat(parts)


def _write_layout(root: Path, name: str, lift: float, rng: np.random.Generator) -> None:
    steps = _steps(lift)
    middle, along = steps[-1][14], steps[-1][15] - steps[-1][13]
    across = np.array([-along[2], 0.0, along[0]]) / np.linalg.norm(along)
    obstacles = tuple(
        Obstacle("cylinder", {"center_m": tuple((middle + side * across).tolist()), "axis": (0.0, 1.0, 0.0),
                              "radius_m": (0.03,), "height_m": (0.06,)})
        for side in (0.055, -0.055)
    )  # fmt: skip
    start, grasp = Pose(np.zeros(3), ALONG_X), Pose(steps[0][-1], ALONG_X)
    s_m = np.linspace(0, LENGTH_M, 30)
    layout = Layout(name, ROPE, GRAVITY, Ends(), obstacles, start, grasp, s_m, steps[-1])
    write_layout(layout, root / "data" / "layouts" / name)
    folder = root / "reports" / "learn" / name
    ends = np.array([np.interp(np.linspace(0, 10, 301), np.arange(11), column) for column in
                     np.array([nodes[-1] for nodes in steps]).T]).T  # fmt: skip
    ends[:, 1] = 0.02 * np.sin(np.linspace(0, np.pi, 301))
    turn = np.tile(ALONG_X, (301, 1))
    write_motion(Motion(np.linspace(0, 3, 301), 0 * ends, turn, ends, turn), folder / "trajectory.csv")
    write_csv(
        folder / ("shapes.csv"),
        _nodes([n + [0, 0.002, 0.002] * np.linspace(0, 1, 30)[:, None] for n in steps]),
    )
    iteration = np.arange(120)
    error = 0.06 * np.exp(-iteration / 30) + 0.004 + 0.001 * rng.random(120)
    clear = np.where(iteration < 40, 0.00295, 0.008 - 0.005 * np.exp(-(iteration - 40) / 15))
    write_csv(folder / "curve.csv", pd.DataFrame({
        "iteration": iteration, "loss": error**2 * 40, "goal_error_mean_m": error, (
            "goal_error_max_m"
        ): 2 * error,
        "min_clearance_m": clear, "contacts": (clear < 0.007).astype(int), "contact_margin_m": 0.003,
    }))  # fmt: skip
    write_json(folder / "result.json", {
        "layout": name, "goal_error_m": {"mean": 0.0041 + lift / 200, "max": 0.009, "end": 0.003}, "seed": 1,
        "min_clearance_m": 0.0052 - lift / 300, "contacts": 0, "iterations": 120, "loss": 0.002,
        "starts": 2, "iterations_total": 171, "free_of_contact": True,
    })  # fmt: skip


def _write_execution(folder: Path, lift: float) -> None:
    laws, parts = {}, []
    for law, extra in (("elastic", 0.02), ("plastic", 0.12)):
        nodes = curve(1.25 + extra, lift)
        parts.append(_nodes([nodes]).assign(law=law))
        laws[law] = {
            "goal_error_m": {"mean": 0.1 * extra, "max": 0.2 * extra, "end": 0.0},
            "min_clearance_m": 0.004 - 0.03 * extra, "rod_error_m": {"mean": 0.05 * extra, (
                "max"
            ): 0.2 * extra},
        }  # fmt: skip
    write_csv(folder / "shapes.csv", pd.concat(parts))
    write_json(
        folder / "result.json",
        {"completed": True, "reason": "", "samples": 301, ("tracking_error_m"): 0.0, ("laws"): laws},
    )


def write_robot_log(folder: Path) -> None:
    """A log as ur_rtde's recorder writes it, in place of an execution in the laboratory."""
    folder.mkdir(parents=True, exist_ok=True)
    time = np.linspace(0, 3, 400)
    columns = {"timestamp": 100 + time}
    for axis in range(6):
        columns[f"target_TCP_pose_{axis}"] = 0.1 * np.sin(time + axis)
        columns[f"actual_TCP_pose_{axis}"] = 0.1 * np.sin(time + axis - 0.004)
    write_csv(folder / "log.csv", pd.DataFrame(columns))
    write_json(
        folder / "result.json",
        {"completed": False, "reason": "protective stop", "samples": 400, ("tracking_error_m"): 4e-4},
    )


def _write_ablation(path: Path, rng: np.random.Generator) -> None:
    """Learning's rope is thicker by the margin, not inside: plain MSE ends at the cylinder, on and off."""
    parts = []
    iteration = np.arange(120)
    for seed in range(1, 6):
        pace = 20 + 10 * rng.random()
        for loss, floor, clear in (("mse", 0.045, 0.00295), ("contact", 0.005, 0.0045)):
            error = floor + (0.09 - floor) * np.exp(-iteration / pace)
            off = 0.01 * np.exp(-iteration / 12) + 0.0003 * (iteration % 5)
            parts.append(pd.DataFrame({
                "loss": loss, "seed": seed, "iteration": iteration, "value": error * 0.2, (
                    "goal_error_mean_m"
                ): error,
                "min_clearance_m": clear + off, "contact_margin_m": 0.003,
            }))  # fmt: skip
    write_csv(path, pd.concat(parts))


def _write_extras(folder: Path) -> None:
    names = ("unweighted", "weighted", "short_unweighted", "short_weighted", "all together")
    each = [
        {
            "name": name,
            "parameters": {"bending_stiffness": _estimate(value)},
            "rmse_m": 0.009,
            "heldout_rmse_m": 0.011,
        }
        for name, value in zip(names, (0.11, 0.13, 0.09, 0.15, 0.12), strict=True)
    ]
    cables = {
        "recordings": each[:-1],
        "joint": each[-1],
        "test": {"says": "Do they agree? F(3, 20) = 11.2, p = 0.0002: at the 5 % level they do not agree."},
        "contradiction": "The chord is longer than the cable in no pose.",
    }
    write_json(folder / "cables.json", cables)
    tip = {"pac_sweep": {"elastic": 0.047, "model": 0.0053}}
    swept = {"summary": "What an elastic rod leaves out: friction.", "named": ["internal_friction"]}
    halved = {**swept, "commit": 40 * "c", "tip_rmse_m": tip, "foretold_tip_rmse_m": 0.011}
    write_json(folder / "sweeps.json", {"cases": {"foretold": halved}})
    means = {"left_out_mean_mm": {"all": 4.1, "free": 5.0}, "eval_mean_mm": {"all": 3.3, "free": 4.0}}
    swung = {"dlo3": {"chosen": "curved", "kinds": {"elastic": means, "curved": means}}}
    write_json(folder / "deform.json", {"goal_mm": 10.0, "cables": swung})
    elastic = {"bending_stiffness": _estimate(3.02e-4), "true_ei_n_m2": 3e-4, "ei_error": 0.0067}
    write_json(folder / "elastic.json", {**elastic, "rmse_m": 0.0012})
    _write_solvers(folder / "solvers.json")
    _write_agreement(folder / "agreement.json")
    _write_bench(folder / "bench.json")
    _write_chain_bench(folder / "chain_bench.json")
    _write_proof(folder)


def _write_proof(folder: Path) -> None:
    """A shard of five: found, tied, missed, nothing, and a false alarm; one practice recording."""

    def row(true: list[str], status: str, named: list[str], outcome: str) -> dict[str, object]:
        tie = [[name] for name in (*named, "end_angle")] if status == "ambiguous" else []
        said = {"status": status, "named": named, "tie": tie, "outcome": outcome}
        found = {"detectable": true, "elastic_gain": 50.0 * len(true)}
        return {"true": true, **found, "everywhere": {**found, "outcome": outcome}, **said}

    rows = [
        row(["clock_offset"], "explained", ["clock_offset"], "right")
        | {"covered": {"clock_offset.time": True}, "stiffness_error": {"baseline": 0.2, "augmented": 0.01}},
        row(["mass_profile"], "ambiguous", ["mass_profile"], "tied"),
        row(["mass_profile"], "no_mismatch", [], "missed"),
        row([], "no_mismatch", [], "right"),
        row([], "explained", ["end_angle"], "wrong"),
    ]
    shards = {"started": 2, "scored": 1, "version": "0a1b", "shards": ["shard_1"]}
    shards |= {"shards_of_intervals": []}
    told = summarise(rows)
    before = {"shards": ["shard_0"], **told, "recordings": 4}
    versions = [before, {"shards": ["shard_1"], **told}]
    write_json(folder / "proof/summary.json", shards | told | {"versions": versions})
    write_json(folder / "proof/sizes.json", {"found": share(9, 10)})
    write_json(folder / "proof/screen.json", {"missed": share(1, 12), "otherwise": share(0, 12)})
    null = {"effects": [], "obstacles": 1, "bodies": 58, "gain": 0.42, "bodies_m": 2.5e-4, "steps_m": 3e-5}
    null |= {"steps_gain": 0.2, "harder_gain": 0.1, "harder_m": 4e-5}
    write_json(folder / "proof/refinement.json", {"goal": 2.0, "cases": [null]})
    held = {"true": 3e-4, "value": 3.02e-4, "low": 2.9e-4, "high": 3.1e-4, "inside": True}
    one = {"seconds": 31.0, "status": "explained", "named": ["clock_offset"], "true": ["clock_offset"]}
    planted = {"bending_stiffness": held, "clock_offset.time": {**held, "inside": False}}
    practice = {"recordings": {"practice_clock": {**one, "names_right": True, "parameters": planted}}}
    write_json(folder / "practice.json", practice)


def _write_solvers(path: Path) -> None:
    scan = [3e-5, 3e-4, 3e-3, 0.3]
    ladder = [("iterative", 10, None), ("iterative", 20, None), ("iterative", 200, 5e-4)]
    direct = [(name, None, 3e-4) for name in ("direct", "direct, quasi-static", "direct, the paper's ends")]
    solvers = [
        {
            "solver": solver,
            "iterations": iterations,
            "shape_error": 1 / (iterations or 500),
            "rmse_at_truth_m": 0.004,
            "bending_stiffness": None if ei is None else _estimate(ei),
            "rmse_m": 0.003,
            "scan_rmse_m": [0.02, 0.01, 0.008, 0.007],
        }
        for solver, iterations, ei in (*direct, *ladder)
    ]
    setting = {"particles": 30, "step_s": 0.01, "steps": 400, "frames": 40, "marked_iterations": 20}
    write_json(path, {"true_ei_n_m2": 3e-4, **setting, "scan_ei_n_m2": scan, "solvers": solvers})


def _write_bench(path: Path) -> None:
    rows = {
        "forward_vs_mujoco": (3.0, 12.0, "times", True),
        "elastica_error_percent": (0.12, 0.25, "%", False),
        "batch64_over_single": (None, 0.2, "times", False),
    }
    table = {}
    for key, (value, goal, unit, at_least) in rows.items():
        table[key] = {"value": value, "goal": goal, "unit": unit, "at_least": at_least, "how": "measured so"}
    write_json(path, table)


def _write_agreement(path: Path) -> None:
    """One within its goal, one beyond it and in another equilibrium, one refused."""
    near = {"most_percent": 0.013, "mean_percent": 0.002, "frames_elsewhere": 0}
    far = {"most_percent": 7.0, "mean_percent": 0.2, "frames_elsewhere": 3}
    rows = [
        {"effect": "", "draw": 0, "goal_percent": 0.5, **near},
        {"effect": "plastic_bending", "draw": 0, "goal_percent": 1.0, **far},
        {"effect": "grasp_slip", "draw": 0, "goal_percent": 0.5, "refused": "it would tear"},
    ]
    write_json(path, {"size": 3.0, "each": 1, "met": 1, "of": 3, "recordings": rows})


def _write_chain_bench(path: Path) -> None:
    axis = {"axis_rms_mm": {"value": 0.26, "goal": 0.6, "met": True}}
    crossing = {**axis, "spacing_percent": {"value": 6.0, "goal": 3.0, "met": False}}
    how = {"axis_rms_mm": "off the axis", "spacing_percent": "largest change of spacing"}
    write_json(path, {"how": how, "cases": {"clear": {"figures": axis}, "crossing": {"figures": crossing}}})


def _estimate(value: float) -> dict[str, object]:
    return {"value": value, "low": 0.9 * value, "high": 1.1 * value, "unit": "N m^2"}


def blocks_of(content: dict, kind: str) -> list[dict]:
    """The blocks of one kind in a report.json, in order."""
    return [block for part in content["sections"] for block in part["blocks"] if block["kind"] == kind]
