"""Hold verdicts against answers: right, tied, confidently wrong, and how often, with Wilson's intervals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest, halfnorm, norm

from dlolib.proof.gain import DETECTABLE

Answer = Mapping[str, Any]
Verdict = Mapping[str, Any]

MOST_IN_TIE, PLACE_M = 3, 0.015
CONFIDENTLY_WRONG = ("wrong", "missed")
# What a row says of intervals; versions may differ in these alone.
INTERVALS = ("covered", "covered_forms")
# With these a rope has sides.
DIRECTED = frozenset({"anisotropic_bending", "rest_curvature"})
PLACED = ("stiffness_profile", "mass_profile")
# So many quantiles stand for what chance draws.
DRAWN = 200
# How far off EI is at least without the named effect, to see by how much that effect mends it.
BIASED = (0.01, 0.02, 0.05, 0.1)
# Parameters that mean the same in the laboratory's laws as in formats.md.
FORM_FREE = frozenset(
    {
        "anisotropic_bending.stiffness_ratio",
        "axial_stretch.axial_stiffness",
        "camera_pose.depth",
        "camera_pose.rotation_1",
        "camera_pose.rotation_2",
        "camera_pose.rotation_3",
        "clock_offset.time",
        "contact_friction.coefficient",
        "end_angle.end_1",
        "end_angle.end_2",
        "end_angle.start_1",
        "end_angle.start_2",
        "end_compliance.end_stiffness",
        "end_compliance.start_stiffness",
        "end_twist.end",
        "end_twist.start",
        "grasp_slip.length",
        "grasp_slip.time",
        "inertia_drag.drag",
        "lateral_load.x",
        "lateral_load.y",
        "length_error.relative",
        "mass_profile.gradient",
        "mass_profile.mass",
        "mass_profile.s",
        "rest_curvature.kappa_1",
        "rest_curvature.kappa_2",
        "stiffness_profile.s",
    }
)


def accepted(names: Sequence[str], answer: Answer) -> bool:
    """Whether these effects are the true set: all detectable ones, and nothing that is not there.

    Where no member is detectable because each explains the pair alone, one of them must be named.
    """
    said, true = set(names), set(answer["effects"])
    something = bool(said) or answer["elastic_gain"] < DETECTABLE
    return set(answer["detectable"]) <= said <= true and something


def named(verdict: Verdict) -> list[str]:
    """The names of the winning model's effects."""
    return sorted(effect["name"] for effect in verdict["effects"])


def outcome(verdict: Verdict | None, answer: Answer) -> str:
    """ "right", "tied", "wrong" (confidently), "missed" (so too), "undecided" or "failed" (no verdict)."""
    if verdict is None:
        return "failed"
    status = verdict["status"]
    if status == "no_mismatch":
        return "right" if accepted((), answer) else "missed"
    if status == "explained":
        return "right" if accepted(named(verdict), answer) else "wrong"
    tie = verdict["equivalent"]
    if status == "ambiguous" and len(tie) <= MOST_IN_TIE and any(accepted(one, answer) for one in tie):
        return "tied"
    return "undecided"


def owns_up(verdict: Verdict | None, taken_out: str) -> bool:
    """Whether a diagnosis that lacks the true effect says so, or names the one that does nearly the same."""
    if verdict is None:
        return False
    twins = ({"internal_friction", "plastic_bending"},)
    swapped = any({taken_out, *named(verdict)} == pair for pair in twins)
    return verdict["status"] in ("unexplained", "ambiguous") or swapped


def score(verdict: Verdict | None, answer: Answer) -> dict[str, Any]:
    """One recording's row: what is true, what was said, and how that is judged."""
    row: dict[str, Any] = {
        "true": sorted(answer["effects"]),
        "detectable": list(answer["detectable"]),
        "elastic_gain": answer["elastic_gain"],
        "status": None if verdict is None else verdict["status"],
        "named": [] if verdict is None else named(verdict),
        "tie": [] if verdict is None else list(verdict["equivalent"]),
        "outcome": outcome(verdict, answer),
        "everywhere": {
            "detectable": list(answer["everywhere"]["detectable"]),
            "outcome": outcome(verdict, {**answer, **answer["everywhere"]}),
        },
    }
    if verdict is not None and row["named"]:
        row |= {"heldout": _heldout(verdict)}
    if verdict is not None and row["outcome"] == "right" and row["named"]:
        row |= {"covered": _covered(verdict, answer), "place_error_m": _place_error(verdict, answer)}
        row["covered_forms"] = _inside(_parameters(verdict), answer["nearest"])
        row["stiffness_error"] = {
            part: _stiffness_error(verdict[part], answer) for part in ("baseline", "augmented")
        }
        row["stiffness_deviation"] = _stiffness_deviation(verdict)
    return row


def summarise(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The figures of issue 4's table over all rows, and over those with something detectable alone where
    what is named without being that counts, too."""
    found = [row for row in rows if row["detectable"]]
    nulls = [row for row in rows if not row["true"]]
    pairs = [row for row in found if len(row["detectable"]) == 2]
    small = [row for row in rows if row["true"] and not row["detectable"]]
    outcomes = Counter(row["outcome"] for row in found)
    confusion = Counter((" + ".join(row["true"]) or "nothing", _said(row)) for row in rows)
    return {
        "recordings": len(rows),
        "drawn": _drawn(rows),
        "detectable": len(found),
        "outcomes": dict(sorted(outcomes.items())),
        "right_or_tied": share(outcomes["right"] + outcomes["tied"], len(found)),
        "tied": share(outcomes["tied"], len(found)),
        "confidently_wrong": share(sum(outcomes[one] for one in CONFIDENTLY_WRONG), len(found)),
        "missed": share(outcomes["missed"], len(found)),
        # neither among the detectable nor among the alarms, and named all the same
        "wrong_of_too_small": share(sum(row["outcome"] in CONFIDENTLY_WRONG for row in small), len(small)),
        "false_alarms": share(sum(row["status"] != "no_mismatch" for row in nulls), len(nulls)),
        "pairs_both_named": share(sum(_all_named(row) for row in pairs), len(pairs)),
        "heldout_better": _share_of(rows, "than_elastic"),
        "heldout_better_than_black_box": _share_of(rows, "than_black_box"),
        "everywhere": _everywhere(rows),
        "by_effect": _by_effect(found),
        "coverage": _coverage(rows, "covered"),
        "coverage_forms": _coverage(rows, "covered_forms"),
        "place": _places(rows),
        "where_detectable": {
            "heldout_better": _share_of(found, "than_elastic"),
            "heldout_better_than_black_box": _share_of(found, "than_black_box"),
            "place": _places(found),
            "coverage": _coverage(found, "covered")["all"],
        },
        "stiffness_bias": _bias(rows),
        "confusion": [
            {"true": true, "said": said, "count": count} for (true, said), count in sorted(confusion.items())
        ],
    }


def _drawn(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """How often each effect was drawn alone; how many pairs, and of how many combinations."""
    pairs = [tuple(sorted(row["true"])) for row in rows if len(row["true"]) > 1]
    alone = Counter(row["true"][0] for row in rows if len(row["true"]) == 1)
    return {"alone": dict(sorted(alone.items())), "pairs": len(pairs), "combinations": len(set(pairs))}


def _share_of(rows: Sequence[Mapping[str, Any]], key: str) -> dict[str, Any]:
    told = [row["heldout"][key] for row in rows if row.get("heldout")]
    return share(sum(told), len(told))


def _everywhere(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The first shares where the held-out frames, which no diagnosis fits, count for what is detectable."""
    both = [row["everywhere"] for row in rows if "everywhere" in row]  # rows of earlier versions lack it
    ends = [one["outcome"] for one in both if one["detectable"]]
    return {
        "right_or_tied": share(ends.count("right") + ends.count("tied"), len(ends)),
        "confidently_wrong": share(sum(ends.count(one) for one in CONFIDENTLY_WRONG), len(ends)),
    }


def share(count: int, total: int) -> dict[str, Any]:
    """A share with Wilson's 95 % interval; null of nothing."""
    if not total:
        return {"count": count, "of": total, "share": None, "low": None, "high": None}
    interval = binomtest(count, total).proportion_ci(0.95, method="wilson")
    return {
        "count": count,
        "of": total,
        "share": count / total,
        "low": float(interval.low),
        "high": float(interval.high),
    }


def _all_named(row: Mapping[str, Any]) -> bool:
    return set(row["detectable"]) <= set(row["named"])


def _said(row: Mapping[str, Any]) -> str:
    if row["status"] == "ambiguous":
        return "tie: " + " | ".join(sorted(" + ".join(sorted(one)) for one in row["tie"]))
    named = " + ".join(row["named"])
    if row["status"] == "unexplained" and named:
        return f"unexplained, and {named}"
    return named or str(row["status"])


def _by_effect(found: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    alone = [row for row in found if len(row["true"]) == 1]
    names = sorted({row["true"][0] for row in alone})
    return {name: dict(Counter(row["outcome"] for row in alone if row["true"] == [name])) for name in names}


def _parameters(verdict: Verdict) -> dict[str, Mapping[str, Any]]:
    return {
        f"{effect['name']}.{name}": estimate
        for effect in verdict["effects"]
        for name, estimate in effect["parameters"].items()
    }


def _covered(verdict: Verdict, answer: Answer) -> dict[str, bool]:
    """Whether the 95 % intervals hold the truth, of EI and of what does not depend on a law's form."""
    said = _parameters(verdict)
    held = {name: inside for name, inside in _inside(said, answer["parameters"]).items() if name in FORM_FREE}
    held |= _rolled(said, answer)
    if not answer["parameters"].get("mass_profile", {}).get("mass", 1.0):
        held.pop("mass_profile.s", None)  # a gradient has no place
    stiffness = verdict["augmented"]["parameters"].get("bending_stiffness")
    if stiffness is not None:
        held["bending_stiffness"] = _holds(stiffness, answer["bending_stiffness"])
    return held


def _rolled(said: Mapping[str, Any], answer: Answer) -> dict[str, bool]:
    """Whether the interval of one end's roll holds what the other was rolled by, the other way round: a rope
    that bends alike about all axes feels the difference alone."""
    true = answer["parameters"].get("end_twist", {})
    if len(true) != 1 or not DIRECTED.isdisjoint(answer["effects"]):
        return {}
    ((end, value),) = true.items()
    names = f"end_twist.{end}", f"end_twist.{'start' if end == 'end' else 'end'}"
    if names[0] in said or names[1] not in said:
        return {}
    return {names[0]: _holds(said[names[1]], -value)}


def _inside(said: Mapping[str, Any], true: Mapping[str, Mapping[str, float]]) -> dict[str, bool]:
    """Whether the intervals of what was said hold these values, by `<effect>.<parameter>`."""
    return {
        f"{effect}.{name}": _holds(said[f"{effect}.{name}"], value)
        for effect, values in true.items()
        for name, value in values.items()
        if f"{effect}.{name}" in said
    }


def _holds(estimate: Mapping[str, Any], value: float) -> bool:
    low = -np.inf if estimate["low"] is None else estimate["low"]
    high = np.inf if estimate["high"] is None else estimate["high"]
    return bool(low <= value <= high)


def _heldout(verdict: Verdict) -> dict[str, bool] | None:
    """Whether the winner foretells the held-out frames better than the elastic rod and than the black box."""
    names, change = set(named(verdict)), {}
    for one in verdict["candidates"]:
        if one["kind"] == "black_box" or set(one["effects"]) == names:
            change[one["kind"] == "black_box"] = one["heldout_delta_chi2"]
    if None in (change.get(True), change.get(False)):
        return None
    return {"than_elastic": change[False] < 0, "than_black_box": change[False] < change[True]}


def _place_error(verdict: Verdict, answer: Answer) -> dict[str, float]:
    """Distance of named places from the true ones [m]: along the rope, or of a sphere's surface."""
    said, errors = _parameters(verdict), {}
    for effect in PLACED:
        true = answer["parameters"].get(effect, {})
        if true.get("mass", 1.0) and f"{effect}.s" in said and "s" in true:
            errors[effect] = abs(said[f"{effect}.s"]["value"] - true["s"])
    ball = [said.get(f"hidden_obstacle.{name}") for name in ("x", "y", "z", "radius")]
    if answer.get("touch_m") and all(ball):
        x, y, z, radius = (estimate["value"] for estimate in ball if estimate)
        reach = np.linalg.norm(np.array(answer["touch_m"]) - [x, y, z])
        errors["hidden_obstacle"] = float(abs(reach - radius))
    return errors


def _stiffness_error(part: Mapping[str, Any], answer: Answer) -> float | None:
    found = part["parameters"].get("bending_stiffness")
    return None if found is None else found["value"] / answer["bending_stiffness"] - 1


def _stiffness_deviation(verdict: Verdict) -> float | None:
    """EI's standard deviation beside the named effects, over EI, as its interval has it; None: has none."""
    found = verdict["augmented"]["parameters"].get("bending_stiffness")
    if found is None or None in (found["low"], found["high"]):
        return None
    wide = 2 * norm.ppf(0.975)
    return float((found["high"] - found["low"]) / wide / found["value"])


def _coverage(rows: Sequence[Mapping[str, Any]], key: str) -> dict[str, Any]:
    held = [(name, inside) for row in rows for name, inside in row.get(key, {}).items()]
    names = sorted({name for name, _ in held})
    each = {name: [inside for other, inside in held if other == name] for name in names}
    together = share(sum(inside for _, inside in held), len(held))
    return {"all": together} | {name: share(sum(ones), len(ones)) for name, ones in each.items()}


def _places(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    errors = [error for row in rows for error in row.get("place_error_m", {}).values()]
    return share(sum(error <= PLACE_M for error in errors), len(errors))


def _bias(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Median size of EI's relative error with the named effect and without, and of their ratio; that also
    where the error without is more than some: where it is less, there is no bias to take away but noise.

    expected: the ratio's median if EI were off by what its intervals say, no more and no less.
    """
    both = [row["stiffness_error"] for row in rows if "stiffness_error" in row]
    known = [one for one in both if one["baseline"] and one["augmented"] is not None]
    if not known:
        return {"recordings": 0, "without": None, "with": None, "ratio": None, "where": [], "expected": None}
    without = np.abs([one["baseline"] for one in known])
    named_too = np.abs([one["augmented"] for one in known])
    where = [(more, without > more) for more in BIASED if (without > more).any()]
    return {
        "recordings": len(known),
        "without": float(np.median(without)),
        "with": float(np.median(named_too)),
        "ratio": float(np.median(named_too / without)),
        "where": [
            {
                "without_more_than": more,
                "recordings": int(some.sum()),
                "ratio": float(np.median((named_too / without)[some])),
            }
            for more, some in where
        ],
        "expected": _expected(rows),
    }


def _expected(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    told = [
        (row.get("stiffness_deviation"), row["stiffness_error"]["baseline"])
        for row in rows
        if "stiffness_error" in row
    ]
    scale = [deviation / abs(without) for deviation, without in told if deviation is not None and without]
    if not scale:
        return None
    of_one = halfnorm.ppf((np.arange(DRAWN) + 0.5) / DRAWN)
    return {"recordings": len(scale), "ratio": float(np.median(np.outer(scale, of_one)))}
