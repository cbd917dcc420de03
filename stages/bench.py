"""How fast and how right the rod is, beside its peers, in one run: reports/bench.json (`make bench`).

Every figure stands with its goal and with how it was measured. What is timed runs in turn, so that a busy
machine slows all alike, and the best of several repeats counts. A peer that is not installed, or a scene that
is not as exact as it must be, leaves its figure null, with the reason in `how`.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path as File
from typing import Any

import numpy as np
from mujoco import minimize
from scipy.interpolate import interp1d
from scipy.optimize import least_squares

from dlolib.errors import DloError
from dlolib.files import write_json
from dlolib.formats import read_layout
from dlolib.identify.identify import CORRECTIONS, FINER
from dlolib.learn import learn
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod, scene
from dlolib.sim.scene import SAMPLES, Scene, contact_points
from dlolib.sim.simulate import Clock, Rollout, State, gradient, roll_out
from dlolib.sim.simulate import Path as SimPath
from dlolib.sim.start import settle
from dlolib.types import Ends, Floats, Obstacle, Points, Recording
from stages import DATA, REPORTS, peers, run
from stages.gradients import derivative_errors
from stages.learn import settings as learn_settings
from stages.peers import EI, GJ, GRAVITY, MOTION, ROPE, STEP_S, STEPS, Race

REPEATS = 7
EXACT_PERCENT = 0.3
"""How far from the elastica a solver may be that is timed."""


@dataclass(frozen=True)
class Figure:
    """A figure of the table: null where it could not be measured."""

    value: float | None
    how: str


@dataclass(frozen=True)
class Goal:
    """What a key says, its goal, and whether the goal is the least or the most."""

    goal: float
    unit: str
    at_least: bool = False


GOALS = {
    "forward_vs_mujoco": Goal(12.0, "times", at_least=True),
    "forward_vs_pyelastica": Goal(300.0, "times", at_least=True),
    "backward_over_forward": Goal(1.0, "times"),
    "batch64_over_single": Goal(0.2, "times"),
    "per_segment_growth": Goal(1.1, "times"),
    "contact_over_free": Goal(2.0, "times"),
    "elastica_error_percent": Goal(0.25, "%"),
    "stretch_percent": Goal(0.05, "%"),
    "ei_spread_percent": Goal(1.0, "%"),
    "gradient_error": Goal(1e-6, "relative"),
    "identify_vs_mujoco": Goal(50.0, "times", at_least=True),
    "learn_seconds": Goal(5.0, "s"),
    "memory_mb": Goal(50.0, "MB"),
    "cosseratbench_error_time": Goal(0.1, "times"),
}


def main(*keys: str) -> None:
    """Measure all keys, or those named and keep the others as they are."""
    file = REPORTS / "bench.json"
    table = _kept(file) if keys else {}
    for names, measure in MEASURES:
        if keys and not set(names) & set(keys):
            continue
        print(f"measuring {', '.join(names)}", file=sys.stderr)
        try:
            figures = list(measure())
        except DloError as error:
            figures = [Figure(None, f"not measured: {error}")] * len(names)
        for key, figure in zip(names, figures, strict=True):
            goal = asdict(GOALS[key])
            table[key] = {"value": figure.value, **goal, "how": figure.how}
        # after each, so that nothing is lost where the next is stopped
        write_json(file, {key: table[key] for key in GOALS if key in table})
    for key, row in _kept(file).items():
        value = "not measured" if row["value"] is None else f"{row['value']:.4g} {row['unit']}".rstrip()
        print(f"{key}: {value} (goal {'≥' if row['at_least'] else '≤'} {row['goal']:g}) - {row['how']}")


def _kept(file: File) -> dict[str, Any]:
    from json import loads

    return dict(loads(file.read_text(encoding="utf-8"))) if file.exists() else {}


def in_turn(jobs: list[Callable[[], Any]], repeats: int = REPEATS) -> list[float]:
    """The best time of each job [s], all of them run in turn; once before, for what is compiled."""
    best = [np.inf] * len(jobs)
    for number in range(repeats + 1):
        for k, job in enumerate(jobs):
            begin = time.perf_counter()
            job()
            if number:
                best[k] = min(best[k], time.perf_counter() - begin)
    return [float(value) for value in best]


def us(seconds: float, steps: int = STEPS) -> str:
    """Microseconds a step."""
    return f"{1e6 * seconds / steps:.3g} µs"


def forward() -> Iterator[Figure]:
    """Ours against MuJoCo and PyElastica on the arc, after all three came close to the elastica."""
    exact = peers.exact_shapes()
    races: dict[str, Race] = {"ours": peers.ours(), "MuJoCo 4 flex": peers.mujoco_flex()}
    if find_spec("elastica"):
        races["PyElastica"] = peers.pyelastica()
    ladder = {
        "MuJoCo 4 flex": [peers.mujoco_flex(n) for n in (15, 60)],
        "ours": [peers.ours(n) for n in (15, 60)],
    }
    if "PyElastica" in races:
        ladder["PyElastica"] = [peers.pyelastica(16), peers.pyelastica(60, 200)]
    errors = {}
    for name, race in races.items():
        race.go()
        errors[name] = 100 * peers.error_of(race, exact)
    for name, made in ladder.items():
        for one in made:
            one.go()
        coarse, fine = (100 * peers.error_of(one, exact) for one in made)
        errors[f"{name}, n = 15 and 60"] = coarse
        if not fine < errors[name] < coarse:
            yield from [Figure(None, f"{name} does not converge: {coarse:.2g}, {fine:.2g} %")] * 2
            return
    quick = ["ours", "MuJoCo 4 flex"]
    times = dict(zip(quick, in_turn([races[name].go for name in quick]), strict=True))
    if "PyElastica" in races:
        again = in_turn([races["ours"].go, races["PyElastica"].go], 2)
        times["ours"], times["PyElastica"] = min(times["ours"], again[0]), again[1]
    for peer in ("MuJoCo 4 flex", "PyElastica"):
        if peer not in races:
            yield Figure(None, f"{peer} is not installed: the extra `bench`")
            continue
        yield _against(peer, times, errors)


def _against(peer: str, times: dict[str, float], errors: dict[str, float]) -> Figure:
    said = (
        f"{us(times[peer])} against {us(times['ours'])} a step of {1e3 * STEP_S:g} ms, n = 30, "
        f"one core; off the elastica by {errors[peer]:.2f} and {errors['ours']:.2f} % of the length"
    )
    off = [name for name in (peer, "ours") if errors[name] > EXACT_PERCENT]
    if off:
        return Figure(None, f"{' and '.join(off)} not within {EXACT_PERCENT} % of the elastica: {said}")
    return Figure(times[peer] / times["ours"], said)


def backward() -> Iterator[Figure]:
    """The adjoint over the forward pass, which always stores what the adjoint needs."""
    race = peers.ours()
    rollout: Rollout = race.go()
    weights = np.random.default_rng(0).normal(size=rollout.x.shape)
    ahead, back = in_turn([race.go, lambda: gradient(rollout, weights)])
    yield Figure(back / ahead, f"{us(back)} over {us(ahead)} a step; arc of {STEPS} steps, n = 30, one core")


def batch() -> Iterator[Figure]:
    """64 ropes of their own stiffness in one launch, each rope's time over that of one alone."""
    made, start = peers.at_rest([Rod(ROPE, ei, GJ) for ei in np.geomspace(1e-4, 1e-3, 64)])
    path = peers.arc_path(64)
    one = peers.ours()
    many, alone = in_turn([lambda: roll_out(made, start, path, Clock(STEP_S)), one.go], 3)
    yield Figure(
        many / 64 / alone,
        f"{us(many / 64)} a rope and step of 64 with EI from 1e-4 to 1e-3 N m² over {us(alone)} alone",
    )


def growth() -> Iterator[Figure]:
    """A step's time a segment at n = 480 over that at n = 30."""
    short, long = in_turn([peers.ours(30).go, peers.ours(480).go], 3)
    ratio = (long / 479) / (short / 29)
    yield Figure(ratio, f"{us(long)} a step at n = 480, {us(short)} at n = 30, the same arc")


CYLINDERS = tuple(
    Obstacle(
        "cylinder",
        {"center_m": (x, 0.0, -0.01), "axis": (0.0, 1.0, 0.0), "radius_m": (0.06,), "height_m": (0.4,)},
    )
    for x in (0.1, 0.28)
)
"""Two cylinders under the rope, which is let fall on them."""
# Soft enough to lie round the cylinders by its weight, at ten points and more.
SOFT = 1e-6


def laid(rod: Rod, obstacles: tuple[Obstacle, ...]) -> tuple[Scene, State]:
    """The rod at the arc's beginning, fallen from an arch, which it is with gravity the other way."""
    _, arch = peers.at_rest([rod], obstacles, -GRAVITY)
    made = scene([rod], GRAVITY, Ends(), obstacles)
    one = peers.arc_path()
    return made, settle(made, arch, SimPath(one.x[:, :1], one.q[:, :1])).final.at_rest()


def contact() -> Iterator[Figure]:
    """The step with the rope on two rough cylinders over the same step without them."""
    rough = Rod(ROPE, SOFT, SOFT, {"contact_friction.coefficient": 0.3})
    made, start = laid(rough, CYLINDERS)
    path = peers.arc_path()
    last: list[Rollout] = []

    def lying() -> None:
        last[:] = [roll_out(made, start, path, Clock(STEP_S))]

    bare, begin = laid(replace(rough, effects={}), ())
    touching, free = in_turn([lying, lambda: roll_out(bare, begin, path, Clock(STEP_S))], 3)
    x, share = last[0].x[0, 1:], np.arange(contact_points(rough.particles)) / SAMPLES
    points = interp1d(np.arange(rough.particles), x, axis=1)(share)
    centres = np.array([o.values["center_m"] for o in CYLINDERS])[:, [0, 2]]
    radius = CYLINDERS[0].values["radius_m"][0]
    away = np.linalg.norm(points[:, :, None, [0, 2]] - centres, axis=3).min(axis=2)
    depth = radius + ROPE.radius_m - away
    count, slides = (depth > 0).sum(axis=1), ((depth > 0) & (last[0].sliding[0, 1:] == 1)).sum(axis=1)
    said = (
        f"{us(touching)} over {us(free)} a step, EI {SOFT:g} N m²; contacts {int(np.median(count))} "
        f"(median; {count.min()} to "
        f"{count.max()}), {slides.mean():.1f} of them sliding on average; deepest {1e3 * depth.max():.3f} mm"
    )
    asked = np.median(count) >= 10 and 0 < slides.sum() < count.sum() and depth.max() <= 1e-4
    yield Figure(touching / free if asked else None, said if asked else f"the scene is not as asked: {said}")


def elastica() -> Iterator[Figure]:
    """Quasi-static shapes over the arc against the elastica, and the segments' lengths."""
    exact = peers.exact_shapes()
    errors = []
    for n in (15, 30, 60):
        race = peers.ours(n, Clock(None))
        rollout: Rollout = race.go()
        errors.append(100 * peers.error_of(race, exact))
        if n == 30:
            lengths = np.linalg.norm(np.diff(rollout.x[0], axis=1), axis=2)
            stretch = 100 * float(np.abs(lengths / rollout.scene.segment_l[0] - 1).max())
    orders = np.log(np.array(errors[:-1]) / errors[1:]) / np.log([29 / 14, 59 / 29])
    yield Figure(
        errors[1],
        f"{len(peers.SHOWN)} shapes on the arc, quasi-static; n = 15, 30, 60: "
        f"{', '.join(f'{e:.3g}' for e in errors)} %, orders {', '.join(f'{o:.2f}' for o in orders)}",
    )
    yield Figure(stretch, "largest change of a segment's length on the same arc, n = 30")


def clean(rod: Rod, step_s: float, frame_every: int) -> Recording:
    """What a rope ten times finer in space and time does on the arc, at 30 even arc lengths a frame."""
    s = np.linspace(0, ROPE.length_m, 30)
    times = MOTION.t_s[frame_every::frame_every]
    blank = Points(
        np.repeat(np.arange(len(times)), 30), np.repeat(times, 30), np.tile(s, len(times)),
        np.zeros((30 * len(times), 3)),
    )  # fmt: skip
    recording = Recording("clean", ROPE, GRAVITY, Ends(), MOTION, blank, quasi_static=False)
    xyz = RecordingModel(recording, rod.particles, step_s).predict(rod).xyz_m
    return replace(recording, points=replace(blank, xyz_m=xyz))


def spread() -> Iterator[Figure]:
    """EI from one clean recording at several discretisations, with the correction and without.

    The correction is `identify`'s: what a finer mesh adds to the shapes, made anew at the fit's own optimum.
    Its several starts, intervals and held-out frames are left out, which would take an hour.
    """
    recording = clean(Rod(ROPE, EI, GJ, particles=240), 1e-3, 20)
    said, spreads = [], []
    for corrections in (CORRECTIONS, 0):
        grid = [(n, step_s) for n in (15, 30, 60, 120) for step_s in (0.005, 0.01, 0.02)]
        found = [_fit_ours(recording, n, step_s, 1.5 * EI, corrections)[0] for n, step_s in grid]
        spreads.append(100 * (max(found) - min(found)) / EI)
        off = [100 * (value / EI - 1) for value in found]
        name = "on" if corrections else "off"
        said.append(f"{name}: {spreads[-1]:.2f} % ({min(off):+.2f} to {max(off):+.2f} %)")
    yield Figure(
        spreads[0],
        f"n = 15, 30, 60, 120 by dt = 5, 10, 20 ms; correction {'; '.join(said)}. The recording "
        "is our own rod's with 240 particles at 1 ms",
    )


def _fit_ours(
    recording: Recording, n: int, step_s: float, first: float, corrections: int = 0
) -> tuple[float, float]:
    """EI [N m²] and the sum of squares by Levenberg-Marquardt on forward sensitivities."""
    model, true = RecordingModel(recording, n, step_s), recording.points.xyz_m
    theta, offset = np.array([np.log(first)]), np.zeros_like(true)

    def rod(theta: Floats, particles: int = n) -> Rod:
        return Rod(ROPE, float(np.exp(theta[0])), GJ, particles=particles)

    def residual(theta: Floats) -> Floats:
        return np.asarray((model.predict(rod(theta)).xyz_m + offset - true).ravel())

    def jacobian(theta: Floats) -> Floats:
        by = model.predict(rod(theta), ["bending_stiffness"]).by_parameter
        return np.asarray(by.reshape(-1, 1) * np.exp(theta[0]))

    fine = FINER * (n - 1) + 1
    for number in range(corrections + 1):
        end = least_squares(residual, theta, jacobian, x_scale=[0.1], xtol=1e-6)
        theta = end.x
        if number < corrections:
            finely = RecordingModel(recording, fine, step_s).predict(rod(theta, fine)).xyz_m
            offset = finely - model.predict(rod(theta)).xyz_m
    return float(np.exp(theta[0])), float(end.cost)


def against_sysid() -> Iterator[Figure]:
    """EI from one recording: MuJoCo's least squares (finite differences) on its flex, ours on the rod."""
    recording = clean(Rod(ROPE, EI, GJ, particles=240), 1e-3, 20)
    frames = np.unique(np.searchsorted(MOTION.t_s, recording.points.t_s - 1e-9))
    true = recording.points.xyz_m.reshape(len(frames), 30, 3)
    first = float(np.log(1.5))

    def residual(theta: Floats) -> Floats:
        columns = []
        for value in np.ravel(theta):
            model, data = peers.flex_scene(30, EI * float(np.exp(value)))
            start = peers.flex_at_rest(model, data)
            kept = np.array(peers.flex_run(model, data, start))
            columns.append((kept[frames - 1] - true).ravel())
        return np.stack(columns, axis=1)

    ends: dict[str, Any] = {}
    bounds = [np.array([[-1.0]]), np.array([[1.0]])]

    def theirs() -> None:
        ends["theirs"] = minimize.least_squares(
            np.array([[first]]), residual, bounds, eps=1e-4, verbose=minimize.Verbosity.SILENT
        )

    def ours() -> None:
        ends["ours"] = _fit_ours(recording, 30, STEP_S, 1.5 * EI)

    slow, quick = in_turn([theirs, ours], 1)
    value, cost = ends["ours"]
    x, log = ends["theirs"]
    points = true.size / 3
    rms = [1e3 * np.sqrt(2 * c / points) for c in (float(log[-1].objective), cost)]
    yield Figure(
        slow / quick,
        f"mujoco.minimize.least_squares (what mujoco.sysid calls) on its flex {slow:.2f} s, ours "
        f"{quick:.3f} s, from 1.5 EI; residuals {rms[0]:.2f} and {rms[1]:.2f} mm RMS, "
        f"EI {100 * (np.exp(float(np.ravel(x)[0])) - 1):+.1f} and {100 * (value / EI - 1):+.1f} %; a "
        f"settling of {peers.COMING + peers.RESTING} steps is part of theirs",
    )


def learning() -> Iterator[Figure]:
    """Learning layout 1 as the stage does, its own compilation left out."""
    layout = read_layout(DATA / "layouts" / "layout_1")
    rod = Rod(layout.rope, EI, EI)
    given = learn_settings()
    learn(layout, rod, replace(given, iterations=1, starts=1))
    begin = time.perf_counter()
    done = learn(layout, rod, given)
    seconds = time.perf_counter() - begin
    yield Figure(
        seconds,
        f"layout_1, EI 3e-4 N m², {len(done.curve)} iterations of at most {given.iterations}; goal error "
        f"{1e3 * done.kept.goal.mean_m:.1f} mm, clearance {1e3 * done.kept.min_clearance_m:.1f} mm; one run",
    )


MEMORY = """
import re
from pathlib import Path
import numpy as np
from stages import peers
from dlolib.sim import simulate
made, start = peers.at_rest([peers.Rod(peers.ROPE, peers.EI, peers.GJ)])
path = peers.arc_path()
def go(steps):
    part = simulate.Path(path.x[:, :steps], path.q[:, :steps])
    rollout = simulate.roll_out(made, start, part, simulate.Clock(peers.STEP_S))
    return simulate.gradient(rollout, np.ones_like(rollout.x)).end_x
go(2)
def kb(what):
    return int(re.search(what + r":\\s*(\\d+)", Path("/proc/self/status").read_text())[1])
Path("/proc/self/clear_refs").write_text("5")
before = kb("VmRSS")
go(peers.STEPS)
print((kb("VmHWM") - before) / 1024)
"""


def memory() -> Iterator[Figure]:
    """Peak resident memory of a roll-out with its gradient above the process that did two steps before."""
    if not File("/proc/self/clear_refs").exists():
        yield Figure(None, "needs Linux: the peak is read from /proc/self/status")
        return
    done = subprocess.run([sys.executable, "-c", MEMORY], capture_output=True, text=True, check=False)
    if done.returncode:
        yield Figure(None, f"the process that measures it failed: {done.stderr.strip().splitlines()[-1]}")
        return
    said = f"VmHWM over VmRSS after two steps of the same; {STEPS} steps and their adjoint, n = 30"
    yield Figure(float(done.stdout), said)


def gradients() -> Iterator[Figure]:
    """Forward sensitivities and adjoint of every effect's parameters against extrapolated differences."""
    errors, left_out, idle = derivative_errors()
    worst = sorted(errors, key=lambda label: -errors[label])
    share = 100 * len(left_out) / (len(left_out) + len(errors))
    first = ", ".join(f"{label} {errors[label]:.1e}" for label in worst[:4])
    listed = f" ({'; '.join(left_out)})" if left_out else ""
    yield Figure(
        errors[worst[0]],
        f"{len(errors)} derivatives; worst: {first}; median {float(np.median(list(errors.values()))):.1e}. "
        "Sensitivities against Richardson's differences, "
        f"adjoint against sensitivities; an event changed within the stencil in {share:.0f} %{listed}; "
        f"{len(idle)} move nothing{': ' + ', '.join(idle) if idle else ''}",
    )


SCORES = {
    "catenary": "shape_error",
    "cantilever": "tip_deflection_error",
    "pendulum": "period_error",
    "twist": "critical_twist_error",
}


def cosserat() -> Iterator[Figure]:
    """cosseratbench's experiments: our error times seconds over the best other solver's."""
    if not find_spec("cosseratbench"):
        yield Figure(None, "cosseratbench is not installed: the extra `bench`")
        return
    from cosseratbench import registry
    from cosseratbench.experiment import run as run_experiment

    from dlolib.bench.cosserat import RodSolver

    ratios, said = {}, []
    for name, metric in SCORES.items():
        experiment = registry.load_experiment(name)
        ours = run_experiment(experiment, RodSolver())
        others, failed = {}, []
        for solver in ("pyelastica", "mujoco"):
            try:
                result = run_experiment(experiment, registry.load_solver(solver))
                if result.outcome == "completed" and np.isfinite(result.metrics[metric]):
                    others[solver] = result.metrics[metric] * (result.wall_time or 0.0)
                    said.append(f"{name} {solver} {result.metrics[metric]:.2e} in {result.wall_time:.2f} s")
                else:
                    failed.append(f"{solver} {result.failure or result.outcome}")
            except Exception as error:  # an adapter that does not fit its library
                failed.append(f"{solver} {type(error).__name__}: {str(error).splitlines()[0]}")
        said.extend(f"{name} {one}" for one in failed)
        if ours.outcome != "completed":
            yield Figure(None, f"{name}: {ours.failure or ours.missing}")
            return
        said.append(f"{name} ours {ours.metrics[metric]:.2e} in {ours.wall_time:.3f} s")
        if others:
            ratios[name] = ours.metrics[metric] * (ours.wall_time or 0.0) / min(others.values())
    slid = run_experiment(registry.load_experiment("capstan"), RodSolver())
    slide = slid.metrics.get("slide")
    said.append(f"capstan ours {slid.failure if slide is None else f'slide {slide:.1e} m'}")
    said.append("crossing and pile: unsupported, no contact between rods")
    if not ratios:
        yield Figure(None, f"no other solver completed: {'; '.join(said)}")
        return
    worst = max(ratios, key=lambda name: ratios[name])
    yield Figure(ratios[worst], f"worst {worst}; {'; '.join(said)}")


MEASURES: tuple[tuple[tuple[str, ...], Callable[[], Iterator[Figure]]], ...] = (
    (("forward_vs_mujoco", "forward_vs_pyelastica"), forward),
    (("backward_over_forward",), backward),
    (("batch64_over_single",), batch),
    (("per_segment_growth",), growth),
    (("contact_over_free",), contact),
    (("elastica_error_percent", "stretch_percent"), elastica),
    (("ei_spread_percent",), spread),
    (("gradient_error",), gradients),
    (("identify_vs_mujoco",), against_sysid),
    (("learn_seconds",), learning),
    (("memory_mb",), memory),
    (("cosseratbench_error_time",), cosserat),
)


if __name__ == "__main__":
    run(main, *sys.argv[1:])
