"""Quaternions (w, x, y, z) inside kernels."""

from dlolib.sim.runtime import mat3, ti, vec3, vec4


@ti.func
def product(p: vec4, q: vec4) -> vec4:
    """Hamilton product p q."""
    return vec4(
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    )


@ti.func
def conjugate(q: vec4) -> vec4:
    """The inverse of a unit quaternion."""
    return vec4(q[0], -q[1], -q[2], -q[3])


@ti.func
def rotated(q: vec4, angle: vec3) -> vec4:
    """q exp(angle / 2): the frame q turned by the rotation vector `angle` [rad] in its own axes."""
    half = 0.5 * angle.norm()
    sinc = 0.5 * (1.0 - half * half / 6.0)
    if half > 1e-4:
        sinc = 0.5 * ti.sin(half) / half
    return product(q, vec4(ti.cos(half), sinc * angle[0], sinc * angle[1], sinc * angle[2])).normalized()


@ti.func
def matrix(q: vec4) -> mat3:
    """R(q): material axes to world axes."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return mat3(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@ti.func
def identity() -> mat3:
    """The 3 x 3 identity."""
    return mat3([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
