"""What is known of a rope: its density and the parameters of its rod, stored by a fit or given by hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace

from dlolib.errors import ParameterError
from dlolib.types import PER_DENSITY, Estimate, Fit, Rope

STIFFNESSES = ("bending_stiffness", "torsional_stiffness")
RATIO = "_over_density"


@dataclass(frozen=True)
class RopeValues:
    """A rope with its density, and the parameters of its rod by name; bending and torsional stiffness
    [N m^2] are always among them (m^4/s^2 where the density is not known)."""

    rope: Rope
    parameters: Mapping[str, float]


def rope_values(rope: Rope, name: str, fit: Fit | None, values: Mapping[str, float]) -> RopeValues:
    """The rope of the recording or layout `name` with a fit's parameters and, over them, given values.

    The fit's nuisances apply to the recording that they are stored under. Stiffnesses over density, forces
    and masses that are such are multiplied by the rope's density, or stay where it is not known (it is then
    simulated as 1 kg/m).
    A torsional stiffness that nothing tells equals the bending stiffness, as for a round solid rope to
    within a third.

    Raises:
        ParameterError: no bending stiffness, or one in N m^2 for a rope of unknown density.
    """
    if "linear_density" in values:
        rope = _of_density(rope, values["linear_density"])
    _say_another(rope, name, None if fit is None else fit.rope)
    parameters: dict[str, float] = {}
    for key, estimate in _stored(fit, name):
        _check_stored(key, estimate.value)
        if key in STIFFNESSES and rope.linear_density_kg_m is None:
            problem = f"the stored {key} is in {estimate.unit}, but the density of {rope.name} is not known"
            mend = "give its linear_density_kg_m there, or, where a command has it, --set linear_density"
            raise ParameterError(problem, place=name, mend=mend)
        of_density = key.endswith(RATIO) or estimate.unit.endswith(PER_DENSITY)
        ratio = (rope.linear_density_kg_m or 1.0) if of_density else 1.0
        known = key.removesuffix(RATIO)
        parameters[known] = parameters.get(known, 0.0) + estimate.value * ratio
    if rope.linear_density_kg_m is None and any(key in values for key in STIFFNESSES):
        from dlolib.formats import say

        unknown = f"the density of {rope.name} is not known: it is simulated as 1 kg/m"
        say([f"{unknown}, and what --set gives in N m^2 counts as m^4/s^2; give --set linear_density=VALUE"])
    parameters |= {key: value for key, value in values.items() if key != "linear_density"}
    if "bending_stiffness" not in parameters:
        mend = "give --set bending_stiffness=VALUE (N m^2), --fit FILE or --verdict FILE"
        raise ParameterError("no bending_stiffness is given", place=name, mend=mend)
    parameters.setdefault("torsional_stiffness", parameters["bending_stiffness"])
    _check_places(rope, parameters)
    return RopeValues(rope, parameters)


def with_effects(known: RopeValues, effects: Mapping[str, float]) -> RopeValues:
    """The rope with effects over what is known of it.

    Raises:
        ParameterError: one is at a place beyond the rope.
    """
    from dlolib.formats import say
    from dlolib.sim.rod import unit_of

    rope, parameters = known.rope, {**known.parameters, **effects}
    _check_places(rope, parameters)
    weighs = [name for name in effects if unit_of(name, weighed=False).endswith(PER_DENSITY)]
    if rope.linear_density_kg_m is None and weighs:
        unit = f"{unit_of(weighs[0])} counts as {unit_of(weighs[0], weighed=False)}"
        problem = f"the density of {rope.name} is not known: what {weighs[0]} has in {unit}"
        say([f"{problem}; give --set linear_density=VALUE"])
    return RopeValues(rope, parameters)


def _of_density(rope: Rope, density_kg_m: float) -> Rope:
    """The rope with another density, which a file could say of it, too."""
    from pydantic import ValidationError

    from dlolib.formats._schema import RopeModel

    changed = replace(rope, linear_density_kg_m=density_kg_m)
    try:
        RopeModel.model_validate(asdict(changed))
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]["msg"].removeprefix("Value error, ")
        problem, _, mend = problem.partition(": ")
        place = f"--set linear_density={density_kg_m:g}"
        raise ParameterError(problem, place=place, mend=mend or "give kg/m") from error
    return changed


def _say_another(rope: Rope, name: str, stored: Rope | None) -> None:
    """Say that what is stored was found on another rope; its length may be another piece's."""
    from dlolib.formats import say

    if stored is None:
        return
    for what in ("name", "diameter_m", "linear_density_kg_m"):
        here, there = getattr(rope, what), getattr(stored, what)
        if None not in (here, there) and here != there:
            problem = f"{name} has object.{what} = {here!r}, the stored parameters are of {there!r}"
            say([f"{problem}; they are taken all the same"])
            return


def _check_stored(key: str, value: float) -> None:
    """Refuse a stored parameter that no rod has."""
    from dlolib.sim.effects import check

    try:
        if key.removesuffix(RATIO) not in STIFFNESSES:
            check(key, value)
        elif not 0 < value < float("inf"):
            raise ParameterError(f"{value:g} is not a positive number", mend="give one above 0")
    except ParameterError as error:
        raise ParameterError(error.problem, place=f"--fit or --verdict: {key}", mend=error.mend) from error


def elsewhere(known: RopeValues) -> RopeValues:
    """What goes along to another place: how one recording was held and seen is left out, and that is said."""
    from dlolib.formats import say
    from dlolib.sim.effects import of_the_rope

    parameters, stay = of_the_rope(known.parameters)
    if stay:
        say([f"{', '.join(stay)}: of the recording and not of the rope, left out"])
    return replace(known, parameters=parameters)


def _check_places(rope: Rope, parameters: Mapping[str, float]) -> None:
    """Refuse an effect at a place beyond the rope's end, as one that was found on a longer rope.

    Raises:
        ParameterError: names it and the rope's length.
    """
    from dlolib.sim.effects import parameter

    for name, value in parameters.items():
        if name not in STIFFNESSES and parameter(name).along == "rope" and value > rope.length_m:
            problem = f"{name} = {value:g} m is beyond the end of a rope of {rope.length_m:g} m"
            raise ParameterError(problem, mend="give a place on it")


def _stored(fit: Fit | None, name: str) -> list[tuple[str, Estimate]]:
    """What all recordings share, and what one has for itself, which comes on top."""
    return [] if fit is None else [*fit.parameters.items(), *fit.nuisances.get(name, {}).items()]
