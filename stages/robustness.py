"""Random roll-outs of the rod, in search of one that it does not survive: reports/robustness.json.

Beside the pipeline (`make robustness COUNT=10000`). Rope, ends, motion, clock and obstacles are drawn from a
seed and the roll-out's number, so that each can be looked at again alone (`scene_of_number`). A step is
solved, to finite positions and a rope that is whole, or it is refused by a `SimulationError` that names the
step and the reason. Anything else is a failure and is listed.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dlolib.errors import DloError, SimulationError
from dlolib.files import write_json
from dlolib.formats import nearest_distance
from dlolib.obstacles import SHAPES
from dlolib.progress import track
from dlolib.sim.clearance import clearance
from dlolib.sim.rod import Rod, scene
from dlolib.sim.scene import Scene
from dlolib.sim.simulate import Clock, Path, State, roll_out
from dlolib.sim.start import first_shape, released, settle
from dlolib.types import EndKind, Ends, Floats, Obstacle, Pose, Rope
from stages import REPORTS, number, run

SEED = 20240501
STEPS = 60
FASTEST_M_S, FASTEST_RAD_S = 1.0, 4.0
LARGEST_QUASI_STATIC_M = 0.01
STIFFNESS_N_M2 = (1e-6, 1.0)
SIZES = (5, 200)
STEP_S = (0.002, 0.05)
GRAVITY = np.array([0.0, 0.0, -9.81])
# A segment that is longer or shorter by this share is torn; the rod refuses a little less.
TORN = 0.06
# As near to the rope's length as the motion brings two held ends.
TAUT = 0.95
LISTED = 100
# Segments this short are pushed at points near enough to each other for what they touch.
FINE_M = 0.015


@dataclass(frozen=True)
class Drawn:
    """One random roll-out before it is made: what it is called, the scene, the way to go."""

    label: dict[str, Any]
    rod: Rod
    made: Scene
    ends: Ends
    obstacles: tuple[Obstacle, ...]
    path: Path
    clock: Clock
    begin: State


def main(count: str) -> None:
    asked = number(count, "COUNT", 1)
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        every = list(track(pool.map(outcome, range(asked), chunksize=10), "robustness", total=asked))
    found = summary(every)
    write_json(REPORTS / "robustness.json", found)
    bad = found["not_finite"] + found["torn"] + found["unnamed_error"]
    print(f"{asked} roll-outs: {found['solved']} solved, {found['refused']} refused by name, {bad} failed")


def summary(every: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What became of the roll-outs from number 0 on, counted; of those not solved, why."""
    kinds: dict[str, Counter[str]] = {}
    for one in every:
        for kind in one["kinds"]:
            kinds.setdefault(kind, Counter())[one["outcome"]] += 1
    solved = [one for one in every if one["outcome"] == "solved"]
    # failures come first: of what was refused not all are listed
    others = [one for one in every if one["outcome"] not in ("solved", "refused")]
    others += [one for one in every if one["outcome"] == "refused"]
    tally = Counter(one["outcome"] for one in every)
    fine = [one["depth_m"] for one in solved if one["segment_m"] <= FINE_M]
    return {
        "command": f"make robustness COUNT={len(every)}",
        "rollouts": len(every),
        "steps_each": STEPS,
        "drawn_from": {
            "seed": SEED,
            "particles": SIZES,
            "bending_stiffness_n_m2": STIFFNESS_N_M2,
            "fastest_m_s": FASTEST_M_S,
            "step_s": STEP_S,
        },
        **{name: tally[name] for name in ("solved", "refused", "not_finite", "torn", "unnamed_error")},
        "largest_stretch_percent": 100 * max((one["stretch"] for one in solved), default=0.0),
        "stretched_over_1_percent": sum(one["stretch"] > 0.01 for one in solved),
        "deepest_contact_mm": 1e3 * max((one["depth_m"] for one in solved), default=0.0),
        f"deepest_contact_mm_segments_to_{1e3 * FINE_M:.0f}_mm": 1e3 * max(fine, default=0.0),
        "most_iterations": max((one["iterations"] for one in solved), default=0),
        "by_kind": {kind: dict(sorted(kinds[kind].items())) for kind in sorted(kinds)},
        "reasons": dict(Counter(one["why"] for one in others).most_common()),
        "listed": [{k: v for k, v in one.items() if k != "kinds"} for one in others[:LISTED]],
    }


def outcome(number: int) -> dict[str, Any]:
    """What became of a roll-out: solved, refused, not_finite, torn or unnamed_error."""
    drawn: Drawn | None = None
    said: dict[str, Any] = {"number": number}
    try:
        drawn = scene_of_number(number)
        said |= drawn.label
        moved = roll_out(drawn.made, _begun(drawn), drawn.path, drawn.clock)
    except SimulationError as error:
        return said | {
            "kinds": _kinds(drawn),
            "outcome": "refused",
            "why": _reason(error),
            "says": str(error),
        }
    except Exception as error:  # that none but the named one comes is what is asked
        why = type(error).__name__
        return said | {"kinds": _kinds(drawn), "outcome": "unnamed_error", "why": why, "says": str(error)}
    said |= {"kinds": _kinds(drawn)}
    if not (np.isfinite(moved.x).all() and np.isfinite(moved.q).all()):
        return said | {"outcome": "not_finite", "why": "not finite"}
    rest = drawn.made.segment_l[0]
    stretch = np.abs(np.linalg.norm(np.diff(moved.x[0], axis=1), axis=2) / rest - 1).max(axis=1)
    depth = -clearance(moved.x[0], drawn.rod.rope.radius_m, drawn.obstacles).min()
    said |= {
        "stretch": float(stretch.max()),
        "depth_m": float(max(depth, 0.0)),
        "segment_m": float(rest.max()),
    }
    if stretch.max() > TORN:
        return said | {"outcome": "torn", "why": "torn", "step": int(np.argmax(stretch > TORN))}
    return said | {"outcome": "solved", "iterations": int(moved.iterations.max())}


def _begun(drawn: Drawn) -> State:
    """At rest between its first poses; a rope that nobody holds as it was drawn."""
    if drawn.made.clamped.any():
        return settle(drawn.made, drawn.begin, drawn.path).final.at_rest()
    return drawn.begin


def scene_of_number(number: int) -> Drawn:
    """The roll-out of that number, the same every time."""
    rng = np.random.default_rng([SEED, number])
    particles = round(_between(rng, *SIZES))
    length = _between(rng, 0.2, 1.5)
    radius = float(rng.uniform(0.001, 0.006))
    rope = Rope("random", length, 2 * radius, _between(rng, 0.005, 0.5), float(rng.choice([0.0, 0.05])))
    ei = _between(rng, *STIFFNESS_N_M2)
    ends = Ends(*_ends(rng))
    quasi_static = bool(ends != Ends("free", "free") and rng.random() < 0.3)
    step_s = None if quasi_static else _between(rng, *STEP_S)
    path = _way(rng, length, ends, step_s)
    begin = _first(rng, rope, particles, ends, path)
    obstacles = _obstacles(rng, begin.x[0], path, ends, radius)
    rough = bool(obstacles and rng.random() < 0.5)
    effects = {"contact_friction.coefficient": float(rng.uniform(0.05, 1.0))} if rough else {}
    rod = Rod(rope, ei, ei * float(rng.uniform(0.3, 1.5)), effects, particles)
    label = {
        "ends": f"{ends.start}-{ends.end}",
        "clock": "quasi_static" if quasi_static else "dynamic",
        "contact": "none" if not obstacles else "rough" if rough else "smooth",
        "obstacles": [one.shape for one in obstacles],
        "particles": particles,
        "bending_stiffness": float(f"{ei:.4g}"),
        "step_s": None if step_s is None else float(f"{step_s:.4g}"),
    }
    made = scene([rod], GRAVITY, ends, obstacles)
    return Drawn(label, rod, made, ends, obstacles, path, Clock(step_s), begin)


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """Log-uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _ends(rng: np.random.Generator) -> tuple[EndKind, EndKind]:
    kinds: list[tuple[EndKind, EndKind]] = [
        ("clamped", "clamped"),
        ("clamped", "free"),
        ("free", "clamped"),
        ("free", "free"),
    ]
    return kinds[int(rng.choice(4, p=[0.55, 0.2, 0.1, 0.15]))]


def _way(rng: np.random.Generator, length: float, ends: Ends, step_s: float | None) -> Path:
    """Both ends go straight from one random place to the next, turning evenly, and never further apart than
    the rope allows."""
    step = LARGEST_QUASI_STATIC_M if step_s is None else FASTEST_M_S * float(rng.uniform(0.1, 1.0)) * step_s
    turn = 0.1 if step_s is None else min(FASTEST_RAD_S * step_s, 0.1)
    most = TAUT * length
    place = np.array([np.zeros(3), rng.uniform(0.3, 0.95) * most * _direction(rng)])
    # a held end begins within a right angle of the chord
    tangent = [_near(rng, place[1] - place[0], 1.2), _near(rng, place[1] - place[0], 1.2)]
    frame = [_frame(rng, one) for one in tangent]
    moves = [bool(rng.random() < 0.3), True]
    places, frames = np.zeros((STEPS, 2, 3)), np.zeros((STEPS, 2, 4))
    aims = place.copy()
    spin = [rng.uniform(-turn, turn) * _direction(rng) for _ in range(2)]
    for t in range(STEPS):
        for end in range(2):
            places[t, end] = place[end]
            frames[t, end] = frame[end].as_quat(scalar_first=True)
            if np.linalg.norm(aims[end] - place[end]) < step:
                aims[end] = place[1 - end] + rng.uniform(0.1, 1.0) * most * _direction(rng)
                spin[end] = rng.uniform(-turn, turn) * _direction(rng)
            if moves[end]:
                ahead = place[end] + step * _unit(aims[end] - place[end])
                if ends == Ends() and np.linalg.norm(ahead - place[1 - end]) > most:
                    aims[end] = place[end]
                else:
                    place[end] = ahead
                    frame[end] = frame[end] * Rotation.from_rotvec(spin[end])
    return Path(places[None], frames[None])


def _first(rng: np.random.Generator, rope: Rope, particles: int, ends: Ends, path: Path) -> State:
    poses = [Pose(path.x[0, 0, k], path.q[0, 0, k]) for k in range(2)]
    if ends == Ends("free", "free"):
        s = np.linspace(0, rope.length_m, particles)
        bend = rng.uniform(0.1, 4.0) / rope.length_m
        curl = np.stack([np.sin(bend * s) / bend, 0.1 * s, (1 - np.cos(bend * s)) / bend], axis=1)
        return released(s, curl, np.full(particles - 1, rope.length_m / (particles - 1)))
    start = poses[0] if ends.start == "clamped" else None
    end = poses[1] if ends.end == "clamped" else None
    return first_shape(rope.length_m, particles, start, end, GRAVITY)


def _obstacles(
    rng: np.random.Generator, begin: Floats, path: Path, ends: Ends, radius: float
) -> tuple[Obstacle, ...]:
    """None to three obstacles near the rope, which neither its first shape nor a held end's way enters."""
    held = [path.x[0, :, k] for k, kind in enumerate((ends.start, ends.end)) if kind == "clamped"]
    clear = np.concatenate([begin, *held])
    size = float(np.linalg.norm(begin[-1] - begin[0])) + 0.1
    found: list[Obstacle] = []
    for _ in range(int(rng.choice(4, p=[0.3, 0.35, 0.2, 0.15]))):
        for _ in range(20):
            centre = begin[rng.integers(len(begin))] + 0.4 * size * rng.uniform(0.1, 1.0) * _direction(rng)
            shape = str(rng.choice(list(SHAPES)))
            values = {
                "center_m": centre,
                "point_m": centre,
                "axis": _direction(rng),
                "normal": _near(rng, -GRAVITY, 0.5),
                "radius_m": rng.uniform(0.01, 0.06, 1),
                "height_m": rng.uniform(0.03, 0.3, 1),
                "quaternion": _unit(rng.normal(size=4)),
                "size_m": rng.uniform(0.02, 0.2, 3),
            }
            one = Obstacle(shape, {name: tuple(values[name].tolist()) for name in SHAPES[shape]})
            if nearest_distance([one], clear).min() > radius + 1e-3:
                found.append(one)
                break
    return tuple(found)


def _direction(rng: np.random.Generator) -> Floats:
    return _unit(rng.normal(size=3))


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12))


def _near(rng: np.random.Generator, axis: Floats, angle: float) -> Floats:
    """A random direction within so many radians of an axis, more or less."""
    return _unit(_unit(axis) + np.tan(angle * rng.random() / 2) * _direction(rng))


def _frame(rng: np.random.Generator, tangent: Floats) -> Rotation:
    across = _unit(np.cross(tangent, _direction(rng)))
    return Rotation.from_matrix(np.stack([across, np.cross(tangent, across), tangent], axis=1))


def _kinds(drawn: Drawn | None) -> Sequence[str]:
    if drawn is None:
        return ["undrawn"]
    label = drawn.label
    size = "5-19" if label["particles"] < 20 else "20-79" if label["particles"] < 80 else "80-200"
    decade = int(np.floor(np.log10(label["bending_stiffness"])))
    return [
        f"ends {label['ends']}",
        f"clock {label['clock']}",
        f"contact {label['contact']}",
        f"particles {size}",
        f"stiffness 1e{decade}",
    ]


def _reason(error: DloError) -> str:
    """The error without the numbers of rope and step, and without figures."""
    return re.sub(r"rope \d+(, step \d+)?:? ?|held \d+ % ", "", error.problem)


if __name__ == "__main__":
    run(main, *sys.argv[1:])
