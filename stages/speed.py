"""How fast the rod is: its step, its adjoint, batches, contact and learning, beside its peers."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path as File

import numpy as np
from scipy.interpolate import interp1d

from dlolib.formats import read_layout
from dlolib.learn import learn
from dlolib.sim.differentiate import gradient
from dlolib.sim.rod import Rod, scene
from dlolib.sim.scene import SAMPLES, Scene, contact_points
from dlolib.sim.simulate import Clock, Rollout, State, roll_out
from dlolib.sim.simulate import Path as SimPath
from dlolib.sim.start import settle
from dlolib.types import Ends, Obstacle
from stages import DATA, peers, timing
from stages.learn import settings as learn_settings
from stages.peers import EI, GJ, GRAVITY, ROPE, STEP_S, STEPS, Race
from stages.timing import REPEATS, Figure, in_turn

EXACT_PERCENT = 0.3
"""How far from the elastica a solver may be that is timed."""
us = partial(timing.us, steps=STEPS)


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
    # a peer's time stands over ours of the same minute
    for peer, repeats in (("MuJoCo 4 flex", REPEATS), ("PyElastica", 2)):
        if peer not in races:
            yield Figure(None, f"{peer} is not installed: the extra `bench`")
            continue
        theirs, own = in_turn([races[peer].go, races["ours"].go], repeats)
        yield _against(peer, theirs, own, errors)


def _against(peer: str, theirs: float, own: float, errors: dict[str, float]) -> Figure:
    said = (
        f"{us(theirs)} against {us(own)} a step of {1e3 * STEP_S:g} ms, n = 30, "
        f"one core; off the elastica by {errors[peer]:.2f} and {errors['ours']:.2f} % of the length"
    )
    off = [name for name in (peer, "ours") if errors[name] > EXACT_PERCENT]
    if off:
        return Figure(None, f"{' and '.join(off)} not within {EXACT_PERCENT} % of the elastica: {said}")
    return Figure(theirs / own, said)


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


def learning() -> Iterator[Figure]:
    """Learning layout 1 as the stage does, its own compilation left out."""
    layout = read_layout(DATA / "layouts" / "layout_1")
    rod = Rod(layout.rope, EI, EI)
    given = learn_settings(layout.rope.length_m)
    learn(layout, rod, replace(given, iterations=1, starts=1))
    begin = time.perf_counter()
    done = learn(layout, rod, given)
    seconds = time.perf_counter() - begin
    yield Figure(
        seconds,
        f"layout_1, EI 3e-4 N m², {done.iterations_total} iterations in all, starts tried: {done.starts}; "
        f"goal error {1e3 * done.kept.goal.mean_m:.1f} mm, clearance "
        f"{1e3 * done.kept.min_clearance_m:.1f} mm; one run",
    )


MEMORY = """
import ctypes
import re
from pathlib import Path
import numpy as np
from stages import peers
from dlolib.sim import simulate
from dlolib.sim.differentiate import gradient
made, start = peers.at_rest([peers.Rod(peers.ROPE, peers.EI, peers.GJ)])
path = peers.arc_path()
def go(steps):
    part = simulate.Path(path.x[:, :steps], path.q[:, :steps])
    rollout = simulate.roll_out(made, start, part, simulate.Clock(peers.STEP_S))
    return gradient(rollout, np.ones_like(rollout.x)).end_x
go(2)
def kb(what):
    return int(re.search(what + r":\\s*(\\d+)", Path("/proc/self/status").read_text())[1])
# what was freed since the process began would be taken again unseen
ctypes.CDLL(None).malloc_trim(0)
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
    said = (
        f"VmHWM over VmRSS after two steps of the same, freed memory handed back; {STEPS} steps and their "
        "adjoint, n = 30"
    )
    yield Figure(float(done.stdout), said)
