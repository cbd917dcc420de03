"""The library of effects: a new one is a file here and a line below (a law of bending: in both tuples)."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dlolib.errors import ParameterError
from dlolib.sim.effects import (
    anisotropic_bending,
    axial_stretch,
    camera_pose,
    clock_offset,
    contact_friction,
    end_angle,
    end_compliance,
    end_twist,
    grasp_slip,
    hidden_obstacle,
    inertia_drag,
    internal_friction,
    lateral_load,
    length_error,
    mass_profile,
    nonlinear_bending,
    plastic_bending,
    prior_history,
    rest_curvature,
    stiffness_profile,
    viscoelastic_bending,
)
from dlolib.sim.effects.base import Effect, Law, Parameter, Setup
from dlolib.sim.scene import LAWS as FIRST_COLUMN
from dlolib.sim.scene import STIFFNESS

# Moments in the joints; the step calls each of them by its place here, not by its name.
LAWS: tuple[Law, ...] = (nonlinear_bending, plastic_bending, internal_friction, viscoelastic_bending)
# Everything else, in the order in which it is applied.
CHANGES: tuple[Effect, ...] = (
    length_error,
    rest_curvature,
    prior_history,
    anisotropic_bending,
    stiffness_profile,
    axial_stretch,
    mass_profile,
    inertia_drag,
    lateral_load,
    end_angle,
    end_twist,
    end_compliance,
    grasp_slip,
    contact_friction,
    hidden_obstacle,
    clock_offset,
    camera_pose,
)
EFFECTS: dict[str, Effect | Law] = {law.NAME: law for law in LAWS} | {
    change.NAME: change for change in CHANGES
}
JOINT_WIDTH = FIRST_COLUMN + 2 * len(LAWS)


@functools.cache
def parameter(name: str) -> Parameter:
    """The parameter `<effect>.<parameter>`.

    Raises:
        ParameterError: there is no such effect or parameter.
    """
    group, _, part = name.partition(".")
    if group not in EFFECTS:
        raise ParameterError(f"unknown effect {group!r}", mend=f"choose from {', '.join(sorted(EFFECTS))}")
    found = {p.name: p for p in EFFECTS[group].PARAMETERS}
    if part not in found:
        raise ParameterError(f"{group} has no parameter {part!r}", mend=f"choose from {', '.join(found)}")
    return found[part]


def named(name: str, parts: Mapping[str, float]) -> dict[str, float]:
    """An effect with some of its parameters, `<effect>.<parameter>` each, as `applied` takes them.

    Raises:
        ParameterError: there is no such effect or parameter, or a value is out of range.
    """
    for part, value in parts.items():
        check(f"{name}.{part}", value)
    if not parts:
        known = EFFECTS.get(name)
        usual = getattr(known, "NAMED", {})
        if not usual:
            listed = ", ".join(p.name for p in known.PARAMETERS) if known else ", ".join(sorted(EFFECTS))
            problem = f"{name} without parameters" if known else f"unknown effect {name!r}"
            raise ParameterError(problem, mend=f"choose from {listed}")
        parts = usual
    return {f"{name}.{part}": float(value) for part, value in parts.items()}


def check(name: str, value: float, beyond: float = 0.0) -> None:
    """Refuse a parameter's value that is beyond a bound by more than that share of its scale or of the bound.

    Raises:
        ParameterError: it is, or there is no such parameter.
    """
    known = parameter(name)
    low, high = (
        bound + sign * beyond * max(known.scale, abs(bound)) if np.isfinite(bound) else bound
        for bound, sign in ((known.low, -1), (known.high, 1))
    )
    if value != known.neutral and not low <= value <= high:
        problem = f"{name} = {value:g} is out of range"
        mend = f"give one from {known.low:g} to {known.high:g} {known.unit}".rstrip()
        raise ParameterError(problem, mend=mend)


def of_the_rope(values: Mapping[str, float]) -> tuple[dict[str, float], tuple[str, ...]]:
    """Of a rod's values those that it takes along to another place, and the effects of the others: these
    belong to one recording."""
    effects = dict.fromkeys(name.partition(".")[0] for name in values if "." in name)
    stay = tuple(name for name in effects if getattr(EFFECTS.get(name), "OF_RECORDING", False))
    return {name: value for name, value in values.items() if name.partition(".")[0] not in stay}, stay


def applied(setup: Setup, values: Mapping[str, float]) -> Setup:
    """The set-up with all effects in it that the values name, `<effect>.<parameter>` each.

    A parameter of a named effect that is not given is neutral, unless the effect says otherwise (`NAMED`).
    """
    given: dict[str, dict[str, float]] = {}
    for name, value in values.items():
        parameter(name)
        group, _, part = name.partition(".")
        given.setdefault(group, {})[part] = float(value)
    for change in CHANGES:
        if change.NAME in given:
            setup = change.apply(setup, _whole(change, given[change.NAME]))
    for number, law in enumerate(LAWS):
        if law.NAME in given:
            pair = law.coefficients(_whole(law, given[law.NAME]))
            if any(pair):
                setup = _bending_by(setup, number, pair)
    return setup


def _bending_by(setup: Setup, number: int, pair: tuple[float, float]) -> Setup:
    """The set-up with the law of this number, by its two coefficients, in every joint that holds a moment."""
    law, column = LAWS[number], FIRST_COLUMN + 2 * number
    # the joint of an end that nobody holds has no stiffness, and no law puts a moment there
    holds = setup.joints[:, [STIFFNESS]] > 0
    has_potential = law.SYMMETRIC or (getattr(law, "ROUND", False) and setup.is_round)
    relaxes_s = pair[law.RELAXES] if hasattr(law, "RELAXES") else np.inf
    return replace(
        setup.with_joints(slice(column, column + 2), holds * np.asarray(pair)),
        symmetric=setup.symmetric and has_potential,
        path_dependent=setup.path_dependent or not getattr(law, "FORGETS", False),
        relaxes_s=min(setup.relaxes_s, relaxes_s),
    )


def _whole(effect: Effect | Law, given: Mapping[str, float]) -> dict[str, float]:
    named = getattr(effect, "NAMED", {})
    neutral = {p.name: named.get(p.name, p.neutral) for p in effect.PARAMETERS}
    return {**neutral, **given}


__all__ = [
    "CHANGES",
    "EFFECTS",
    "JOINT_WIDTH",
    "LAWS",
    "Effect",
    "Law",
    "Parameter",
    "Setup",
    "applied",
    "check",
    "named",
    "of_the_rope",
    "parameter",
]
