"""The verdict in words for a person."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dlolib.diagnose.decide import Decision
from dlolib.diagnose.fitting import Fitted
from dlolib.diagnose.residuals import UNLIKELY
from dlolib.diagnose.study import Seen, Study
from dlolib.sim.effects import EFFECTS, parameter
from dlolib.types import Estimate, Ints, Named, Place, Quality

# A sentence holds no more of an effect's parameters than this.
MOST_NUMBERS = 4


def named(study: Study, name: str, probability: float, parameters: Mapping[str, Estimate]) -> Named:
    """One effect of the winning model, its parameters by their own names."""
    own = {key.partition(".")[2]: value for key, value in parameters.items() if key.startswith(f"{name}.")}
    return Named(name, probability, own, _where(study, own, name), _says(name, own))


def _where(
    study: Study, own: Mapping[str, Estimate], name: str
) -> dict[str, tuple[float, float] | None] | None:
    """The stretch of rope or of frames that an effect's own place or time names."""
    length = study.seen[0].recording.rope.length_m
    for part, value in own.items():
        along = parameter(f"{name}.{part}").along
        if along == "rope":
            half = own["width"].value / 2 if "width" in own else 0.0
            return {"s_m": (max(value.value - half, 0.0), min(value.value + half, length)), "frames": None}
        if along == "motion":
            half = own["duration"].value if "duration" in own else 1.0
            seen = [_frames(one, value.value - half, value.value + half) for one in study.seen]
            # frames are numbered in each recording anew: those of the first that was seen then
            inside = next((some for some in seen if len(some)), None)
            frames = None if inside is None else (float(inside.min()), float(inside.max()))
            return {"s_m": None, "frames": frames}
    return None


def _frames(one: Seen, first_s: float, last_s: float) -> Ints:
    """The frame of each point that was seen between two times."""
    points = one.recording.points
    return points.frame[(points.t_s >= first_s) & (points.t_s <= last_s)]


def _says(name: str, own: Mapping[str, Estimate]) -> str:
    """A sentence: what it is, and its numbers, the first ones where there are many."""
    numbers = [_number(part, value) for part, value in own.items()]
    more = f" and {len(numbers) - MOST_NUMBERS} more" if len(numbers) > MOST_NUMBERS else ""
    return f"{EFFECTS[name].SAYS}: {', '.join(numbers[:MOST_NUMBERS])}{more}"


def _number(part: str, value: Estimate) -> str:
    words = part.replace("_", " ")
    if value.low is None or value.high is None:
        return f"{words} {value.value:.3g} {value.unit}".rstrip()
    half = (value.high - value.low) / 2
    return f"{words} {value.value:.3g} ± {half:.2g} {value.unit}".rstrip()


def summary(
    decision: Decision,
    effects: Sequence[Named],
    where: Sequence[Place],
    base: Quality,
    best: Quality,
    asked: str | None,
    several: bool = False,
) -> str:
    """A few sentences: what is missing, where it shows (and of several recordings in which), what that
    changes; `asked` tells a tie apart."""
    before, after = 1e3 * base.rmse_m, 1e3 * best.rmse_m
    if decision.status == "no_mismatch":
        seen = f"An elastic rod explains what was seen ({before:.1f} mm RMS)"
        return f"{seen}: nothing is missing that could show."
    of = f" of {where[0].recording}" if where and several else ""
    place = f" It shows most {_place(where[0])}{of}." if where else ""
    told = "; ".join(one.says for one in effects)
    if decision.status == "unexplained":
        what = f"Something is missing that no effect of the library explains ({before:.1f} mm RMS)."
        worse = " It foretells the held-out frames worse than the elastic rod." if decision.refuted else ""
        return f"{what}{place}{_nearest(decision.winner, told, after)}{worse}"
    rest = "" if best.p_value >= UNLIKELY else ", and what is left is more than noise"
    fall = f"The distance falls from {before:.1f} to {after:.1f} mm RMS{rest}."
    first = f"What an elastic rod leaves out: {told}.{place} {fall}"
    if decision.status == "explained":
        return first
    others = " or ".join(" with ".join(one.effects) for one in decision.tie[1:])
    mend = f"to tell them apart, {asked}" if asked else "no motion of the menu promises to tell them apart"
    return f"{first} It cannot be told from {others}; {mend}."


def _nearest(model: Fitted, told: str, after_mm: float) -> str:
    if not model.effects:
        return ""
    if not told:
        return f" Nearest comes {' with '.join(model.effects)}, which leaves {after_mm:.1f} mm."
    return f" Most of it is taken up by what may come near: {told}; {after_mm:.1f} mm are left."


def _place(place: Place) -> str:
    (lo, hi), (first, last) = place.s_m, place.frames
    return f"between {lo:.2f} and {hi:.2f} m, in frames {first} to {last}"
