"""Four recordings of real cables that no pipeline carries (their data have no licence): reports/cables.json.

`make cables DATA=DIR`, DIR holding the recordings: each by itself, then one stiffness for all, with an
F-test of whether they agree and the residual on the poses left out.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from dlolib.files import write_json
from dlolib.formats import read_recording
from dlolib.identify import Identified, identify, summary
from dlolib.types import Recording
from stages import REPORTS, run
from stages.identify import settings

NAMES = (
    "pac_black_unweighted_settled",
    "pac_black_weighted_settled",
    "pac_black_short_unweighted_settled",
    "pac_black_short_weighted_settled",
)


def main(data: str) -> None:
    recordings = [read_recording(Path(data) / name) for name in NAMES]
    each = [identify([recording], settings()) for recording in recordings]
    joint = identify(recordings, settings())
    agreement = agree(each, joint, recordings)
    write_json(
        REPORTS / "cables.json",
        {
            "command": "make cables DATA=DIR",
            "recordings": [_figures(one, [r]) for one, r in zip(each, recordings, strict=True)],
            "joint": _figures(joint, recordings),
            "test": agreement,
            "contradiction": contradiction(each, recordings),
        },
    )
    for one, recording in zip(each, recordings, strict=True):
        print(_line(recording.name, one))
    print(_line("all together", joint))
    print(agreement["says"])


def agree(each: Sequence[Identified], joint: Identified, recordings: Sequence[Recording]) -> dict[str, Any]:
    """F-test of one stiffness and rest curvature for all against each recording's own.

    Residuals of one pose are not independent, so a pose counts once.
    """
    apart = sum(_squares(one) for one in each)
    together = _squares(joint)
    own, shared = sum(_unknowns(one) for one in each), _unknowns(joint)
    poses = sum(len(np.unique(r.points.frame)) for r in recordings)
    more, left = own - shared, poses - own
    statistic = (together - apart) / more / (apart / left)
    p = float(stats.f.sf(statistic, more, left))
    verdict = "they agree" if p >= 0.05 else "they do not agree"
    says = (
        f"Do the four agree on one stiffness and one rest curvature? F({more}, {left}) = {statistic:.1f}, "
        f"p = {p:.2g}: at the 5 % level {verdict}."
    )
    return {"name": "F-test", "statistic": float(statistic), "p_value": p, "says": says}


def contradiction(each: Sequence[Identified], recordings: Sequence[Recording]) -> str:
    """What no rod of the recorded length can do: markers further apart than the rope between them is long."""
    parts = []
    for recording in recordings:
        xyz = recording.points.xyz_m.reshape(-1, 2, 3)
        s = recording.points.s_m.reshape(-1, 2)
        excess = np.linalg.norm(xyz[:, 1] - xyz[:, 0], axis=1) - (s[:, 1] - s[:, 0])
        if excess.max() > 0:
            poses = int((excess > 0).sum())
            parts.append(f"{recording.name}: in {poses} poses by up to {1e3 * excess.max():.1f} mm")
    worst = max(zip(each, recordings, strict=True), key=lambda pair: pair[0].fit.rmse_m)
    chord = "; ".join(parts) if parts else "in none"
    return (
        "The chord from the middle marker to the tip is longer than the cable between them in "
        f"{chord}. No elastic rod of the recorded length and mass reaches such poses; the worst residual is "
        f"that of {worst[1].name}, {1e3 * worst[0].fit.rmse_m:.0f} mm."
    )


def _figures(found: Identified, recordings: Sequence[Recording]) -> dict[str, Any]:
    figures = summary(found, recordings)
    return {
        "name": figures["name"] if len(recordings) == 1 else "all together",
        "parameters": figures["parameters"],
        "rmse_m": figures["rmse_m"],
        "rmse_each_m": figures["rmse_each_m"],
        "heldout_rmse_m": figures["heldout_rmse_m"],
        "heldout_frames": figures["heldout_frames"],
    }


def _unknowns(found: Identified) -> int:
    return len(found.fit.parameters) + sum(len(own) for own in found.fit.nuisances.values())


def _squares(found: Identified) -> float:
    return found.fit.rmse_m**2 * found.fit.points


def _line(name: str, found: Identified) -> str:
    ei = found.fit.parameters["bending_stiffness"]
    interval = f"({ei.low:.3f} to {ei.high:.3f})"
    return f"{name}: EI {ei.value:.3f} {interval} N m^2, RMS {1e3 * found.fit.rmse_m:.1f} mm"


if __name__ == "__main__":
    run(main, *sys.argv[1:])
