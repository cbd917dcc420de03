"""Newton's method on a banded Hessian: the equilibrium of one step, or of a share of one.

A segment hardly stretches: a step that turns it a little, and thereby stretches it by the square of that,
changes the force in it by far too much, and the Hessian with it. So these forces first are unknowns of their
own (mixed integration points: Magisano, Leonetti and Garcea, Comput. Methods Appl. Mech. Eng. 313, 2017):
each step's Hessian is that under the forces that the step before foretold, and three steps do instead of
eight. What they do not find is sought downhill, by the energy.
"""

from dlolib.sim.assembly import assemble, clear_held, hold_ends, sample
from dlolib.sim.band import factor, solve
from dlolib.sim.contact import grip_of
from dlolib.sim.foretell import passed
from dlolib.sim.joints import laws_act
from dlolib.sim.rotations import rotated
from dlolib.sim.runtime import ti, vec3
from dlolib.sim.saddle import MOST_LEFT, STEEP, fall, scale_of
from dlolib.sim.scene import FRICTION, LOAD, SAMPLES, STIFFNESS
from dlolib.sim.strain import stretch_shear_force

CONVERGED, UNCONVERGED, NOT_FINITE, TOO_FAR = 0, 1, 2, 3
LARGEST_TURN = 0.5
# A Newton step this small that no longer shrinks is rounding: the stretch stiffness times the last bit of a
# position is a force, and a soft rope moves under it.
ROUNDING = 1e-7
# A Newton step leaves less than a hundredth of its square times this [1/m], for a rope without contact and
# history; a hundredth, so that differences of two roll-outs are good for derivatives. The second is for mixed
# steps; what these do not end in so many they never do.
QUADRATIC_1_M, QUADRATIC_MIXED_1_M, MOST_MIXED = 1e6, 1e4, 12
# What Newton's method leaves goes with the square of its step. Two of them, the second no larger than this,
# foretell the next, which is left out if it would be no more than so many times the tolerance.
FORETOLD, FORETELLS = 1e-6, 1e-4
# So many steps under Coulomb's law in full need not lessen the forces: where contacts come to stick or slide
# these rise before they fall, and shorter steps creep up to the next such change for a hundred iterations.
LEAPS = 6
# Newton's step at which contacts with noted limits are near enough to note them anew.
LAGGED_ENOUGH = 1e-4
# The farthest that a shape on a saddle, found with a shift, is moved onto it.
LARGEST_POLISH = 1e-5
# The way down from a saddle may be long and bent: so many times the iterations.
LONG_WAY = 10
# What is added to the Hessian where a step was none or made it worse, over the rope's own stiffness; where it
# lies on a saddle, over what bends the whole rope.
LEAST_ADDED, LEAST_SHIFT, MOST_ADDED = 1e-6, 1e-3, 1e12


@ti.func
def stiffen(upper: ti.template(), b: int, rows: int, by: float, scale_x: float, scale_t: float):
    """Add to the Hessian's diagonal so many times the rope's own stiffness."""
    if by > 0.0:
        for r in range(rows):
            upper[b, r][0] += by * scale_of(r, scale_x, scale_t)


@ti.func
def factor_stiffer(
    upper: ti.template(), lower: ti.template(), factors: ti.template(), under: ti.template(), b: int,
    rows: int, symmetric: int, exact: bool, again: int, loose: float, damping: float, shift_before: float,
    least_shift: float, enough: float, scale_x: float, scale_t: float,
):  # fmt: skip
    """Factor the Hessian; where it is that of a rope about to buckle, with `again` the same ever stiffer.

    enough: what was, before; a little less is tried at first. factors, under: where they go.

    Returns:
        whether it is still indefinite; what was added to it; what of that because it was indefinite.
    """
    shift = shift_before
    added, had = ti.max(loose, ti.max(shift, damping)), 0.0
    indefinite, trying = True, True
    while trying:
        stiffen(upper, b, rows, added - had, scale_x, scale_t)
        had = added
        indefinite = factor(upper, lower, b, factors, under, rows, symmetric, 0 if exact else 1) > 0
        trying = indefinite and again == 1 and shift <= MOST_ADDED
        if trying:
            shift = ti.max(least_shift, 10.0 * ti.max(added, enough / 1000.0))
            added = ti.max(loose, ti.max(shift, damping))
    return indefinite, added, shift


@ti.func
def keep(b: int, t: int, x: ti.template(), q: ti.template(), to_x: ti.template(), to_q: ti.template()):
    """Note where the rope stands at index t."""
    for p in range(x.shape[2]):
        to_x[b, p] = x[b, t, p]
    for i in range(q.shape[2]):
        to_q[b, i] = q[b, t, i]


@ti.func
def put_back(
    b: int, t: int, x: ti.template(), q: ti.template(), from_x: ti.template(), from_q: ti.template()
):
    """Put the rope where it stood."""
    for p in range(x.shape[2]):
        x[b, t, p] = from_x[b, p]
    for i in range(q.shape[2]):
        q[b, t, i] = from_q[b, i]


@ti.func
def stand(
    b: int, t: int, x: ti.template(), q: ti.template(), base_x: ti.template(), base_q: ti.template(),
    y: ti.template(), fraction: float,
):  # fmt: skip
    """Put the rope where a fraction of the step in column 1 takes it from the base."""
    for p in range(x.shape[2]):
        r = 6 * (p + 1)
        x[b, t, p] = base_x[b, p] + fraction * vec3(y[b, 1, r], y[b, 1, r + 1], y[b, 1, r + 2])
    for i in range(q.shape[2]):
        r = 6 * i + 3
        turn = fraction * vec3(y[b, 1, r], y[b, 1, r + 1], y[b, 1, r + 2])
        q[b, t, i] = rotated(base_q[b, i], turn)


@ti.func
def note_limits(
    b: int, t: int, x: ti.template(), contacts: ti.template(), obstacles: ti.template(), limits: ti.template()
):
    """At which stretch each contact slides, by how deep it is at index t."""
    n = x.shape[2]
    for p in range(n):
        for j in range(SAMPLES):
            if j == 0 or p + 1 < n:
                k = SAMPLES * p + j
                limit, normal, _slope, _bend = grip_of(sample(x, b, t, p, j), contacts[b, k, 1], obstacles, b)
                limits[b, 0, k] = limit
                pull = shortened(vec3(limits[b, 4, k], limits[b, 5, k], limits[b, 6, k]), limit)
                for j in ti.static(range(3)):
                    limits[b, 1 + j, k] = normal[j]
                    limits[b, 4 + j, k] = pull[j]


@ti.func
def shortened(v: vec3, most: float) -> vec3:
    """v, or as much of it as is not longer than that."""
    return v * ti.min(1.0, most / ti.max(v.norm(), 1e-300))


@ti.func
def note_pulls(
    b: int, t: int, base_x: ti.template(), x: ti.template(), y: ti.template(), slip: ti.template(),
    limits: ti.template(),
):  # fmt: skip
    """What stretch Newton's step in column 1 from base_x expects of each contact whose limit is noted."""
    n = x.shape[2]
    for p in range(n):
        for j in range(SAMPLES):
            k = SAMPLES * p + j
            if (j == 0 or p + 1 < n) and limits[b, 0, k] > 0.0:
                there = j / float(SAMPLES)
                r = 6 * (p + 1)
                step = (1.0 - there) * vec3(y[b, 1, r], y[b, 1, r + 1], y[b, 1, r + 2])
                here = (1.0 - there) * base_x[b, p]
                if j > 0:
                    step += there * vec3(y[b, 1, r + 6], y[b, 1, r + 7], y[b, 1, r + 8])
                    here += there * base_x[b, p + 1]
                limit = limits[b, 0, k]
                normal = vec3(limits[b, 1, k], limits[b, 2, k], limits[b, 3, k])
                pull = vec3(limits[b, 4, k], limits[b, 5, k], limits[b, 6, k])
                v = slip[b, t - 1, k] + here - sample(x, b, t - 1, p, j)
                v -= normal.dot(v) * normal
                step -= normal.dot(step) * normal
                size = v.norm()
                expected = v + step
                if size > limit:
                    expected = (limit * expected - v.dot(step) / size * pull) / size
                expected = shortened(expected, limit)
                for i in ti.static(range(3)):
                    limits[b, 4 + i, k] = expected[i]


@ti.func
def note_forces(
    b: int, t: int, x: ti.template(), q: ti.template(), segments: ti.template(), steps: ti.template(),
    y: ti.template(), fraction: float, expected: ti.template(),
):  # fmt: skip
    """What force is to be expected in each segment at index t after a fraction of the step in column 1."""
    for s in range(x.shape[2] - 1):
        r = 6 * (s + 1)
        went = vec3(
            y[b, 1, r + 6] - y[b, 1, r], y[b, 1, r + 7] - y[b, 1, r + 1], y[b, 1, r + 8] - y[b, 1, r + 2]
        )
        turn = vec3(y[b, 1, r + 3], y[b, 1, r + 4], y[b, 1, r + 5])
        expected[b, s] = stretch_shear_force(
            x[b, t, s + 1] - x[b, t, s], q[b, t, s + 1], segments[b, s, 0] * steps[b, t, 1],
            vec3(segments[b, s, 1], segments[b, s, 2], segments[b, s, 3]), fraction * went, fraction * turn,
        )  # fmt: skip


@ti.func
def near_enough(
    step: float, last_step: float, smooth: bool, mixed: int, shifted: bool, tolerance: float
) -> bool:
    """Whether the iteration ends with a step, by the one before it, too."""
    bend = QUADRATIC_MIXED_1_M if mixed == 1 else QUADRATIC_1_M
    enough = (smooth and step * step * bend < tolerance) or step < tolerance
    enough = enough or (step < ROUNDING and step > 0.5 * last_step)
    if step < FORETOLD and last_step < LARGEST_TURN and not shifted:
        enough = enough or step * (step / last_step) ** 2 < FORETELLS * tolerance
    return enough


@ti.func
def equilibrium(
    b: int, t: int, x: ti.template(), q: ti.template(), first: ti.template(),
    past: ti.template(), slip: ti.template(), sliding: ti.template(), end_q: ti.template(),
    steps: ti.template(), joints: ti.template(), segments: ti.template(), particles: ti.template(),
    contacts: ti.template(), obstacles: ti.template(), grips: ti.template(), clamped: ti.template(),
    moving: int, euler: int, fresh: int, symmetric: int, tolerance: float, most: int,
    added_before: float, upper: ti.template(), lower: ti.template(), factors: ti.template(),
    under: ti.template(), y: ti.template(), limits: ti.template(), expected: ti.template(),
    begin_x: ti.template(), begin_q: ti.template(), base_x: ti.template(), base_q: ti.template(),
    plain: ti.template(),
):  # fmt: skip
    """Newton's method from where the rope was put at index t, to where no force is left.

    added_before: what was added to the Hessian last where steps made it worse.

    Returns:
        whether it converged, or why not; the number of iterations; what was added to the Hessian last.
    """
    kept = added_before
    n = x.shape[2]
    rows = 6 * (n + 1)
    length = segments[b, 0, 0]
    scale_t = joints[b, n // 2, STIFFNESS] / length
    scale_x = scale_t / length**2
    # what bends the whole rope, over that
    whole = 1.0 / (n - 1.0) ** 4
    # what a full step leaves of itself where forces are smooth; else each step is as good as its word
    lawless = True
    for i in range(n):
        lawless = lawless and not laws_act(joints, b, i)
    smooth = lawless and obstacles.shape[1] == 0
    # nothing resists a turn about itself of a rope that neither end holds
    loose = 0.0
    if joints[b, 0, STIFFNESS + 2] == 0.0 and joints[b, n - 1, STIFFNESS + 2] == 0.0:
        loose = LEAST_ADDED
    # no iteration of a rope that falls takes it through an obstacle
    rough, most_m = 0, 1e300
    for k in range(obstacles.shape[1]):
        most_m = ti.min(most_m, passed(b, k, contacts, obstacles))
        if obstacles[b, k, FRICTION] > 0.0 and fresh == 0:
            rough = 1
    done, found = False, UNCONVERGED
    count = 0
    lowest, least, promised = 1e300, 1e300, 0.0
    step, last_step, fraction = 1e300, 1e300, 1.0
    # what is added to the Hessian: where it is not positive definite, and where steps made it worse
    shift, enough, damping, least_shift = 0.0, 0.0, 0.0, LEAST_ADDED
    shifted, exact, fresh_base, left = False, False, False, 0
    # friction first by the limits of the step before, which makes it a potential; then in full
    lagged, rounds, again, noted, nearer = rough, 1, 1, False, False
    # steps that are still free to make it worse
    leaps = 0
    # first with the segments' forces as unknowns of their own, those of the step before to begin with
    mixed = 1 - rough
    astray = False
    # what the energy is rounded by: it may be next to nothing, the difference of large parts
    rounding = 1e-18
    for p in range(n):
        load = vec3(particles[b, p, LOAD], particles[b, p, LOAD + 1], particles[b, p, LOAD + 2])
        rounding += 1e-15 * ti.abs(load.dot(x[b, t, p]))
    keep(b, t, x, q, begin_x, begin_q)
    if mixed == 1:
        note_forces(b, t - 1, x, q, segments, steps, y, 0.0, expected)
    while not done and count < (LONG_WAY if left > 0 else 1) * most:
        count += 1
        # friction by noted limits has a potential
        even = symmetric
        if lawless and lagged == 1:
            even = 1
        energy = assemble(
            b, t, b, x, q, first, past, slip, sliding, end_q, steps, joints, segments, particles,
            contacts, obstacles, grips, clamped, moving, euler, fresh, even, 0, lagged,
            limits, mixed, expected, upper, lower, y, plain,
        )  # fmt: skip
        clear_held(y, b, 0, n, b, grips, clamped)
        # forces without a potential have no energy that falls; then the forces themselves may
        force = 0.0
        if symmetric == 0:
            for r in range(rows):
                force += y[b, 0, r] * y[b, 0, r] / scale_of(r, scale_x, scale_t)
        worse = energy > lowest + 1e-13 * ti.abs(lowest) + rounding
        if symmetric == 0 and lagged == 0:
            worse = force > least and (worse or rough == 1)
        elif symmetric == 0 and not lawless:
            worse = force > least and worse
        worse = worse and shift == 0.0 and not exact and mixed == 0 and leaps == 0
        if worse and fraction > (0.2 if lagged == rough else 0.1):
            # the same step, half as far
            fraction *= 0.5
            stand(b, t, x, q, base_x, base_q, y, fraction)
        elif worse and lagged < rough:
            # the contacts' state goes to and fro: back to the base, with its limits, and nearer with
            # limits noted again and again
            stand(b, t, x, q, base_x, base_q, y, 0.0)
            lagged, noted, nearer = 1, True, True
            rounds = ti.min(4 * rounds, 256)
            again = rounds
            lowest, least, step, fraction = 1e300, 1e300, 1e300, 1.0
            fresh_base = False
        elif worse and damping < MOST_ADDED:
            # another step from the base, in which what is soft goes less far
            stand(b, t, x, q, base_x, base_q, y, 0.0)
            damping = ti.max(LEAST_ADDED, ti.max(10.0 * ti.max(damping, enough), kept / 10.0))
            step, fraction = 1e300, 1.0
            fresh_base = False
        else:
            if fresh_base and damping > 0.0:
                kept = damping
                damping /= 10.0 if lowest - energy > 0.75 * promised else 3.0
                if damping < LEAST_ADDED:
                    damping = 0.0
            lowest, least, fresh_base = energy, force, False
            hold_ends(upper, lower, b, n, b, grips, clamped, even)
            indefinite, added, shift = factor_stiffer(
                upper, lower, factors, under, b, rows, even, exact, 1 - mixed, loose, damping, shift,
                least_shift, enough, scale_x, scale_t,
            )  # fmt: skip
            if mixed == 1 and (indefinite or astray or count > MOST_MIXED):
                # once more from the beginning, now downhill
                mixed = 0
                put_back(b, t, x, q, begin_x, begin_q)
                lowest, least, step, last_step, fraction = 1e300, 1e300, 1e300, 1e300, 1.0
            elif indefinite:
                done, found = True, NOT_FINITE
            else:
                shifted, enough, shift, fresh_base = shift > 0.0, shift, 0.0, True
                for r in range(rows):
                    y[b, 1, r] = y[b, 0, r]
                solve(factors, under, b, y, b, 1, rows, even)
                last_step, step, promised, far = step, 0.0, 0.0, 0.0
                for r in range(rows):
                    went = y[b, 1, r]
                    step = ti.max(step, ti.abs(went))
                    if r % 6 < 3:
                        far = ti.max(far, ti.abs(went))
                    held = added * scale_of(r, scale_x, scale_t)
                    promised += 0.5 * went * (y[b, 0, r] + held * went)
                astray = not (step <= last_step)
                if mixed == 0 and not (step < 1e300):
                    done, found = True, NOT_FINITE
                fraction = ti.min(1.0, LARGEST_TURN / (step + 1e-300))
                if left > 0:
                    fraction = ti.min(fraction, most_m / (far + 1e-300))
                if exact and step > LARGEST_POLISH:
                    fraction = 0.0
                keep(b, t, x, q, base_x, base_q)
                small = near_enough(step, last_step, smooth, mixed, shifted, tolerance)
                if mixed == 1 and not small:
                    note_forces(b, t, x, q, segments, steps, y, fraction, expected)
                if ti.static(not plain):
                    if lagged == 1:
                        note_pulls(b, t, base_x, x, y, slip, limits)
                stand(b, t, x, q, base_x, base_q, y, fraction)
                met = False
                if exact:
                    done = step < tolerance or fraction == 0.0 or step > 0.5 * last_step
                    if done:
                        found = CONVERGED
                elif damping > 0.0:
                    noted = False
                    if step < tolerance:
                        # only an undamped step tells whether any force is left
                        kept, damping = damping, 0.0
                elif lagged == 1:
                    # only what moves no further under the limits that belong to it is an equilibrium
                    met = noted and step < tolerance
                    noted = False
                    if step < LAGGED_ENOUGH / rounds and not met:
                        again -= 1
                        lagged, noted, nearer = 1 if again > 0 else 0, True, True
                        lowest, least, step = 1e300, 1e300, 1e300
                        if lagged == 0:
                            leaps = LEAPS
                            keep(b, t, x, q, begin_x, begin_q)
                else:
                    met = small
                    if leaps > 0 and not met:
                        leaps -= 1
                        if leaps == 0:
                            put_back(b, t, x, q, begin_x, begin_q)
                            lowest, least, step, fraction = 1e300, 1e300, 1e300, 1.0
                            fresh_base = False
                may_fall = symmetric == 1 and (moving == 0 or euler < 0) and left < MOST_LEFT
                if met and shifted and may_fall and least_shift > LEAST_SHIFT * whole:
                    # once more, by as little as tells how steeply the energy falls
                    least_shift, enough, step = LEAST_SHIFT * whole, 0.0, 1e300
                elif met and shifted:
                    steep = 0.0
                    if may_fall:
                        steep = fall(
                            b, n, grips, clamped, factors, under, y, added, scale_x, scale_t
                        )  # fmt: skip
                    if steep > STEEP * whole:
                        # on the way down each step then is about twice the one before
                        left, shift = left + 1, 2.0 * steep
                        stand(b, t, x, q, base_x, base_q, y, 1.0)
                        lowest, least, step, fraction, fresh_base = 1e300, 1e300, 1e300, 1.0, False
                    else:
                        # a stiffer Hessian's step is not what is missing to a saddle
                        exact, lagged, step = True, 0, 1e300
                elif met:
                    done, found = True, CONVERGED
        if ti.static(not plain):
            if nearer:
                note_limits(b, t, x, contacts, obstacles, limits)
                nearer = False
    if ti.static(not plain):
        if rough == 1:
            note_limits(b, t, x, contacts, obstacles, limits)
    return found, count, kept
