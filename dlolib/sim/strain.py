"""The elastic constraints of Section IV as energies: value, gradient and exact Hessian.

A compliant XPBD constraint C with inverse stiffness alpha is the energy |C|^2 / (2 alpha); here the
stiffnesses are physical (N, N m^2). Rotations vary in material axes, q <- q exp(theta / 2), the Hessians
are with respect to that theta, so Newton's method converges quadratically.
"""

from math import comb

from dlolib.sim.rotations import conjugate, matrix, product
from dlolib.sim.runtime import mat3, ti, vec3, vec4

# Where |v|^2 is no more than this, 2 asin(|v|) / |v| is its series to the last bit.
SERIES = 0.03
ARCSINE = tuple(2 * comb(2 * k, k) / (4**k * (2 * k + 1)) for k in range(11))


@ti.func
def stretch_shear(d: vec3, q: vec4, length: float, stiffness: vec3, mixed: int, expected: vec3):
    """Constraint 1, equation (4): gamma = R(q)^T d / l - e3, energy l/2 gamma . K gamma.

    Args:
        d: from the segment's first to its second particle [m].
        q: the segment's frame.
        length: rest length l [m].
        stiffness: K = (GA, GA, EA) [N].
        mixed, expected: whether the Hessian is that under the expected force [N], or under K gamma.

    Returns:
        energy [J]; its gradient to d and theta; its Hessian blocks dd, d-theta and theta-theta.
    """
    rotation = matrix(q)
    u = rotation.transpose() @ d / length
    k = stiffness
    own = k * (u - vec3(0.0, 0.0, 1.0))
    energy = 0.5 * length * own.dot(u - vec3(0.0, 0.0, 1.0))
    n = own
    if mixed == 1:
        n = expected
    # products with K and with the cross matrices of u and n, written out: a compiler keeps their zeros
    h_dd, h_dt, per_length = mat3(0.0), mat3(0.0), 1.0 / length
    for i in ti.static(range(3)):
        for j in ti.static(range(3)):
            flat = rotation[i, 0] * k[0] * rotation[j, 0] + rotation[i, 1] * k[1] * rotation[j, 1]
            h_dd[i, j] = (flat + rotation[i, 2] * k[2] * rotation[j, 2]) * per_length
            a, c = ti.static((j + 1) % 3, (j + 2) % 3)
            h_dt[i, j] = rotation[i, a] * (k[a] * u[c] - n[c]) - rotation[i, c] * (k[c] * u[a] - n[a])
    h_tt = mat3(0.0)
    for i in ti.static(range(3)):
        a, c = ti.static((i + 1) % 3, (i + 2) % 3)
        h_tt[i, i] = length * (k[a] * u[c] * u[c] + k[c] * u[a] * u[a] - n[a] * u[a] - n[c] * u[c])
        h_tt[i, a] = length * (0.5 * (n[i] * u[a] + u[i] * n[a]) - k[c] * u[i] * u[a])
        h_tt[a, i] = h_tt[i, a]
    return energy, rotation @ own, length * own.cross(u), h_dd, h_dt, h_tt


@ti.func
def stretch_shear_force(d: vec3, q: vec4, length: float, stiffness: vec3, went: vec3, turn: vec3) -> vec3:
    """K gamma [N] of a segment to first order, after d grew by `went` [m] and the frame turned [rad]."""
    rotation = matrix(q).transpose()
    u = rotation @ d / length
    return stiffness * (u - vec3(0.0, 0.0, 1.0) + rotation @ went / length + u.cross(turn))


@ti.func
def darboux(qa: vec4, qb: vec4):
    """Rotation vector from frame a to frame b, phi = c v with (w, v) = conj(qa) qb, equation (7).

    The paper's Omega is v alone; phi = 2 asin(|v|) v / |v| is the same while bends are gentle and stays
    the angle where they are not (the formats' curvature times length).

    Returns:
        phi; w and v with w >= 0; c and its derivatives c1 = c'/|v|, c2 = c1'/|v|.
    """
    p = product(conjugate(qa), qb)
    if p[0] < 0.0:
        p = -p
    w = p[0]
    v = vec3(p[1], p[2], p[3])
    ss = v.dot(v)
    c, c1, c2 = 0.0, 0.0, 0.0
    if ss <= SERIES:
        for k in ti.static(range(len(ARCSINE) - 1, -1, -1)):
            c = c * ss + ARCSINE[k]
            if ti.static(k > 0):
                c1 = c1 * ss + 2 * k * ARCSINE[k]
            if ti.static(k > 1):
                c2 = c2 * ss + 4 * k * (k - 1) * ARCSINE[k]
    else:
        s = ti.sqrt(ss)
        c = 2.0 * ti.atan2(s, w) / s
        c1 = (2.0 / w - c) / ss
        c2 = (2.0 / (w * w * w) - 3.0 * c1) / ss
    return c * v, w, v, c, c1, c2


@ti.func
def bend_twist(w: float, v: vec3, c: float, c1: float, c2: float, moment: vec3, stiffness: mat3):
    """Constraint 2, equation (7): what the moment in a joint does to its two frames.

    Args:
        w, v, c, c1, c2: what `darboux` says of the frames.
        moment: derivative of the joint's energy by the rotation vector phi between them [N m].
        stiffness: and the moment's by phi [N m]; not symmetric where the moment has no potential.

    Returns:
        gradient to theta_a and theta_b; Hessian aa, ab, ba, bb.
    """
    # chain rule from phi to v: dphi = (c + c1 v v^T) dv
    mv = moment.dot(v)
    f = c * moment + c1 * mv * v
    kv = stiffness @ v
    left, right = c * kv + moment, c * (stiffness.transpose() @ v) + moment
    along = c1 * c1 * v.dot(kv) + c2 * mv
    h = mat3(0.0)
    for i in ti.static(range(3)):
        for j in ti.static(range(3)):
            h[i, j] = c * c * stiffness[i, j] + c1 * (left[i] * v[j] + v[i] * right[j]) + along * v[i] * v[j]
    # and from v to the two rotations, to second order: dv = jb theta_b - jb^T theta_a + ...
    own = 0.25 * f.dot(v)
    mixed = 0.25 * (v.outer_product(f) + f.outer_product(v))
    for i in ti.static(range(3)):
        a, d = ti.static((i + 1) % 3, (i + 2) % 3)
        h[i, i] += c1 * mv
        mixed[i, i] -= own
        mixed[a, i] += 0.25 * w * f[d]
        mixed[i, a] -= 0.25 * w * f[d]
    ht = h.transpose()
    hj, hjt = half_turn(w, v, ht, -1.0).transpose(), half_turn(w, v, ht, 1.0).transpose()
    aa, bb = half_turn(w, v, hjt, 1.0), half_turn(w, v, hj, -1.0)
    for i in ti.static(range(3)):
        aa[i, i] -= own
        bb[i, i] -= own
    ab, ba = mixed - half_turn(w, v, hj, 1.0), mixed.transpose() - half_turn(w, v, hjt, -1.0)
    ga, gb = 0.5 * (w * f + v.cross(f)), 0.5 * (w * f - v.cross(f))
    return -ga, gb, aa, ab, ba, bb


@ti.func
def half_turn(w: float, v: vec3, a: mat3, side: float) -> mat3:
    """jb @ a where side is 1, jb^T @ a where it is -1, with jb = (w + v x) / 2."""
    found = 0.5 * w * a
    h = 0.5 * side * v
    for j in ti.static(range(3)):
        found[0, j] += h[1] * a[2, j] - h[2] * a[1, j]
        found[1, j] += h[2] * a[0, j] - h[0] * a[2, j]
        found[2, j] += h[0] * a[1, j] - h[1] * a[0, j]
    return found


@ti.func
def moment_to_rotations(w: float, v: vec3, c: float, c1: float, moment: vec3):
    """What a moment [N m] in a joint does to theta_a and theta_b: (dphi/dtheta)^T moment.

    w, v, c, c1: what `darboux` says of the frames.
    """
    f = c * moment + c1 * v.dot(moment) * v
    return -0.5 * (w * f + v.cross(f)), 0.5 * (w * f - v.cross(f))


@ti.func
def rotations_to_strain(w: float, v: vec3, c: float, c1: float, ta: vec3, tb: vec3) -> vec3:
    """dphi for rotations ta, tb of the two frames [rad]: the transpose of `moment_to_rotations`."""
    dv = 0.5 * (w * (tb - ta) + v.cross(ta + tb))
    return c * dv + c1 * v.dot(dv) * v
