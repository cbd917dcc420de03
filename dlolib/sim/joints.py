"""Moment against curvature in one joint: the elastic part, and every law of `effects` beside it.

The step does not know what laws there are. A law is called where its first coefficient is not 0; its history
is two numbers a joint beside the branch that it took, and it sees the curvature now and at the step before.
"""

from dlolib.sim.effects import LAWS
from dlolib.sim.runtime import mat3, ti, vec2, vec3
from dlolib.sim.scene import LAWS as FIRST
from dlolib.sim.scene import PRIOR, REST, STIFFNESS, UNIFORM
from dlolib.sim.strain import darboux

# Of each law: two numbers of history and the branch.
HISTORY = 3 * len(LAWS)


@ti.func
def curvature(q: ti.template(), b: int, t: int, i: int, length: float) -> vec3:
    """Curvatures about the two first material axes and twist [1/m] of joint i at index t."""
    phi, _w, _v, _c, _c1, _c2 = darboux(q[b, t, i], q[b, t, i + 1])
    return phi / length


@ti.func
def law_acts(joints: ti.template(), b: int, i: int, k: int) -> bool:
    """Whether joint i follows law k."""
    return joints[b, i, FIRST + 2 * k] != 0.0


@ti.func
def laws_act(joints: ti.template(), b: int, i: int) -> bool:
    """Whether joint i has any moment beside the elastic one."""
    act = False
    for k in ti.static(range(len(LAWS))):
        act = act or law_acts(joints, b, i, k)
    return act


@ti.func
def branch_of(past: ti.template(), b: int, t: int, i: int, k: ti.template(), forced: int) -> int:
    """The branch that law k took in joint i after index t, or -1 where it is free to choose."""
    branch = -1
    if forced == 1:
        branch = int(past[b, t + 1, i, 3 * k + 2])
    return branch


@ti.func
def elastic(joints: ti.template(), b: int, i: int, now: vec3):
    """Energy a length [N], moment [N m] and its derivative by the curvature, of joint i without laws."""
    d = vec3(joints[b, i, STIFFNESS], joints[b, i, STIFFNESS + 1], joints[b, i, STIFFNESS + 2])
    strain = now - vec3(joints[b, i, REST], joints[b, i, REST + 1], joints[b, i, REST + 2])
    moment = d * strain
    return 0.5 * moment.dot(strain), moment, mat3([[d[0], 0.0, 0.0], [0.0, d[1], 0.0], [0.0, 0.0, d[2]]])


@ti.func
def begin(joints: ti.template(), past: ti.template(), case: int, b: int, t: int, i: int, forced: int):
    """Into past[b, t, i] the histories of a rope that was bent from straight to the curvature it once had.

    Where it had none it has no history. With `forced` the laws take the branches noted at index t.
    """
    prior = vec2(joints[case, i, PRIOR], joints[case, i, PRIOR + 1])
    for k in ti.static(range(len(LAWS))):
        p = vec2(joints[case, i, FIRST + 2 * k], joints[case, i, FIRST + 2 * k + 1])
        after = vec2(0.0)
        branch = 0
        if p[0] != 0.0 and (prior[0] != 0.0 or prior[1] != 0.0):
            _m, after, _w, _mn, _mb, _mp, _hn, _hb, _hp, branch = LAWS[k].respond(
                prior, vec2(0.0), vec2(0.0), vec2(joints[case, i, REST], joints[case, i, REST + 1]), p,
                vec2(joints[case, i, STIFFNESS], joints[case, i, STIFFNESS + 1]), joints[case, i, UNIFORM],
                0.0, branch_of(past, b, t - 1, i, k, forced),
            )  # fmt: skip
        past[b, t, i, 3 * k], past[b, t, i, 3 * k + 1] = after[0], after[1]
        if forced == 0:
            past[b, t, i, 3 * k + 2] = float(branch)


@ti.func
def respond(
    joints: ti.template(), past: ti.template(), case: int, b: int, t: int, i: int, now: vec3, before: vec3,
    dt: float, forced: int, keep: ti.template(), after: ti.template(), side: int,
):  # fmt: skip
    """Energy a length [N], moment [N m] and its derivative by the curvature, of joint i.

    Args:
        joints: `Scene.joints`, read at row `case`.
        past: the laws' histories (B, T + 1, n, HISTORY), read at row b and index t.
        forced: 1 to take the branches that stand at index t + 1, 0 to take them as they come.
        now, before: curvatures and twist at this step and at the one before [1/m].
        dt: time between them [s].
        keep: whether the histories after the step are written into after[b, side, i].
    """
    d = vec3(joints[case, i, STIFFNESS], joints[case, i, STIFFNESS + 1], joints[case, i, STIFFNESS + 2])
    rest = vec3(joints[case, i, REST], joints[case, i, REST + 1], joints[case, i, REST + 2])
    energy, moment, tangent = elastic(joints, case, i, now)
    for k in ti.static(range(len(LAWS))):
        p = vec2(joints[case, i, FIRST + 2 * k], joints[case, i, FIRST + 2 * k + 1])
        if p[0] != 0.0:
            h = vec2(past[b, t, i, 3 * k], past[b, t, i, 3 * k + 1])
            m_law, new, work, m_now, _mb, _mp, _hn, _hb, _hp, _branch = LAWS[k].respond(
                vec2(now[0], now[1]), vec2(before[0], before[1]), h, vec2(rest[0], rest[1]), p,
                vec2(d[0], d[1]), joints[case, i, UNIFORM], dt, branch_of(past, b, t, i, k, forced),
            )  # fmt: skip
            energy += work
            for r in ti.static(range(2)):
                moment[r] += m_law[r]
                if ti.static(keep):
                    after[b, side, i, 3 * k + r] = new[r]
                for c in ti.static(range(2)):
                    tangent[r, c] += m_now[r, c]
    return energy, moment, tangent


@ti.func
def remember(
    joints: ti.template(), past: ti.template(), b: int, t: int, i: int, now: vec3, before: vec3, dt: float
):  # fmt: skip
    """The laws' histories after the step to index t, and the branches that they took, into past[b, t, i]; the
    arguments are those of `respond`."""
    for k in ti.static(range(len(LAWS))):
        p = vec2(joints[b, i, FIRST + 2 * k], joints[b, i, FIRST + 2 * k + 1])
        after = vec2(0.0)
        branch = 0
        if p[0] != 0.0:
            _m, after, _w, _mn, _mb, _mp, _hn, _hb, _hp, branch = LAWS[k].respond(
                vec2(now[0], now[1]), vec2(before[0], before[1]),
                vec2(past[b, t - 1, i, 3 * k], past[b, t - 1, i, 3 * k + 1]),
                vec2(joints[b, i, REST], joints[b, i, REST + 1]), p,
                vec2(joints[b, i, STIFFNESS], joints[b, i, STIFFNESS + 1]), joints[b, i, UNIFORM], dt, -1,
            )  # fmt: skip
        past[b, t, i, 3 * k], past[b, t, i, 3 * k + 1] = after[0], after[1]
        past[b, t, i, 3 * k + 2] = float(branch)


@ti.func
def law_derivatives(
    k: ti.template(), joints: ti.template(), past: ti.template(), b: int, t: int, i: int, now: vec3,
    before: vec3, dt: float,
):  # fmt: skip
    """Of law k: the moment's derivatives by curvature before and history; the history's by all three."""
    _m, _h, _w, _m_now, m_before, m_past, h_now, h_before, h_past, _branch = LAWS[k].respond(
        vec2(now[0], now[1]), vec2(before[0], before[1]),
        vec2(past[b, t, i, 3 * k], past[b, t, i, 3 * k + 1]),
        vec2(joints[b, i, REST], joints[b, i, REST + 1]),
        vec2(joints[b, i, FIRST + 2 * k], joints[b, i, FIRST + 2 * k + 1]),
        vec2(joints[b, i, STIFFNESS], joints[b, i, STIFFNESS + 1]), joints[b, i, UNIFORM], dt,
        branch_of(past, b, t, i, k, 1),
    )  # fmt: skip
    return m_before, m_past, h_now, h_before, h_past
