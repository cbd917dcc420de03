"""How fast and how right the rod is, beside its peers, in one run: reports/bench.json (`make bench`).

Every figure stands with its goal and with how it was measured. What is timed runs in turn, so that a busy
machine slows all alike, and the best of several repeats counts. A peer that is not installed, or a scene that
is not as exact as it must be, leaves its figure null, with the reason in `how`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from dlolib.errors import DloError
from dlolib.files import write_json
from stages import REPORTS, exactness, known, run, speed
from stages.timing import Figure


@dataclass(frozen=True)
class Goal:
    """What a key says, its goal, and whether the goal is the least or the most."""

    goal: float
    unit: str
    at_least: bool = False


GOALS = {
    "forward_vs_mujoco": Goal(12.0, "times", at_least=True),
    "forward_vs_pyelastica": Goal(300.0, "times", at_least=True),
    "backward_over_forward": Goal(1.0, "times"),
    "batch64_over_single": Goal(0.2, "times"),
    "per_segment_growth": Goal(1.1, "times"),
    "contact_over_free": Goal(2.0, "times"),
    "elastica_error_percent": Goal(0.25, "%"),
    "stretch_percent": Goal(0.05, "%"),
    "ei_spread_percent": Goal(1.0, "%"),
    "gradient_error": Goal(1e-6, "relative"),
    "identify_vs_mujoco": Goal(50.0, "times", at_least=True),
    "learn_seconds": Goal(5.0, "s"),
    "memory_mb": Goal(50.0, "MB"),
    "cosseratbench_error_time": Goal(0.1, "times"),
}

ONE_LANE = "Newton's method goes on until it stands, where XPBD makes one solve, and in scalar code: no SIMD"
WHY = {
    "forward_vs_mujoco": ONE_LANE,
    "forward_vs_pyelastica": ONE_LANE,
    "backward_over_forward": "every step's Hessian is made and factored once more, at its converged state",
    "batch64_over_single": "cores share the ropes, and each rope is its own loop: there are no SIMD lanes",
    "contact_over_free": "Coulomb's law takes several times the iterations, of a Hessian that is not "
    "symmetric, and looks for obstacles at four points a segment",
    "identify_vs_mujoco": "an evaluation with its derivative takes some two forward passes, and a quarter of "
    "both is Python",
    "learn_seconds": "two thirds are the rope's kernels, the rest is Python between them",
}
"""Why a figure misses its goal, as far as that is known; it stands in `how` where it does."""


def main(*keys: str) -> None:
    """Measure all keys, or those named and keep the others as they are."""
    known(keys, GOALS, "figure")
    file = REPORTS / "bench.json"
    table = _kept(file) if keys else {}
    for names, measure in MEASURES:
        if keys and not set(names) & set(keys):
            continue
        print(f"measuring {', '.join(names)}", file=sys.stderr)
        try:
            figures = list(measure())
        except DloError as error:
            figures = [Figure(None, f"not measured: {error}")] * len(names)
        for key, figure in zip(names, figures, strict=True):
            table[key] = {"value": figure.value, **asdict(GOALS[key]), "how": _how(key, figure)}
        # after each, so that nothing is lost where the next is stopped
        write_json(file, {key: table[key] for key in GOALS if key in table})
    for key, row in _kept(file).items():
        value = "not measured" if row["value"] is None else f"{row['value']:.4g} {row['unit']}".rstrip()
        print(f"{key}: {value} (goal {'≥' if row['at_least'] else '≤'} {row['goal']:g}) - {row['how']}")


def _how(key: str, figure: Figure) -> str:
    """How a figure was measured, and why it misses its goal where it does."""
    goal = GOALS[key]
    missed = figure.value is not None and (
        figure.value < goal.goal if goal.at_least else figure.value > goal.goal
    )
    return f"{figure.how}. Missed: {WHY[key]}" if missed and key in WHY else figure.how


def _kept(file: Path) -> dict[str, Any]:
    return dict(json.loads(file.read_text(encoding="utf-8"))) if file.exists() else {}


MEASURES: tuple[tuple[tuple[str, ...], Callable[[], Iterator[Figure]]], ...] = (
    (("forward_vs_mujoco", "forward_vs_pyelastica"), speed.forward),
    (("backward_over_forward",), speed.backward),
    (("batch64_over_single",), speed.batch),
    (("per_segment_growth",), speed.growth),
    (("contact_over_free",), speed.contact),
    (("elastica_error_percent", "stretch_percent"), exactness.elastica),
    (("ei_spread_percent",), exactness.spread),
    (("gradient_error",), exactness.gradients),
    (("identify_vs_mujoco",), exactness.against_sysid),
    (("learn_seconds",), speed.learning),
    (("memory_mb",), speed.memory),
    (("cosseratbench_error_time",), exactness.cosserat),
)


if __name__ == "__main__":
    run(main, *sys.argv[1:])
