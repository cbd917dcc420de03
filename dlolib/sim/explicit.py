"""What parameters do to a step at fixed states: -dr/dp and dG/dp of `derivatives`, by two scenes each.

Of the k-th parameter the scenes of rope b, a little to either side and `widths[k]` apart, are those of rows
(2 k) B + b and (2 k + 1) B + b; its column is `slots[k]`. Most differ in a few joints or loads alone:
`differs[k, b, i]` says by the bits below what differs of joint i, of grip i, of particle i and of the segment
and the contacts behind it. The rest is the same on both sides, and nobody looks.

Columns lie in groups of `LANES`, as `band.solve_lanes` takes them.
"""

from dlolib.sim.assembly import bent_from, grip, joint_lengths, out_of_reach, sample
from dlolib.sim.contact import friction, push
from dlolib.sim.inertia import paces, slowed
from dlolib.sim.joints import HISTORY, begin, law_acts, respond
from dlolib.sim.runtime import LANES, ti, vec3, vec4
from dlolib.sim.scene import LOAD, SAMPLES
from dlolib.sim.strain import darboux, moment_to_rotations, stretch_shear

JOINT, SEGMENT, PARTICLE, CONTACT, GRIP = 1, 2, 4, 8, 16


@ti.func
def take(y: ti.template(), b: int, c: int, row: int, force: vec3):
    """Take a force, or a moment, from the three unknowns of column c that begin at a row."""
    for k in ti.static(range(3)):
        y[b, c // LANES, row + k][c % LANES] -= force[k]


@ti.func
def side_of(number: int, side: int, b: int, ropes: int):
    """The row of one of a parameter's two scenes, and its sign in their difference."""
    return (2 * number + side) * ropes + b, 1.0 - 2.0 * side


@ti.func
def of_joints(
    b: int, t: int, q: ti.template(), past: ti.template(), steps: ti.template(), joints: ti.template(),
    fresh: int, differs: ti.template(), slots: ti.template(), widths: ti.template(), y: ti.template(),
    by_past: ti.template(), after: ti.template(),
):  # fmt: skip
    """Moments of the joints; into by_past[b] what laws remember. after[b] is room for two sides of that."""
    for i in range(joints.shape[1]):
        phi, w, v, c0, c1, _c2 = darboux(q[b, t, i], q[b, t, i + 1])
        phi_before, _w, _v, _c, _d, _e = darboux(q[b, t - 1, i], q[b, t - 1, i + 1])
        for number in range(widths.shape[0]):
            if differs[number, b, i] & JOINT:
                c, width = slots[number], widths[number]
                moment = vec3(0.0)
                for side in range(2):
                    case, sign = side_of(number, side, b, q.shape[0])
                    if fresh == 1:
                        # what was before the first shape depends on the parameters too
                        begin(joints, past, case, b, t - 1, i, 1)
                    now_l, before_l = joint_lengths(joints, steps, case, t, i)
                    before = bent_from(joints, case, i, phi_before / before_l, fresh)
                    _energy, m, _tangent = respond(
                        joints, past, case, b, t - 1, i, phi / now_l, before,
                        steps[case, t, 0] * (1 - fresh), 1, True, after, side,
                    )  # fmt: skip
                    moment += sign * m
                    for k in range(HISTORY // 3 if by_past.shape[2] > 1 else 0):
                        for r in ti.static(range(2)):
                            value = 0.0
                            if law_acts(joints, case, i, k):
                                value = after[b, side, i, 3 * k + r]
                            after[b, side, i, 3 * k + r] = value
                ga, gb = moment_to_rotations(w, v, c0, c1, moment / width)
                take(y, b, c, 6 * i + 3, ga)
                take(y, b, c, 6 * i + 9, gb)
                for k in range(HISTORY if by_past.shape[2] > 1 else 0):
                    changed = (after[b, 0, i, k] - after[b, 1, i, k]) / width
                    by_past[b, c // LANES, i, k][c % LANES] = changed


@ti.func
def of_segments(
    b: int, t: int, x: ti.template(), q: ti.template(), steps: ti.template(), segments: ti.template(),
    differs: ti.template(), slots: ti.template(), widths: ti.template(), y: ti.template(),
):  # fmt: skip
    """Forces that stretch and shear the segments."""
    for s in range(segments.shape[1]):
        for number in range(widths.shape[0]):
            if differs[number, b, s] & SEGMENT:
                pull, moment = vec3(0.0), vec3(0.0)
                for side in range(2):
                    case, sign = side_of(number, side, b, x.shape[0])
                    _e, force, turn, _dd, _dt, _tt = stretch_shear(
                        x[b, t, s + 1] - x[b, t, s], q[b, t, s + 1], segments[case, s, 0] * steps[case, t, 1],
                        vec3(segments[case, s, 1], segments[case, s, 2], segments[case, s, 3]), 0, vec3(0.0),
                    )  # fmt: skip
                    pull += sign * force
                    moment += sign * turn
                c, width = slots[number], widths[number]
                take(y, b, c, 6 * (s + 1), -pull / width)
                take(y, b, c, 6 * (s + 2), pull / width)
                take(y, b, c, 6 * (s + 1) + 3, moment / width)


@ti.func
def of_particles(
    b: int, t: int, x: ti.template(), first: ti.template(), steps: ti.template(), particles: ti.template(),
    moving: int, euler: int, differs: ti.template(), slots: ti.template(), widths: ti.template(),
    y: ti.template(),
):  # fmt: skip
    """Loads, inertia and drag of the particles."""
    for p in range(particles.shape[1]):
        for number in range(widths.shape[0]):
            if differs[number, b, p] & PARTICLE:
                pull = vec3(0.0)
                for side in range(2):
                    case, sign = side_of(number, side, b, x.shape[0])
                    for k in ti.static(range(3)):
                        pull[k] -= sign * particles[case, p, LOAD + k]
                    if moving == 1:
                        inertia, drag = paces(steps, case, t, euler)
                        force, _stiffness = slowed(x, first, particles, inertia, drag, case, b, t, p)
                        pull += sign * force
                take(y, b, slots[number], 6 * (p + 1), pull / widths[number])


@ti.func
def of_grips(
    b: int, t: int, q: ti.template(), end_q: ti.template(), grips: ti.template(), differs: ti.template(),
    slots: ti.template(), widths: ti.template(), y: ti.template(),
):  # fmt: skip
    """Moments of clamps that give way."""
    for end in range(2):
        i = end * (q.shape[2] - 1)
        for number in range(widths.shape[0]):
            if differs[number, b, i] & GRIP:
                moment = vec3(0.0)
                for side in range(2):
                    case, sign = side_of(number, side, b, q.shape[0])
                    stiffness = vec3(grips[case, end, 0], grips[case, end, 1], grips[case, end, 2])
                    _e, m, _h = grip(end_q[case, t - 1, end], q[b, t, i], stiffness)
                    moment += sign * m
                take(y, b, slots[number], 6 * i + 3, moment / widths[number])


@ti.func
def contact_force(
    case: int, b: int, t: int, p: int, j: int, x: ti.template(), slip: ti.template(), sliding: ti.template(),
    contacts: ti.template(), obstacles: ti.template(), fresh: int,
):  # fmt: skip
    """Gradient of the energy [N] by contact point j after particle p, and the stretch of its spring [m]."""
    k = SAMPLES * p + j
    point, stiffness, radius = sample(x, b, t, p, j), contacts[case, k, 0], contacts[case, k, 1]
    _energy, force, _h = push(point, radius, stiffness, obstacles, case)
    stretch = vec3(0.0)
    if slip.shape[2] > 1 and fresh == 0:
        before = sample(x, b, t - 1, p, j)
        _e, hold, stretch_now, _by_p, _by_past, _slides = friction(
            point, before, slip[b, t - 1, k], radius, stiffness, obstacles, case, sliding[b, t, k],
            vec4(-1.0), vec3(0.0),
        )  # fmt: skip
        force += hold * stretch_now
        stretch = stretch_now
    return force, stretch


@ti.func
def of_contacts(
    b: int, t: int, x: ti.template(), slip: ti.template(), sliding: ti.template(), steps: ti.template(),
    segments: ti.template(), contacts: ti.template(), obstacles: ti.template(), fresh: int,
    differs: ti.template(), slots: ti.template(), widths: ti.template(), y: ti.template(),
    by_slip: ti.template(),
):  # fmt: skip
    """Forces of the contacts, and the stretch that friction remembers: into by_slip[b]."""
    n = x.shape[2]
    for p in range(n):
        for number in range(widths.shape[0]):
            if differs[number, b, p] & CONTACT:
                c, width = slots[number], widths[number]
                for j in range(SAMPLES if p + 1 < n else 1):
                    k, there = SAMPLES * p + j, j / float(SAMPLES)
                    force, stretched = vec3(0.0), vec3(0.0)
                    for side in range(2):
                        case, sign = side_of(number, side, b, x.shape[0])
                        if not out_of_reach(case, b, t, p, x, steps, segments, contacts, obstacles):
                            pushed, stretch = contact_force(
                                case, b, t, p, j, x, slip, sliding, contacts, obstacles, fresh
                            )
                            force += sign * pushed
                            stretched += sign * stretch
                    take(y, b, c, 6 * (p + 1), (1.0 - there) / width * force)
                    if j > 0:
                        take(y, b, c, 6 * (p + 2), there / width * force)
                    if slip.shape[2] > 1:
                        for r in ti.static(range(3)):
                            by_slip[b, c // LANES, k, r][c % LANES] = stretched[r] / width


@ti.func
def explicit(
    b: int, t: int, x: ti.template(), q: ti.template(), first: ti.template(), past: ti.template(),
    slip: ti.template(), sliding: ti.template(), end_q: ti.template(), steps: ti.template(),
    joints: ti.template(), segments: ti.template(), particles: ti.template(), contacts: ti.template(),
    obstacles: ti.template(), grips: ti.template(), moving: int, euler: int, fresh: int,
    differs: ti.template(), slots: ti.template(), widths: ti.template(), y: ti.template(),
    by_past: ti.template(), by_slip: ti.template(), after: ti.template(),
):  # fmt: skip
    """What all parameters do to the step to index t of rope b: minus what they do to its forces is added to
    y[b], what they do to the histories that follow it is put into by_past[b] and by_slip[b]."""
    of_joints(b, t, q, past, steps, joints, fresh, differs, slots, widths, y, by_past, after)
    of_segments(b, t, x, q, steps, segments, differs, slots, widths, y)
    of_particles(b, t, x, first, steps, particles, moving, euler, differs, slots, widths, y)
    of_grips(b, t, q, end_q, grips, differs, slots, widths, y)
    of_contacts(
        b, t, x, slip, sliding, steps, segments, contacts, obstacles, fresh, differs, slots, widths, y,
        by_slip,
    )  # fmt: skip
