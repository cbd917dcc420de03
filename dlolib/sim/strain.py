"""The elastic constraints of Section IV as energies: value, gradient and exact Hessian.

A compliant XPBD constraint C with inverse stiffness alpha is the energy |C|^2 / (2 alpha); here the
stiffnesses are physical (N, N m^2). Rotations vary in material axes, q <- q exp(theta / 2), the Hessians
are with respect to that theta, so Newton's method converges quadratically.
"""

from dlolib.sim.rotations import conjugate, cross_matrix, identity, matrix, product
from dlolib.sim.runtime import mat3, ti, vec3, vec4


@ti.func
def stretch_shear(d: vec3, q: vec4, length: float, stiffness: vec3):
    """Constraint 1, equation (4): gamma = R(q)^T d / l - e3, energy l/2 gamma . K gamma.

    Args:
        d: from the segment's first to its second particle [m].
        q: the segment's frame.
        length: rest length l [m].
        stiffness: K = (GA, GA, EA) [N].

    Returns:
        energy [J]; its gradient to d and theta; its Hessian blocks dd, d-theta and theta-theta.
    """
    rotation = matrix(q)
    u = rotation.transpose() @ d / length
    n = stiffness * (u - vec3(0.0, 0.0, 1.0))
    k = mat3([[stiffness[0], 0.0, 0.0], [0.0, stiffness[1], 0.0], [0.0, 0.0, stiffness[2]]])
    ux = cross_matrix(u)
    energy = 0.5 * length * n.dot(u - vec3(0.0, 0.0, 1.0))
    h_dd = rotation @ k @ rotation.transpose() / length
    h_dt = rotation @ (k @ ux - cross_matrix(n))
    geometric = 0.5 * (n.outer_product(u) + u.outer_product(n)) - n.dot(u) * identity()
    h_tt = length * (ux.transpose() @ k @ ux + geometric)
    return energy, rotation @ n, length * n.cross(u), h_dd, h_dt, h_tt


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
    c = 2.0 + ss * (1 / 3 + ss * (3 / 20 + ss * 5 / 56))
    c1 = 2 / 3 + ss * (3 / 5 + ss * (15 / 28 + ss * 35 / 72))
    c2 = 6 / 5 + ss * (15 / 7 + ss * 35 / 12)
    if ss > 1e-3:
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
    dphi = c * identity() + c1 * v.outer_product(v)
    f = dphi @ moment
    mv = moment.dot(v)
    bend = c1 * (v.outer_product(moment) + moment.outer_product(v) + mv * identity())
    h = dphi @ stiffness @ dphi + bend + c2 * mv * v.outer_product(v)
    # and from v to the two rotations, to second order: dv = jb theta_b - jb^T theta_a + ...
    jb = 0.5 * (w * identity() + cross_matrix(v))
    jbt = jb.transpose()
    own = 0.25 * f.dot(v) * identity()
    mixed = 0.25 * (v.outer_product(f) + f.outer_product(v) + w * cross_matrix(f)) - own
    hj, hjt = h @ jb, h @ jbt
    return -(jb @ f), jbt @ f, jb @ hjt - own, mixed - jb @ hj, mixed.transpose() - jbt @ hjt, jbt @ hj - own


@ti.func
def moment_to_rotations(qa: vec4, qb: vec4, moment: vec3):
    """What a moment [N m] in a joint does to theta_a and theta_b: (dphi/dtheta)^T moment."""
    _phi, w, v, c, c1, _c2 = darboux(qa, qb)
    f = c * moment + c1 * v.dot(moment) * v
    jb = 0.5 * (w * identity() + cross_matrix(v))
    gb = jb.transpose() @ f
    return -(jb @ f), gb


@ti.func
def rotations_to_strain(qa: vec4, qb: vec4, ta: vec3, tb: vec3) -> vec3:
    """dphi for rotations ta, tb of the two frames [rad]: the transpose of `moment_to_rotations`."""
    _phi, w, v, c, c1, _c2 = darboux(qa, qb)
    jb = 0.5 * (w * identity() + cross_matrix(v))
    dv = jb @ tb - jb.transpose() @ ta
    return c * dv + c1 * v.dot(dv) * v
