"""Every effect of the library: neutral to the last bit, differentiated right, forwards and backwards."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from sim.ropes import EI, GJ, GRAVITY, LEVEL, ROPE, swing

from dlolib.errors import ParameterError
from dlolib.sim import simulate
from dlolib.sim.assembly import scalars3
from dlolib.sim.differentiate import Case, Cotangent, Variation, gradient, sensitivities, zero_tangent
from dlolib.sim.effects import EFFECTS, LAWS, Setup, named, nonlinear_bending, of_the_rope
from dlolib.sim.effects.base import Slip
from dlolib.sim.recording import RecordingModel
from dlolib.sim.rod import Rod, scene_of, setup
from dlolib.sim.runtime import ti, vec2
from dlolib.sim.scene import INERTIA, LOAD
from dlolib.sim.sides import sides_of
from dlolib.sim.simulate import Clock, roll_out
from dlolib.types import Ends, Floats, Motion, Obstacle, Points, Recording

PARTICLES, SEEN = 14, 5
TABLE = Obstacle("plane", {"point_m": (0.0, 0.0, -0.085), "normal": (0.0, 0.1, 1.0)})


@dataclass(frozen=True)
class Try:
    """An effect at a size that shows, the parameters that are differentiated there, and what is there too."""

    values: Mapping[str, float]
    also: tuple[str, ...] = ("bending_stiffness",)
    table: bool = False
    beside: Mapping[str, float] = field(default_factory=dict)


YIELDING = {"plastic_bending.yield_curvature": 6.0, "plastic_bending.hardening_ratio": 0.2}
RUBBING = {"internal_friction.saturation_curvature": 1.0, "internal_friction.transition_curvature": 2.0}
TRIES = {
    "rest_curvature": Try({"kappa_1": 0.5, "kappa_2": -1.0, "wave_1_2": 0.5, "wave_2_3": 1.5}),
    "plastic_bending": Try({"yield_curvature": 3.0, "hardening_ratio": 0.2}, ("end_twist.end",)),
    "internal_friction": Try(
        {"saturation_curvature": 1.0, "transition_curvature": 2.0}, ("torsional_stiffness",)
    ),
    "viscoelastic_bending": Try({"modulus_ratio": 0.4, "relaxation_time": 3.0}),
    "nonlinear_bending": Try({"cubic": -0.003}, ("bending_stiffness", "anisotropic_bending.stiffness_ratio")),
    # softer about the second axis the rope would buckle sideways, and have no derivative there
    "anisotropic_bending": Try({"stiffness_ratio": 1.5}),
    "prior_history": Try(
        {"kappa_1": 2.0, "kappa_2": 9.0},
        ("bending_stiffness", *YIELDING, *RUBBING),
        beside={**YIELDING, **RUBBING},
    ),
    "stiffness_profile": Try({"s": 0.2, "factor": 0.5, "width": 0.04}),
    "mass_profile": Try({"s": 0.3, "mass": 0.002, "gradient": 0.1}),
    "axial_stretch": Try({"axial_stiffness": 20.0}),
    "end_angle": Try({"start_1": 0.05, "start_2": -0.1, "end_1": 0.02, "end_2": 0.03}),
    "end_twist": Try({"start": 0.2, "end": -0.1}),
    "end_compliance": Try(
        {"start_stiffness": 0.01, "end_stiffness": 0.02}, ("end_angle.start_1", "end_twist.end")
    ),
    "grasp_slip": Try({"length": 0.005, "time": 3.0, "duration": 1.0}),
    "length_error": Try({"relative": 0.01}),
    "lateral_load": Try({"x": 0.01, "y": 0.02, "z": 0.01}),
    "contact_friction": Try({"coefficient": 0.3}, table=True),
    "hidden_obstacle": Try({"x": 0.17, "y": 0.01, "z": -0.12, "radius": 0.03}),
    "inertia_drag": Try({"inertia": 1.0, "drag": 0.05}),
    "clock_offset": Try({"time": 0.08}),
    "camera_pose": Try(
        {"rotation_1": 0.01, "rotation_2": 0.02, "rotation_3": -0.01, "depth": 0.003, "shift_1": 0.002}
    ),
}


def recording(table: bool = False) -> Recording:
    """The gripper swings out and back; the points are where nobody looked."""
    t_s = np.linspace(0, 6, 61)
    way = np.concatenate([swing(31), swing(31)[-2::-1]])
    held = np.tile(LEVEL, (61, 1))
    motion = Motion(t_s, np.zeros((61, 3)), held, way, held)
    frame = np.repeat(np.arange(SEEN), SEEN)
    s = np.tile(np.linspace(0.05, 0.4, SEEN), SEEN)
    points = Points(frame, 1.03 + 1.1 * frame, s, np.zeros((len(s), 3)))
    obstacles = (TABLE,) if table else ()
    return Recording("made", ROPE, GRAVITY, Ends(), motion, points, obstacles=obstacles, quasi_static=True)


def names_of(effect: str) -> list[str]:
    return [f"{effect}.{p.name}" for p in EFFECTS[effect].PARAMETERS] + list(TRIES[effect].also)


def rod_with(effect: str, values: Mapping[str, float]) -> Rod:
    return Rod(ROPE, EI, GJ, {**TRIES[effect].beside, **named(effect, values)}, PARTICLES)


def test_the_table_has_every_effect() -> None:
    assert set(TRIES) == set(EFFECTS)


@pytest.mark.parametrize("effect", EFFECTS)
def test_of_no_size_it_is_not_there(effect: str) -> None:
    model = RecordingModel(recording(TRIES[effect].table), PARTICLES, 0.02)
    neutral = {p.name: p.neutral for p in EFFECTS[effect].PARAMETERS}
    without = model.predict(Rod(ROPE, EI, GJ, TRIES[effect].beside, PARTICLES)).xyz_m
    assert np.array_equal(model.predict(rod_with(effect, neutral)).xyz_m, without)
    assert not np.allclose(model.predict(rod_with(effect, TRIES[effect].values)).xyz_m, without, atol=1e-5)


@pytest.mark.parametrize("effect", EFFECTS)
def test_its_derivatives_are_those_of_the_points(effect: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulate, "TOLERANCE", 1e-11)
    model = RecordingModel(recording(TRIES[effect].table), PARTICLES, 0.02)
    rod, names = rod_with(effect, TRIES[effect].values), names_of(effect)
    found = model.predict(rod, names).by_parameter
    missed = [name for k, name in enumerate(names) if not agrees(model, rod, name, found[:, :, k])]
    assert not missed


def agrees(model: RecordingModel, rod: Rod, name: str, found: Floats) -> bool:
    """Within 1e-6 of extrapolated differences over 19 of 20 points: an event may fall within the stencil."""
    _, _, width = sides_of(model, rod, name)
    for wider in (30.0, 3.0, 300.0):
        h = wider * width
        coarse, fine = (central(model, rod, name, h / part) for part in (1, 2))
        by = (4 * fine - coarse) / 3
        off = np.linalg.norm(found - by, axis=1) / np.linalg.norm(by, axis=1).max()
        if np.quantile(off, 0.95) < 1e-6:
            return True
    return False


@pytest.mark.parametrize(
    ("effect", "size", "little"),
    [
        ("internal_friction", "saturation_curvature", 1e-4),
        ("viscoelastic_bending", "modulus_ratio", 1e-4),
        ("nonlinear_bending", "cubic", 1e-6),
    ],
)
def test_a_law_that_is_not_there_has_the_derivative_of_a_little_of_it(
    effect: str, size: str, little: float
) -> None:
    """What it would remember is most of that."""
    model, name = RecordingModel(recording(), PARTICLES, 0.02), f"{effect}.{size}"
    rod = rod_with(effect, {**TRIES[effect].values, size: 0.0})
    found = model.predict(rod, ["bending_stiffness", name]).by_parameter[..., 1]
    by = (model.predict(rod.with_values({name: little})).xyz_m - model.predict(rod).xyz_m) / little
    assert np.linalg.norm(found - by) < 0.02 * np.linalg.norm(by)


@ti.kernel
def bent_by(curvatures: vec2, cubic: float, out: scalars3):
    """Into out[0]: moment, the work, the moment's derivatives of a rope as stiff about both axes."""
    zero = vec2(0.0)
    moment, _h, work, m_now, _mb, _mp, _hn, _hb, _hp, _branch = nonlinear_bending.respond(
        curvatures, zero, zero, vec2(0.5, -1.0), vec2(cubic, 0.0), vec2(EI, EI), EI, 1.0, -1
    )
    for r in range(2):
        out[0, 0, r], out[0, 1, r] = moment[r], work
        for c in range(2):
            out[0, 2 + r, c] = m_now[r, c]


@pytest.mark.parametrize("cubic", [0.003, -0.003])
def test_of_a_round_rope_a_moment_that_is_not_proportional_has_a_potential(cubic: float) -> None:
    """The moment is the slope of its work, and its derivatives, alike across, are that of the moment."""

    def response(curvatures: Floats) -> Floats:
        out = np.zeros((1, 4, 2))
        bent_by(vec2(*curvatures), cubic, out)
        return out[0] / EI

    at, step = np.array([4.0, -9.0]), 1e-4
    here = response(at)
    sides = [(response(at + by) - response(at - by)) / (2 * step) for by in step * np.eye(2)]
    assert here[0] == pytest.approx([side[1, 0] for side in sides], rel=1e-7)
    assert here[2:] == pytest.approx(np.array([side[0] for side in sides]).T, rel=1e-7)
    assert here[2, 1] == pytest.approx(here[3, 0], rel=1e-14)


def test_what_has_a_history_and_what_has_a_potential() -> None:
    def made(values: Mapping[str, float]) -> Setup:
        return setup(Rod(ROPE, EI, GJ, values, PARTICLES), GRAVITY, Ends(), (TABLE,))

    remember = {law.NAME: made(named(law.NAME, TRIES[law.NAME].values)).path_dependent for law in LAWS}
    assert [name for name, does in remember.items() if not does] == ["nonlinear_bending"]
    rubbing = made({"contact_friction.coefficient": 0.3})
    assert rubbing.path_dependent and not rubbing.symmetric
    cubic = {"nonlinear_bending.cubic": 0.003}
    assert made(cubic).symmetric and made({**cubic, "anisotropic_bending.stiffness_ratio": 1.0}).symmetric
    assert not made({**cubic, "anisotropic_bending.stiffness_ratio": 1.1}).symmetric
    assert not made({**cubic, **RUBBING}).symmetric


def test_a_derivative_at_the_edge_of_yielding_is_that_of_the_branch_taken() -> None:
    """Of a rope that once was bent by a hair more than to its yield; its differences look to either side."""
    model, names = RecordingModel(recording(), PARTICLES, 0.02), ["prior_history.kappa_2", *YIELDING]

    def derivatives(beyond: float) -> Floats:
        prior = {"prior_history.kappa_2": YIELDING["plastic_bending.yield_curvature"] + beyond}
        return model.predict(Rod(ROPE, EI, GJ, {**YIELDING, **prior}, PARTICLES), names).by_parameter

    edge, well = derivatives(1e-9), derivatives(1e-3)
    # the hardening's grows with what has yielded; the other two are the same
    for k in range(2):
        assert np.linalg.norm(edge[..., k] - well[..., k]) < 1e-2 * np.linalg.norm(well[..., k])


def test_a_roll_out_of_no_steps_keeps_the_derivatives_of_its_state() -> None:
    model = RecordingModel(recording(), PARTICLES, 0.02)
    rod = rod_with("plastic_bending", TRIES["plastic_bending"].values)
    rest, made = model.at_rest(rod), model.setup(rod)
    path = model.path(made, model.times(made)[:1])
    nowhere = replace(path, x=path.x[:, :0], q=path.q[:, :0], dt_s=None, span=None)
    none = roll_out(rest.scene, rest.final.at_rest(), nowhere, Clock(None))
    ways = [Variation(Case(rest.scene, none.path), Case(rest.scene, none.path), 1.0)]
    rng, zero = np.random.default_rng(4), zero_tangent(rest.scene, 1)
    parts = ("x", "turn", "past", "slip")
    before = replace(zero, **{part: rng.normal(size=getattr(zero, part).shape) for part in parts})
    _, after = sensitivities(none, ways, np.array([], int), before)
    assert all(np.array_equal(getattr(after, part), getattr(before, part)) for part in parts)


def test_a_path_of_other_steps_than_the_roll_out_s_is_refused() -> None:
    """Kernels would read beyond it."""
    model = RecordingModel(recording(), PARTICLES, 0.02)
    rod = rod_with("plastic_bending", TRIES["plastic_bending"].values)
    rollout = model.roll_out(rod)
    made = model.setup(rod)
    case = Case(rollout.scene, model.path(made, model.times(made)[:-1]))
    with pytest.raises(ValueError, match="another number of steps"):
        sensitivities(rollout, [Variation(case, case, 1.0)], np.array([1]))


def central(model: RecordingModel, rod: Rod, name: str, h: float) -> Floats:
    sides = (model.predict(rod.with_values({name: rod.value(name) + d})).xyz_m for d in (h, -h))
    return np.asarray((next(sides) - next(sides)) / (2 * h))


@pytest.mark.parametrize("effect", sorted(set(EFFECTS) - {"camera_pose"}))
def test_backwards_as_forwards(effect: str) -> None:
    """The adjoint of a random loss over the motion against its sensitivities, history and all."""
    model = RecordingModel(recording(TRIES[effect].table), PARTICLES, 0.02)
    rod, names = rod_with(effect, TRIES[effect].values), names_of(effect)
    rollout, rest = model.roll_out(rod), model.at_rest(rod)
    times = model.times(model.setup(rod))
    ways = [
        Variation(*(Case(scene_of([one]), model.path(one, times)) for one in sides), width)
        for *sides, width in (sides_of(model, rod, name) for name in names)
    ]
    assert rest.x.shape[1] == 2
    weights = np.random.default_rng(0).normal(size=rollout.x.shape)
    weights[:, 0] = 0.0
    out, _ = sensitivities(rollout, ways, np.arange(1, rollout.x.shape[1]))
    forwards = np.einsum("btcnk,btnk->c", out, weights[:, 1:])
    backwards = gradient(rollout, weights, variations=ways).parameter[0]
    assert backwards == pytest.approx(forwards, rel=1e-8, abs=1e-9 * np.abs(forwards).max())


def test_a_rope_that_remembers_nothing_has_no_prior_history() -> None:
    model = RecordingModel(recording(), PARTICLES, 0.02)
    prior = {"prior_history.kappa_1": 20.0, "prior_history.kappa_2": -30.0}
    for others in ({}, {"nonlinear_bending.cubic": -0.003}, {"plastic_bending.yield_curvature": 50.0}):
        rods = [Rod(ROPE, EI, GJ, values, PARTICLES) for values in (others, {**others, **prior})]
        first, second = (model.predict(rod).xyz_m for rod in rods)
        assert np.array_equal(first, second)


def test_prior_history_is_what_bending_there_and_back_leaves() -> None:
    """Before the first row the plastic rope's history is that of a return mapping by hand."""
    prior, yields, hardening = 20.0, 6.0, 0.2
    values = {"prior_history.kappa_2": prior, "plastic_bending.yield_curvature": yields}
    model = RecordingModel(recording(), PARTICLES, 0.02)
    rod = Rod(ROPE, EI, GJ, {**values, "plastic_bending.hardening_ratio": hardening}, PARTICLES)
    rest = model.at_rest(rod)
    permanent = rest.past[0, 0, :, 3 * 1 + 1]
    assert permanent == pytest.approx((prior - yields) / (1 + hardening), rel=1e-9)


def test_prior_history_has_an_adjoint() -> None:
    """Of the first shape and of what the laws remember of it, all that the way there contributes."""
    model = RecordingModel(recording(), PARTICLES, 0.02)
    rod, names = rod_with("prior_history", TRIES["prior_history"].values), names_of("prior_history")
    rest, times = model.at_rest(rod), model.times(model.setup(rod))[:1]
    ways = []
    for name in names:
        *sides, width = sides_of(model, rod, name)
        paths = [replace(model.path(side, times), dt_s=None) for side in sides]
        cases = [Case(scene_of([side]), path) for side, path in zip(sides, paths, strict=True)]
        ways.append(Variation(*cases, width))
    rng = np.random.default_rng(2)
    by_x, by_past = rng.normal(size=rest.x.shape), 1e-3 * rng.normal(size=rest.past[:, -1].shape)
    by_past[:, :, 2::3] = 0.0
    by_x[:, 0] = 0.0
    out, tangent = sensitivities(rest, ways, np.array([1]))
    forwards = np.einsum("bcnk,bnk->c", out[:, 0], by_x[:, 1])
    forwards += np.einsum("bcnh,bnh->c", tangent.past, by_past)
    none = np.zeros((1, PARTICLES, 3))
    final = Cotangent(none, none, np.zeros((1, PARTICLES + 1, 3)), by_past, np.zeros_like(rest.slip[:, -1]))
    backwards = gradient(rest, by_x, final, ways).parameter[0]
    assert np.all(np.abs(forwards[:2]) > 1e-3)
    assert backwards == pytest.approx(forwards, rel=1e-8, abs=1e-9 * np.abs(forwards).max())


@pytest.mark.parametrize("effect", ["plastic_bending", "internal_friction", "viscoelastic_bending"])
def test_the_gradient_passes_through_a_state_with_history(effect: str) -> None:
    """A motion in two pieces, as learning takes it, has the gradient of the motion in one."""
    model = RecordingModel(recording(), PARTICLES, 0.02)
    rod = rod_with(effect, TRIES[effect].values)
    rest, whole = model.at_rest(rod), model.roll_out(rod)
    path, half = whole.path, whole.path.x.shape[1] // 2
    weights = np.random.default_rng(1).normal(size=whole.x.shape)
    pieces = [
        replace(path, x=path.x[:, a:b], q=path.q[:, a:b], dt_s=path.dt_s[:, a:b], span=None)
        for a, b in ((0, half), (half, None))
    ]
    first = roll_out(rest.scene, rest.final.at_rest(), pieces[0], Clock(None))
    second = roll_out(rest.scene, first.final, pieces[1], Clock(None))
    assert np.abs(second.x[:, -1] - whole.x[:, -1]).max() < 1e-9
    late = np.concatenate([np.zeros_like(weights[:, :1]), weights[:, half + 1 :]], axis=1)
    back = gradient(second, late)
    early = gradient(first, weights[:, : half + 1], back.initial)
    one = gradient(whole, weights)
    both = np.concatenate([early.end_x, back.end_x], axis=1)
    assert both == pytest.approx(one.end_x, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize(
    ("effect", "values", "says"),
    [
        ("stiffnes", {}, "unknown effect"),
        ("plastic_bending", {"limit": 3.0}, "no parameter"),
        ("plastic_bending", {"yield_curvature": -3.0}, "out of range"),
        ("plastic_bending", {}, "without parameters"),
    ],
)
def test_what_makes_no_sense_is_refused(effect: str, values: Mapping[str, float], says: str) -> None:
    with pytest.raises(ParameterError, match=says):
        named(effect, values)


@pytest.mark.parametrize("time_s", [3.0, 3.06])
@pytest.mark.parametrize("duration_s", [0.0, 1e-5])
def test_a_slip_that_hardly_lasts_has_no_derivative_by_how_long(time_s: float, duration_s: float) -> None:
    """A frame at its middle or not; and how far a derivative looks to either side reverses no slip."""
    made = recording()
    made = replace(made, points=replace(made.points, t_s=made.points.frame + 1.0))
    model = RecordingModel(made, PARTICLES, 0.02)
    slip = {"length": 0.005, "time": time_s, "duration": duration_s}
    predicted = model.predict(rod_with("grasp_slip", slip), ["grasp_slip.duration", "grasp_slip.length"])
    by_duration, by_length = np.moveaxis(predicted.by_parameter, 2, 0)
    assert np.abs(by_duration).max() < 1e-9
    assert np.abs(by_length).max() > 0.1


def test_a_slip_at_once_is_the_limit_of_short_ones() -> None:
    t_s = np.array([2.0, 3.0, 4.0])
    for duration_s in (1e-3, 0.0, -1e-3):
        assert Slip(0.01, 3.0, duration_s).gone(t_s) == pytest.approx([0.0, 0.005, 0.01], abs=1e-15)


@pytest.mark.parametrize("time_s", [-100.0, 1.7e9])
def test_a_slip_is_at_a_time_of_any_clock(time_s: float) -> None:
    assert named("grasp_slip", {"time": time_s}) == {"grasp_slip.time": time_s}


def test_what_belongs_to_a_recording_stays_there() -> None:
    """A rope keeps its laws wherever it is, not how it was once held and seen."""
    rope = {
        "bending_stiffness": EI,
        "plastic_bending.yield_curvature": 8.0,
        "contact_friction.coefficient": 0.3,
    }
    there = {"end_angle.end_1": 0.1, "hidden_obstacle.x": 0.2, "length_error.relative": 0.01}
    assert of_the_rope(rope | there) == (rope, ("end_angle", "hidden_obstacle", "length_error"))
    groups = {"end_angle", "end_compliance", "end_twist", "grasp_slip", "length_error", "hidden_obstacle"}
    groups |= {"clock_offset", "camera_pose", "prior_history"}
    assert set(of_the_rope({f"{name}.any": 0.0 for name in EFFECTS})[1]) == groups


def test_the_page_lists_every_parameter() -> None:
    page = Path("docs/effects.md").read_text(encoding="utf-8")
    for effect in EFFECTS.values():
        rows = [f"`{p.name}`: {p.says} | {p.unit} | {p.neutral:g} |" for p in effect.PARAMETERS]
        assert all(row in page for row in rows), effect.NAME


def test_a_rope_without_inertia_has_none_in_a_dynamic_recording() -> None:
    made = setup(rod_with("inertia_drag", {"inertia": 0.0, "drag": 0.0}), np.zeros(3), Ends(), moving=True)
    assert made.moving and not made.particles[:, INERTIA].any()


def test_a_load_per_length_is_on_all_of_a_longer_rope() -> None:
    rod = Rod(ROPE, EI, GJ, {"length_error.relative": 0.1, "lateral_load.x": 0.2}, PARTICLES)
    force = setup(rod, np.zeros(3), Ends()).particles[:, LOAD].sum()
    assert force == pytest.approx(0.2 * 1.1 * ROPE.length_m)
